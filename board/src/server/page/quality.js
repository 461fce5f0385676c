// Quality of the scene, by the duration of its frames: soft penumbras are dropped first, then shadows, then highlights of weak lights, then
// resolution.

/** Levels of quality, from the slowest to the fastest: number of lights with shadows (1: a disc for the brightest lights), samples that search the
 * occluder (0: penumbras of one width), samples of the shadow, pixels per pixel of the screen, number of lights with highlights. */
export const LADDER = [
  { shadows: 32, search: 12, taps: 16, scale: 1, glossy: 64 }, { shadows: 16, search: 12, taps: 16, scale: 1, glossy: 64 },
  { shadows: 16, search: 0, taps: 8, scale: 1, glossy: 64 }, { shadows: 8, search: 0, taps: 6, scale: 1, glossy: 64 },
  { shadows: 4, search: 0, taps: 4, scale: 1, glossy: 64 }, { shadows: 1, search: 0, taps: 6, scale: 1, glossy: 16 },
  { shadows: 1, search: 0, taps: 3, scale: 1, glossy: 6 }, { shadows: 1, search: 0, taps: 3, scale: 0.7, glossy: 6 },
  { shadows: 0, search: 0, taps: 1, scale: 0.7, glossy: 6 }, { shadows: 0, search: 0, taps: 1, scale: 0.5, glossy: 6 },
];

/** Frame times that are too long and those below which the quality may rise, ms, with a GPU and without; without one, part of the processor time is left to other work. */
const GPU = { long: 34, room: 20, first: 1, pause: 0 }, SOFTWARE = { long: 95, room: 84, first: 6, pause: 55 };

/** Number of frames in the mean, of slow frames before a step down, of fast frames before a step up, and of frames at the beginning that are ignored. */
const MEAN = 4, DOWN = 5, UP = 40, FIRST = 8;

export class Quality {
  /** True if the highest quality is kept at any frame time. */
  isFixed = false;
  #limits; #step; #mean = null; #slow = 0; #frames = -FIRST; #last = 0; #patience = UP; #hasRisen = false;

  constructor() {
    this.#limits = isSoftware() ? SOFTWARE : GPU;
    this.#step = this.#limits.first;
  }

  get current() { return LADDER[this.isFixed ? 0 : this.#step]; }

  /** Pause between two pictures of the scene, ms. */
  get pause() { return this.#limits.pause; }

  /** Frame rate of the scene, Hz; 0 before the first frames. */
  get rate() { return this.#mean ? 1000 / this.#mean : 0; }

  /** Measures the start of a frame; its duration is counted only if it `follows` another frame without a pause. */
  frame(now, follows) {
    const passed = now - this.#last, { long, room } = this.#limits;
    this.#last = now;
    if (!follows) return;
    if (++this.#frames <= 0) return;
    this.#mean = this.#mean === null ? passed : this.#mean + (passed - this.#mean) / MEAN;
    if (this.isFixed) return;
    // A single long frame causes no step; if frames are far too slow, fewer of them suffice.
    const haste = Math.min(3, Math.floor(this.#mean / long));
    this.#slow = haste > 0 ? this.#slow + haste : 0;
    if (this.#slow > DOWN && this.#step < LADDER.length - 1) {
      this.#move(haste);
      // A quality that was too slow is not tried again soon.
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

/** True if WebGL is rendered by the processor. The check takes some time, so it runs when it is needed first. */
export const isSoftware = () => known ??= softwareRenderer();

function softwareRenderer() {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) return false;
  const name = String(gl.getParameter(gl.RENDERER)) + (gl.getExtension("WEBGL_debug_renderer_info") ? gl.getParameter(37446) : "");
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

/** Returns the context for drawing in two dimensions; without a GPU in main memory, since each picture would otherwise wait for the scene's. */
export function penOf(canvas) {
  return canvas.getContext("2d", { willReadFrequently: isSoftware() });
}
