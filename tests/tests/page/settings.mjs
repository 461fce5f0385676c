// The settings of the page.

import { check, json, open, problems, state, text, until } from "./browser.mjs";

/** Every setting has an effect; wrong input is refused beside its field and changes nothing. */
export async function settings(browser, url) {
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
  await act("ambient", s => page.check(s), async () => "ambient_sh" in await json(page, "/v1/lights?ambient=own"));
  await act("ambient", s => page.uncheck(s), async () => !("ambient_sh" in await json(page, "/v1/lights?ambient=own")));
  // The lamp moves, so that only sets of one frame can be compared.
  const fits = wanted => page.evaluate(async wanted => {
    const get = async query => (await fetch(`/v1/lights?${query}`)).json(), after = `after=${(await get("")).frame}`;
    const [own, points, discs] = await Promise.all([get(after), get(`soft=0&${after}`), get(`soft=1&${after}`)]);
    if (own.frame !== points.frame || own.frame !== discs.frame) return false;
    const alike = other => JSON.stringify(other.lights) === JSON.stringify(own.lights);
    return alike(points) === (wanted === "points") && alike(discs) === (wanted === "discs");
  }, wanted);
  await act("soft", s => page.check(s), () => fits("discs"));
  await act("soft", s => page.uncheck(s), () => fits("points"));
  const dark = await level();
  await act("extrapolation", choose("average"), async () => await level() > 1.02 * dark);
  await act("tiers", fill(7), async () => (await json(page, "/v1/status")).tiers.most === 7);
  // Budgets that are always exceeded would reduce the quality of later sets.
  await act("degrade", s => page.uncheck(s), async () => (await values()).degrade === false);
  await act("mains", choose("off"), async () => (await values()).mains === "off");
  // The flicker of lamps is removed from bursts alone, so that the window can slide only with mains off.
  await act("window", choose("sliding"), async () => (await values()).window === "sliding");
  await act("window", choose("burst"), async () => (await values()).window === "burst");
  await act("merge", choose("all"), async () => (await values()).merge === "all");
  await act("auto_exposures", s => page.check(s), async () => (await values()).auto_exposures === true);
  await act("auto_exposures", s => page.uncheck(s), async () => await page.locator("#burst figure").count() === 3);
  await act("gui", s => page.check(s), async () => page.evaluate(async () => (await fetch("/screenshot")).status === 200));
  // Without the shortest exposure the lamp clips, and two pictures are left.
  await act("exposures_s", fill("0.02, 0.05"), async () => Number.parseFloat(await text(page, "#n-clipped")) > 0 && await page.locator("#burst figure").count() === 2);
  await page.fill("#set-exposures_s", "0.05, 0.02");
  await until("falling exposures are refused", async () => (await text(page, "#set-exposures_s-error")).includes("expected 1 to 12 rising numbers"));
  await page.fill("#set-exposures_s", "often");
  await until("words are refused", async () => (await text(page, "#set-exposures_s-error")).includes("expected 1 to 12 rising numbers"));
  await act("exposures_s", fill(""), async () => Number.parseFloat(await text(page, "#n-clipped")) === 0 && await page.locator("#burst figure").count() === 3);
  await budgets(page, act, set, fill);
  await act("sampler", choose("pharr"), async () => (await set()).sampler === "pharr");
  await until("the page names the sampler", async () => (await page.locator("#tiles").textContent()).includes("pharr"));
  check(await page.isHidden("#set-tolerance"), "what has no effect is not shown");
  await filters(page, act, set, fill, choose);
  // On a map of low order the tree has fewer quads than the requested lights.
  await act("sampler", choose("q2tree"), async () => (await set()).sampler === "q2tree");
  await act("lights", fill(3000), async () => await count() > 2900);
  await act("order", fill(4), async () => await count() < 2100);
  await act("order", fill(""), async () => await count() > 2900);
  const missed = names.filter(name => !tried.has(name));
  check(missed.length === 0, `settings that this test does not try: ${missed}`);
  await act("sampler", choose("pharr"), async () => (await set()).sampler === "pharr");
  // A wrong number, an empty field, and a choice that is invalid with the value of another field.
  const before = JSON.stringify(await values());
  await page.fill("#set-lights", "-5");
  await until("a wrong number is refused", async () => (await text(page, "#set-lights-error")).includes("found -5, expected"));
  check(await page.getAttribute("#set-lights", "aria-invalid") === "true", "the field is marked");
  await page.fill("#set-lights", "2.5");
  await until("a broken number is refused", async () => (await text(page, "#set-lights-error")).includes("found 2.5, expected"));
  await page.fill("#set-lights", "");
  await until("no number is refused", async () => (await text(page, "#set-lights-error")).includes("found nothing, expected"));
  await page.fill("#set-budget_front_ms", "0");
  await until("a budget of nothing is refused", async () => (await text(page, "#set-budget_front_ms-error")).includes("expected a number from 0.01"));
  check(JSON.stringify(await values()) === before, "nothing was changed");
  await page.fill("#set-lights", "3");
  await until("three lights", async () => await count() === 3 && await text(page, "#set-lights-error") === "");
  await page.selectOption("#set-sampler", "q2tree");
  await until("what does not go together is refused", async () => (await text(page, "#set-lights-error")).includes("for 'q2tree'"));
  check(await page.inputValue("#set-sampler") === "pharr", "the choice is taken back");
  // A change by another client is displayed.
  await page.evaluate(() => fetch("/v1/config", { method: "PATCH", body: "{\"lights\": 33}" }));
  await until("another client's change shows", async () => await page.inputValue("#set-lights") === "33");
  const found = await problems(page);
  check(found.length === 0, found.join("\n"));
  check(faults.length === 0, faults.join("\n"));
  await context.close();
}

/** A budget below every duration is exceeded in the next set, a budget above every duration is not. */
async function budgets(page, act, set, fill) {
  for (const stage of ["capture", "front", "pyramid", "sample", "filter", "encode", "total"]) {
    const name = `budget_${stage}_ms`, shown = async ms => (await text(page, `#t-${stage}-budget`)).includes(` ${ms} ms`);
    const takesTime = !["filter", "encode"].includes(stage);
    await act(name, fill(0.01), async () => await shown(0.01) && (!takesTime || (await set()).overrun.includes(stage)));
    await act(name, fill(60000), async () => await shown(60000) && !(await set()).overrun.includes(stage));
  }
  await until("overruns are counted on the page", async () => /\d %/.test(await text(page, "#t-front-over")));
}

/** Filters over time slow lights down; q2tree's threshold keeps lights in place. */
async function filters(page, act, set, fill, choose) {
  /** Returns all sets of one turn of the film, which has eight frames, as successive pairs; a busy machine may miss some. */
  const follow = async () => {
    const sets = [await set()];
    for (let i = 0; i < 40 && sets.at(-1).frame < sets[0].frame + 8; i++) sets.push(await json(page, `/v1/lights?after=${sets.at(-1).frame}`));
    check(sets.at(-1).frame >= sets[0].frame + 8, "the film goes on");
    return { frames: sets.at(-1).frame - sets[0].frame, pairs: sets.slice(1).map((next, i) => [sets[i].lights, next.lights]) };
  };
  /** Returns the angle that a light moves per frame, degrees. */
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
  /** Returns the number of new lights per frame. */
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

/** Settings are saved; the test program checks the file. */
export async function save(browser, url) {
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
