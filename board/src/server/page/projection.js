// Conversion between directions and positions in the two views of the sky. Positions are fractions of the picture, (0, 0) at the top left.

const HALF = Math.PI / 2;

/** The lens view: the zenith at the centre, the horizon at the rim, radius proportional to the angle. Positions outside of the rim have no direction. */
export const lens = {
  aspect: 1,
  place([x, y, z]) {
    const across = Math.hypot(x, y), r = Math.atan2(across, z) / HALF / 2;
    return across > 0 ? [0.5 + r * x / across, 0.5 + r * y / across] : [0.5, 0.5];
  },
  angles(u, v) {
    const x = 2 * u - 1, y = 2 * v - 1, r = Math.sqrt(x * x + y * y);
    return r < 1 ? [r * HALF, Math.atan2(y, x)] : null;
  },
};

/** The map view: the zenith at the upper edge, the horizon at the lower edge, azimuth from 180 degrees at the left to -180 at the right. */
export const polar = {
  aspect: 2,
  place([x, y, z]) {
    return [(Math.PI - Math.atan2(y, x)) / (2 * Math.PI), Math.atan2(Math.hypot(x, y), z) / HALF];
  },
  angles(u, v) {
    return [v * HALF, Math.PI - 2 * Math.PI * u];
  },
};

/** Returns, for each pixel of a picture of `view`, the four surrounding texels and their interpolation weights. */
export function plan(view, width, height, map) {
  const at = new Int32Array(4 * width * height).fill(-1), part = new Float32Array(2 * width * height);
  for (let y = 0, i = 0; y < height; y++) {
    for (let x = 0; x < width; x++, i++) {
      const angles = view.angles((x + 0.5) / width, (y + 0.5) / height);
      if (!angles) continue;
      const row = angles[0] / HALF * map.height - 0.5;
      const column = (Math.PI - angles[1]) / (2 * Math.PI) * map.width - 0.5 + map.width;
      const top = Math.max(0, Math.floor(row)), bottom = Math.min(map.height - 1, Math.floor(row) + 1);
      const left = Math.floor(column) % map.width, right = (left + 1) % map.width;
      at[4 * i] = top * map.width + left;
      at[4 * i + 1] = top * map.width + right;
      at[4 * i + 2] = bottom * map.width + left;
      at[4 * i + 3] = bottom * map.width + right;
      part[2 * i] = column - Math.floor(column);
      part[2 * i + 1] = Math.min(1, Math.max(0, row - top));
    }
  }
  return { width, height, at, part };
}

/** Interpolates display codes of texels by a plan of {@link plan}; pixels outside of the view stay transparent. */
export function paint({ width, height, at, part }, codes) {
  const image = new ImageData(width, height), out = image.data;
  for (let i = 0; i < width * height; i++) {
    const a = 3 * at[4 * i], b = 3 * at[4 * i + 1], c = 3 * at[4 * i + 2], d = 3 * at[4 * i + 3];
    if (a < 0) continue;
    const u = part[2 * i], v = part[2 * i + 1];
    for (let k = 0; k < 3; k++) {
      const top = codes[a + k] + u * (codes[b + k] - codes[a + k]), bottom = codes[c + k] + u * (codes[d + k] - codes[c + k]);
      out[4 * i + k] = top + v * (bottom - top);
    }
    out[4 * i + 3] = 255;
  }
  return image;
}

/** Draws hatching on unseen pixels, and stripes in the other direction on clipped ones. */
export function hatch({ width, height, at, part }, codes, step) {
  const image = new ImageData(width, height), out = image.data;
  for (let y = 0, i = 0; y < height; y++) {
    for (let x = 0; x < width; x++, i++) {
      if (at[4 * i] < 0) continue;
      const code = codes[at[4 * i + (part[2 * i] > 0.5 ? 1 : 0) + (part[2 * i + 1] > 0.5 ? 2 : 0)]];
      if (code === 0 && (x + y) % (3 * step) < step) out.set([150, 150, 160, 150], 4 * i);
      else if (code === 255 && (x - y + height) % (2 * step) < step) out.set([255, 46, 196, 255], 4 * i);
    }
  }
  return image;
}
