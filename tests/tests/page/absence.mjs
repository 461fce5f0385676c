// The page without a token, and the page while the probe is absent.

import { check, open, picture, please, problems, state, text, until } from "./browser.mjs";

/** Without the token the page shows and changes nothing; with the token it shows and changes everything. */
export async function login(browser, url, token) {
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

/** While the probe is stopped, the page reports that it does not answer; after a restart the page continues without a click. */
export async function restart(browser, url) {
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
  await until("the sky is there again", async () => (await picture(page, "#sky-canvas")).colours > 500);
  check(faults.length === 0, faults.join("\n"));
  await context.close();
}
