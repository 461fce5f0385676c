// Follows a probe with the installed package and checks the sets.
import assert from "node:assert/strict";
import { Hemilux, mix } from "hemilux";

const address = process.argv[2];
const probe = new Hemilux(address, { coordinates: "three", lights: 5, ambient: true });
const states = [], sets = [];
probe.addEventListener("state", ({ detail }) => states.push(detail));
await new Promise(done => probe.addEventListener("set", ({ detail }) => sets.push(detail) === 6 && done()));
const between = probe.interpolated();
probe.close();
assert.deepEqual(states, ["live", "lost"]);
assert.equal(sets[0].coordinates, "y-up");
assert.ok(sets.every((set, i) => i === 0 || set.frame > sets[i - 1].frame), "frames rise");
assert.ok(sets.every(set => set.lights.length <= 5 && set.ambient_sh.length === 9), "as requested");
assert.ok(between.every(light => Math.abs(Math.hypot(...light.direction) - 1) < 1e-3), "unit vectors");
const light = { id: 1, direction: [0, 0, 1], irradiance: [2, 2, 2], radius_deg: 1, age: 0, parent: null };
assert.deepEqual(mix([], [light], 0.5)[0].irradiance, [1, 1, 1], "a new light fades in");

// An address without a probe, and a probe that refuses the request: one line each, and the client tries again.
for (const [base, options, expected] of [["http://127.0.0.1:9", {}, "127.0.0.1:9"], [address, { lights: 0 }, "answered 400"]]) {
  const lost = new Hemilux(base, options);
  await new Promise(done => lost.addEventListener("state", done, { once: true }));
  assert.equal(lost.state, "lost");
  assert.ok(lost.reason.includes(expected) && !lost.reason.includes("\n"), lost.reason);
  lost.close();
}
assert.throws(() => new Hemilux("nonsense"), /expected an address/);
