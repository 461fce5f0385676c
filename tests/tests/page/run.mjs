// node run.mjs SCENARIO URL [TOKEN]: runs one test of the page. Prints "passed" and figures, or the failed condition.

import { login, restart } from "./absence.mjs";
import { launch } from "./browser.mjs";
import { calibrate, response, vignetting } from "./calibration.mjs";
import { foreignBasic, foreignCookie, foreignOpen } from "./foreign.mjs";
import { compare, controls, live } from "./looks.mjs";
import { gathered, penumbra } from "./penumbra.mjs";
import { save, settings } from "./settings.mjs";
import { shading, speed } from "./speed.mjs";
import { fault, source, traffic, visitor } from "./visitor.mjs";

const SCENARIOS = { live, controls, settings, compare, save, shading, speed, login, restart, foreignOpen, foreignBasic, foreignCookie, calibrate,
  vignetting, response, fault, source, traffic, visitor, penumbra, gathered };
const [scenario, url, token] = process.argv.slice(2);

const browser = await launch();
try {
  await SCENARIOS[scenario](browser, url, token);
  console.log("passed");
} catch (error) {
  console.log(`failed: ${error.message.replaceAll("\n", " ")}`);
} finally {
  await browser.close();
  process.exit();
}
