// Light sets as three.js lights: directional lights, and a light probe for the light without a direction.
//
//   import * as THREE from "three";
//   import { Hemilux } from "http://127.0.0.1:8080/client.js";
//   import { ProbeLights } from "http://127.0.0.1:8080/three.js";
//   const probe = new Hemilux("http://127.0.0.1:8080", { coordinates: "three", ambient: true, lights: 8 });
//   const lights = new ProbeLights(THREE, 8);
//   scene.add(lights.group);
//   renderer.setAnimationLoop(() => { lights.update(probe); renderer.render(scene, camera); });
//
// With `soft` (of the Hemilux and of ProbeLights) lights are discs. three.js has no discs: the intensity is the irradiance of a surface that faces the disc, and
// `shadow.radius`, which PCFShadowMap and VSMShadowMap use, is the penumbra of an occluder `occluder` units before the shadowed surface. Penumbras that
// widen with distance, and highlights of the disc's size, are not possible.
//
// Intensities are irradiance in the set's unit times `exposure`, which the scene determines, as does the renderer's toneMappingExposure.

export class ProbeLights {
  /** Creates `most` lights, which stay in the scene and are dark when unused: adding or removing a light makes three.js compile its shaders again. */
  constructor(THREE, most = 8, { exposure = 1, distance = 10, castShadow = false, soft = false, occluder = 1 } = {}) {
    this.exposure = exposure;
    this.distance = distance;
    this.soft = soft;
    this.occluder = occluder;
    this.group = new THREE.Group();
    this.group.name = "hemilux";
    this.directional = Array.from({ length: most }, () => {
      const light = new THREE.DirectionalLight(0xffffff, 0);
      light.castShadow = castShadow;
      this.group.add(light, light.target);
      return light;
    });
    this.ambient = new THREE.LightProbe();
    this.ambient.intensity = 0;
    this.group.add(this.ambient);
    this.#places = new Map();
  }

  /** Id of the light that each three.js light shows: a light keeps its place as long as it exists, so that its shadow does not jump. */
  #places;

  /** Updates the three.js lights to this time. The Hemilux must have been created with `coordinates: "three"`. */
  update(probe, now = performance.now()) {
    if (!probe.latest) return;
    const lights = probe.interpolated(now).slice();
    lights.sort((a, b) => brightness(b) - brightness(a));
    const shown = lights.slice(0, this.directional.length);
    const ids = new Set(shown.map(light => light.id));
    for (const id of this.#places.keys()) if (!ids.has(id)) this.#places.delete(id);
    const taken = new Set(this.#places.values());
    const free = this.directional.map((_, place) => place).filter(place => !taken.has(place));
    for (const light of this.directional) light.intensity = 0;
    for (const light of shown) {
      if (!this.#places.has(light.id)) this.#places.set(light.id, free.pop());
      this.#show(this.directional[this.#places.get(light.id)], light);
    }
    const rows = probe.latest.ambient_sh;
    this.ambient.intensity = rows ? this.exposure : 0;
    rows?.forEach((row, i) => this.ambient.sh.coefficients[i].set(...row));
  }

  #show(target, light) {
    const top = Math.max(...light.irradiance);
    // The colour is at most 1, the intensity has the remaining factor. The set is linear, like three.js's working colour space.
    target.color.setRGB(...light.irradiance.map(v => top > 0 ? v / top : 0));
    target.intensity = top * this.exposure;
    if (this.soft) this.#soften(target, Math.min(80, light.radius_deg) * Math.PI / 180);
    target.position.set(...light.direction).multiplyScalar(this.distance);
    target.userData.id = light.id;
    target.userData.radius_deg = light.radius_deg;
  }

  /** Sets intensity and shadow for a disc of `radius` radians: the irradiance of a surface that faces it, and its penumbra in texels of the shadow map. */
  #soften(target, radius) {
    const { camera, mapSize } = target.shadow, texel = (camera.right - camera.left) / mapSize.width;
    target.intensity *= (1 + Math.cos(radius)) / 2;
    target.shadow.radius = this.occluder * Math.tan(radius) / texel;
  }
}

function brightness({ irradiance: [r, g, b] }) {
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}
