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
// Lights as discs: a surface facing a disc of 60 degrees receives three quarters of its energy.
const discs = new ProbeLights(THREE, 1, { soft: true, castShadow: true, occluder: 0.5 });
const disc = [{ id: 1, direction: [0, 1, 0], irradiance: [2, 2, 2], radius_deg: 60 }];
discs.update({ latest: { lights: disc }, interpolated: () => disc });
const [{ intensity, shadow }] = discs.directional;
assert(Math.abs(intensity - 1.5) < 1e-9, "the irradiance of a surface facing the disc");
const texel = (shadow.camera.right - shadow.camera.left) / shadow.mapSize.width;
assert(Math.abs(shadow.radius * texel - 0.5 * Math.sqrt(3)) < 1e-9, "the penumbra behind an occluder half a unit away");
