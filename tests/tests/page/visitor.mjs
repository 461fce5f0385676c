// Files and program texts that the page offers, tried unchanged, and the bytes of their transfer.
// HEMILUX_NODE may hold three and gltf-validator; HEMILUX_BPY names a Python with the package bpy, HEMILUX_USD one with usd-core. The names of missing tools are printed.

import { execFile } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { promisify } from "node:util";
import { check, json, open, picture, state, text, until } from "./browser.mjs";

const run = promisify(execFile), require = createRequire(`${process.env.HEMILUX_NODE}/`);

/** The origin of the three.js page in its text, which the probe admits. No port is opened: the test answers the requests. */
const SITE = "http://localhost:8000";

/** Returns a package of HEMILUX_NODE, or null. */
function optional(name, of) {
  try { return of(require.resolve(name)); } catch { console.log(`skipped: ${name} is not in HEMILUX_NODE`); return null; }
}

async function file(page, folder, choose) {
  const [link] = await choose(), waiting = page.waitForEvent("download");
  await page.click(link);
  const download = await waiting, path = join(folder, download.suggestedFilename());
  await download.saveAs(path);
  return path;
}

const lightsAs = (page, form) => async () => { await page.selectOption("#set-form", form); return ["#set-link"]; };
const mapAs = (page, form, covers, width) => async () => {
  await page.selectOption("#map-form", form);
  await page.selectOption("#map-covers", covers);
  await page.selectOption("#map-width", width);
  return ["#map-link"];
};

/** Runs `program` with `env`'s Python. */
async function python(env, program, ...args) {
  if (!process.env[env]) { console.log(`skipped: ${env} is not set`); return null; }
  return (await run(process.env[env], ["-c", program, ...args], { timeout: 120_000 })).stdout;
}

/** Returns the suns that a script, or a text, creates in Blender; it is run twice, since a second run must give the same suns. */
const BLENDER = `
import sys, json, bpy
from mathutils import Vector
text = open(sys.argv[1]).read()
for _ in range(2):
    exec(compile(text, "script", "exec"), {"__name__": "__main__"})
suns = [o for o in bpy.data.objects if o.type == "LIGHT" and o.data.type == "SUN" and "hemilux_id" in o]
bpy.context.view_layer.update()
print("SUNS" + json.dumps([{"towards": list(o.matrix_world.to_3x3() @ Vector((0, 0, 1))), "irradiance": [c * o.data.energy for c in o.data.color],
    "angle": o.data.angle, "id": str(o["hemilux_id"])} for o in suns]))
`;

const USD = `
import sys, json
from pxr import Usd, UsdLux
stage = Usd.Stage.Open(sys.argv[1])
print(json.dumps([UsdLux.DistantLight(p).GetAngleAttr().Get() for p in stage.Traverse() if p.IsA(UsdLux.DistantLight)]))
`;

function holdSuns(output, count, what) {
  const suns = JSON.parse(output.split("\n").find(line => line.startsWith("SUNS")).slice(4));
  check(suns.length === count, `${what}: ${suns.length} suns of ${count}`);
  for (const { towards, irradiance, angle } of suns) {
    check(Math.abs(Math.hypot(...towards) - 1) < 1e-5 && towards[2] > -0.02, `${what}: a sun from below the horizon: ${towards}`);
    check(irradiance.every(Number.isFinite) && Math.max(...irradiance) > 0 && angle >= 0 && angle <= Math.PI + 1e-6, `${what}: ${irradiance} ${angle}`);
  }
  return suns;
}

/** Returns the green irradiance of the level ground. */
const ground = lights => lights.reduce((sum, { towards, irradiance }) => sum + irradiance[1] * Math.max(0, towards[2]), 0);

/** Tries the files and the program texts unchanged. */
export async function visitor(browser, url) {
  const folder = mkdtempSync(join(tmpdir(), "hemilux-")), { context, page, faults } = await open(browser, url, { reducedMotion: "reduce", acceptDownloads: true });
  const base = new URL(url).origin;
  try {
    await state(page, "live");
    await page.waitForSelector("#map-link[href]");
    await page.fill("#set-count", "16");
    const glb = await file(page, folder, lightsAs(page, "glb")), usda = await file(page, folder, lightsAs(page, "usda"));
    const script = await file(page, folder, lightsAs(page, "blender")), csv = await file(page, folder, lightsAs(page, "csv")), set = await file(page, folder, lightsAs(page, "json"));
    check([glb, usda, script, csv, set].every((path, i) => path.endsWith([".glb", ".usda", ".py", ".csv", ".json"][i])), `${glb} ${usda} ${script} ${csv} ${set}`);
    const { lights, horizontal_irradiance } = JSON.parse(readFileSync(set)), count = lights.length;
    check(count > 3 && count <= 16, `${count} lights`);
    check(readFileSync(csv, "utf8").split("\n").filter(line => /^\d/.test(line)).length === count, "a line for each light");
    const validator = optional("gltf-validator", () => require("gltf-validator"));
    if (validator) {
      const { issues } = await validator.validateBytes(new Uint8Array(readFileSync(glb)));
      check(issues.numErrors + issues.numWarnings === 0, JSON.stringify(issues.messages));
    }
    const distant = await python("HEMILUX_USD", USD, usda);
    if (distant !== null) {
      const angles = JSON.parse(distant);
      check(angles.length > 3 && angles.length <= 16 && angles.every(angle => angle >= 0 && angle <= 180) && Math.max(...angles) > 1, `USD: angles ${angles}`);
    }
    const suns = await python("HEMILUX_BPY", BLENDER, script);
    if (suns !== null) {
      const found = ground(holdSuns(suns, readFileSync(script, "utf8").split("\n").filter(line => line.startsWith('    ("')).length, "the Blender script")), expected = horizontal_irradiance[1];
      console.log(`ground under the script's suns ${(100 * (found / expected - 1)).toFixed(2)} % off`);
      check(Math.abs(found / expected - 1) < 0.05, `the suns light the ground with ${found}, the set says ${expected}`);
    }
    const exr = await file(page, folder, mapAs(page, "exr", "hemisphere", "512")), hdr = await file(page, folder, mapAs(page, "hdr", "sphere", ""));
    const png = await file(page, folder, mapAs(page, "png", "sphere", "1024"));
    check(readFileSync(exr).readUInt32LE(0) === 20000630 && exr.endsWith("map.exr"), "an OpenEXR file");
    check(readFileSync(hdr, "latin1").includes("-Y 180 +X 360"), "a sphere of 360 texels");
    check(readFileSync(png).readUInt32BE(16) === 1024 && readFileSync(png).readUInt32BE(20) === 512, "a picture of 1024 x 512 pixels");
    const snippet = async name => {
      await page.check(`[name=snippet][value="${name}"]`, { force: true });
      const found = await text(page, "#use-text");
      check(found.includes(base), `${name} names the probe`);
      return found;
    };
    const javascript = join(folder, "lights.mjs"), follow = join(folder, "lights_of_probe.py");
    writeFileSync(javascript, await snippet("JavaScript"));
    check(/towards \[/.test((await run("node", [javascript], { timeout: 60_000 })).stdout), "the JavaScript prints lights");
    writeFileSync(follow, await snippet("Python"));
    check(/frame \d+\n\d+ towards/.test((await run("python3", [follow], { timeout: 60_000 })).stdout), "the Python prints lights");
    for (const line of (await snippet("curl")).trim().split("\n")) {
      const isEndless = line.includes("/v1/events"), { stdout } = await run("sh", ["-c", isEndless ? `${line} --max-time 2 -s || true` : `${line} -sf`], { cwd: folder, timeout: 60_000 });
      check(line.includes(" -o ") || stdout.length > 200, `${line}: ${stdout}`);
    }
    check(readFileSync(join(folder, "lights.glb"), "latin1").startsWith("glTF"), "curl has got a glTF file");
    writeFileSync(join(folder, "suns.py"), await snippet("Blender"));
    const live = await python("HEMILUX_BPY", BLENDER, join(folder, "suns.py"));
    if (live !== null) holdSuns(live, JSON.parse(await (await fetch(`${base}/v1/lights?soft=1&lights=16`)).text()).lights.length, "the Blender text");
    check((await snippet("Rust")).includes(`Options::new("${base}")`), "the Rust text");
    await threePage(browser, await snippet("three.js"));
    await page.click("#use-copy");
    await until("copied or marked", async () => /Copied|Marked/.test(await text(page, "#use-told")));
    check(faults.length === 0, faults.join("\n"));
    console.log(`${count} lights as .glb, .usda, .py, .csv and .json, three maps, six program texts`);
  } finally {
    rmSync(folder, { recursive: true });
    await context.close();
  }
}

/** Tries the three.js page unchanged, from another site; three.js comes from npm instead of the CDN. */
async function threePage(browser, html) {
  const module = optional("three", path => path.replace(/[^/]*$/, ""));
  if (!module) return;
  const context = await browser.newContext(), page = await context.newPage(), faults = [];
  // The page's origin has no real address; a page of localhost may access this machine without a permission.
  await context.grantPermissions(["local-network-access"], { origin: SITE }).catch(() => {});
  page.on("pageerror", error => faults.push(error.message));
  page.on("console", message => { if (message.type() === "error") faults.push(message.text()); });
  await page.addInitScript(() => {
    const real = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, options) { return real.call(this, kind, { ...options, preserveDrawingBuffer: true }); };
  });
  await page.route(`${SITE}/**`, route => route.fulfill({ contentType: "text/html", body: html }));
  await page.route("https://cdn.jsdelivr.net/**", route => route.fulfill({
    contentType: "text/javascript", headers: { "access-control-allow-origin": "*" }, body: readFileSync(module + route.request().url().split("/").pop(), "utf8"),
  }));
  await page.route("**/favicon.ico", route => route.fulfill({ status: 204 }));
  await page.goto(`${SITE}/`);
  await page.waitForSelector("canvas", { timeout: 60_000 }).catch(() => check(false, `the three.js page shows nothing: ${faults.join("\n")}`));
  await until("a lit ball", async () => (await picture(page, "canvas")).colours > 60);
  check(faults.length === 0, `the three.js page: ${faults.join("\n")}`);
  await context.close();
}

/** Measures the bytes on the wire for the first view, pictures included, and per second after it. */
export async function traffic(browser, url) {
  const { context, page } = await open(browser, "about:blank", { isTimed: true, reducedMotion: "no-preference" }), errors = [];
  page.on("console", message => { if (message.type() === "error") errors.push(message.text()); });
  page.on("pageerror", error => errors.push(error.message));
  const wire = await context.newCDPSession(page);
  // Repeated requests count once for the first view, and the stream of sets counts as one set, however long a busy machine takes.
  let bytes = 0;
  const paths = new Map(), seen = new Map();
  const count = (id, length, text = 0) => {
    bytes += length;
    const path = paths.get(id), known = seen.get(path) ?? { id, length: 0, text: 0 };
    if (known.id === id) Object.assign(known, { length: known.length + length, text: known.text + text });
    seen.set(path, known);
  };
  await wire.send("Network.enable");
  wire.on("Network.requestWillBeSent", ({ requestId, request }) => paths.set(requestId, new URL(request.url).pathname));
  wire.on("Network.dataReceived", ({ requestId, encodedDataLength, dataLength }) => count(requestId, encodedDataLength, dataLength));
  wire.on("Network.responseReceived", ({ requestId, response }) => count(requestId, response.encodedDataLength));
  const began = Date.now();
  await page.goto(url);
  await state(page, "live");
  await page.waitForSelector("#burst figure:nth-child(3) img");
  await until("the scene", () => page.evaluate(() => document.querySelector("#scene-canvas").dataset.quality));
  const took = Date.now() - began, view = [...seen].map(([path, sizes]) => [path, { ...sizes }]);
  const set = JSON.stringify(await json(page, "/v1/lights")).length;
  const once = ([path, { length, text }]) => path === "/v1/events" && text > set ? length * set / text : length;
  const first = view.reduce((sum, entry) => sum + once(entry), 0);
  await page.waitForTimeout(2000);
  const from = bytes, since = Date.now();
  await page.waitForTimeout(10_000);
  const rate = 1000 * (bytes - from) / (Date.now() - since);
  console.log(`first view ${(first / 1000).toFixed(0)} KB in ${took} ms, then ${(rate / 1000).toFixed(0)} KB/s`);
  check(first <= 150_000, `the first view takes ${first} bytes`);
  check(rate > 1000 && rate <= 100_000, `${rate} bytes a second`);
  check(errors.length === 0, errors.join("\n"));
  await context.close();
}

/** Without a first frame the page displays the fault, and the console has no error. */
export async function fault(browser, url) {
  const { context, page } = await open(browser, "about:blank", { reducedMotion: "reduce" }), errors = [];
  page.on("console", message => { if (message.type() === "error") errors.push(message.text()); });
  await page.goto(url);
  await state(page, "fault");
  await until("the fault is told", async () => (await text(page, "#state")).includes("No light") && (await text(page, "#state")).includes("no camera at /dev/video7"));
  await page.waitForTimeout(6000);
  check((await text(page, "#state")).includes("no camera") && !(await page.content()).includes("does not answer;"), await text(page, "#state"));
  check((await json(page, "/v1/status")).fault.includes("no camera"), "the status says the same");
  check(errors.length === 0, errors.join("\n"));
  await context.close();
}

/** Another source is selected on the page. */
export async function source(browser, url) {
  const { context, page, faults } = await open(browser, url, { reducedMotion: "reduce" });
  await state(page, "live");
  await page.waitForSelector("#source:enabled");
  await until("scenes to choose from", async () => (await page.locator("#source option").allTextContents()).includes("scene:sky"));
  await page.selectOption("#source", "scene:sky");
  await until("the sky is the source", async () => (await json(page, "/v1/status")).source === "scene:sky");
  await until("the page says so", async () => (await text(page, "#state")).includes("scene:sky") && (await text(page, "#n-rate + dd")) === "scene:sky");
  await until("its light is shown", async () => (await picture(page, "#sky-canvas")).colours > 500);
  check(await text(page, "#source-text") === "", await text(page, "#source-text"));
  check(faults.length === 0, faults.join("\n"));
  await context.close();
}
