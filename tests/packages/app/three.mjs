// The lights of a probe in a three.js scene.
import * as THREE from "three";
import { Hemilux } from "hemilux";
import { ProbeLights } from "hemilux/three";

const assert = (holds, text) => {
  if (!holds) throw new Error(text);
};
const probe = new Hemilux(process.argv[2], { coordinates: "three", lights: 4, ambient: true });
const lights = new ProbeLights(THREE, 4, { exposure: 2 });
await new Promise(done => probe.addEventListener("set", done, { once: true }));
lights.update(probe, performance.now() + 1e6);
probe.close();
const lit = lights.group.children.filter(child => child.isDirectionalLight && child.intensity > 0);
assert(lit.length === probe.latest.lights.length, "a directional light for each light");
for (const shown of lit) {
  const light = probe.latest.lights.find(({ id }) => id === shown.userData.id);
  const towards = shown.position.clone().normalize().toArray();
  assert(light.direction.every((v, i) => Math.abs(v - towards[i]) < 1e-6), "its direction");
  const found = shown.color.toArray().map(v => v * shown.intensity);
  assert(light.irradiance.every((v, i) => Math.abs(found[i] - 2 * v) < 1e-4 * (1 + v)), "its irradiance times the exposure");
}
