// Calibrates as a person would: from start to saved file.

import { check, json, open, please, problems, state, text, until } from "./browser.mjs";

/** Returns the state of the calibration; while an action is in progress, the probe returns none. */
const get = page => until("a state", async () => {
  const state = await json(page, "/v1/calibration");
  return state.errors ? null : state;
});

/** Calibrates the lens by a moving board, the circle by mouse and keys, and lux; undoes, saves. The test program checks the file. */
export async function calibrate(browser, url) {
  const { context, page, faults } = await open(browser, url, { reducedMotion: "reduce" });
  await state(page, "live");
  await page.click("#cal-open > summary");
  await page.waitForSelector("#cal-start:enabled");
  await until("the picture is live", () => page.evaluate(() => document.querySelector("#cal-image").naturalWidth === 480));
  await circle(page);
  await lens(page);
  await lux(page);
  const found = await problems(page);
  check(found.length === 0, found.join("\n"));
  check(await page.isEnabled("#cal-save"), "there is something to save");
  await page.click("#cal-save");
  await until("it says so", async () => (await text(page, "#cal-text")).startsWith("Saved"));
  check(!(await get(page)).unsaved, "nothing is left to save");
  check(await text(page, "#cal-error") === "", await text(page, "#cal-error"));
  check(faults.length === 0, faults.join("\n"));
  await context.close();
}

/** The circle is detected, dragged by the mouse, moved by keys, and reset. */
async function circle(page) {
  await page.check("[name=cal-part][value=circle]", { force: true });
  await page.click("#cal-find");
  const found = await until("a circle", async () => (await get(page)).circle);
  check(Math.abs(found.radius - 232.8) < 3 && Math.abs(found.centre[0] - 243.3) < 3, `found ${JSON.stringify(found)}`);
  // Texts above the picture move the handle shortly after it appears; `hover` waits until it rests under the mouse.
  await page.hover("[data-handle=centre]");
  const box = await page.locator("[data-handle=centre]").boundingBox();
  await page.mouse.down();
  await page.mouse.move(box.x + box.width / 2 + 40, box.y + box.height / 2, { steps: 4 });
  await page.mouse.up();
  const dragged = await until("it was dragged", async () => { const { circle } = await get(page); return circle?.centre[0] > found.centre[0] + 5 && circle; });
  await page.focus("[data-handle=rim]");
  await page.keyboard.press("ArrowLeft");
  await until("a key moves the rim", async () => Math.abs((await get(page)).circle.radius - dragged.radius + 1) < 0.01);
  await page.click("#cal-undo");
  await page.waitForFunction(() => !document.querySelector("#cal-text").textContent);
  await until("one step back", async () => Math.abs((await get(page)).circle.radius - dragged.radius) < 0.01);
  await page.click("#cal-undo");
  await until("two steps back", async () => Math.abs((await get(page)).circle.centre[0] - found.centre[0]) < 0.01);
}

/** Checks that pictures of the board are taken automatically, and removes the last one. */
async function lens(page) {
  await page.check("[name=cal-part][value=lens]", { force: true });
  await page.fill("#cal-board", "9by7");
  await page.click("#cal-start");
  await until("a wrong board is refused", async () => (await text(page, "#cal-error")).includes("COLUMNSxROWS"));
  await page.fill("#cal-board", "9x7");
  await page.click("#cal-start");
  const views = async () => (await get(page)).guide?.views ?? 0;
  await until("a place is named", async () => (await text(page, "#cal-advice")).includes("The board has not been at"));
  await until("twelve pictures", async () => await views() >= 12);
  await page.click("#cal-start");
  const before = await views();
  await page.click("#cal-undo");
  await until("one is taken back", async () => await views() === before - 1);
  await page.click("#cal-compute");
  await until("a lens", async () => (await text(page, "#cal-result")).includes("Covered up to") || await text(page, "#cal-error"));
  check(await text(page, "#cal-error") === "", await text(page, "#cal-error"));
  const { lens } = await get(page);
  check(lens.method === "board" && lens.rms_px < 0.3, JSON.stringify(lens));
}

/** Takes two photometric readings and removes one. */
async function lux(page) {
  await page.check("[name=cal-part][value=photometric]", { force: true });
  const readings = async () => (await get(page)).photometric.length;
  await page.fill("#cal-lux", "0");
  await page.click("#cal-measure");
  await until("no light is refused", async () => (await text(page, "#cal-error")).includes("positive"));
  await page.fill("#cal-lux", "500");
  for (const count of [1, 2]) {
    await page.click("#cal-measure");
    await until(`${count} readings`, async () => await readings() === count);
  }
  await page.click("#cal-undo");
  await until("one is taken back", async () => await readings() === 1);
}

/** Number of positions of the lit screen before the camera, from the axis to the rim. */
const PLACES = 18;

/** The viewport of a phone held upright. */
const PHONE = { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true, reducedMotion: "reduce" };

/** Opens the calibration on a phone by touch, and checks that no element is wider than the screen. */
async function openOnPhone(browser, url, part) {
  const opened = await open(browser, url, PHONE), { page } = opened;
  await state(page, "live");
  await page.tap("#cal-open > summary");
  await page.waitForSelector("#cal-start:enabled");
  await page.tap(`label:has(> [name=cal-part][value=${part}])`);
  await until("the picture is live", () => page.evaluate(() => document.querySelector("#cal-image").naturalWidth === 480));
  const width = await page.evaluate(() => document.scrollingElement.scrollWidth);
  check(width <= 390, `the page is ${width} px wide, expected at most 390`);
  return opened;
}

/** Saves the calibration by touch and closes the page. */
async function saveOnPhone({ context, page, faults }) {
  const found = await problems(page);
  check(found.length === 0, found.join("\n"));
  await page.tap("#cal-save");
  await until("it says so", async () => (await text(page, "#cal-text")).startsWith("Saved"));
  check(await text(page, "#cal-error") === "", await text(page, "#cal-error"));
  check(faults.length === 0, faults.join("\n"));
  await context.close();
}

/** Takes readings of screens from the axis to the rim and removes the last; too few readings are refused. */
export async function vignetting(browser, url) {
  const opened = await openOnPhone(browser, url, "vignetting"), { page } = opened;
  const readings = async () => (await get(page)).vignetting.readings;
  await page.tap("#cal-fit");
  await until("no reading is refused", async () => (await text(page, "#cal-error")).includes("expected"));
  const bursts = async () => (await json(page, "/v1/status")).frames;
  for (let count = 0; count < PLACES; count++) {
    await page.tap("#cal-screen");
    await until("one more reading", async () => (await readings()).length === count + 1);
    await please("next");
    const seen = await bursts();
    await until("a picture of the next place", async () => await bursts() >= seen + 2);
  }
  const before = (await readings()).length, angles = (await readings()).map(([theta]) => theta);
  check(Math.min(...angles) < 3 && Math.max(...angles) > 80, `readings at ${angles} degrees`);
  await page.tap("#cal-undo");
  await until("one is taken back", async () => (await readings()).length === before - 1);
  await page.tap("#cal-fit");
  await until("how well it fits", async () => (await text(page, "#cal-result")).includes("Fit within") || await text(page, "#cal-error"));
  check(await text(page, "#cal-error") === "", await text(page, "#cal-error"));
  const { fitted } = (await get(page)).vignetting;
  check(fitted.rms < 0.02, JSON.stringify(fitted));
  await saveOnPhone(opened);
}

/** Detects the circle, drags it by a finger and resets it; then fits the response. */
export async function response(browser, url) {
  const opened = await openOnPhone(browser, url, "circle"), { page, context } = opened;
  await page.tap("#cal-find");
  const found = await until("a circle", async () => (await get(page)).circle);
  check(Math.abs(found.radius - 239.5) < 4 && Math.abs(found.centre[0] - 239.5) < 4, `found ${JSON.stringify(found)}`);
  await page.locator("#cal-stage").scrollIntoViewIfNeeded();
  const handle = await page.waitForSelector("[data-handle=centre]");
  await handle.waitForElementState("stable");
  const box = await handle.boundingBox();
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 2], finger = await context.newCDPSession(page);
  const touch = (type, ...touchPoints) => finger.send("Input.dispatchTouchEvent", { type, touchPoints });
  await touch("touchStart", { x, y });
  for (const step of [10, 20, 30]) await touch("touchMove", { x: x + step, y });
  await touch("touchEnd");
  await until("it was dragged", async () => (await get(page)).circle?.centre[0] > found.centre[0] + 5);
  // A tap has no effect while the page waits for the answer to the drag.
  await until("taken back", async () => {
    if (Math.abs((await get(page)).circle.centre[0] - found.centre[0]) < 0.01) return true;
    await page.tap("#cal-undo");
    await page.waitForTimeout(2000);
    return false;
  });
  await page.tap("label:has(> [name=cal-part][value=response])");
  await page.tap("#cal-response");
  await until("a response", async () => (await text(page, "#cal-result")).includes("within") || await text(page, "#cal-error"));
  check(await text(page, "#cal-error") === "", await text(page, "#cal-error"));
  const { neighbours } = (await get(page)).response;
  check(neighbours.length === 4 && neighbours.every(n => Math.abs(n.estimated / n.declared - 1) < 0.03), JSON.stringify(neighbours));
  await saveOnPhone(opened);
}
