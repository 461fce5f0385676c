// Combines the brightest lights to one disc: where the frame time allows only one shadow, the shadow of a single light among many would be invisible.

import { luminance } from "./map.js";

/** Cosines of the angles from the disc's centre up to which a light belongs to the disc as a whole, and from which it does not. */
const INNER = Math.cos(25 * Math.PI / 180), OUTER = Math.cos(45 * Math.PI / 180);

/** Ratio by which another disc must be brighter than the disc of the last picture to replace it, so that shadows do not jump. */
const BRIGHTER = 1.3;

/** Number of brightest lights around which a disc is searched. */
const STARTS = 8;

/** Number of steps in which a disc's centre moves to the mean direction of its lights. */
const STEPS = 3;

export class Gathering {
  #centre = null;

  /** Splits `lights`, the brightest first, into a disc and the remainder of each light; the sum is unchanged. */
  split(lights) {
    const found = lights.slice(0, STARTS).map(({ direction }) => around(lights, direction)).reduce((best, disc) => disc.level > best.level ? disc : best);
    const kept = this.#centre && around(lights, this.#centre);
    const { centre, parts, level, length } = kept && kept.level * BRIGHTER > found.level ? kept : found;
    this.#centre = centre;
    const sum = [0, 1, 2].map(c => lights.reduce((all, { irradiance }, i) => all + parts[i] * irradiance[c], 0));
    // The mean direction of a uniform disc of radius r has the length (1 + cos r) / 2.
    const apart = Math.acos(Math.max(-1, 2 * length - 1)) * 180 / Math.PI;
    const own = lights.reduce((all, { irradiance, radius_deg }, i) => all + parts[i] * luminance(...irradiance) * radius_deg, 0) / level;
    const rest = lights.map((light, i) => ({ ...light, irradiance: light.irradiance.map(v => v * (1 - parts[i])) }));
    return [{ direction: centre, irradiance: sum, radius_deg: Math.hypot(apart, own) }, ...rest.filter(({ irradiance }) => luminance(...irradiance) > 0)];
  }
}

/** Returns the disc near `from`: its centre, the part of each light that belongs to it, its luminance, and the length of the mean of its lights' directions. */
function around(lights, from) {
  let centre = from, parts = [], level = 0, length = 1;
  for (let step = 0; step < STEPS; step++) {
    const mean = [0, 0, 0];
    level = 0;
    parts = lights.map(({ direction: d, irradiance }) => {
      const t = Math.min(1, Math.max(0, (d[0] * centre[0] + d[1] * centre[1] + d[2] * centre[2] - OUTER) / (INNER - OUTER))), part = t * t * (3 - 2 * t);
      const weight = part * luminance(...irradiance);
      d.forEach((v, i) => { mean[i] += weight * v; });
      level += weight;
      return part;
    });
    if (!(level > 0)) return { centre: from, parts, level: 1e-30, length: 1 };
    const sum = Math.hypot(...mean);
    length = Math.min(1, sum / level);
    centre = mean.map(v => v / sum);
  }
  return { centre, parts, level, length };
}
