// node run.mjs SCENARIO URL [TOKEN]: one of the page's tests. Prints "passed" and figures, or what did not hold.

import { gzipSync } from "node:zlib";
import { changes, check, difference, json, launch, open, picture, please, problems, state, text, until } from "./browser.mjs";

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
  await until("the sky has colours", async () => (await picture(page, "#sky-canvas", "sky")).colours > 500);
  await changes(page, "the sky changes when the lamp moves", "#sky-canvas", "sky", 0.01);
  await page.locator("#scene-canvas").scrollIntoViewIfNeeded();
  // The map behind it moves too, and says nothing of the light on it.
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

/** Exposure, projection, the keyboard and the switches act; nothing is wider than a phone. */
async function controls(browser) {
  // The light stands still here, and so does the scene without motion: differences are ours.
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
  await until("the scene is drawn", async () => (await picture(page, "#scene-canvas", "scene")).colours > 200);
  for (let i = 0; i < 5; i++) await page.keyboard.press("ArrowLeft");
  await changes(page, "the keys turn the scene", "#scene-canvas", "scene", 0.05);
  await page.keyboard.press("Home");
  await until("and back", async () => (await picture(page, "#scene-canvas")).colours > 200 && await difference(page, "scene", "now") < 0.001);
  await page.check("#show-rays");
  await changes(page, "lines are drawn", "#scene-canvas", "scene", 0.005);
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
  await page.evaluate(() => document.querySelectorAll("#settings details").forEach(group => { group.open = true; }));
  const values = async () => (await json(page, "/v1/config")).values;
  const set = () => json(page, "/v1/lights");
  const names = Object.keys(await values()), tried = new Set();
  const act = async (name, change, seen) => {
    tried.add(name);
    await change(`#set-${name}`);
    await until(`${name} acts`, seen);
    check(await text(page, `#set-${name}-error`) === "", `${name}: ${await text(page, `#set-${name}-error`)}`);
  };
  const fill = value => selector => page.fill(selector, String(value)), choose = value => selector => page.selectOption(selector, value);
  const count = async () => Number.parseInt(await text(page, "#n-lights"), 10);
  const level = async () => Number.parseFloat(await text(page, "#n-illuminance"));
  await act("lights", fill(20), async () => await count() === 20);
  await act("tolerance", fill(0.3), async () => await count() < 20);
  await act("tolerance", fill(""), async () => await count() === 20);
  await act("ambient", s => page.check(s), async () => "ambient_sh" in await json(page, "/v1/lights?ambient=1"));
  await act("ambient", s => page.uncheck(s), async () => (await values()).ambient === false);
  const dark = await level();
  await act("extrapolation", choose("average"), async () => await level() > 1.02 * dark);
  await act("gui", s => page.check(s), async () => page.evaluate(async () => (await fetch("/screenshot")).status === 200));
  // Without the shortest exposure the lamp clips, and two pictures are left.
  await act("exposures_s", fill("0.02, 0.05"), async () => Number.parseFloat(await text(page, "#n-clipped")) > 0 && await page.locator("#burst figure").count() === 2);
  await page.fill("#set-exposures_s", "0.05, 0.02");
  await until("falling exposures are refused", async () => (await text(page, "#set-exposures_s-error")).includes("expected 1 to 12 rising numbers"));
  await page.fill("#set-exposures_s", "often");
  await until("words are refused", async () => (await text(page, "#set-exposures_s-error")).includes("expected numbers"));
  await act("exposures_s", fill(""), async () => Number.parseFloat(await text(page, "#n-clipped")) === 0 && await page.locator("#burst figure").count() === 3);
  await budgets(page, act, set, fill);
  await act("sampler", choose("pharr"), async () => (await set()).sampler === "pharr");
  await until("the page names the sampler", async () => (await page.locator("#tiles").textContent()).includes("pharr"));
  check(await page.isHidden("#set-tolerance"), "what has no effect is not shown");
  await filters(page, act, set, fill, choose);
  // A tree of more lights than a small map has quads.
  await act("sampler", choose("q2tree"), async () => (await set()).sampler === "q2tree");
  await act("lights", fill(3000), async () => await count() > 2900);
  await act("order", fill(4), async () => await count() < 2100);
  await act("order", fill(""), async () => await count() > 2900);
  const missed = names.filter(name => !tried.has(name));
  check(missed.length === 0, `settings that this test does not try: ${missed}`);
  await act("sampler", choose("pharr"), async () => (await set()).sampler === "pharr");
  // A wrong number, none, and a choice that does not go with another field.
  const before = JSON.stringify(await values());
  await page.fill("#set-lights", "-5");
  await until("a wrong number is refused", async () => (await text(page, "#set-lights-error")).includes("found -5, expected"));
  check(await page.getAttribute("#set-lights", "aria-invalid") === "true", "the field is marked");
  await page.fill("#set-lights", "2.5");
  await until("a broken number is refused", async () => (await text(page, "#set-lights-error")).includes("found 2.5, expected"));
  await page.fill("#set-lights", "");
  await until("no number is refused", async () => (await text(page, "#set-lights-error")).includes("no number"));
  await page.fill("#set-budget_front_ms", "0");
  await until("a budget of nothing is refused", async () => (await text(page, "#set-budget_front_ms-error")).includes("expected a number from 0.01"));
  check(JSON.stringify(await values()) === before, "nothing was changed");
  await page.fill("#set-lights", "3");
  await until("three lights", async () => await count() === 3 && await text(page, "#set-lights-error") === "");
  await page.selectOption("#set-sampler", "q2tree");
  await until("what does not go together is refused", async () => (await text(page, "#set-lights-error")).includes("for 'q2tree'"));
  check(await page.inputValue("#set-sampler") === "pharr", "the choice is taken back");
  // What another client changes shows here.
  await page.evaluate(() => fetch("/v1/config", { method: "PATCH", body: "{\"lights\": 33}" }));
  await until("another client's change shows", async () => await page.inputValue("#set-lights") === "33");
  const found = await problems(page);
  check(found.length === 0, found.join("\n"));
  check(faults.length === 0, faults.join("\n"));
  await context.close();
}

/** A budget that nothing keeps is overrun in the next set, one that all keep is not. */
async function budgets(page, act, set, fill) {
  for (const stage of ["capture", "front", "pyramid", "sample", "filter", "encode", "total"]) {
    const name = `budget_${stage}_ms`, shown = async ms => (await text(page, `#t-${stage}-budget`)).includes(` ${ms} ms`);
    const takesTime = !["filter", "encode"].includes(stage);
    await act(name, fill(0.01), async () => await shown(0.01) && (!takesTime || (await set()).overrun.includes(stage)));
    await act(name, fill(60000), async () => await shown(60000) && !(await set()).overrun.includes(stage));
  }
  await until("overruns are counted on the page", async () => /\d %/.test(await text(page, "#t-front-over")));
}

/** Filters over time slow lights down, q2tree's threshold keeps them. */
async function filters(page, act, set, fill, choose) {
  /** All sets of one turn of the film, which has eight frames, as pairs that follow each other; a busy machine may miss some. */
  const follow = async () => {
    const sets = [await set()];
    for (let i = 0; i < 40 && sets.at(-1).frame < sets[0].frame + 8; i++) sets.push(await json(page, `/v1/lights?after=${sets.at(-1).frame}`));
    check(sets.at(-1).frame >= sets[0].frame + 8, "the film goes on");
    return { frames: sets.at(-1).frame - sets[0].frame, pairs: sets.slice(1).map((next, i) => [sets[i].lights, next.lights]) };
  };
  /** Way that a light goes per frame, degrees. */
  const motion = async () => {
    const { frames, pairs } = await follow(), means = pairs.map(([before, now]) => {
      const steps = now.flatMap(({ id, direction: d }) => {
        const old = before.find(l => l.id === id)?.direction;
        return old ? [Math.acos(Math.min(1, d[0] * old[0] + d[1] * old[1] + d[2] * old[2])) * 180 / Math.PI] : [];
      });
      return steps.reduce((a, b) => a + b, 0) / Math.max(1, steps.length);
    });
    return means.reduce((a, b) => a + b, 0) / frames;
  };
  /** Lights that are born per frame. */
  const births = async () => {
    const { frames, pairs } = await follow();
    return pairs.reduce((sum, [before, now]) => sum + now.filter(l => !before.some(o => o.id === l.id)).length, 0) / frames;
  };
  await act("lights", fill(64), async () => (await set()).requested === 64);
  await act("sampler", choose("hemigon-fir"), async () => (await set()).sampler === "hemigon-fir");
  await act("fir_taps", fill(1), async () => (await json(page, "/v1/config")).values.fir_taps === 1);
  const free = await motion();
  check(free > 0, "the lamp moves");
  await act("fir_taps", fill(63), async () => await motion() < 0.6 * free);
  await act("fir_cutoff_hz", fill(5), async () => await motion() > 0.7 * free);
  await act("fir_cutoff_hz", fill(0.05), async () => await motion() < 0.6 * free);
  await act("sampler", choose("q2tree"), async () => (await set()).sampler === "q2tree");
  const born = await births();
  check(born > 0, "lights are born while the lamp moves");
  await act("q2tree_threshold", fill(10), async () => await births() < 0.5 * born);
}

/** Two methods on the same frames, side by side. */
async function compare(browser) {
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
  // Another choice, at once; a wrong one, refused in place.
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
  // While somebody else looks at another one, we have to wait, and go on by ourselves.
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
  check((await json(page, "/v1/config")).values.sampler === "adaptive", "nobody else's light has changed");
  check(faults.length === 0, faults.join("\n"));
  await context.close();
}

/** What is set is kept; the test that started this looks at the file. */
async function save(browser) {
  const { context, page, faults } = await open(browser, url, { reducedMotion: "reduce" });
  await state(page, "live");
  await page.waitForSelector("#save:enabled");
  await page.evaluate(() => document.querySelectorAll("#settings details").forEach(group => { group.open = true; }));
  for (const [name, value] of [["lights", "21"], ["budget_front_ms", "12.5"], ["exposures_s", "0.001, 0.02"]]) {
    await page.fill(`#set-${name}`, value);
    await until(`${name} is taken`, async () => JSON.stringify((await json(page, "/v1/config")).values[name]).replace(/[[\]]/g, "").replace(",", ", ") === value);
  }
  await page.click("#save");
  await until("it says so", async () => (await text(page, "#save-text")).startsWith("Saved"));
  check(faults.length === 0, faults.join("\n"));
  await context.close();
}

/** What is given up for speed hardly shows: light baked by normal against the sum over all lights, highlights of a few lights against those of all. */
async function shading(browser) {
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
    await page.waitForSelector(`#scene-canvas[data-quality$=' ${quality.glossy}']`);
    await picture(page, "#scene-canvas", name);
  };
  await page.locator("#scene-canvas").scrollIntoViewIfNeeded();
  const part = { shadows: 0, taps: 1, scale: 1 };
  for (const [name, glossy] of [["few", 6], ["none", 0], ["all", 64]]) await draw(name, { ...part, glossy });
  // Every picture is compared as if of one quality: that is what is asked.
  const [few, none] = await page.evaluate(() => ["few", "none"].map(name => {
    const [one, all] = [window.pictures[name].data, window.pictures.all.data];
    return one.reduce((sum, v, i) => sum + Math.abs(v - all[i]), 0) / one.length;
  }));
  check(few < none && few < 0.3, `highlights of a few lights are off by ${few} codes of 255`);
  check(faults.length === 0, faults.join("\n"));
  console.log(`baked light off by ${(100 * baked.rms).toFixed(3)} % of the mean, at most ${(100 * baked.most).toFixed(2)} %; six highlights by ${few.toFixed(3)} codes of 255, none by ${none.toFixed(3)}`);
  await context.close();
}

/** How fast it is here: told, not judged. Several tries, since others may be busy. */
async function speed(browser) {
  const best = { live: Infinity, sky: Infinity, scene: Infinity, rate: 0 };
  for (let i = 0; i < 4; i++) {
    const { context, page } = await open(browser, "about:blank", { isTimed: true });
    await page.addInitScript(() => {
      window.seen = { frames: 0 };
      const watch = (type, name, act) => {
        const real = type.prototype[name];
        type.prototype[name] = function (...all) { act(); return real.apply(this, all); };
      };
      watch(OffscreenCanvasRenderingContext2D, "putImageData", () => { window.seen.sky ??= performance.now(); });
      watch(WebGL2RenderingContext, "drawElements", () => { window.seen.scene ??= performance.now(); });
      // The sky behind is drawn once a picture.
      watch(WebGL2RenderingContext, "drawArrays", () => { window.seen.frames++; });
    });
    await page.goto(url);
    await state(page, "live");
    const live = await page.evaluate(() => performance.now());
    await until("the first picture", () => page.evaluate(() => window.seen.sky && window.seen.scene));
    const { sky, scene } = await page.evaluate(() => window.seen);
    await page.addStyleTag({ content: "#scene-canvas { width: 640px; height: 360px; aspect-ratio: auto }" });
    await page.locator("#scene-canvas").scrollIntoViewIfNeeded();
    await page.waitForTimeout(4000);
    const rate = await page.evaluate(async () => {
      const from = window.seen.frames, began = performance.now();
      await new Promise(done => setTimeout(done, 4000));
      return 1000 * (window.seen.frames - from) / (performance.now() - began);
    });
    const size = await page.evaluate(() => { const c = document.querySelector("#scene-canvas"); return `${c.width} x ${c.height}`; });
    console.log(`live ${live.toFixed(0)} ms, sky ${sky.toFixed(0)} ms, scene ${scene.toFixed(0)} ms, ${rate.toFixed(1)} pictures/s of ${size}, ${await text(page, "#scene-rate")}`);
    for (const [name, v] of Object.entries({ live, sky, scene })) best[name] = Math.min(best[name], v);
    best.rate = Math.max(best.rate, rate);
    await context.close();
  }
  console.log(`best: live ${best.live.toFixed(0)} ms, sky ${best.sky.toFixed(0)} ms, scene ${best.scene.toFixed(0)} ms, ${best.rate.toFixed(1)} pictures/s`);
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
  await until("the sky is there again", async () => (await picture(page, "#sky-canvas")).colours > 500);
  check(faults.length === 0, faults.join("\n"));
  await context.close();
}

const browser = await launch();
try {
  await { live, controls, settings, compare, save, shading, speed, login, restart }[scenario](browser);
  console.log("passed");
} catch (error) {
  console.log(`failed: ${error.message.replaceAll("\n", " ")}`);
} finally {
  await browser.close();
  process.exit();
}
