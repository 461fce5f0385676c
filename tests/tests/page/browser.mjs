// A real browser for the page's tests, and what they all ask of it.
// HEMILUX_NODE is a folder with node_modules/{playwright-core,axe-core}; HEMILUX_BROWSER the browser's program, chromium without it.

import { existsSync, readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { createInterface } from "node:readline";

const require = createRequire(`${process.env.HEMILUX_NODE}/`);
const { chromium } = require("playwright-core");

/** Longest wait for anything, ms: a busy machine without a GPU takes its time. */
export const PATIENCE = 60_000;

/** WebGL by the processor. */
const FLAGS = ["--no-sandbox", "--disable-dev-shm-usage", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"];

export async function launch() {
  const program = process.env.HEMILUX_BROWSER ?? "chromium", folders = process.env.PATH.split(":");
  const executablePath = program.includes("/") ? program : folders.map(folder => `${folder}/${program}`).find(existsSync);
  return chromium.launch({ executablePath, args: FLAGS, timeout: PATIENCE });
}

/** A page of `url`, and the list of what went wrong in it. A refused request is the test's own doing and no fault of the page. */
export async function open(browser, url, options = {}) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 900 }, ...options });
  const page = await context.newPage(), faults = [];
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

/** Waits until `ask` gives something true. */
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

/** Mean, number of colours, and the green of every pixel of what a canvas shows. */
export function picture(page, selector) {
  return page.evaluate(async selector => {
    const canvas = document.querySelector(selector), copy = new OffscreenCanvas(canvas.width, canvas.height), pen = copy.getContext("2d");
    // What WebGL has drawn can be read until the browser shows it: by who is called after the drawing, and before the showing.
    for (let tries = 0; tries < 300; tries++) {
      await new Promise(done => setTimeout(done, 29 * Math.random()));
      const found = await new Promise(done => requestAnimationFrame(() => {
        if (!canvas.width || !canvas.height) return done(null);
        copy.width = canvas.width;
        copy.height = canvas.height;
        pen.drawImage(canvas, 0, 0);
        const { data } = pen.getImageData(0, 0, copy.width, copy.height), colours = new Set(), green = [];
        let sum = 0;
        for (let i = 0; i < data.length; i += 4) {
          sum += data[i] + data[i + 1] + data[i + 2];
          green.push(data[i + 1]);
          colours.add(data[i] << 16 | data[i + 1] << 8 | data[i + 2]);
        }
        done(sum > 0 ? { mean: sum / (3 * green.length), colours: colours.size, data: green, width: copy.width } : null);
      }));
      if (found) return found;
    }
    throw new Error(`${selector} stays black`);
  }, selector);
}

/** Part of the pixels that differ between two pictures by more than noise. */
export function difference(a, b) {
  if (a.data.length !== b.data.length) return 1;
  return a.data.filter((v, i) => Math.abs(v - b.data[i]) > 8).length / a.data.length;
}

/** What axe-core calls serious or critical. */
export async function problems(page) {
  // The page's own policy lets no foreign script in; this one comes from the test.
  await page.evaluate(readFileSync(require.resolve("axe-core/axe.min.js"), "utf8"));
  const found = await page.evaluate(() => window.axe.run({ resultTypes: ["violations"] }));
  const serious = found.violations.filter(v => v.impact === "serious" || v.impact === "critical");
  return serious.map(v => `${v.id}: ${v.nodes.map(n => `${n.target} ${n.failureSummary}`).join("; ")}`);
}

const lines = createInterface({ input: process.stdin })[Symbol.asyncIterator]();

/** Asks the program that started us for something, and waits until it is done. */
export async function please(what) {
  console.log(what);
  await lines.next();
}
