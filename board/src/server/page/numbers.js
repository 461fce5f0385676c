// The tiles with the probe's rates, errors and counts.

import { duration, element, fixed, percent, short } from "./figures.js";
import { luminance } from "./map.js";

/** Weight of the newest frame in the smoothed flicker. */
const SMOOTHING = 0.05;

/** Explanation of the estimated error in its tile. */
const ESTIMATED = "of shadows, against the mean";

const TILES = [
  ["error", "Estimated error", ESTIMATED],
  ["lights", "Lights", ""],
  ["rate", "Frames", ""],
  ["latency", "Latency", "from burst to set"],
  ["illuminance", "Illuminance", "on the level ground"],
  ["flicker", "Flicker", "change a frame, motion included"],
  ["mains", "Mains", "no flicker of lamps"],
  ["clipped", "Clipped", "of the hemisphere"],
  ["unseen", "Unseen", "of the hemisphere"],
  ["quality", "Quality", "full, as in the settings"],
  ["clients", "Clients", ""],
];

/** Normals of the receivers by which flicker is computed: over the upper hemisphere, on a golden spiral. */
const NORMALS = Array.from({ length: 64 }, (_, i) => {
  const z = (i + 0.5) / 64, across = Math.sqrt(1 - z * z), phi = i * 2.399963;
  return [across * Math.cos(phi), across * Math.sin(phi), z];
});

export class Numbers {
  #values = new Map(); #notes = new Map(); #receivers = null; #flicker = null; #run = null;

  constructor(tiles) {
    for (const [id, name, note] of TILES) {
      const box = tiles.appendChild(document.createElement("div"));
      box.append(element("dt", name));
      const value = box.appendChild(element("dd", "–")), small = box.appendChild(element("dd", note));
      value.id = `n-${id}`;
      small.className = "note";
      this.#values.set(id, value);
      this.#notes.set(id, small);
    }
  }

  /** Updates the tiles with a new light set. */
  take(set) {
    if (set.run !== this.#run) {
      this.#run = set.run;
      this.#receivers = this.#flicker = null;
    }
    this.#follow(set.lights);
    const isEstimated = set.estimated_error !== null;
    this.#tile("error", isEstimated ? percent(set.estimated_error) : "–", isEstimated ? "%" : "", isEstimated ? ESTIMATED : `${set.sampler} does not estimate it`);
    const total = luminance(...set.horizontal_irradiance);
    this.#tile("illuminance", short(total), set.unit === "lux" ? "lx" : "rel.");
    this.#tile("flicker", this.#flicker === null ? "–" : percent(this.#flicker), this.#flicker === null ? "" : "%");
    this.#mains(set.mains);
    this.#tile("clipped", percent(set.clipped), "%");
    this.#values.get("clipped").classList.toggle("warn", set.clipped > 0);
    this.#tile("unseen", percent(set.unseen), "%");
    this.#tile("latency", ...duration(set.latency_us.total / 1e6).split(" "));
  }

  /** Shows the steps by which the probe lowers the quality to keep its budget. */
  #quality(steps, { down, up } = { down: 0, up: 0 }) {
    const kinds = [...new Set(steps)].map(kind => `${kind}${steps.length > 1 ? ` x ${steps.filter(step => step === kind).length}` : ""}`);
    this.#tile("quality", steps.length ? `−${steps.length}` : "full", steps.length === 1 ? "step" : steps.length ? "steps" : "",
      steps.length ? kinds.join(", ") : down ? `lowered ${down} times, raised ${up}` : "full, as in the settings");
    this.#values.get("quality").classList.toggle("warn", steps.length > 0);
  }

  /** Shows the flicker of lamps that was removed from the newest set, if there was any. */
  #mains(found) {
    const hz = found?.frequency_hz;
    const note = found ? `${percent(found.depth)} % deep, in ${percent(found.share)} % of the light` : "no flicker of lamps";
    this.#tile("mains", hz ? fixed(hz, 1) : "–", hz ? "Hz" : "", note);
  }

  /** Updates the tiles with an answer of `/v1/status`. */
  status({ degraded, last, streams, connections, source }) {
    this.#tile("clients", streams, "", `${streams === 1 ? "stream" : "streams"}, ${connections} ${connections === 1 ? "connection" : "connections"}`);
    if (degraded) this.#quality(degraded.steps, degraded);
    if (!last) return;
    this.#tile("rate", fixed(last.rate_hz, 1), "/s", source);
  }

  /** Shows the number of lights of the newest set; `requested` is the probe's setting. */
  count(count, requested, sampler) {
    this.#tile("lights", count, requested === undefined ? "" : `of ${requested}`, sampler);
  }

  #tile(id, value, unit, note) {
    const box = this.#values.get(id), text = `${value}${unit ? ` ${unit}` : ""}`;
    if (box.textContent !== text) box.replaceChildren(String(value), ...(unit ? [element("small", ` ${unit}`)] : []));
    const small = this.#notes.get(id);
    // A long name is truncated; its tooltip has the whole name.
    if (note !== undefined && small.textContent !== note) small.textContent = small.title = note;
  }

  /** Computes the flicker of the newest set: RMS change of irradiance over the normals, divided by the mean irradiance. */
  #follow(lights) {
    const now = NORMALS.map(n => lights.reduce((sum, { direction: d, irradiance }) =>
      sum + luminance(...irradiance) * Math.max(0, n[0] * d[0] + n[1] * d[1] + n[2] * d[2]), 0));
    const mean = now.reduce((a, b) => a + b, 0) / now.length;
    if (this.#receivers && mean > 0) {
      const square = now.reduce((sum, e, k) => sum + (e - this.#receivers[k]) ** 2, 0) / now.length;
      const change = Math.sqrt(square) / mean;
      this.#flicker = this.#flicker === null ? change : this.#flicker + SMOOTHING * (change - this.#flicker);
    }
    this.#receivers = now;
  }
}
