// The speed of the page, and the loss of picture quality by its approximations.

import { loadavg } from "node:os";
import { check, json, open, picture, state, text, until } from "./browser.mjs";

/** The approximations are hardly visible: light baked by normal against the sum over all lights, highlights of a few lights against highlights of all. */
export async function shading(browser, url) {
  const { context, page, faults } = await open(browser, url, { reducedMotion: "reduce" });
  await state(page, "live");
  const { lights } = await json(page, "/v1/lights"), baked = await page.evaluate(async lights => {
    const { SIDE, bake } = await import("/page/irradiance.js"), map = bake(lights, null, 1);
    const place = ([x, y, z]) => {
      const sum = Math.abs(x) + Math.abs(y) + Math.abs(z), [u, v] = [x / sum, y / sum];
      const at = z >= 0 ? [u, v] : [(1 - Math.abs(v)) * Math.sign(u), (1 - Math.abs(u)) * Math.sign(v)];
      return at.map(c => (0.5 + 0.5 * c) * (SIDE - 1));
    };
    const read = normal => {
      const [x, y] = place(normal), [i, j] = [x, y].map(c => Math.min(SIDE - 2, Math.floor(c))), [a, b] = [x - i, y - j];
      const at = (i, j) => map[3 * (j * SIDE + i) + 1];
      return (1 - b) * ((1 - a) * at(i, j) + a * at(i + 1, j)) + b * ((1 - a) * at(i, j + 1) + a * at(i + 1, j + 1));
    };
    let [square, most, mean] = [0, 0, 0];
    const count = 4000;
    for (let k = 0; k < count; k++) {
      const z = 1 - 2 * (k + 0.5) / count, r = Math.sqrt(1 - z * z), n = [r * Math.cos(2.399963 * k), r * Math.sin(2.399963 * k), z];
      const exact = lights.reduce((sum, { direction: d, irradiance }) => sum + irradiance[1] * Math.max(0, n[0] * d[0] + n[1] * d[1] + n[2] * d[2]), 0);
      const off = read(n) - exact;
      [square, most, mean] = [square + off * off, Math.max(most, Math.abs(off)), mean + exact / count];
    }
    return { rms: Math.sqrt(square / count) / mean, most: most / mean };
  }, lights);
  check(lights.length === 64 && baked.rms < 0.004 && baked.most < 0.05, `the baked light is off by ${baked.rms} of the mean, at most ${baked.most}`);
  const draw = async (name, quality) => {
    await page.evaluate(async quality => {
      const { LADDER } = await import("/page/quality.js");
      LADDER.forEach(step => Object.assign(step, quality));
    }, quality);
    await page.waitForSelector(`#scene-canvas[data-quality^='shadows of 0 '][data-quality$=' ${quality.glossy}']`);
    await picture(page, "#scene-canvas", name);
  };
  await page.locator("#scene-canvas").scrollIntoViewIfNeeded();
  const part = { shadows: 0, taps: 1, scale: 1 };
  for (const [name, glossy] of [["few", 6], ["none", 0], ["all", 64]]) await draw(name, { ...part, glossy });
  // All pictures are compared as if they had one quality.
  const [few, none] = await page.evaluate(() => ["few", "none"].map(name => {
    const [one, all] = [window.pictures[name].data, window.pictures.all.data];
    return one.reduce((sum, v, i) => sum + Math.abs(v - all[i]), 0) / one.length;
  }));
  check(few < none && few < 0.3, `highlights of a few lights are off by ${few} codes of 255`);
  check(faults.length === 0, faults.join("\n"));
  console.log(`baked light off by ${(100 * baked.rms).toFixed(3)} % of the mean, at most ${(100 * baked.most).toFixed(2)} %; six highlights by ${few.toFixed(3)} codes of 255, none by ${none.toFixed(3)}`);
  await context.close();
}

/** Prints the time since navigation began, without a limit. Repeated, since the machine may be busy; the probe is new at the first try only. */
export async function speed(browser, url) {
  const best = { live: Infinity, sky: Infinity, scene: Infinity, rate: 0 }, first = {};
  for (let i = 0; i < 4; i++) {
    const { context, page } = await open(browser, "about:blank", { isTimed: true });
    await page.addInitScript(() => {
      window.seen = { frames: 0 };
      const watch = (type, name, act) => {
        const real = type.prototype[name];
        type.prototype[name] = function (...all) { act(this.canvas.id, ...all); return real.apply(this, all); };
      };
      const told = new MutationObserver(() => { if (document.querySelector("#state[data-state=live]")) window.seen.live ??= performance.now(); });
      told.observe(document, { subtree: true, attributes: true, attributeFilter: ["data-state"] });
      // Until there is a map, only marks of one pixel are drawn.
      watch(CanvasRenderingContext2D, "drawImage", (id, picture) => { if (id === "sky-canvas" && picture.width > 1) window.seen.sky ??= performance.now(); });
      watch(WebGL2RenderingContext, "drawElements", () => { window.seen.scene ??= performance.now(); });
      // The scene enables blending once per picture, so that the calls count the pictures.
      watch(WebGL2RenderingContext, "enable", (_, what) => { if (what === WebGL2RenderingContext.BLEND) window.seen.frames++; });
    });
    await page.goto(url);
    await until("the first picture", () => page.evaluate(() => window.seen.live && window.seen.sky && window.seen.scene));
    const { live, sky, scene } = await page.evaluate(() => window.seen);
    await page.addStyleTag({ content: "#scene-canvas { width: 640px; height: 360px; aspect-ratio: auto }" });
    await page.locator("#scene-canvas").scrollIntoViewIfNeeded();
    await page.waitForTimeout(4000);
    const rate = await page.evaluate(async () => {
      const from = window.seen.frames, began = performance.now();
      await new Promise(done => setTimeout(done, 4000));
      return 1000 * (window.seen.frames - from) / (performance.now() - began);
    });
    const size = await page.evaluate(() => { const c = document.querySelector("#scene-canvas"); return `${c.width} x ${c.height}`; });
    console.log(`live ${live.toFixed(0)} ms, sky ${sky.toFixed(0)} ms, scene ${scene.toFixed(0)} ms, ${rate.toFixed(1)} pictures/s of ${size}, ${await text(page, "#scene-rate")}, load ${loadavg()[0].toFixed(1)}`);
    for (const [name, v] of Object.entries({ live, sky, scene })) {
      first[name] ??= v;
      best[name] = Math.min(best[name], v);
    }
    best.rate = Math.max(best.rate, rate);
    await context.close();
  }
  console.log(`first visit: live ${first.live.toFixed(0)} ms, sky ${first.sky.toFixed(0)} ms, scene ${first.scene.toFixed(0)} ms`);
  console.log(`best: live ${best.live.toFixed(0)} ms, sky ${best.sky.toFixed(0)} ms, scene ${best.scene.toFixed(0)} ms, ${best.rate.toFixed(1)} pictures/s`);
}
