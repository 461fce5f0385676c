// A camera that orbits a point, controlled by mouse, touch and keyboard.

const HOME = { around: -1.95, up: 0.33, away: 5.4 };
const TARGET = [0, 0, 0.62];
const FIELD = 38 * Math.PI / 180;

/** Least ratio of width to height at which the solids fit into the picture. */
const WIDTH = 1.2;

export class Orbit {
  #at = { ...HOME }; #pointers = new Map(); #changed;

  constructor(canvas, changed) {
    this.#changed = changed;
    canvas.addEventListener("pointerdown", e => {
      canvas.setPointerCapture(e.pointerId);
      this.#pointers.set(e.pointerId, [e.clientX, e.clientY]);
    });
    canvas.addEventListener("pointermove", e => this.#drag(e, canvas.clientHeight || 1));
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, e => this.#pointers.delete(e.pointerId));
    canvas.addEventListener("wheel", e => {
      e.preventDefault();
      this.#turn(0, 0, Math.exp(Math.sign(e.deltaY) * Math.min(0.3, Math.abs(e.deltaY) / 500)));
    }, { passive: false });
    canvas.addEventListener("keydown", e => this.#key(e));
  }

  #drag(event, height) {
    const old = this.#pointers.get(event.pointerId);
    if (!old) return;
    const now = [event.clientX, event.clientY], others = [...this.#pointers].filter(([id]) => id !== event.pointerId);
    if (others.length) {
      const [, other] = others[0], span = p => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
      this.#turn(0, 0, span(old) / span(now));
    } else this.#turn((old[0] - now[0]) / height * 2.5, (now[1] - old[1]) / height * 2.5, 1);
    this.#pointers.set(event.pointerId, now);
  }

  #key(event) {
    const step = { ArrowLeft: [-0.1, 0, 1], ArrowRight: [0.1, 0, 1], ArrowUp: [0, 0.08, 1], ArrowDown: [0, -0.08, 1],
      "+": [0, 0, 0.9], "=": [0, 0, 0.9], "-": [0, 0, 1.1] }[event.key];
    if (event.key === "Home") this.#at = { ...HOME };
    if (!step && event.key !== "Home" || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    this.#turn(...(step ?? [0, 0, 1]));
  }

  #turn(around, up, away) {
    this.#at.around += around;
    this.#at.up = Math.min(1.5, Math.max(0.04, this.#at.up + up));
    this.#at.away = Math.min(14, Math.max(2.6, this.#at.away * away));
    this.#changed();
  }

  /** Returns the position of the eye, the matrix to clip space (column major) and its inverse. */
  camera(aspect) {
    const { around, up, away } = this.#at;
    const back = [Math.cos(up) * Math.cos(around), Math.cos(up) * Math.sin(around), Math.sin(up)];
    const eye = back.map((v, i) => TARGET[i] + away * v);
    const right = [-Math.sin(around), Math.cos(around), 0];
    const top = [back[1] * right[2] - back[2] * right[1], back[2] * right[0] - back[0] * right[2], back[0] * right[1] - back[1] * right[0]];
    // In a narrow picture, the field of view is widened so that the solids fit.
    const f = 1 / Math.tan(FIELD / 2) * Math.min(1, aspect / WIDTH), near = 0.1, far = 40, a = (far + near) / (near - far), b = 2 * far * near / (near - far);
    const dot = (u, v) => u[0] * v[0] + u[1] * v[1] + u[2] * v[2], rows = [right.map(v => v * f / aspect), top.map(v => v * f), back.map(v => v * a)];
    const move = [-dot(rows[0], eye), -dot(rows[1], eye), -dot(rows[2], eye) + b];
    const view = [0, 1, 2].flatMap(c => [rows[0][c], rows[1][c], rows[2][c], -back[c]]).concat(move, dot(back, eye));
    // In the inverse, depth is -w, and the remaining part of z is the homogeneous coordinate.
    const world = [right.map(v => v * aspect / f).concat(0), top.map(v => v / f).concat(0), eye.map(v => v / b).concat(1 / b),
      back.map((v, i) => eye[i] * a / b - v).concat(a / b)];
    return { eye, view: new Float32Array(view), back: new Float32Array(world.flat()) };
  }
}
