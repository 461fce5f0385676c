// node screenshots.mjs URL FOLDER: pictures of the page of a running probe, for the README: page.png as on a desk, page-phone.png as on a phone.
// HEMILUX_NODE and HEMILUX_BROWSER as in browser.mjs.

import { launch, open, picture, state, until } from "./browser.mjs";

const [url, folder] = process.argv.slice(2);
const WAYS = [
  ["page.png", { viewport: { width: 1440, height: 900 }, colorScheme: "dark" }],
  ["page-phone.png", { viewport: { width: 360, height: 1000 }, colorScheme: "light" }],
];

const browser = await launch();
for (const [name, options] of WAYS) {
  const { context, page } = await open(browser, url, { ...options, reducedMotion: "reduce" });
  await state(page, "live");
  await page.waitForSelector("#burst figure:nth-child(3) img");
  await page.selectOption("#show-shadows", "all");
  await page.locator("#scene-canvas").scrollIntoViewIfNeeded();
  await until("the scene", async () => (await picture(page, "#scene-canvas")).colours > 300);
  // What the history shows has to come first.
  await page.waitForTimeout(20_000);
  await page.evaluate(() => scrollTo(0, 0));
  await page.screenshot({ path: `${folder}/${name}`, timeout: 180_000 });
  await context.close();
  console.log(`${folder}/${name}`);
}
await browser.close();
process.exit();
