// Irradiance of all lights together by surface normal, computed once per picture into a small map, so that a pixel needs one look-up in place of a
// loop over the lights. Lights with shadows are computed per pixel.

/** Side of the map of irradiance, texels: for the room in 64 lights, values read from it differ by 0.3 % of the mean (RMS over normals), a sixth of the error of the lights. */
export const SIDE = 48;

/** Direction of each texel of the map of irradiance: an octahedron projected to the sphere and unfolded into a square [Cigolle et al. 2014], with the outermost texel centres on its edge. */
const NORMALS = (() => {
  const normals = new Float32Array(3 * SIDE * SIDE);
  for (let y = 0, i = 0; y < SIDE; y++) for (let x = 0; x < SIDE; x++, i += 3) {
    let [u, v] = [2 * x / (SIDE - 1) - 1, 2 * y / (SIDE - 1) - 1];
    const z = 1 - Math.abs(u) - Math.abs(v);
    if (z < 0) [u, v] = [(1 - Math.abs(v)) * Math.sign(u || 1), (1 - Math.abs(u)) * Math.sign(v || 1)];
    const length = Math.hypot(u, v, z);
    normals.set([u / length, v / length, z / length], i);
  }
  return normals;
})();

/** GLSL function that returns the position of a direction in the map. */
export const PLACE = `
vec2 place(vec3 n) {
  n /= abs(n.x) + abs(n.y) + abs(n.z);
  vec2 at = n.z >= 0.0 ? n.xy : (1.0 - abs(n.yx)) * vec2(n.x >= 0.0 ? 1.0 : -1.0, n.y >= 0.0 ? 1.0 : -1.0);
  return (0.5 + 0.5 * at) * ${((SIDE - 1) / SIDE).toFixed(6)} + ${(0.5 / SIDE).toFixed(6)};
}
`;

/** Returns the real spherical harmonics up to order 2 of a direction, in the usual order. */
export function basis(x, y, z) {
  return [0.282095, 0.488603 * y, 0.488603 * z, 0.488603 * x, 1.092548 * x * y, 1.092548 * y * z, 0.315392 * (3 * z * z - 1), 1.092548 * x * z,
    0.546274 * (x * x - y * y)];
}

/** Factors from harmonics of radiance to those of irradiance [Ramamoorthi and Hanrahan 2001]. */
const LAMBERT = [1, 2, 2, 2, 3, 3, 3, 3, 3].map(band => [0, Math.PI, 2 * Math.PI / 3, Math.PI / 4][band]);

const BASES = LAMBERT.map((a, k) => Float32Array.from({ length: SIDE * SIDE }, (_, i) => a * basis(...NORMALS.subarray(3 * i, 3 * i + 3))[k]));

/** Returns the irradiance by normal, three floats per texel, of `lights` and of harmonics of radiance (nine rows of three, or null), times `scale`. */
export function bake(lights, ambient, scale, out = new Float32Array(3 * SIDE * SIDE)) {
  out.fill(0);
  ambient?.forEach((row, k) => {
    const [r, g, b] = row.map(v => v * scale), part = BASES[k];
    for (let i = 0, o = 0; i < part.length; i++, o += 3) {
      out[o] += r * part[i];
      out[o + 1] += g * part[i];
      out[o + 2] += b * part[i];
    }
  });
  // Negative irradiance, where the harmonics ring, becomes 0.
  if (ambient) for (let o = 0; o < out.length; o++) out[o] = Math.max(0, out[o]);
  for (const { direction: [x, y, z], irradiance } of lights) {
    const [r, g, b] = irradiance.map(v => v * scale);
    for (let o = 0; o < out.length; o += 3) {
      const cosine = x * NORMALS[o] + y * NORMALS[o + 1] + z * NORMALS[o + 2];
      if (cosine <= 0) continue;
      out[o] += r * cosine;
      out[o + 1] += g * cosine;
      out[o + 2] += b * cosine;
    }
  }
  return out;
}
