// Code of a user of the package; the compiler must accept it, except the marked lines.
import { Hemilux, mix, type Light, type LightSet } from "hemilux";
import { ProbeLights } from "hemilux/three";
import * as THREE from "three";

const probe = new Hemilux("http://127.0.0.1:8080", { coordinates: "unity", lights: 8, ambient: "own" });
probe.addEventListener("set", ({ detail: set }) => {
  const first: Light | undefined = set.lights[0];
  const reason: string = set.stale?.reason ?? "";
  console.log(first?.direction[0].toFixed(3), reason);
});
const latest: LightSet | null = probe.latest;
const lights: Light[] = mix([], latest?.lights ?? [], 0.5);
const scene = new THREE.Scene(), shown = new ProbeLights<THREE.Group>(THREE, 8);
scene.add(shown.group);
shown.update(probe);
console.log(lights);
// @ts-expect-error: no such axes.
new Hemilux("http://127.0.0.1:8080", { coordinates: "maya" });
// @ts-expect-error: no such member.
console.log(latest?.colour);
