// Prints each light set of a probe: node lights.mjs [http://127.0.0.1:8080] [frames]
import { Hemilux } from "hemilux";

const [address = "http://127.0.0.1:8080", frames = "Infinity"] = process.argv.slice(2);
let left = Number(frames), probe;
try {
  probe = new Hemilux(address, { lights: 4 });
} catch (error) {
  console.error(`lights.mjs: ${error.message}`);
  process.exit(2);
}
probe.addEventListener("state", ({ detail: state }) => {
  if (state !== "live" && left > 0) console.error(`${state}: ${probe.reason}`);
});
probe.addEventListener("set", ({ detail: set }) => {
  console.log(`frame ${set.frame}`);
  for (const { id, direction, irradiance } of set.lights) {
    console.log(`  ${id}  towards (${direction.map(v => v.toFixed(3))})  irradiance ${irradiance.map(v => v.toPrecision(3))}`);
  }
  if (--left <= 0) probe.close();
});
