// Light sets of a hemilux probe in a page.
//
//   import { Hemilux } from "http://127.0.0.1:8080/client.js";
//   const probe = new Hemilux("http://127.0.0.1:8080", { coordinates: "three", lights: 8 });
//   probe.addEventListener("set", ({ detail: set }) => console.log(set.frame, set.lights));
//   probe.addEventListener("state", ({ detail: state }) => console.log(state)); // "live", "stale" or "lost"
//   probe.interpolated();                                                       // lights for this moment, as often as you draw
//
// A page of another site needs the probe to be started with --allow-origin.

/** First pause before connecting again, ms; each further one is twice as long, up to the longest. */
const FIRST_PAUSE = 250, LONGEST_PAUSE = 8000;

/** The probe repeats the last set at least every 1.5 s: silence for longer means that the connection is dead. */
const SILENCE = 4000;

export class Hemilux extends EventTarget {
  /** The newest set as `/v1/lights` gives it, or null. */
  latest = null;
  /** "lost", "stale" or "live". */
  state = "lost";
  #previous = null;
  #arrived = 0;
  #interval = 100;
  #pause = FIRST_PAUSE;
  #url;
  #source = null;
  #timer = 0;
  #closed = false;

  /** `base` is the probe's address, by default where this module came from; options: `coordinates`, `lights`, `ambient`
   * (true, false, or "own" for what the probe itself is set to). */
  constructor(base = new URL(import.meta.url).origin, options = {}) {
    super();
    this.#url = new URL("/v1/events", base);
    for (const [name, value] of Object.entries(options)) {
      this.#url.searchParams.set(name, value === true ? "1" : value === false ? "0" : String(value));
    }
    this.#connect();
  }

  /** Ends the connection for good. */
  close() {
    this.#closed = true;
    this.#drop();
    this.#tell("lost");
  }

  /**
   * The lights at `now` (as of performance.now()): between the last two sets, each light moves from where it was to where it is, by its id;
   * a new one fades in, one that is gone fades out. One frame's time behind the newest set, and never beyond it.
   */
  interpolated(now = performance.now()) {
    if (!this.latest) return [];
    const part = Math.min(1, Math.max(0, (now - this.#arrived) / this.#interval));
    return this.#previous ? mix(this.#previous.lights, this.latest.lights, part) : this.latest.lights;
  }

  #connect() {
    if (this.#closed) return;
    this.#source = new EventSource(this.#url);
    this.#source.onmessage = event => this.#take(event.data);
    this.#source.onerror = () => this.#again();
    this.#watch();
  }

  #take(data) {
    let set;
    try { set = JSON.parse(data); } catch { return this.#again(); }
    const now = performance.now();
    this.#pause = FIRST_PAUSE;
    this.#watch();
    const isNew = !this.latest || set.run !== this.latest.run || set.frame !== this.latest.frame;
    if (isNew) {
      const follows = this.latest && set.run === this.latest.run;
      if (follows) this.#interval = Math.min(1000, Math.max(5, now - this.#arrived));
      this.#previous = follows ? this.latest : null;
      this.#arrived = now;
    }
    this.latest = set;
    this.#tell(set.stale ? "stale" : "live");
    this.dispatchEvent(new CustomEvent("set", { detail: set }));
  }

  /** The browser would connect again at a fixed pace; this backs off, and notices a connection that says nothing. */
  #again() {
    this.#drop();
    this.#tell("lost");
    if (this.#closed) return;
    this.#timer = setTimeout(() => this.#connect(), this.#pause * (0.75 + Math.random() / 2));
    this.#pause = Math.min(LONGEST_PAUSE, 2 * this.#pause);
  }

  #watch() {
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => this.#again(), SILENCE);
  }

  #drop() {
    clearTimeout(this.#timer);
    this.#source?.close();
    this.#source = null;
  }

  #tell(state) {
    if (state === this.state) return;
    this.state = state;
    this.dispatchEvent(new CustomEvent("state", { detail: state }));
  }
}

/** The lights between two sets' (`part` 0 to 1), each on its way by its id; what is new fades in, what is gone fades out. */
export function mix(old, latest, part) {
  if (part >= 1) return latest;
  const before = new Map(old.map(light => [light.id, light]));
  const lights = latest.map(light => {
    const was = before.get(light.id);
    before.delete(light.id);
    return was ? between(was, light, part) : scaled(light, part);
  });
  for (const gone of before.values()) lights.push(scaled(gone, 1 - part));
  return lights;
}

function between(a, b, part) {
  const mix = (x, y) => x.map((v, i) => v + part * (y[i] - v));
  const d = mix(a.direction, b.direction), length = Math.hypot(...d);
  // Opposite directions have no way between them.
  const direction = length > 1e-6 ? d.map(v => v / length) : b.direction;
  const radius_deg = a.radius_deg + part * (b.radius_deg - a.radius_deg);
  return { ...b, direction, irradiance: mix(a.irradiance, b.irradiance), radius_deg };
}

function scaled(light, part) {
  return { ...light, irradiance: light.irradiance.map(v => v * part) };
}
