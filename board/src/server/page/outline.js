// Marks over a picture, in the picture's pixels: corners, coverage, a circle that can be dragged, and a patch whose corners are clicked.

const NS = "http://www.w3.org/2000/svg";

function shape(name, attributes, title) {
  const element = document.createElementNS(NS, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (title) element.setAttribute("aria-label", title);
  return element;
}

export class Outline {
  /** Called with { centre, radius } of the image circle, pixels, after the user has dragged it. */
  onCircle = () => {};
  #svg; #size = [1, 1]; #circle = null; #patch = []; #takesPatch = false;

  constructor(svg) {
    this.#svg = svg;
    svg.addEventListener("click", event => {
      if (!this.#takesPatch) return;
      this.#patch.push(this.#at(event));
      this.draw(this.#last);
    });
  }

  #last = {};

  /** Corners of the patch that the user has clicked, pixels of the picture. */
  get patch() { return this.#patch; }

  set takesPatch(on) {
    this.#takesPatch = on;
    this.draw(this.#last);
  }

  undoPatch() {
    const had = this.#patch.length > 0;
    this.#patch.pop();
    this.draw(this.#last);
    return had;
  }

  clearPatch() { this.#patch = []; this.draw(this.#last); }

  /** Draws the marks of `part` for `state`, an answer of `/v1/calibration`. */
  draw({ state = null, part = "lens" } = this.#last) {
    this.#last = { state, part };
    if (state?.size) this.#size = state.size;
    const [width, height] = this.#size;
    this.#svg.setAttribute("viewBox", `-0.5 -0.5 ${width} ${height}`);
    const focused = document.activeElement?.dataset?.handle;
    this.#svg.replaceChildren();
    if (part === "lens" && state?.guide) this.#board(state.guide);
    if (part === "circle" && state?.circle) this.#drawCircle(state.circle);
    if (this.#takesPatch && this.#patch.length) {
      const points = this.#patch.map(p => p.join(",")).join(" ");
      this.#svg.append(shape("polygon", { points, class: "patch" }));
      this.#patch.forEach(([cx, cy]) => this.#svg.append(shape("circle", { cx, cy, r: this.#unit, class: "handle" })));
    }
    if (focused) this.#svg.querySelector(`[data-handle=${focused}]`)?.focus();
  }

  /** A length in pixels of the picture that is visible at any scale. */
  get #unit() { return Math.max(...this.#size) / 90; }

  #board(guide) {
    const [width, height] = this.#size, x = (width - 1) / 2, y = (height - 1) / 2, radius = Math.min(width, height) / 2;
    guide.covered.forEach((ring, i) => ring.forEach((has, sector) => {
      if (!has) this.#svg.append(shape("path", { d: part(x, y, radius * i / guide.covered.length, radius * (i + 1) / guide.covered.length, sector, ring.length), class: "missing" }));
    }));
    for (const corners of guide.corners) for (const [cx, cy] of corners) this.#svg.append(shape("circle", { cx, cy, r: this.#unit / 4, class: "taken" }));
    for (const [cx, cy] of guide.seen) this.#svg.append(shape("circle", { cx, cy, r: this.#unit / 2, class: guide.taken ? "seen now" : "seen" }));
  }

  #drawCircle({ centre: [cx, cy], radius: r }) {
    this.#circle = { centre: [cx, cy], radius: r };
    this.#svg.append(shape("circle", { cx, cy, r, class: "rim" }));
    this.#handle("centre", [cx, cy], "Centre of the image circle: drag, or arrow keys");
    this.#handle("rim", [cx + r * Math.SQRT1_2, cy + r * Math.SQRT1_2], "Rim of the image circle: drag, or arrow keys");
  }

  #handle(name, [cx, cy], title) {
    const handle = shape("circle", { cx, cy, r: 1.6 * this.#unit, class: "handle", tabindex: 0, role: "slider", "aria-valuenow": Math.round(name === "rim" ? this.#circle.radius : cx), "data-handle": name }, title);
    handle.addEventListener("pointerdown", event => {
      event.preventDefault();
      handle.setPointerCapture(event.pointerId);
      handle.onpointermove = moved => this.#move(name, this.#at(moved), handle);
    });
    const end = () => {
      if (!handle.onpointermove) return;
      handle.onpointermove = null;
      this.onCircle(this.#circle);
    };
    handle.addEventListener("pointerup", end);
    handle.addEventListener("pointercancel", end);
    handle.addEventListener("keydown", event => this.#key(name, event, handle));
    this.#svg.append(handle);
  }

  #move(name, at, handle) {
    const circle = this.#circle;
    if (name === "centre") circle.centre = at;
    else circle.radius = Math.max(8, Math.hypot(at[0] - circle.centre[0], at[1] - circle.centre[1]));
    const rim = this.#svg.querySelector(".rim"), other = this.#svg.querySelector("[data-handle=rim]");
    const set = (element, values) => Object.entries(values).forEach(([key, value]) => element.setAttribute(key, value));
    set(rim, { cx: circle.centre[0], cy: circle.centre[1], r: circle.radius });
    set(handle, { cx: at[0], cy: at[1] });
    if (name === "centre") set(other, { cx: at[0] + circle.radius * Math.SQRT1_2, cy: at[1] + circle.radius * Math.SQRT1_2 });
  }

  #key(name, event, handle) {
    const step = event.shiftKey ? 10 : 1;
    const [dx, dy] = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }[event.key] ?? [0, 0];
    if (!dx && !dy) return;
    event.preventDefault();
    const circle = this.#circle;
    if (name === "centre") circle.centre = [circle.centre[0] + dx, circle.centre[1] + dy];
    else circle.radius = Math.max(8, circle.radius + dx - dy);
    handle.focus();
    this.onCircle(circle);
  }

  #at(event) {
    const box = this.#svg.getBoundingClientRect(), [width, height] = this.#size;
    return [(event.clientX - box.left) / box.width * width - 0.5, (event.clientY - box.top) / box.height * height - 0.5];
  }
}

/** Returns a part of a ring as an SVG path; the centre of the first sector points to the right. */
function part(x, y, inner, outer, sector, sectors) {
  const at = (radius, turn) => `${x + radius * Math.cos(turn)} ${y + radius * Math.sin(turn)}`;
  const from = 2 * Math.PI * (sector - 0.5) / sectors, to = 2 * Math.PI * (sector + 0.5) / sectors;
  return `M${at(inner, from)}L${at(outer, from)}A${outer} ${outer} 0 0 1 ${at(outer, to)}L${at(inner, to)}A${inner} ${inner} 0 0 0 ${at(inner, from)}Z`;
}
