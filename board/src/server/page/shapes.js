// The scene's solids as triangles, computed here so that no file must be loaded. +Z is up; a unit is about the width of a hand.

/** Number of floats of a vertex: position, normal, colour (linear), roughness. */
export const STRIDE = 10;

/** A ball that contains all objects on the ground, from the centre of the ground up. */
export const BALL = { centre: [0, 0, 0.75], radius: 2.35 };

/** Distances at which the ground begins to fade and is invisible. */
export const FADES = 4.5, FADED = 8.8;

class Mesh {
  #vertices = []; #indices = [];

  vertex(position, normal, { colour, roughness }) {
    this.#vertices.push(...position, ...normal, ...colour, roughness);
    return this.#vertices.length / STRIDE - 1;
  }

  triangle(a, b, c) { this.#indices.push(a, b, c); }

  quad(a, b, c, d) { this.#indices.push(a, b, c, a, c, d); }

  get count() { return this.#indices.length; }

  arrays() { return { vertices: new Float32Array(this.#vertices), indices: new Uint32Array(this.#indices) }; }
}

/** Returns vertices, indices, and the numbers of indices up to the end of the shiny solids, of all solids, and of all opaque triangles: the near ground
 * follows the solids, and the far ground is last. Triangles are anticlockwise seen from outside. */
export function scene() {
  const mesh = new Mesh();
  ball(mesh, [1.25, 0.75, 0.5], 0.5, { colour: [0.5, 0.035, 0.03], roughness: 0.12 });
  cone(mesh, [0.95, -1.15, 0], 0.42, 1.1, { colour: [0.16, 0.42, 0.2], roughness: 0.45 });
  pole(mesh, [-1.3, -0.6, 0], 0.05, 1.9, { colour: [0.75, 0.75, 0.78], roughness: 0.25 });
  const shining = mesh.count;
  rabbit(mesh, { colour: [0.72, 0.66, 0.58], roughness: 0.75 });
  block(mesh, [-0.95, 1.05, 0.45], [0.42, 0.42, 0.45], 0.5, { colour: [0.12, 0.25, 0.55], roughness: 0.55 });
  const solids = mesh.count, earth = { colour: [0.42, 0.41, 0.39], roughness: 0.9 };
  ground(mesh, 0, FADES, earth);
  const opaque = mesh.count;
  ground(mesh, FADES, FADED, earth);
  return { ...mesh.arrays(), shining, solids, opaque };
}

/** Adds the ground as rings of vertices: each vertex represents half a ring around it, so that small rings are needed near the solids. */
function ground(mesh, from, to, look, rings = 4) {
  const ring = k => Array.from({ length: 64 }, (_, i) => {
    const [r, a] = [from + k / rings * (to - from), i * Math.PI / 32];
    return mesh.vertex([r * Math.cos(a), r * Math.sin(a), 0], [0, 0, 1], look);
  });
  let inner = ring(0);
  for (let k = 1; k <= rings; k++) {
    const outer = ring(k);
    outer.forEach((v, i) => mesh.quad(inner[i], v, outer[(i + 1) % 64], inner[(i + 1) % 64]));
    inner = outer;
  }
}

/** Adds a surface of revolution: a ring of vertices for each [radius, height, normal's across, normal's up]. */
function turned(mesh, [x, y, z], profile, look, around = 40) {
  const rings = profile.map(([r, h, across, up]) => Array.from({ length: around }, (_, i) => {
    const c = Math.cos(2 * Math.PI * i / around), s = Math.sin(2 * Math.PI * i / around);
    return mesh.vertex([x + r * c, y + r * s, z + h], [across * c, across * s, up], look);
  }));
  for (let k = 0; k + 1 < rings.length; k++) {
    for (let i = 0; i < around; i++) {
      const j = (i + 1) % around;
      mesh.quad(rings[k][i], rings[k][j], rings[k + 1][j], rings[k + 1][i]);
    }
  }
}

function ball(mesh, centre, radius, look) {
  const profile = Array.from({ length: 25 }, (_, i) => {
    const a = Math.PI * (i / 24 - 0.5);
    return [radius * Math.cos(a), radius * Math.sin(a), Math.cos(a), Math.sin(a)];
  });
  turned(mesh, centre, profile, look, 48);
}

function cone(mesh, base, radius, height, look) {
  const slope = Math.hypot(radius, height), n = [height / slope, radius / slope];
  turned(mesh, base, [[radius, 0, ...n], [0, height, ...n]], look);
}

function pole(mesh, base, radius, height, look) {
  turned(mesh, base, [[radius, 0, 1, 0], [radius, height, 1, 0], [radius, height, 0, 1], [0, height, 0, 1]], look, 24);
}

function block(mesh, [x, y, z], half, turn, look) {
  const [c, s] = [Math.cos(turn), Math.sin(turn)], rotate = ([a, b, h]) => [c * a - s * b, s * a + c * b, h];
  for (let axis = 0; axis < 3; axis++) {
    for (const side of [-1, 1]) {
      const corner = (u, v) => {
        const p = [0, 0, 0], n = [0, 0, 0];
        p[axis] = side * half[axis];
        p[(axis + 1) % 3] = u * side * half[(axis + 1) % 3];
        p[(axis + 2) % 3] = v * half[(axis + 2) % 3];
        n[axis] = side;
        const [a, b, h] = rotate(p);
        return mesh.vertex([x + a, y + b, z + h], rotate(n), look);
      };
      mesh.quad(corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1));
    }
  }
}

/** Ellipsoids of the rabbit, which blend into each other: centre, radii, rotation about the y axis. */
const LIMBS = [
  [[-0.05, 0, 0.42], [0.5, 0.36, 0.4], 0.15], [[0.27, 0, 0.58], [0.26, 0.27, 0.34], 0.3], [[0.48, 0, 1.0], [0.26, 0.21, 0.22], 0.2],
  [[0.66, 0, 0.93], [0.13, 0.13, 0.11], 0], [[0.33, 0.12, 1.42], [0.075, 0.06, 0.31], -0.35], [[0.33, -0.12, 1.42], [0.075, 0.06, 0.31], -0.35],
  [[0.42, 0.17, 0.09], [0.2, 0.09, 0.09], 0], [[0.42, -0.17, 0.09], [0.2, 0.09, 0.09], 0], [[-0.15, 0.27, 0.3], [0.3, 0.15, 0.27], -0.2],
  [[-0.15, -0.27, 0.3], [0.3, 0.15, 0.27], -0.2], [[-0.02, 0.3, 0.08], [0.26, 0.1, 0.09], 0], [[-0.02, -0.3, 0.08], [0.26, 0.1, 0.09], 0],
  [[-0.55, 0, 0.36], [0.14, 0.14, 0.14], 0],
].map(([centre, radii, turn]) => ({ centre, radii, cos: Math.cos(turn), sin: Math.sin(turn) }));

/** Returns the approximate distance to the rabbit's surface, negative inside. */
function rabbitDistance(x, y, z) {
  let d = 9;
  for (const { centre, radii: [p, q, r], cos, sin } of LIMBS) {
    const a = x - centre[0], h = z - centre[2], u = (cos * a - sin * h) / p, v = (y - centre[1]) / q, w = (sin * a + cos * h) / r;
    // Math.hypot takes ten times as long.
    const k = Math.sqrt(u * u + v * v + w * w), g = Math.sqrt((u / p) ** 2 + (v / q) ** 2 + (w / r) ** 2), e = k * (k - 1) / (g + 1e-9);
    const blend = Math.max(0, 1 - Math.abs(e - d) / 0.09);
    d = Math.min(d, e) - 0.09 * blend * blend / 4;
  }
  return d;
}

/** Adds the rabbit by surface nets [Gibson 1998]: a vertex in each cell that the surface crosses, a quad around each edge that it crosses. */
function rabbit(mesh, look) {
  const cell = 0.045, low = [-0.8, -0.55, -0.1], size = [38, 25, 44], at = (i, j, k) => (k * size[1] + j) * size[0] + i;
  const value = new Float32Array(size[0] * size[1] * size[2]), vertex = new Int32Array(value.length).fill(-1);
  const each = visit => {
    for (let k = 0; k < size[2] - 1; k++) for (let j = 0; j < size[1] - 1; j++) for (let i = 0; i < size[0] - 1; i++) visit(i, j, k);
  };
  for (let k = 0; k < size[2]; k++) for (let j = 0; j < size[1]; j++) for (let i = 0; i < size[0]; i++) {
    value[at(i, j, k)] = rabbitDistance(low[0] + i * cell, low[1] + j * cell, low[2] + k * cell);
  }
  const steps = [1, size[0], size[0] * size[1]];
  each((i, j, k) => {
    const sum = [0, 0, 0];
    let count = 0;
    for (let corner = 0; corner < 8; corner++) for (let axis = 0; axis < 3; axis++) {
      if (corner >> axis & 1) continue;
      const from = [i + (corner & 1), j + (corner >> 1 & 1), k + (corner >> 2)], a = value[at(...from)], b = value[at(...from) + steps[axis]];
      if (a < 0 === b < 0) continue;
      from[axis] += a / (a - b);
      from.forEach((v, c) => { sum[c] += v; });
      count++;
    }
    if (!count) return;
    const p = sum.map((v, c) => low[c] + cell * v / count), h = 0.01;
    const n = [0, 1, 2].map(c => rabbitDistance(...p.map((v, i) => i === c ? v + h : v)) - rabbitDistance(...p.map((v, i) => i === c ? v - h : v)));
    const length = Math.hypot(...n) || 1;
    vertex[at(i, j, k)] = mesh.vertex(p, n.map(v => v / length), look);
  });
  each((i, j, k) => {
    for (let axis = 0; axis < 3; axis++) {
      const here = at(i, j, k), a = value[here], b = value[here + steps[axis]], u = steps[(axis + 1) % 3], v = steps[(axis + 2) % 3];
      if (a < 0 === b < 0) continue;
      const ring = [here, here - u, here - u - v, here - v].map(c => vertex[c]);
      if (ring.every(c => c >= 0)) mesh.quad(...(a < 0 ? ring : ring.reverse()));
    }
  });
}
