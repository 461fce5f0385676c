// A few solids under the current lights, in WebGL2: all lights by a map of irradiance, the strongest ones with shadows and highlights.

import { Gathering } from "./gathering.js";
import { SIDE as BAKED, bake, basis } from "./irradiance.js";
import { luminance } from "./map.js";
import { Orbit } from "./orbit.js";
import { Quality, isSoftware } from "./quality.js";
import { MOST_LIGHTS, depth, dome, matt, rays, shiny, sky, solid } from "./shaders.js";
import { BALL, STRIDE, scene } from "./shapes.js";

/** Depth maps of lights with shadows: side in texels, and number of maps. */
const SIDE = 512, LAYERS = 32;

/** Map of the sky as a disc: side in texels, of at most about one degree each, and change of exposure from which it is painted again, stops. */
const DISC = 256, FINE = 0.02;

/** Factor by which the pause between pictures is longer while nothing moves: without a GPU, other work needs the processor. */
const SELDOM = 4;

/** Largest width of the picture of the scene, pixels. */
const WIDEST = 1600;

/** Time constant of the adaptation of the exposure, ms: short enough to follow a lamp that is switched on, long enough to keep flicker visible. */
const EYE_TIME = 1500;

export class Scene {
  #canvas; #gl; #programs; #solids; #rays; #depths; #map; #dome; #sums = new Float32Array(3 * BAKED * BAKED); #known = false; #orbit; #quality;
  #supply; #told; #due = 0; #visible = true; #goesOn = false; #exposure = 0; #last = 0; #ev = 0;
  #gatherings = [new Gathering(), new Gathering()];
  #options = { sky: true, rays: false, shadows: "auto" };

  /** `supply(now)` gives { views: [{ lights, ambient }], moving }, two views side by side for a comparison; `told` is called with what is drawn and how fast. Throws where WebGL2 is missing. */
  constructor(canvas, supply, told) {
    this.#canvas = canvas;
    this.#supply = supply;
    this.#told = told;
    // Without a GPU edges are not antialiased, which would take four times as long.
    this.#gl = canvas.getContext("webgl2", { antialias: !isSoftware(), alpha: false, preserveDrawingBuffer: false });
    if (!this.#gl) throw new Error("This browser has no WebGL2: the scene cannot be drawn.");
    this.#quality = new Quality();
    this.#make();
    this.#orbit = new Orbit(canvas, () => this.draw());
    canvas.addEventListener("webglcontextlost", e => e.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => { this.#make(); this.draw(); });
    document.addEventListener("visibilitychange", () => { this.#goesOn = false; this.draw(); });
    new ResizeObserver(() => this.draw()).observe(canvas);
    new IntersectionObserver(([entry]) => { this.#visible = entry.isIntersecting; this.draw(); }).observe(canvas);
  }

  /** Sets options: `sky` and `rays` are shown or not; `shadows` are "auto" (as many as time allows), "all" or "none". */
  set(options) {
    Object.assign(this.#options, options);
    this.#quality.isFixed = this.#options.shadows === "all";
    this.draw();
  }

  /** Exposure compensation of the scene, stops. */
  set exposure(ev) { this.#ev = ev; this.draw(); }

  /** The map that is shown as background of the scene; null for none. */
  set map(map) {
    const gl = this.#gl;
    this.#known = Boolean(map);
    this.#dome.scale = 0;
    if (map) {
      gl.activeTexture(gl.TEXTURE1);
      gl.bindTexture(gl.TEXTURE_2D, this.#map);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB16F, map.width, map.height, 0, gl.RGB, gl.FLOAT, map.texels);
    }
    this.draw();
  }

  /** Requests a picture of the scene, and further ones while the lights move. */
  draw() {
    this.#due ||= requestAnimationFrame(now => {
      this.#due = 0;
      if (!this.#visible || this.#gl.isContextLost()) this.#goesOn = false;
      else if (now - this.#last < this.#quality.pause * (this.#goesOn ? 1 : SELDOM)) this.draw();
      else {
        this.#goesOn = this.#frame(now);
        if (this.#goesOn) this.draw();
      }
    });
  }

  #make() {
    const gl = this.#gl, { vertices, indices, shining, solids, opaque } = scene();
    this.#programs = Object.fromEntries(Object.entries({ depth, dome, solid, shiny, matt, sky, rays }).map(([name, p]) => [name, program(gl, p)]));
    this.#solids = { array: gl.createVertexArray(), shining, solids, opaque, all: indices.length };
    gl.bindVertexArray(this.#solids.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, vertices, gl.STATIC_DRAW);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
    [[3, 0], [3, 3], [3, 6], [1, 9]].forEach(([size, offset], i) => attribute(gl, i, size, STRIDE, offset));
    this.#rays = { array: gl.createVertexArray(), buffer: gl.createBuffer() };
    gl.bindVertexArray(this.#rays.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.#rays.buffer);
    attribute(gl, 0, 3, 7, 0);
    attribute(gl, 1, 4, 7, 3);
    gl.bindVertexArray(null);
    this.#depths = depthMaps(gl);
    this.#map = image(gl, gl.TEXTURE1, gl.REPEAT);
    image(gl, gl.TEXTURE2, gl.CLAMP_TO_EDGE);
    this.#dome = { target: disc(gl), scale: 0 };
    this.#known = false;
    gl.enable(gl.CULL_FACE);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  #frame(now) {
    const { views, moving } = this.#supply(now);
    if (moving) this.#quality.frame(now, this.#goesOn);
    const quality = this.#quality.current, gl = this.#gl;
    this.#fit(quality.scale);
    const parts = views.map(({ lights, ambient }) =>
      ({ ambient, lights: lights.filter(l => l.direction[2] > -1).sort((a, b) => luminance(...b.irradiance) - luminance(...a.irradiance)) }));
    if (!parts.length) return moving;
    // Both views have the exposure of the first one, so that the comparison does not hide differences.
    this.#adapt(now, parts[0]);
    const count = parts[0].lights.length, most = this.#options.shadows !== "none" ? Math.min(Math.ceil(quality.shadows / parts.length), count) : 0;
    const width = Math.floor(this.#canvas.width / parts.length), height = this.#canvas.height, camera = this.#orbit.camera(width / height);
    if (most === 1) parts.forEach((part, i) => { if (part.lights.length) part.lights = this.#gatherings[i].split(part.lights); });
    if (this.#known && this.#options.sky) this.#paintDome();
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    parts.forEach((part, i) => {
      const shadows = Math.min(most, part.lights.length);
      for (let k = 0; k < shadows; k++) this.#drawDepth(part.lights[k], k);
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
      gl.viewport(i * width, 0, width, height);
      gl.disable(gl.POLYGON_OFFSET_FILL);
      this.#drawSolids(camera, part, shadows, quality, () => this.#drawSky(camera));
      if (this.#options.rays) this.#drawRays(camera, part.lights);
    });
    this.#tell(`shadows of ${most} of ${count}, highlights of ${Math.min(quality.glossy, count)}`);
    this.#told({ rate: this.#quality.rate, shadows: most, moving });
    return moving;
  }

  /** Sets the text alternative for screen readers: contents and quality of the picture. */
  #tell(quality) {
    const { sky, rays } = this.#options, shown = `${sky ? "sky " : ""}${rays ? "lines " : ""}${this.#ev} EV`, { dataset } = this.#canvas;
    if (dataset.quality !== quality) dataset.quality = quality;
    if (dataset.shown !== shown) dataset.shown = shown;
  }

  #fit(scale) {
    const ratio = Math.min(2, window.devicePixelRatio || 1) * scale, { clientWidth, clientHeight } = this.#canvas;
    const shrink = Math.min(1, WIDEST / (clientWidth * ratio || 1));
    const width = Math.max(1, Math.round(clientWidth * ratio * shrink)), height = Math.max(1, Math.round(clientHeight * ratio * shrink));
    if (this.#canvas.width !== width || this.#canvas.height !== height) Object.assign(this.#canvas, { width, height });
  }

  /** Adapts the exposure, with a time constant like that of an eye, so that a white ground has a fixed grey. */
  #adapt(now, { lights, ambient }) {
    const level = lights.reduce((sum, l) => sum + luminance(...l.irradiance) * Math.max(0, l.direction[2]), 0)
      + (ambient ? Math.max(0, Math.PI * 0.282095 * luminance(...ambient[0])) : 0);
    const wanted = level > 0 ? 2.2 / level : 1, part = this.#exposure ? 1 - Math.exp(-Math.min(1000, now - this.#last) / EYE_TIME) : 1;
    this.#exposure = this.#exposure ? this.#exposure * (wanted / this.#exposure) ** part : wanted;
    this.#last = now;
  }

  get #scale() { return this.#exposure * 2 ** this.#ev; }

  #drawDepth({ direction }, layer) {
    const gl = this.#gl, { use, at } = this.#programs.depth;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.#depths.targets[layer]);
    gl.viewport(0, 0, SIDE, SIDE);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(2, 4);
    use();
    gl.uniform3fv(at.light, direction);
    gl.uniform3fv(at.centre, BALL.centre);
    gl.uniform1f(at.radius, BALL.radius);
    gl.bindVertexArray(this.#solids.array);
    gl.drawElements(gl.TRIANGLES, this.#solids.solids, gl.UNSIGNED_INT, 0);
  }

  #paintDome() {
    if (Math.abs(Math.log2(this.#scale / this.#dome.scale)) < FINE) return;
    const gl = this.#gl, { use, at } = this.#programs.dome;
    this.#dome.scale = this.#scale;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.#dome.target);
    gl.viewport(0, 0, DISC, DISC);
    use();
    gl.uniform1i(at.map, 1);
    gl.uniform1f(at.exposure, this.#scale);
    gl.bindVertexArray(null);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  #drawSky({ back, eye }) {
    const gl = this.#gl, { use, at } = this.#programs.sky;
    use();
    gl.uniformMatrix4fv(at.back, false, back);
    gl.uniform3fv(at.eye, eye);
    gl.uniform1i(at.disc, 3);
    gl.uniform1f(at.known, Number(this.#known && this.#options.sky));
    gl.bindVertexArray(null);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** Draws the solids; `behind` draws the background, after the opaque solids and before the transparent ones. */
  #drawSolids({ view, eye }, { lights, ambient }, shadows, { glossy, search, taps }, behind) {
    const gl = this.#gl, scale = this.#scale, { solid, shiny, matt } = this.#programs, { array, shining, opaque, all } = this.#solids;
    gl.activeTexture(gl.TEXTURE2);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB16F, BAKED, BAKED, 0, gl.RGB, gl.FLOAT, bake(lights.slice(shadows), ambient, scale, this.#sums));
    const directions = new Float32Array(4 * MOST_LIGHTS), energies = new Float32Array(4 * MOST_LIGHTS);
    lights.slice(0, Math.max(shadows, glossy)).forEach((light, i) => {
      directions.set([...light.direction, Math.sin(Math.min(80, light.radius_deg) * Math.PI / 180)], 4 * i);
      energies.set(light.irradiance.map(v => v * scale), 4 * i);
    });
    // Rough surfaces have no highlights: for them all lights are harmonics.
    const soft = gathered(ambient, lights, scale), rest = gathered(ambient, lights.slice(glossy), scale);
    const draw = ({ use, at }, harmonics, from, to) => {
      use();
      gl.bindVertexArray(array);
      gl.uniformMatrix4fv(at.view, false, view);
      gl.uniform3fv(at.eye, eye);
      gl.uniform3fv(at.harmonics, harmonics);
      gl.uniform1i(at.baked, 2);
      // Uniforms that a program does not use have no location and are not set.
      gl.uniform3fv(at.centre ?? null, BALL.centre);
      gl.uniform1f(at.radius ?? null, BALL.radius);
      gl.uniform1i(at.glossy ?? null, Math.min(glossy, lights.length));
      gl.uniform1i(at.shadows ?? null, shadows);
      gl.uniform1i(at.search ?? null, search);
      gl.uniform1i(at.taps ?? null, taps);
      gl.uniform4fv(at.direction ?? null, directions);
      gl.uniform4fv(at.irradiance ?? null, energies);
      gl.uniform1i(at.depths ?? null, 0);
      gl.uniform1i(at.before ?? null, 4);
      gl.drawElements(gl.TRIANGLES, to - from, gl.UNSIGNED_INT, 4 * from);
    };
    draw(shadows ? solid : shiny, rest, 0, shining);
    draw(shadows ? solid : matt, soft, shining, opaque);
    behind();
    // The ground fades into the background at a distance.
    gl.enable(gl.BLEND);
    draw(shadows ? solid : matt, soft, opaque, all);
    gl.disable(gl.BLEND);
  }

  /** Draws each light as a line from its direction; the length of the line and the size of its outer end increase with the energy. */
  #drawRays({ view }, lights) {
    const gl = this.#gl, { use, at } = this.#programs.rays, top = lights.length ? luminance(...lights[0].irradiance) || 1 : 1;
    const vertices = lights.flatMap(({ direction, irradiance }) => {
      const part = Math.sqrt(luminance(...irradiance) / top), brightest = Math.max(...irradiance, 1e-20);
      const colour = irradiance.map(v => Math.max(0.12, (v / brightest) ** (1 / 2.2)));
      return [3, 2.8 - 2.2 * part].flatMap((r, end) =>
        [...direction.map((v, i) => v * r + BALL.centre[i] * (3 - r) / 3), ...colour, end ? 1 : (3 + 13 * part) * Math.min(2, window.devicePixelRatio || 1)]);
    });
    use();
    gl.bindVertexArray(this.#rays.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.#rays.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(vertices), gl.STREAM_DRAW);
    gl.uniformMatrix4fv(at.view, false, view);
    gl.drawArrays(gl.LINES, 0, 2 * lights.length);
    gl.drawArrays(gl.POINTS, 0, 2 * lights.length);
  }
}

/** Returns harmonics of radiance, times `scale`: the given ones and those of lights without highlights, each a peak with the light's irradiance. */
function gathered(ambient, lights, scale) {
  const sums = new Float32Array(27), add = (row, k, part) => row.forEach((v, c) => { sums[3 * k + c] += part * v * scale; });
  ambient?.forEach((row, k) => add(row, k, 1));
  for (const { direction, irradiance } of lights) basis(...direction).forEach((b, k) => add(irradiance, k, b));
  return sums;
}

/** Creates a texture of linear colours, initially black. */
function image(gl, unit, wrap) {
  const texture = gl.createTexture();
  gl.activeTexture(unit);
  gl.bindTexture(gl.TEXTURE_2D, texture);
  for (const [name, value] of [[gl.TEXTURE_WRAP_S, wrap], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE], [gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR]]) {
    gl.texParameteri(gl.TEXTURE_2D, name, value);
  }
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB16F, 1, 1, 0, gl.RGB, gl.FLOAT, new Float32Array(3));
  return texture;
}

/** Creates the target to which the sky's disc is painted. */
function disc(gl) {
  const texture = image(gl, gl.TEXTURE3, gl.CLAMP_TO_EDGE), target = gl.createFramebuffer();
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, DISC, DISC, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
  gl.bindFramebuffer(gl.FRAMEBUFFER, target);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  return target;
}

function depthMaps(gl) {
  const texture = gl.createTexture();
  gl.activeTexture(gl.TEXTURE0);
  gl.bindTexture(gl.TEXTURE_2D_ARRAY, texture);
  gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.DEPTH_COMPONENT16, SIDE, SIDE, LAYERS);
  for (const [name, value] of [[gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR], [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE],
    [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE], [gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE], [gl.TEXTURE_COMPARE_FUNC, gl.LEQUAL]]) {
    gl.texParameteri(gl.TEXTURE_2D_ARRAY, name, value);
  }
  // The search for occluders reads the same texture without comparison.
  const plain = gl.createSampler();
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.samplerParameteri(plain, name, gl.NEAREST);
  for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.samplerParameteri(plain, name, gl.CLAMP_TO_EDGE);
  gl.samplerParameteri(plain, gl.TEXTURE_COMPARE_MODE, gl.NONE);
  gl.activeTexture(gl.TEXTURE4);
  gl.bindTexture(gl.TEXTURE_2D_ARRAY, texture);
  gl.bindSampler(4, plain);
  const targets = Array.from({ length: LAYERS }, (_, layer) => {
    const target = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, target);
    gl.framebufferTextureLayer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, texture, 0, layer);
    gl.drawBuffers([gl.NONE]);
    return target;
  });
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  return { texture, targets };
}

function attribute(gl, index, size, stride, offset) {
  gl.enableVertexAttribArray(index);
  gl.vertexAttribPointer(index, size, gl.FLOAT, false, 4 * stride, 4 * offset);
}

/** Returns the linked program of two shaders and the locations of its uniforms. */
function program(gl, { vertex, fragment }) {
  const made = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) throw new Error(`a shader: ${gl.getShaderInfoLog(shader)}`);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(`a program: ${gl.getProgramInfoLog(made)}`);
  const count = gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS) ?? 0;
  const names = Array.from({ length: count }, (_, i) => gl.getActiveUniform(made, i).name);
  const at = Object.fromEntries(names.map(name => [name.replace("[0]", ""), gl.getUniformLocation(made, name)]));
  return { at, use: () => gl.useProgram(made) };
}
