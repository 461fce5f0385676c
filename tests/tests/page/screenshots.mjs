// node screenshots.mjs URL FOLDER: writes pictures of the page of a running probe, for the README: page.png of a desktop,
// page-phone.png of a phone, page-compare.png with two samplers side by side.
// HEMILUX_NODE and HEMILUX_BROWSER are described in browser.mjs.

import { launch, open, picture, state, until } from "./browser.mjs";

const [url, folder] = process.argv.slice(2);
const WAYS = [
  ["page.png", { viewport: { width: 1440, height: 900 }, colorScheme: "dark" }],
  ["page-phone.png", { viewport: { width: 360, height: 1000 }, colorScheme: "light" }],
  ["page-compare.png", { viewport: { width: 1440, height: 1000 }, colorScheme: "dark" }, "q2tree-jitter"],
];

const browser = await launch();
for (const [name, options, other] of WAYS) {
  const { context, page } = await open(browser, url, { ...options, reducedMotion: "reduce" });
  await state(page, "live");
  await page.waitForSelector("#burst figure:nth-child(3) img");
  if (other) {
    await page.selectOption("#compare-sampler", other);
    await page.check("#compare-on");
    await page.waitForSelector("#compare-result:not([hidden])");
  }
  if (!other) await page.selectOption("#show-shadows", "all");
  await page.locator("#scene-canvas").scrollIntoViewIfNeeded();
  await until("the scene", async () => (await picture(page, "#scene-canvas")).colours > 300);
  // Waits for the entries of the history.
  await page.waitForTimeout(20_000);
  await page.evaluate(() => scrollTo(0, 0));
  await page.screenshot({ path: `${folder}/${name}`, timeout: 180_000 });
  await context.close();
  console.log(`${folder}/${name}`);
}
await browser.close();
process.exit();
