// The figures that tell how well the probe does, and its latency with where the time goes.

import { luminance } from "./map.js";
import { penOf } from "./quality.js";

/** Sets that the history shows. */
const KEPT = 300;

/** Part that the newest frame has in the smoothed flicker. */
const SMOOTHING = 0.05;

const STAGES = [["front", "merge and map", "#4c9be8"], ["pyramid", "pyramid", "#7a6ff0"], ["sample", "sampler", "#e8a33d"],
  ["filter", "filter", "#d95f8c"], ["encode", "encoding", "#5bb98c"]];

const TILES = [
  ["error", "Estimated error", "shadowed, of the mean irradiance"],
  ["lights", "Lights", ""],
  ["rate", "Frames", ""],
  ["latency", "Latency", "end of burst to finished set"],
  ["illuminance", "Illuminance", "on the level ground"],
  ["flicker", "Flicker", "change a frame, 64 normals; true motion is in it"],
  ["clipped", "Clipped", "of the hemisphere"],
  ["unseen", "Unseen", "of the hemisphere"],
  ["clients", "Clients", ""],
];

/** Normals over the upper half, by a golden spiral. */
const NORMALS = Array.from({ length: 64 }, (_, i) => {
  const z = (i + 0.5) / 64, across = Math.sqrt(1 - z * z), phi = i * 2.399963;
  return [across * Math.cos(phi), across * Math.sin(phi), z];
});

const percent = v => `${(100 * v).toPrecision(100 * v >= 9.95 ? 3 : 2)}`;
const figures = v => v === 0 ? "0" : Math.abs(v) >= 1e5 || Math.abs(v) < 1e-3 ? v.toExponential(2) : v.toPrecision(3);
const milliseconds = us => us >= 1e5 ? (us / 1000).toFixed(0) : (us / 1000).toPrecision(us >= 1000 ? 3 : 2);

export class Numbers {
  #values = new Map(); #notes = new Map(); #bars = new Map(); #canvas; #budget;
  #totals = []; #receivers = null; #flicker = null; #run = null; #rate = 0;

  constructor(tiles, latency) {
    for (const [id, name, note] of TILES) {
      const box = tiles.appendChild(document.createElement("div"));
      box.append(element("dt", name));
      const value = box.appendChild(element("dd", "–")), small = box.appendChild(element("dd", note));
      value.id = `n-${id}`;
      small.className = "note";
      this.#values.set(id, value);
      this.#notes.set(id, small);
    }
    this.#budget = latency.appendChild(element("p", ""));
    this.#budget.className = "hint";
    const bar = latency.appendChild(element("div", "")), legend = latency.appendChild(element("ul", ""));
    bar.className = "stages";
    bar.setAttribute("aria-hidden", "true");
    legend.className = "legend";
    for (const [stage, name, colour] of STAGES) {
      const part = bar.appendChild(element("i", "")), row = legend.appendChild(element("li", "")), swatch = row.appendChild(element("i", ""));
      part.style.background = swatch.style.background = colour;
      this.#bars.set(stage, { part, name, text: row.appendChild(element("span", name)) });
    }
    this.#canvas = latency.appendChild(document.createElement("canvas"));
    this.#canvas.id = "history";
    this.#canvas.setAttribute("role", "img");
  }

  /** A new light set. */
  take(set) {
    if (set.run !== this.#run) {
      this.#run = set.run;
      this.#totals = [];
      this.#receivers = this.#flicker = null;
    }
    this.#follow(set.lights);
    this.#totals.push(set.latency_us.total);
    if (this.#totals.length > KEPT) this.#totals.shift();
    this.#tile("error", set.estimated_error === null ? "–" : percent(set.estimated_error), set.estimated_error === null ? "" : "%",
      set.estimated_error === null ? `${set.sampler} does not estimate it` : undefined);
    const total = luminance(...set.horizontal_irradiance);
    this.#tile("illuminance", figures(total), set.unit === "lux" ? "lx" : "rel.");
    this.#tile("flicker", this.#flicker === null ? "–" : percent(this.#flicker), this.#flicker === null ? "" : "%");
    this.#tile("clipped", percent(set.clipped), "%");
    this.#values.get("clipped").classList.toggle("warn", set.clipped > 0);
    this.#tile("unseen", percent(set.unseen), "%");
    this.#tile("latency", milliseconds(set.latency_us.total), "ms");
    this.#latency(set.latency_us);
  }

  /** `/v1/status`. */
  status({ last, streams, connections, source }) {
    this.#tile("clients", streams, "", `${streams === 1 ? "stream" : "streams"}, ${connections} connections`);
    if (!last) return;
    this.#rate = last.rate_hz;
    this.#tile("rate", last.rate_hz.toFixed(1), "/s", source);
  }

  /** Lights of the newest set; `requested` is the probe's setting. */
  count(count, requested, sampler) {
    this.#tile("lights", count, requested === undefined ? "" : `of ${requested}`, sampler);
  }

  #tile(id, value, unit, note) {
    const box = this.#values.get(id), text = `${value}${unit ? ` ${unit}` : ""}`;
    if (box.textContent !== text) box.replaceChildren(String(value), ...(unit ? [element("small", ` ${unit}`)] : []));
    if (note !== undefined && this.#notes.get(id).textContent !== note) this.#notes.get(id).textContent = note;
  }

  /** RMS over normals of what their irradiance changed by, over its mean. */
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

  #latency(us) {
    const sum = STAGES.reduce((total, [stage]) => total + us[stage], 0) || 1;
    for (const [stage, { part, name, text }] of this.#bars) {
      part.style.width = `${100 * us[stage] / sum}%`;
      text.textContent = `${name} ${milliseconds(us[stage])} ms`;
    }
    const budget = this.#rate > 0 ? 1e6 / this.#rate : null;
    this.#budget.textContent = `${milliseconds(us.total)} ms from the end of the burst` +
      (budget ? `: ${percent(us.total / budget)} % of the ${milliseconds(budget)} ms between frames.` : ".") +
      ` The burst took ${milliseconds(us.capture)} ms, waiting included.`;
    this.#draw(budget);
  }

  /** The last totals as a curve, below the line of what there is time for where that is near. */
  #draw(budget) {
    const canvas = this.#canvas, ratio = window.devicePixelRatio || 1, box = canvas.getBoundingClientRect();
    if (!box.width) return;
    if (canvas.width !== Math.round(box.width * ratio)) {
      canvas.width = Math.round(box.width * ratio);
      canvas.height = Math.round(box.height * ratio);
    }
    const pen = penOf(canvas), style = getComputedStyle(canvas), { width, height } = canvas;
    const most = Math.max(...this.#totals, 1), top = niceAbove(1.1 * most), place = v => height - 2 - (height - 4) * v / top;
    pen.clearRect(0, 0, width, height);
    pen.strokeStyle = pen.fillStyle = style.color;
    pen.globalAlpha = 0.25;
    pen.lineWidth = ratio;
    for (const part of [0.5, 1]) { pen.beginPath(); pen.moveTo(0, place(top * part)); pen.lineTo(width, place(top * part)); pen.stroke(); }
    if (budget && budget < top) { pen.globalAlpha = 0.9; pen.fillRect(0, place(budget), width, 2 * ratio); }
    pen.globalAlpha = 0.9;
    pen.font = `${11 * ratio}px system-ui, sans-serif`;
    pen.textBaseline = "top";
    pen.fillText(`${milliseconds(top)} ms`, 3, 4 * ratio);
    pen.globalAlpha = 1;
    pen.lineWidth = 1.5 * ratio;
    pen.strokeStyle = "#e8a33d";
    pen.beginPath();
    this.#totals.forEach((v, i) => pen.lineTo(width * (KEPT - this.#totals.length + i + 1) / KEPT, place(v)));
    pen.stroke();
    canvas.setAttribute("aria-label", `Latency of the last ${this.#totals.length} frames, at most ${milliseconds(most)} milliseconds`);
  }
}

/** 1, 2 or 5 times a power of ten, not below `v`. */
function niceAbove(v) {
  const power = 10 ** Math.floor(Math.log10(v));
  return [1, 2, 5, 10].find(k => k * power >= v) * power;
}

function element(name, text) {
  return Object.assign(document.createElement(name), { textContent: text });
}
