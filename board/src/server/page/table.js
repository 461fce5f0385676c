// A table of the lights, strongest first; it is updated while it is open.

import { fixed, short } from "./figures.js";
import { luminance, screenColour } from "./map.js";
import { angles } from "./sky.js";

/** Largest number of rows of the table of lights, and shortest time between two updates, ms. */
const ROWS = 100, PAUSE = 500;

export class Table {
  #rows; #text; #details; #set = null; #last = 0;

  constructor(rows, text, details) {
    [this.#rows, this.#text, this.#details] = [rows, text, details];
    details.addEventListener("toggle", () => { this.#last = 0; this.#write(); });
  }

  take(set) {
    this.#set = set;
    this.#write();
  }

  #write() {
    const now = performance.now(), set = this.#set;
    if (!this.#details.open || !set || now - this.#last < PAUSE) return;
    this.#last = now;
    const lights = [...set.lights].sort((a, b) => luminance(...b.irradiance) - luminance(...a.irradiance));
    const total = lights.reduce((sum, l) => sum + luminance(...l.irradiance), 0) || 1;
    this.#rows.replaceChildren(...lights.slice(0, ROWS).map(light => row(light, total)));
    this.#text.textContent = lights.length > ROWS ? `The strongest ${ROWS} of ${lights.length}.` : "";
  }
}

function row(light, total) {
  const line = document.createElement("tr"), { elevation, azimuth } = angles(light.direction);
  const cells = [light.id, elevation, azimuth, `${fixed(100 * luminance(...light.irradiance) / total, 1)} %`,
    ...light.irradiance.map(short), `${light.radius_deg.toFixed(1)}°`, light.age];
  for (const text of cells) line.insertCell().textContent = text;
  line.cells[0].style.borderInlineStart = `.6rem solid ${screenColour(light.irradiance)}`;
  return line;
}
