// Starts a real browser for the tests of the page, with helpers that the scenarios share.
// HEMILUX_NODE is a folder with node_modules/{playwright-core,axe-core}; HEMILUX_BROWSER is the browser's program, chromium by default.

import { existsSync, readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { createInterface } from "node:readline";

const require = createRequire(`${process.env.HEMILUX_NODE}/`);
const { chromium } = require("playwright-core");

/** Longest wait for a condition, ms: a busy machine without a GPU is slow. */
export const PATIENCE = 120_000;

/** WebGL by the processor, and two host names other than localhost, since browsers trust localhost more than other names. */
const FLAGS = ["--host-resolver-rules=MAP probe.lan 127.0.0.1, MAP evil.test 127.0.0.1", "--no-sandbox", "--disable-dev-shm-usage", "--disable-gpu", "--enable-unsafe-swiftshader"];

export async function launch() {
  const program = process.env.HEMILUX_BROWSER ?? "chromium", folders = process.env.PATH.split(":");
  const executablePath = program.includes("/") ? program : folders.map(folder => `${folder}/${program}`).find(existsSync);
  return chromium.launch({ executablePath, args: FLAGS, timeout: PATIENCE });
}

/** WebGL discards a drawing after its display unless it is preserved; preserving it permits a screenshot at any time. */
function keepDrawings() {
  const real = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, options) { return real.call(this, kind, { ...options, preserveDrawingBuffer: true }); };
}

/** Opens a page of `url`; returns it and the list of its errors. A refused request is intended by the test and is not
 * an error of the page. `options` are options of Playwright's contexts, and `isTimed`: true for a page whose time is measured, so that the test does not preserve its drawings. */
export async function open(browser, url, options = {}) {
  const { isTimed, ...others } = options;
  const context = await browser.newContext({ viewport: { width: 1280, height: 900 }, ignoreHTTPSErrors: true, ...others });
  const page = await context.newPage(), faults = [];
  if (!isTimed) await page.addInitScript(keepDrawings);
  page.setDefaultTimeout(PATIENCE);
  page.on("pageerror", error => faults.push(`exception: ${error.message}`));
  page.on("console", message => {
    if (message.type() === "error" && !message.text().startsWith("Failed to load resource")) faults.push(`console: ${message.text()}`);
  });
  await page.goto(url);
  return { context, page, faults };
}

export function check(holds, what) {
  if (!holds) throw new Error(what);
}

/** Waits until `ask` returns a true value, which is returned; after {@link PATIENCE}, fails with `what`. */
export async function until(what, ask) {
  const end = Date.now() + PATIENCE;
  for (let last; ;) {
    last = await ask();
    if (last) return last;
    check(Date.now() < end, `${what}: not within ${PATIENCE} ms`);
    await new Promise(done => setTimeout(done, 100));
  }
}

export const state = (page, name) => page.waitForSelector(`#state[data-state=${name}]`);
export const text = (page, selector) => page.textContent(selector);
export const json = (page, url) => page.evaluate(async u => (await fetch(u)).json(), url);

/**
  * Waits until a canvas has content; returns its mean, the number of colours, and the greens in its left and right half. The picture stays in
  * the page under `name` for {@link difference}; for the scene the quality of the drawing is stored too, since pictures of different quality differ.
 */
export function picture(page, selector, name = "now") {
  return until(`${selector} shows something`, () => page.evaluate(([selector, name]) => {
    const canvas = document.querySelector(selector), { width, height } = canvas;
    if (!width || !height) return null;
    const pen = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
    pen.drawImage(canvas, 0, 0);
    const { data } = pen.getImageData(0, 0, width, height), colours = new Set(), halves = [new Set(), new Set()];
    let sum = 0;
    for (let i = 0; i < data.length; i += 4) {
      sum += data[i] + data[i + 1] + data[i + 2];
      colours.add(data[i] << 16 | data[i + 1] << 8 | data[i + 2]);
      halves[i / 4 % width < width / 2 ? 0 : 1].add(data[i + 1]);
    }
    const look = `${width} x ${height} ${canvas.dataset.quality ?? ""}`;
    (window.pictures ??= {})[name] = { data, look };
    return sum > 0 && { mean: sum / (3 * width * height), colours: colours.size, greens: halves.map(half => half.size) };
  }, [selector, name]));
}

/** Returns the share of the pixels that differ visibly between two stored pictures; null if their sizes or qualities differ. */
export function difference(page, a, b) {
  return page.evaluate(([a, b]) => {
    const [one, other] = [window.pictures[a], window.pictures[b]];
    if (one.look !== other.look) return null;
    let count = 0;
    for (let i = 1; i < one.data.length; i += 4) if (Math.abs(one.data[i] - other.data[i]) > 2) count++;
    return 4 * count / one.data.length;
  }, [a, b]);
}

/** Waits until a canvas differs in more than `part` of its pixels from the picture `from`, which is replaced when the quality changes. */
export function changes(page, what, selector, from, part) {
  return until(what, async () => {
    await picture(page, selector);
    const found = await difference(page, from, "now");
    if (found === null) await picture(page, selector, from);
    return found > part;
  });
}

/** Stores the canvas of a still scene as `name`, once two successive pictures are equal. */
async function still(page, selector, name) {
  await picture(page, selector, name);
  await until(`${selector} stands still`, async () => {
    await new Promise(done => setTimeout(done, 200));
    await picture(page, selector);
    if (await difference(page, name, "now") === 0) return true;
    await picture(page, selector, name);
    return false;
  });
}

/**
  * Repeats `act` and `undo` until the first has changed more than `part` of the pixels of a still scene's canvas and the second has
  * restored the old picture. A try in which the page changed the quality of the scene is repeated.
 */
export async function actsAndUndoes(page, what, selector, part, act, undo) {
  await until(what, async () => {
    await undo();
    await still(page, selector, "before");
    await act();
    await still(page, selector, "acted");
    await undo();
    await still(page, selector, "after");
    const [acted, after] = [await difference(page, "before", "acted"), await difference(page, "before", "after")];
    return acted !== null && after !== null && acted > part && after < 0.001;
  });
}

/** Returns the serious and critical violations that axe-core reports. */
export async function problems(page) {
  // The content security policy of the page admits no foreign script; this script is injected by the test.
  await page.evaluate(readFileSync(require.resolve("axe-core/axe.min.js"), "utf8"));
  const found = await page.evaluate(() => window.axe.run({ resultTypes: ["violations"] }));
  const serious = found.violations.filter(v => v.impact === "serious" || v.impact === "critical");
  return serious.map(v => `${v.id}: ${v.nodes.map(n => `${n.target} ${n.failureSummary}`).join("; ")}`);
}

const lines = createInterface({ input: process.stdin })[Symbol.asyncIterator]();

/** Sends a request to the test program that started this process, and waits for its completion. */
export async function please(what) {
  console.log(what);
  await lines.next();
}
