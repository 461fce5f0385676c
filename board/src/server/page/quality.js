// How much is drawn, by how long frames take: penumbras are given up first, then shadows, then highlights of weak lights, then pixels.

/** From the dearest to the cheapest: lights with shadows (1: a disc for the brightest of them), samples that look for what throws a shadow (0: penumbras of one width), samples of the shadow,
 * pixels per pixel of the screen, lights with highlights. */
export const LADDER = [
  { shadows: 32, search: 12, taps: 16, scale: 1, glossy: 64 }, { shadows: 16, search: 12, taps: 16, scale: 1, glossy: 64 },
  { shadows: 16, search: 0, taps: 8, scale: 1, glossy: 64 }, { shadows: 8, search: 0, taps: 6, scale: 1, glossy: 64 },
  { shadows: 4, search: 0, taps: 4, scale: 1, glossy: 64 }, { shadows: 1, search: 0, taps: 6, scale: 1, glossy: 16 },
  { shadows: 1, search: 0, taps: 3, scale: 1, glossy: 6 }, { shadows: 1, search: 0, taps: 3, scale: 0.7, glossy: 6 },
  { shadows: 0, search: 0, taps: 1, scale: 0.7, glossy: 6 }, { shadows: 0, search: 0, taps: 1, scale: 0.5, glossy: 6 },
];

/** Frame times that are too long and those that leave room, ms; without a GPU less is expected, and the processor left some air. */
const GPU = { long: 34, room: 20, first: 1, pause: 0 }, SOFTWARE = { long: 95, room: 84, first: 6, pause: 55 };

/** Frames of the mean, those that are too long before a step down, those to look at before one up, and those at the beginning that tell of the page being loaded. */
const MEAN = 4, DOWN = 5, UP = 40, FIRST = 8;

export class Quality {
  /** The dearest step whatever it takes. */
  isFixed = false;
  #limits; #step; #mean = null; #slow = 0; #frames = -FIRST; #last = 0; #patience = UP; #hasRisen = false;

  constructor() {
    this.#limits = isSoftware() ? SOFTWARE : GPU;
    this.#step = this.#limits.first;
  }

  get current() { return LADDER[this.isFixed ? 0 : this.#step]; }

  /** Time to leave between two pictures, ms. */
  get pause() { return this.#limits.pause; }

  /** Frames a second, 0 before there are some. */
  get rate() { return this.#mean ? 1000 / this.#mean : 0; }

  /** A frame begins; only one that `follows` another without a pause tells how long that took. */
  frame(now, follows) {
    const passed = now - this.#last, { long, room } = this.#limits;
    this.#last = now;
    if (!follows) return;
    if (++this.#frames <= 0) return;
    this.#mean = this.#mean === null ? passed : this.#mean + (passed - this.#mean) / MEAN;
    if (this.isFixed) return;
    // One long frame is no reason; where it is far too slow there is no time to look for long.
    const haste = Math.min(3, Math.floor(this.#mean / long));
    this.#slow = haste > 0 ? this.#slow + haste : 0;
    if (this.#slow > DOWN && this.#step < LADDER.length - 1) {
      this.#move(haste);
      // What was tried and was too much is not tried again soon.
      if (this.#hasRisen) this.#patience = Math.min(4 * this.#patience, 100 * UP);
      this.#hasRisen = false;
    } else if (this.#frames > this.#patience && this.#mean < room && this.#step > 0) {
      this.#move(-1);
      this.#hasRisen = true;
    }
  }

  #move(by) {
    this.#step = Math.min(LADDER.length - 1, this.#step + by);
    this.#frames = this.#slow = 0;
    this.#mean = null;
  }
}

let known = null;

/** Whether WebGL is done by the processor. The check takes some time, so it runs only when there is something to draw. */
export const isSoftware = () => known ??= softwareRenderer();

function softwareRenderer() {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) return false;
  const name = String(gl.getParameter(gl.RENDERER)) + (gl.getExtension("WEBGL_debug_renderer_info") ? gl.getParameter(37446) : "");
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

/** For drawing in two dimensions; without a GPU by the shortest way, or each picture would wait for the scene's. */
export function penOf(canvas) {
  return canvas.getContext("2d", { willReadFrequently: isSoftware() });
}
