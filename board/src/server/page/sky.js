// The sky: the tone-mapped map in one of two views, with marks, and with the lights as dots that can be selected.

import { fixed, short } from "./figures.js";
import { adaptation, luminance, screenColour, toneMap } from "./map.js";
import { hatch, lens, paint, plan, polar } from "./projection.js";
import { penOf } from "./quality.js";

const VIEWS = { lens, polar };

/** Largest width of the painted picture, pixels: texels are larger, so a wider one would cost time only. */
const WIDEST = 560;

/** Width from which dots have their full size, CSS pixels. */
const ROOMY = 420;

const degrees = v => v * 180 / Math.PI;

export class Sky {
  #canvas; #tip;
  #view = "lens";
  #map = null; #mask = null; #lights = [];
  #plan = null; #picture = new OffscreenCanvas(1, 1); #marks = new OffscreenCanvas(1, 1);
  #exposure = 0; #dots = true; #marked = true;
  #chosen = null; #due = 0; #visible = true;

  constructor(canvas, tip) {
    this.#canvas = canvas;
    this.#tip = tip;
    new ResizeObserver(() => this.#fit()).observe(canvas);
    new IntersectionObserver(([entry]) => { this.#visible = entry.isIntersecting; this.#tone(); }).observe(canvas);
    canvas.addEventListener("pointermove", e => this.#point(e));
    canvas.addEventListener("pointerdown", e => this.#point(e));
    canvas.addEventListener("pointerleave", () => this.#choose(null));
    canvas.addEventListener("blur", () => this.#choose(null));
    canvas.addEventListener("keydown", e => this.#step(e));
  }

  /** Name of the view of the sky, "lens" or "polar". */
  set view(name) {
    this.#view = name;
    this.#canvas.classList.toggle("polar", name === "polar");
    this.#fit();
  }

  /** Exposure compensation of the sky's picture, stops. */
  set exposure(ev) { this.#exposure = ev; this.#tone(); }
  set dots(on) { this.#dots = on; if (!on) this.#choose(null); this.#soon(); }
  set marks(on) { this.#marked = on; this.#soon(); }

  set map(map) {
    this.#map = map;
    this.#replan();
    this.#tone();
  }

  set mask(mask) {
    this.#mask = mask;
    this.#hatch();
  }

  set lights(lights) {
    this.#follow(lights);
    this.#lights = [...lights].sort((a, b) => luminance(...b.irradiance) - luminance(...a.irradiance));
    this.#soon();
  }

  /** When the selected light ends, the light that split from it, or the nearest one, is selected. */
  #follow(lights) {
    const old = this.#lights.find(l => l.id === this.#chosen);
    if (!old || lights.some(l => l.id === old.id)) return;
    const [x, y, z] = old.direction, near = l => x * l.direction[0] + y * l.direction[1] + z * l.direction[2] + (l.parent === old.id ? 2 : 0);
    this.#chosen = lights.reduce((best, l) => !best || near(l) > near(best) ? l : best, null)?.id ?? null;
  }

  #fit() {
    const ratio = window.devicePixelRatio || 1, box = this.#canvas.getBoundingClientRect();
    const [width, height] = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
    if (!width || !height) return;
    this.#canvas.width = width;
    this.#canvas.height = height;
    this.#replan();
    this.#tone();
    this.#soon();
  }

  /** The part of the canvas that the picture fills, in canvas pixels. */
  #frame() {
    const { width, height } = this.#canvas, { aspect } = VIEWS[this.#view];
    const w = Math.min(width, height * aspect), h = w / aspect;
    return { x: (width - w) / 2, y: (height - h) / 2, w, h };
  }

  #replan() {
    if (!this.#map) return;
    const { w } = this.#frame(), view = VIEWS[this.#view];
    const width = Math.max(16, Math.round(Math.min(WIDEST, w))), height = Math.round(width / view.aspect);
    const map = { width: this.#map.width, height: this.#map.height }, old = this.#plan;
    if (old?.view === view && old.width === width && old.map.width === map.width && old.map.height === map.height) return;
    this.#plan = { ...plan(view, width, height, map), view, map };
    this.#hatch();
  }

  #tone() {
    if (this.#visible && this.#map && this.#plan) {
      const codes = toneMap(this.#map, adaptation(this.#map) / 2 ** this.#exposure);
      put(this.#picture, paint(this.#plan, codes));
    }
    this.#soon();
  }

  #hatch() {
    const fits = this.#plan && this.#mask && this.#mask.width === this.#plan.map.width && this.#mask.height === this.#plan.map.height;
    if (fits) put(this.#marks, hatch(this.#plan, this.#mask.codes, 3));
    else put(this.#marks, new ImageData(1, 1));
    this.#soon();
  }

  #soon() {
    if (this.#visible) this.#due ||= requestAnimationFrame(() => { this.#due = 0; this.#draw(); });
  }

  #draw() {
    const pen = penOf(this.#canvas), { x, y, w, h } = this.#frame(), round = this.#view === "lens";
    pen.clearRect(0, 0, this.#canvas.width, this.#canvas.height);
    pen.save();
    pen.beginPath();
    if (round) pen.arc(x + w / 2, y + h / 2, w / 2, 0, 7); else pen.rect(x, y, w, h);
    pen.clip();
    pen.fillStyle = "#101014";
    pen.fillRect(x, y, w, h);
    if (this.#map) pen.drawImage(this.#picture, x, y, w, h);
    if (this.#marked) pen.drawImage(this.#marks, x, y, w, h);
    pen.restore();
    this.#grid(x, y, w, h, round);
    if (this.#dots) this.#drawDots(x, y, w, h);
    this.#say();
  }

  /** Draws lines of 30 and 60 degrees elevation, and labels at azimuth 0 and 90 degrees. */
  #grid(x, y, w, h, round) {
    const pen = penOf(this.#canvas), ratio = window.devicePixelRatio || 1;
    pen.lineWidth = ratio;
    pen.strokeStyle = pen.fillStyle = "rgb(255 255 255 / .45)";
    pen.font = `${11 * ratio}px system-ui, sans-serif`;
    pen.textBaseline = "bottom";
    for (const third of [1, 2]) {
      pen.beginPath();
      if (round) pen.arc(x + w / 2, y + h / 2, w / 2 * third / 3, 0, 7);
      else { pen.moveTo(x, y + h * third / 3); pen.lineTo(x + w, y + h * third / 3); }
      pen.stroke();
      const label = `${90 - 30 * third}° up`;
      if (round) pen.fillText(label, x + w / 2 + 3, y + h / 2 - w / 2 * third / 3); else pen.fillText(label, x + 3, y + h * third / 3);
    }
    for (const [direction, label] of [[[1, 0, 0], "0°"], [[0, 1, 0], "90°"]]) {
      const [u, v] = VIEWS[this.#view].place(direction);
      const inwards = round ? [u > 0.9 ? -20 : 4, v > 0.9 ? -4 : -3] : [3, -2];
      pen.fillText(label, x + u * w + inwards[0] * ratio, y + v * h + inwards[1] * ratio);
    }
  }

  /** Returns the radius of a light's dot, canvas pixels: its area is proportional to the light's energy; with many lights and in small pictures, dots are smaller, so that they do not
   * hide the picture. */
  #radius(light, top) {
    const ratio = window.devicePixelRatio || 1, room = Math.min(1, this.#canvas.width / ratio / ROOMY);
    const crowd = room * Math.min(1, Math.sqrt(64 / Math.max(1, this.#lights.length)));
    return ratio * (2.5 + 13 * crowd * Math.sqrt(luminance(...light.irradiance) / top));
  }

  #drawDots(x, y, w, h) {
    const pen = penOf(this.#canvas), ratio = window.devicePixelRatio || 1;
    const top = this.#lights.length ? Math.max(1e-20, luminance(...this.#lights[0].irradiance)) : 1;
    for (const light of this.#lights) {
      const [u, v] = VIEWS[this.#view].place(light.direction), r = this.#radius(light, top);
      pen.beginPath();
      pen.arc(x + u * w, y + v * h, r, 0, 7);
      pen.fillStyle = screenColour(light.irradiance);
      pen.globalAlpha = 0.85;
      pen.fill();
      pen.globalAlpha = 1;
      pen.lineWidth = 2.5 * ratio;
      pen.strokeStyle = "#000a";
      pen.stroke();
      pen.lineWidth = 1.2 * ratio;
      pen.strokeStyle = "#fff";
      pen.stroke();
      if (light.id === this.#chosen) {
        pen.beginPath();
        pen.arc(x + u * w, y + v * h, r + 4 * ratio, 0, 7);
        pen.lineWidth = 3 * ratio;
        pen.strokeStyle = "#ffb454";
        pen.stroke();
      }
    }
  }

  /** Selects the light whose dot is under the pointer. */
  #point(event) {
    if (!this.#dots) return;
    const ratio = window.devicePixelRatio || 1, { x, y, w, h } = this.#frame();
    const top = this.#lights.length ? Math.max(1e-20, luminance(...this.#lights[0].irradiance)) : 1;
    let best = null, least = Infinity;
    for (const light of this.#lights) {
      const [u, v] = VIEWS[this.#view].place(light.direction);
      const away = Math.hypot(x + u * w - event.offsetX * ratio, y + v * h - event.offsetY * ratio);
      if (away < least && away < Math.max(12 * ratio, this.#radius(light, top) + 2)) { best = light; least = away; }
    }
    this.#choose(best?.id ?? null);
  }

  /** Selects the next light in order of energy by the arrow keys. */
  #step(event) {
    const by = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    if (event.key === "Escape") return this.#choose(null);
    if (!by || !this.#lights.length || !this.#dots) return;
    event.preventDefault();
    const at = this.#lights.findIndex(l => l.id === this.#chosen), count = this.#lights.length;
    this.#choose(this.#lights[at < 0 ? (by > 0 ? 0 : count - 1) : (at + by + count) % count].id);
  }

  #choose(id) {
    if (id === this.#chosen) return;
    this.#chosen = id;
    this.#soon();
  }

  /** Shows the values of the selected light next to it, and hides them when it ends. */
  #say() {
    const light = this.#lights.find(l => l.id === this.#chosen);
    this.#tip.hidden = !light;
    if (!light) return;
    const total = this.#lights.reduce((sum, l) => sum + luminance(...l.irradiance), 0) || 1;
    const { elevation, azimuth } = angles(light.direction), [r, g, b] = light.irradiance.map(short);
    const text = `light ${light.id}\n${(100 * luminance(...light.irradiance) / total).toFixed(1)} % of the energy\n` +
      `elevation ${elevation}, azimuth ${azimuth}\nirradiance ${r} ${g} ${b}\nradius ${light.radius_deg.toFixed(1)}°, age ${light.age}`;
    if (this.#tip.textContent !== text) this.#tip.textContent = text;
    const ratio = window.devicePixelRatio || 1, { x, y, w, h } = this.#frame(), [u, v] = VIEWS[this.#view].place(light.direction);
    const box = this.#tip.getBoundingClientRect(), room = this.#canvas.getBoundingClientRect();
    const [left, top] = [(x + u * w) / ratio + 18, (y + v * h) / ratio + 12];
    this.#tip.style.left = `${Math.max(0, left + box.width > room.width ? left - box.width - 36 : left)}px`;
    this.#tip.style.top = `${Math.max(0, top + box.height > room.height ? top - box.height - 24 : top)}px`;
  }
}

function put(canvas, image) {
  canvas.width = image.width;
  canvas.height = image.height;
  penOf(canvas).putImageData(image, 0, 0);
}

/** Returns the elevation of a direction above the horizon and its azimuth from +X towards +Y, as text. */
export function angles([x, y, z]) {
  return { elevation: `${fixed(degrees(Math.asin(Math.min(1, Math.max(-1, z)))), 1)}°`, azimuth: `${fixed(degrees(Math.atan2(y, x)), 1)}°` };
}
