// The shader programs of the scene, GLSL ES 3.00. All directions are in the probe's axes: +Z is up.

import { PLACE } from "./irradiance.js";
import { FADED, FADES } from "./shapes.js";

/** Largest number of lights that are computed per pixel, for shadows and highlights. */
export const MOST_LIGHTS = 64;

const HEAD = `#version 300 es
precision highp float;
precision highp sampler2DArrayShadow;
precision highp sampler2DArray;
`;

/** Axes perpendicular to a light's direction [Duff et al. 2017]; the depth maps and the code that samples them use the same axes. */
const ACROSS = `
void across(vec3 n, out vec3 u, out vec3 v) {
  float s = n.z >= 0.0 ? 1.0 : -1.0, a = -1.0 / (s + n.z), b = n.x * n.y * a;
  u = vec3(1.0 + s * n.x * n.x * a, s * b, -s * n.x);
  v = vec3(b, s + n.y * n.y * a, -n.y);
}
`;

/** Linear colour to display code: the sigmoid on luminance, then sRGB, whose power is computed by roots: a power is slow without a GPU. */
const DISPLAY = `
vec3 display(vec3 c) {
  float y = max(dot(c, vec3(0.2126, 0.7152, 0.0722)), 1e-9), r = pow(y * 2.2, 1.1);
  c = clamp(c * (r / (1.0 + r) / y), 0.0, 1.0);
  vec3 a = sqrt(c), b = sqrt(a);
  return mix(12.92 * c, 0.662002687 * a + 0.684122060 * b - 0.323583601 * sqrt(b) - 0.022541147 * c, step(0.0031308, c));
}
`;

export const depth = {
  vertex: `${HEAD}${ACROSS}
layout(location = 0) in vec3 position;
uniform vec3 light, centre;
uniform float radius;
void main() {
  vec3 u, v, p = (position - centre) / radius;
  across(light, u, v);
  gl_Position = vec4(dot(p, u), dot(p, v), -dot(p, light), 1.0);
}`,
  fragment: `${HEAD}void main() {}`,
};

export const solid = {
  vertex: `${HEAD}${PLACE}
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec3 colour;
layout(location = 3) in float roughness;
uniform mat4 view;
uniform vec3 eye;
uniform vec3 harmonics[9];  // of radiance, times the exposure: what has no highlight of its own
uniform sampler2D baked;     // by normal, of all lights but those with shadows: smooth enough to be read at vertices alone
out vec3 p, n, albedo, diffuse, sheen;
out float rough;
void main() {
  p = position; n = normal; albedo = colour; rough = roughness;
  diffuse = textureLod(baked, place(normal), 0.0).rgb;
  vec3 d = reflect(normalize(position - eye), normal);
  sheen = 0.04 * max(vec3(0.0), 0.282095 * harmonics[0] + 0.488603 * (d.y * harmonics[1] + d.z * harmonics[2] + d.x * harmonics[3])
    + 1.092548 * (d.x * d.y * harmonics[4] + d.y * d.z * harmonics[5] + d.x * d.z * harmonics[7])
    + 0.315392 * (3.0 * d.z * d.z - 1.0) * harmonics[6] + 0.546274 * (d.x * d.x - d.y * d.y) * harmonics[8]);
  gl_Position = view * vec4(position, 1.0);
}`,
  fragment: `${HEAD}${ACROSS}${DISPLAY}
in vec3 p, n, albedo, diffuse, sheen;
in float rough;
uniform vec3 eye, centre;
uniform float radius;
uniform int glossy, shadows, search, taps;
uniform vec4 direction[${MOST_LIGHTS}];   // w: sine of the angular radius
uniform vec4 irradiance[${MOST_LIGHTS}];  // linear RGB, times the exposure
uniform sampler2DArrayShadow depths;
uniform sampler2DArray before;            // the same depths, as they are
out vec4 result;
const float PI = 3.14159265;

// The kth of count positions on the unit disc.
vec2 spot(int k, int count, float turn) {
  float a = turn + 2.399963 * float(k);
  return sqrt((float(k) + 0.5) / float(count)) * vec2(cos(a), sin(a));
}

// Part of the light that reaches p: the depth map, sampled over the penumbra [Fernando 2005]. Its width grows with the distance of the occluder, whose mean
// depth is searched in the light's cone; without a search, that distance is one unit. Depths are compared with the receiver's plane.
float reaches(int i, vec3 l, float wide, float turn) {
  vec3 u, v, q = (p + n * 0.02 - centre) / radius;
  across(l, u, v);
  vec2 at = 0.5 + 0.5 * vec2(dot(q, u), dot(q, v));
  if (any(lessThan(at, vec2(0.0))) || any(greaterThan(at, vec2(1.0)))) return 1.0;
  float here = 0.496 - 0.5 * dot(q, l), spread = clamp(0.3 * wide / radius, 0.0015, 0.1), sum = 0.0;
  vec2 slope = vec2(dot(n, u), dot(n, v)) / max(dot(n, l), 0.2);
  if (search > 0) {
    float cone = wide * inversesqrt(max(0.04, 1.0 - wide * wide)), found = 0.0, gap = 0.0;
    for (int k = 0; k < search; k++) {
      vec2 off = clamp(0.3 * cone, 0.003, 0.25) * spot(k, search, turn);
      float closer = here + dot(slope, off) - texture(before, vec3(at + off, float(i))).r;
      if (closer > 0.0) { gap += closer; found += 1.0; }
    }
    if (found == 0.0) return 1.0;
    spread = clamp(cone * gap / found, 0.0015, 0.25);
  }
  for (int k = 0; k < taps; k++) {
    vec2 off = spread * spot(k, taps, turn);
    sum += texture(depths, vec4(at + off, float(i), clamp(here + dot(slope, off), 0.0, 1.0)));
  }
  return sum / float(taps);
}

void main() {
  vec3 m = normalize(n), matt = diffuse, gloss = sheen;
  // Rough surfaces have no highlights, and lights without shadows are not computed for them.
  int count = rough > 0.5 ? shadows : max(shadows, glossy);
  if (count > 0) {
    vec3 view = normalize(eye - p);
    float nv = max(dot(m, view), 0.02), turn = 6.2832 * fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715))));
    for (int i = 0; i < count; i++) {
      vec3 l = direction[i].xyz;
      float nl = dot(m, l);
      if (nl <= 0.0) continue;
      vec3 e = irradiance[i].rgb;
      if (i < shadows) { e *= reaches(i, l, direction[i].w, turn); matt += e * nl; }
      if (rough > 0.5 || i >= glossy) continue;
      // GGX with Schlick's terms, wider for larger lights; only cosines are needed of the vector halfway between l and view.
      float a = min(1.0, rough * rough + 0.5 * direction[i].w), a2 = a * a, k = 0.5 * a, both = max(1.0 + dot(l, view), 1e-4), sum = nl + nv;
      float t = min(1.0, 0.5 * sum * sum / both) * (a2 - 1.0) + 1.0, g = 1.0 - sqrt(0.5 * both), f = 0.04 + 0.96 * g * g * g * g * g;
      gloss += e * (nl * f * a2 / (4.0 * PI * t * t * mix(nl, 1.0, k) * mix(nv, 1.0, k)));
    }
  }
  float fade = 1.0 - smoothstep(${FADES.toFixed(1)}, ${FADED.toFixed(1)}, length(p.xy));
  result = vec4(display(albedo / PI * matt + gloss) * fade, fade);
}`,
};

/** The solids without shadows, and without the loop for rough surfaces: without a GPU, code that is not called still takes time. */
export const shiny = { vertex: solid.vertex, fragment: solid.fragment.replace(/^.*reaches\(i, l,.*$/m, "") };
export const matt = { vertex: solid.vertex, fragment: shiny.fragment.replace(/int count = .*;/, "const int count = 0;") };

/** The tone-mapped map on an equal-area disc [Lambert 1772]: painted when the map changes, so that a picture's pixels need neither angles nor tone mapping.
 * Alpha, by which the colours are multiplied, is 0 outside of the lens's field. */
export const dome = {
  vertex: `${HEAD}
out vec2 q;
void main() {
  q = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0;
  gl_Position = vec4(q, 0.0, 1.0);
}`,
  fragment: `${HEAD}${DISPLAY}
in vec2 q;
uniform sampler2D map;
uniform float exposure;
out vec4 result;
void main() {
  vec2 at = vec2(0.5 - atan(q.y, q.x) / 6.2831853, acos(clamp(1.0 - dot(q, q), 0.0, 1.0)) / 1.5707963);
  vec3 radiance = exposure * textureLod(map, at, 0.0).rgb;
  result = smoothstep(0.0, 1e-3, radiance.g) * vec4(display(radiance), 1.0);
}`,
};

/** The background of the scene, behind the solids that were drawn before. */
export const sky = {
  vertex: `${HEAD}
uniform mat4 back;
uniform vec3 eye;
out vec3 d;
void main() {
  vec2 at = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0;
  vec4 far = back * vec4(at, 1.0, 1.0);
  d = far.xyz / far.w - eye;
  gl_Position = vec4(at, 1.0, 1.0);
}`,
  fragment: `${HEAD}
in vec3 d;
uniform sampler2D disc;
uniform float known;
out vec4 result;
void main() {
  vec3 v = normalize(d), dark = mix(vec3(0.075, 0.075, 0.085), vec3(0.13, 0.13, 0.15), smoothstep(-0.4, 0.4, v.z));
  vec4 above = textureLod(disc, 0.5 + 0.5 * v.xy * inversesqrt(1.0 + max(v.z, 0.0)), 0.0);
  // Below the horizon the map is continued by its reflection, which fades.
  above *= known * smoothstep(-0.5, 0.0, v.z);
  result = vec4(dark * (1.0 - above.a) + above.rgb, 1.0);
}`,
};

export const rays = {
  vertex: `${HEAD}
layout(location = 0) in vec3 position;
layout(location = 1) in vec4 colour;
uniform mat4 view;
out vec3 c;
void main() {
  c = colour.rgb;
  gl_Position = view * vec4(position, 1.0);
  gl_PointSize = colour.a;
}`,
  fragment: `${HEAD}
in vec3 c;
out vec4 result;
void main() { result = vec4(c, 1.0); }`,
};
