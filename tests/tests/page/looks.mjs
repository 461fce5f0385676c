// The display of the page: lights, controls, and the comparison of two samplers.

import { gzipSync } from "node:zlib";
import { actsAndUndoes, changes, check, difference, json, open, picture, problems, state, text, until } from "./browser.mjs";

/** Lights, numbers and both canvases are displayed, and change with the light. */
export async function live(browser, url) {
  const bytes = [], { context, page, faults } = await open(browser, "about:blank");
  page.on("response", async answer => {
    const path = new URL(answer.url()).pathname;
    if (path === "/" || path.startsWith("/page/") || path === "/client.js") bytes.push(gzipSync(await answer.body()).length);
  });
  const began = Date.now();
  await page.goto(url);
  await state(page, "live");
  const first = Date.now() - began;
  await until("lights are counted", async () => /^\d+ of 64/.test(await text(page, "#n-lights")));
  for (const name of ["error", "rate", "latency", "illuminance", "flicker", "unseen", "clients"]) {
    await until(`a number for ${name}`, async () => /\d/.test(await text(page, `#n-${name}`)));
  }
  await page.waitForSelector("#burst figure:nth-child(3) img");
  await until("the sky has colours", async () => (await picture(page, "#sky-canvas", "sky")).colours > 500);
  await changes(page, "the sky changes when the lamp moves", "#sky-canvas", "sky", 0.01);
  await page.locator("#scene-canvas").scrollIntoViewIfNeeded();
  // The map behind the lights moves too, so it is hidden.
  await page.uncheck("#show-sky");
  await page.waitForSelector("#scene-canvas[data-shown='0 EV']");
  await until("the scene is lit", async () => (await picture(page, "#scene-canvas", "scene")).colours > 300);
  await changes(page, "the scene changes when the lamp moves", "#scene-canvas", "scene", 0.01);
  check(faults.length === 0, faults.join("\n"));
  const sum = bytes.reduce((a, b) => a + b, 0);
  check(bytes.length > 10 && sum < 300_000, `${sum} bytes in ${bytes.length} files`);
  console.log(`files: ${bytes.length}, gzip bytes: ${sum}, live after ${first} ms, scene: ${await text(page, "#scene-rate")}`);
  await context.close();
}

/** Exposure, projection, the keyboard and the switches have an effect; no element is wider than a phone. */
export async function controls(browser, url) {
  // The light and the scene stand still, so every difference is caused by the controls.
  const { context, page, faults } = await open(browser, url, { viewport: { width: 360, height: 760 }, reducedMotion: "reduce" });
  await state(page, "live");
  await page.waitForSelector("#burst figure:nth-child(3) img");
  const wide = await page.evaluate(() => document.documentElement.scrollWidth <= 360 ? []
    : [...document.querySelectorAll("body *")].filter(e => e.getBoundingClientRect().right > 360).map(e => `${e.tagName} ${e.id} ${e.textContent.slice(0, 40)}`));
  check(wide.length === 0, `the page is wider than a phone: ${wide.join("; ")}`);
  const before = await picture(page, "#sky-canvas");
  await page.focus("#exposure");
  await page.keyboard.press("End");
  await until("more exposure is brighter", async () => (await picture(page, "#sky-canvas")).mean > before.mean * 1.15);
  check((await text(page, "#exposure-text")).startsWith("+6"), "the exposure is told");
  await page.fill("#exposure", "0");
  await page.check("[name=view][value=polar]", { force: true });
  const box = await page.locator("#sky-canvas").boundingBox();
  check(Math.abs(box.width / box.height - 2) < 0.05, `the polar map is ${box.width} x ${box.height}`);
  await page.focus("#sky-canvas");
  await page.keyboard.press("ArrowRight");
  await until("the strongest light is told", async () => /^light \d+\n/.test(await text(page, "#sky-tip")));
  await page.keyboard.press("Escape");
  await page.waitForSelector("#sky-tip", { state: "hidden" });
  await page.focus("#scene-canvas");
  await page.waitForSelector("#scene-canvas[data-shown='sky 0 EV']");
  await until("the scene is drawn", async () => (await picture(page, "#scene-canvas")).colours > 200);
  const turn = async () => { for (let i = 0; i < 5; i++) await page.keyboard.press("ArrowLeft"); };
  await actsAndUndoes(page, "the keys turn the scene, and back", "#scene-canvas", 0.05, turn, () => page.keyboard.press("Home"));
  await actsAndUndoes(page, "lines are drawn, and taken away", "#scene-canvas", 0.005, () => page.check("#show-rays"), () => page.uncheck("#show-rays"));
  await page.click("#list summary");
  await page.waitForSelector("#rows tr:nth-child(10)");
  for (const colorScheme of ["light", "dark"]) {
    await page.emulateMedia({ colorScheme, reducedMotion: "reduce" });
    const found = await problems(page);
    check(found.length === 0, `${colorScheme}: ${found.join("\n")}`);
  }
  check(faults.length === 0, faults.join("\n"));
  await context.close();
}

/** Two samplers side by side, on the same frames. */
export async function compare(browser, url) {
  const { context, page, faults } = await open(browser, url, { reducedMotion: "reduce" });
  await state(page, "live");
  await page.waitForSelector("#compare-on:enabled");
  check(await page.isHidden("#sky-canvas-2") && await page.isHidden("#compare-result"), "one sky at first");
  await page.check("#compare-on");
  await page.waitForSelector("#compare-result:not([hidden])");
  const cell = (row, column) => text(page, `#compare-rows tr:nth-child(${row}) td:nth-child(${column})`);
  check(await text(page, "#compare-first") === "adaptive" && await text(page, "#compare-second") === "q2tree", "both are named");
  check(/^64 of 64/.test(await cell(1, 2)) && /^\d+ of 64/.test(await cell(1, 3)), `lights: ${await cell(1, 2)}, ${await cell(1, 3)}`);
  for (const row of [2, 3, 6]) for (const column of [2, 3]) check(/^[\d.]+ (%|ms)/.test(await cell(row, column)), `row ${row}: ${await cell(row, column)}`);
  check(/^[\d.]+ %/.test(await cell(4, 2)) && (await cell(4, 3)).startsWith("–"), "one estimates its error");
  await until("flicker is measured", async () => /^[\d.]+ %/.test(await cell(5, 2)) && /^[\d.]+ %/.test(await cell(5, 3)));
  const pair = await json(page, "/v1/compare?algorithm=q2tree");
  check(pair.sets.length === 2 && pair.sets[0].frame === pair.sets[1].frame, "two sets of one frame");
  await until("two skies with different lights", async () => {
    const skies = [await picture(page, "#sky-canvas", "first"), await picture(page, "#sky-canvas-2", "second")];
    return skies.every(sky => sky.colours > 400) && await difference(page, "first", "second") > 0.01;
  });
  await page.locator("#scene-canvas").scrollIntoViewIfNeeded();
  await until("both scenes are drawn", async () => (await picture(page, "#scene-canvas")).greens.every(count => count > 60));
  const found = await problems(page);
  check(found.length === 0, found.join("\n"));
  // Another sampler applies at once; a wrong one is refused beside its field.
  await page.selectOption("#compare-sampler", "pharr");
  await until("another method is compared", async () => await text(page, "#compare-second") === "pharr");
  await page.fill("#compare-lights", "9");
  await until("with other lights", async () => /^9 of 9/.test(await cell(1, 3)));
  await page.fill("#compare-lights", "5000");
  await until("too many are refused", async () => (await text(page, "#compare-error")).includes("found lights '5000'"));
  await page.fill("#compare-lights", "16");
  await until("and right ones taken again", async () => /^16 of 16/.test(await cell(1, 3)) && await text(page, "#compare-error") === "");
  await page.uncheck("#compare-on");
  await page.waitForSelector("#sky-canvas-2", { state: "hidden" });
  // While another client compares another sampler, the page waits and then continues without a click.
  await page.evaluate(() => {
    window.others = true;
    (async () => { while (window.others) await fetch("/v1/compare?algorithm=hemigon&lights=7"); })();
  });
  await until("the other is let in", async () => (await json(page, "/v1/compare?algorithm=hemigon&lights=7").catch(() => ({}))).sets);
  await page.check("#compare-on");
  await until("one comparison at a time", async () => (await text(page, "#compare-error")).includes("hemigon and 7 lights"));
  await page.evaluate(() => { window.others = false; });
  await page.waitForSelector("#compare-result:not([hidden])");
  await until("nothing is in the way any more", async () => await text(page, "#compare-error") === "");
  check((await json(page, "/v1/config")).values.sampler === "adaptive", "the probe's own sampler is unchanged");
  check(faults.length === 0, faults.join("\n"));
  await context.close();
}
