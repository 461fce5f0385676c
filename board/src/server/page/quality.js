// How much is drawn, by how long frames take: shadows are given up first, then pixels, then single lights.

/** From the dearest to the cheapest: lights with shadows, samples of each, pixels per pixel of the screen, lights shaded one by one. */
const LADDER = [
  { shadows: 32, taps: 8, scale: 1, lights: 64 }, { shadows: 16, taps: 8, scale: 1, lights: 64 }, { shadows: 8, taps: 6, scale: 1, lights: 64 },
  { shadows: 4, taps: 4, scale: 1, lights: 64 }, { shadows: 1, taps: 2, scale: 1, lights: 64 }, { shadows: 0, taps: 1, scale: 1, lights: 64 },
  { shadows: 0, taps: 1, scale: 0.7, lights: 64 }, { shadows: 0, taps: 1, scale: 0.7, lights: 24 }, { shadows: 0, taps: 1, scale: 0.5, lights: 12 },
];

/** Frame times that are too long and those that leave room, ms; without a GPU less is expected, and the processor left some air. */
const GPU = { long: 34, room: 20, first: 1, pause: 0 }, SOFTWARE = { long: 95, room: 75, first: 3, pause: 55 };

/** Frames of the mean, those to look at before a step down, and up. */
const MEAN = 4, DOWN = 5, UP = 90;

export class Quality {
  /** The dearest step whatever it takes. */
  isFixed = false;
  #limits; #step; #mean = null; #frames = 0; #last = 0; #patience = UP;

  constructor(isSoftware) {
    this.#limits = isSoftware ? SOFTWARE : GPU;
    this.#step = this.#limits.first;
  }

  get current() { return LADDER[this.isFixed ? 0 : this.#step]; }

  /** Time to leave between two pictures, ms. */
  get pause() { return this.#limits.pause; }

  /** Frames a second, 0 before there are some. */
  get rate() { return this.#mean ? 1000 / this.#mean : 0; }

  /** A frame begins; frames that do not follow each other, as after a pause, say nothing. */
  frame(now) {
    const passed = now - this.#last;
    this.#last = now;
    if (passed > 1500) return;
    this.#mean = this.#mean === null ? passed : this.#mean + (passed - this.#mean) / MEAN;
    this.#frames++;
    if (this.isFixed) return;
    if (this.#frames > DOWN && this.#mean > this.#limits.long && this.#step < LADDER.length - 1) {
      this.#move(this.#mean > 2 * this.#limits.long ? 2 : 1);
      // What was too much once is not tried again soon.
      this.#patience = Math.min(4 * this.#patience, 100 * UP);
    } else if (this.#frames > this.#patience && this.#mean < this.#limits.room && this.#step > 0) this.#move(-1);
  }

  #move(by) {
    this.#step = Math.min(LADDER.length - 1, this.#step + by);
    this.#frames = 0;
  }
}
