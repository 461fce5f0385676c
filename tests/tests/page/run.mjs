// node run.mjs SCENARIO URL [TOKEN]: one of the page's tests. Prints "passed" and figures, or what did not hold.

import { gzipSync } from "node:zlib";
import { check, difference, json, launch, open, picture, please, problems, state, text, until } from "./browser.mjs";

const [scenario, url, token] = process.argv.slice(2);

/** What the lights, the numbers and both canvases show, and that it changes with the light. */
async function live(browser) {
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
  const skies = [await picture(page, "#sky-canvas")];
  check(skies[0].colours > 500, `the sky has only ${skies[0].colours} colours`);
  await until("the sky changes when the lamp moves", async () => difference(skies[0], await picture(page, "#sky-canvas")) > 0.002);
  await page.locator("#scene-canvas").scrollIntoViewIfNeeded();
  const scene = await until("the scene is lit", async () => {
    const now = await picture(page, "#scene-canvas");
    return now.colours > 300 && now;
  });
  await until("the scene changes when the lamp moves", async () => difference(scene, await picture(page, "#scene-canvas")) > 0.002);
  check(faults.length === 0, faults.join("\n"));
  const sum = bytes.reduce((a, b) => a + b, 0);
  check(bytes.length > 10 && sum < 300_000, `${sum} bytes in ${bytes.length} files`);
  console.log(`files: ${bytes.length}, gzip bytes: ${sum}, live after ${first} ms, scene: ${await text(page, "#scene-rate")}`);
  await context.close();
}

/** Exposure, projection, the keyboard and the switches act; nothing is wider than a phone. */
async function controls(browser) {
  // Without motion the scene stands still between two sets, and differences are ours.
  const { context, page, faults } = await open(browser, url, { viewport: { width: 360, height: 760 }, reducedMotion: "reduce" });
  await state(page, "live");
  await page.waitForSelector("#burst figure:nth-child(3) img");
  check(await page.evaluate(() => document.documentElement.scrollWidth) <= 360, "the page is wider than a phone");
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
  const scene = await until("the scene is drawn", async () => {
    const now = await picture(page, "#scene-canvas");
    return now.colours > 200 && now;
  });
  for (let i = 0; i < 5; i++) await page.keyboard.press("ArrowLeft");
  await until("the keys turn the scene", async () => difference(scene, await picture(page, "#scene-canvas")) > 0.05);
  await page.keyboard.press("Home");
  await page.check("#show-rays");
  await until("lines are drawn", async () => difference(scene, await picture(page, "#scene-canvas")) > 0.005);
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

/** Every setting acts; what is wrong is refused beside its field and changes nothing. */
async function settings(browser) {
  const { context, page, faults } = await open(browser, url, { reducedMotion: "reduce" });
  await state(page, "live");
  await page.waitForSelector("#set-sampler:enabled");
  const values = async () => (await json(page, "/v1/config")).values;
  const names = Object.keys(await values());
  const tried = new Set();
  const act = async (name, change, seen) => {
    tried.add(name);
    await change(`#set-${name}`);
    await until(`${name} acts`, seen);
    check(await text(page, `#set-${name}-error`) === "", `${name}: ${await text(page, `#set-${name}-error`)}`);
  };
  const count = async () => Number.parseInt(await text(page, "#n-lights"), 10);
  const level = async () => Number.parseFloat(await text(page, "#n-illuminance"));
  await act("lights", s => page.fill(s, "20"), async () => await count() === 20);
  await act("tolerance", s => page.fill(s, "0.3"), async () => await count() < 20);
  await act("tolerance", s => page.fill(s, ""), async () => await count() === 20);
  await act("ambient", s => page.check(s), async () => "ambient_sh" in await json(page, "/v1/lights?ambient=1"));
  await act("ambient", s => page.uncheck(s), async () => (await values()).ambient === false);
  const dark = await level();
  await act("extrapolation", s => page.selectOption(s, "average"), async () => await level() > 1.02 * dark);
  await act("gui", s => page.check(s), async () => page.evaluate(async () => (await fetch("/screenshot")).status === 200));
  await act("sampler", s => page.selectOption(s, "pharr"), async () => (await json(page, "/v1/lights")).sampler === "pharr");
  await until("the page names the sampler", async () => (await page.locator("#tiles").textContent()).includes("pharr"));
  const missed = names.filter(name => !tried.has(name));
  check(missed.length === 0, `settings that this test does not try: ${missed}`);
  // A wrong number, none, and a choice that does not go with another field.
  const before = JSON.stringify(await values());
  await page.fill("#set-lights", "-5");
  await until("a wrong number is refused", async () => (await text(page, "#set-lights-error")).includes("found -5, expected"));
  check(await page.getAttribute("#set-lights", "aria-invalid") === "true", "the field is marked");
  await page.fill("#set-lights", "2.5");
  await until("a broken number is refused", async () => (await text(page, "#set-lights-error")).includes("found 2.5, expected"));
  await page.fill("#set-lights", "");
  await until("no number is refused", async () => (await text(page, "#set-lights-error")).includes("no number"));
  check(JSON.stringify(await values()) === before, "nothing was changed");
  await page.fill("#set-lights", "3");
  await until("three lights", async () => await count() === 3 && await text(page, "#set-lights-error") === "");
  await page.selectOption("#set-sampler", "q2tree");
  await until("what does not go together is refused", async () => (await text(page, "#set-lights-error")).includes("for 'q2tree'"));
  check(await page.inputValue("#set-sampler") === "pharr", "the choice is taken back");
  // What another client changes shows here.
  await page.evaluate(() => fetch("/v1/config", { method: "PATCH", body: "{\"lights\": 33}" }));
  await until("another client's change shows", async () => await page.inputValue("#set-lights") === "33");
  check(faults.length === 0, faults.join("\n"));
  await context.close();
}

/** Without the token nothing is shown or changed, with it everything. */
async function login(browser) {
  const { context, page, faults } = await open(browser, url, { reducedMotion: "reduce" });
  await state(page, "live");
  await page.waitForSelector("#login:not([hidden])");
  await page.waitForSelector("#set-lights:disabled");
  check(await page.locator("#burst img").count() === 0, "no picture without the token");
  const found = await problems(page);
  check(found.length === 0, found.join("\n"));
  await page.fill("#token", "not the token at all");
  await page.click("#login button");
  await until("a wrong token is refused", async () => (await text(page, "#login-error")).includes("not the token"));
  await page.fill("#token", token);
  await page.keyboard.press("Enter");
  await page.waitForSelector("#login", { state: "hidden" });
  await page.waitForSelector("#burst img");
  await page.fill("#set-lights", "11");
  await until("a change is let through", async () => (await text(page, "#n-lights")).startsWith("11 "));
  check(!(await page.content()).includes(token), "the token does not stay in the page");
  check(faults.length === 0, faults.join("\n"));
  await context.close();
}

/** The probe goes and comes back: the page says so, and goes on by itself. */
async function restart(browser) {
  const { context, page, faults } = await open(browser, url, { reducedMotion: "reduce" });
  await state(page, "live");
  await until("a run", async () => (await text(page, "#state-text")).includes("run "));
  const run = await text(page, "#state-text");
  await please("stop");
  await state(page, "lost");
  check((await text(page, "#state")).includes("does not answer"), await text(page, "#state"));
  await please("start");
  await state(page, "live");
  await until("another run", async () => (await text(page, "#state-text")).includes("run ") && await text(page, "#state-text") !== run);
  const sky = await picture(page, "#sky-canvas");
  check(sky.colours > 500, "the sky is there again");
  check(faults.length === 0, faults.join("\n"));
  await context.close();
}

const browser = await launch();
try {
  await { live, controls, settings, login, restart }[scenario](browser);
  console.log("passed");
} catch (error) {
  console.log(`failed: ${error.message.replaceAll("\n", " ")}`);
} finally {
  await browser.close();
  process.exit();
}
