// Formatting of numbers, and drawing of the curves next to them.

import { penOf } from "./quality.js";

/** Formats `v` with `count` significant digits, at most 8 decimals and no exponent; a result of zero has no sign. */
export function figures(v, count = 3) {
  if (!Number.isFinite(v)) return "–";
  if (v === 0) return "0";
  const decimals = Math.min(8, Math.max(0, count - 1 - Math.floor(Math.log10(Math.abs(v)) + 1e-9)));
  return fixed(v, decimals);
}

/** Formats `v` with `decimals` decimals; a result of zero has no sign. */
export const fixed = (v, decimals) => v.toFixed(decimals).replace(/^-(0(\.0*)?)$/, "$1");

/** Formats a time in seconds as s, ms or µs. */
export function duration(seconds) {
  const [value, unit] = seconds >= 1 || seconds === 0 ? [seconds, "s"] : seconds >= 1e-3 ? [1e3 * seconds, "ms"] : [1e6 * seconds, "µs"];
  return `${Number(figures(value))} ${unit}`;
}

/** Formats a ratio in per cent, without the sign; positive values below 0.001 are shown as "<0.001". */
export const percent = v => v === 0 ? "0" : v > 0 && v < 1e-5 ? "<0.001" : figures(100 * v, 100 * v >= 9.95 ? 3 : 2);

/** Formats microseconds as milliseconds. */
export const milliseconds = us => figures(us / 1000, us >= 1000 ? 3 : 2);

/** Formats a number with three significant digits. */
export const short = v => v !== 0 && (Math.abs(v) >= 1e6 || Math.abs(v) < 1e-3) ? v.toExponential(2) : figures(v);

/** Returns a round number that is slightly greater than `v`. */
export function niceAbove(v) {
  const power = 10 ** Math.floor(Math.log10(v));
  return [1, 1.5, 2, 3, 4, 5, 6, 8, 10].find(k => k * power >= v) * power;
}

export function element(name, text, properties = {}) {
  return Object.assign(document.createElement(name), { textContent: text, ...properties });
}

/** Resizes a canvas to the pixels of the screen, clears it and returns its context; null while it is hidden. */
export function cleared(canvas) {
  const ratio = window.devicePixelRatio || 1, box = canvas.getBoundingClientRect();
  if (!box.width) return null;
  const [width, height] = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const pen = penOf(canvas);
  pen.clearRect(0, 0, width, height);
  return { pen, ratio, width, height };
}

/** Draws curves over the last `kept` frames from 0 to `top`, which is labelled with the unit `label` if that is given; `line` is drawn across if it is below `top`. */
export function curves(canvas, kept, top, all, { label = "", line = null } = {}) {
  const paper = cleared(canvas);
  if (!paper) return;
  const { pen, ratio, width, height } = paper, place = v => height - 2 - (height - 4) * Math.min(1, v / top);
  pen.strokeStyle = pen.fillStyle = getComputedStyle(canvas).color;
  pen.lineWidth = ratio;
  if (label) {
    pen.globalAlpha = 0.25;
    for (const part of [0, 0.5, 1]) { pen.beginPath(); pen.moveTo(0, place(top * part)); pen.lineTo(width, place(top * part)); pen.stroke(); }
    pen.globalAlpha = 0.9;
    pen.font = `${11 * ratio}px system-ui, sans-serif`;
    pen.textBaseline = "top";
    pen.fillText(label, 3, 4 * ratio);
  }
  if (line !== null && line <= top) {
    pen.globalAlpha = 0.8;
    pen.setLineDash([4 * ratio, 3 * ratio]);
    pen.beginPath();
    pen.moveTo(0, place(line));
    pen.lineTo(width, place(line));
    pen.stroke();
    pen.setLineDash([]);
  }
  pen.globalAlpha = 1;
  pen.lineWidth = 1.5 * ratio;
  pen.lineJoin = "round";
  for (const [colour, values] of all) {
    pen.strokeStyle = colour;
    pen.beginPath();
    values.forEach((v, i) => pen.lineTo(width * (kept - values.length + i + 1) / kept, place(v)));
    pen.stroke();
  }
}
