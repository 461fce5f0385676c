// Client for light sets of a hemilux probe in web pages and Node.js.
//
//   import { Hemilux } from "http://127.0.0.1:8080/client.js";
//   const probe = new Hemilux("http://127.0.0.1:8080", { coordinates: "three", lights: 8 });
//   probe.addEventListener("set", ({ detail: set }) => console.log(set.frame, set.lights));
//   probe.addEventListener("state", ({ detail: state }) => console.log(state)); // "live", "stale" or "lost"
//   probe.interpolated();                                                       // lights for this time, for each picture that is drawn
//
// Runs in browsers and in Node.js 20 or later. A page of another site needs the probe to be started with --allow-origin.

/** First pause before the client connects again, ms; each further pause is twice as long, up to the longest pause. */
const FIRST_PAUSE = 250, LONGEST_PAUSE = 8000;

/** Longest time without an event, ms: the probe repeats the last set at least every 1.5 s, so that a longer silence means a dead connection. */
const SILENCE = 4000;

/** Longest server-sent event that is accepted, characters. */
const LONGEST_EVENT = 16 << 20;

export class Hemilux extends EventTarget {
  /** The newest light set, in the form of `/v1/lights`; null before the first one. */
  latest = null;
  /** State of the connection to the probe: "lost", "stale" or "live". */
  state = "lost";
  /** Reason why the state is not "live", one line. */
  reason = "no set yet";
  #previous = null;
  #arrived = 0;
  #interval = 100;
  #pause = FIRST_PAUSE;
  #url;
  #abort = null;
  #timer = 0;
  #closed = false;

  /** `base` is the probe's address, by default the origin of this module; options: `coordinates`, `lights`, `ambient`
   * (true, false, or "own" for the probe's own setting), `soft` (the same values: whether lights are fitted as discs of their radius). */
  constructor(base = new URL(import.meta.url).origin, options = {}) {
    super();
    this.#url = eventsOf(base);
    for (const [name, value] of Object.entries(options)) {
      this.#url.searchParams.set(name, value === true ? "1" : value === false ? "0" : String(value));
    }
    this.#connect();
  }

  /** Ends the connection to the probe; the client does not connect again. */
  close() {
    this.#closed = true;
    this.#drop();
    this.#tell("lost", "closed");
  }

  /**
   * Returns the lights at the time `now` of performance.now(), interpolated between the last two sets by id: new lights fade in, old ones
   * fade out. The lights are delayed by one frame and never extrapolated.
   */
  interpolated(now = performance.now()) {
    if (!this.latest) return [];
    const part = Math.min(1, Math.max(0, (now - this.#arrived) / this.#interval));
    return this.#previous ? mix(this.#previous.lights, this.latest.lights, part) : this.latest.lights;
  }

  async #connect() {
    if (this.#closed) return;
    const abort = this.#abort = new AbortController();
    this.#watch();
    try {
      const answer = await fetch(this.#url, { signal: abort.signal, cache: "no-store", headers: { Accept: "text/event-stream" } });
      if (!answer.ok) throw new Error(`answered ${answer.status}: ${(await answer.text()).slice(0, 200)}`);
      await readEvents(answer.body, data => this.#abort === abort && this.#take(data));
      throw new Error("the stream ended");
    } catch (error) {
      if (this.#abort === abort) this.#again(reasonOf(error));
    }
  }

  #take(data) {
    let set;
    try { set = JSON.parse(data); } catch { return this.#again("an event that is not a light set"); }
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
    this.#tell(set.stale ? "stale" : "live", set.stale?.reason ?? "");
    this.dispatchEvent(new CustomEvent("set", { detail: set }));
  }

  /** Connects to the probe again after a pause, which is twice as long after each failure. */
  #again(reason) {
    this.#drop();
    this.#tell("lost", `${this.#url.origin}: ${reason}`);
    if (this.#closed) return;
    this.#timer = setTimeout(() => this.#connect(), this.#pause * (0.75 + Math.random() / 2));
    this.#pause = Math.min(LONGEST_PAUSE, 2 * this.#pause);
  }

  #watch() {
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => this.#again(`silent for ${SILENCE / 1000} s`), SILENCE);
  }

  #drop() {
    clearTimeout(this.#timer);
    const abort = this.#abort;
    this.#abort = null;
    abort?.abort();
  }

  #tell(state, reason) {
    const isSame = state === this.state && reason === this.reason;
    this.state = state;
    this.reason = reason;
    if (!isSame) this.dispatchEvent(new CustomEvent("state", { detail: state }));
  }
}

/** Returns the address of the event stream of a probe. */
function eventsOf(base) {
  let url;
  try { url = new URL("/v1/events", base); } catch { url = null; }
  if (!url || !/^https?:$/.test(url.protocol)) throw new TypeError(`probe '${base}': expected an address such as http://127.0.0.1:8080`);
  return url;
}

/** Calls `take` with the data of each server-sent event whose data is one line. */
async function readEvents(body, take) {
  const reader = body.getReader(), decoder = new TextDecoder();
  let rest = "";
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return;
    const lines = (rest + decoder.decode(value, { stream: true })).split("\n");
    rest = lines.pop();
    if (rest.length > LONGEST_EVENT) throw new Error("an event that is too long");
    for (const line of lines) if (line.startsWith("data:")) take(line.slice(5));
  }
}

/** Returns an error as one line; the cause of a failed fetch has more detail than the error. */
function reasonOf(error) {
  const { cause } = error;
  return String(cause?.message || cause?.code || error.message).split("\n")[0];
}

/** Returns the lights between two sets (`part` 0 to 1), interpolated by id; new lights fade in, old ones fade out. */
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
  // Opposite directions cannot be interpolated.
  const direction = length > 1e-6 ? d.map(v => v / length) : b.direction;
  const radius_deg = a.radius_deg + part * (b.radius_deg - a.radius_deg);
  return { ...b, direction, irradiance: mix(a.irradiance, b.irradiance), radius_deg };
}

function scaled(light, part) {
  return { ...light, irradiance: light.irradiance.map(v => v * part) };
}
