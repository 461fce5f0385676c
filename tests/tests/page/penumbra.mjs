// Compares shadows of a disc in the page's scene with the mean of hard shadows of points on the disc, drawn by the same scene.

import { check, json, open, picture, state } from "./browser.mjs";

/** The disc's angular radius, degrees, its centre, and the number of points on it. */
const RADIUS_DEG = 8, CENTRE = [0.6, 0.3, 0.74], POINTS = 48;

/** Runs in the page: `draw(direction, radius_deg, quality)` returns the linear luminance of each pixel. */
async function studio() {
  const { Scene } = await import("/page/scene.js"), { LADDER } = await import("/page/quality.js");
  const canvas = Object.assign(document.createElement("canvas"), { style: "position: fixed; inset: 0 auto auto 0; z-index: 9; width: 360px; height: 240px" });
  document.body.append(canvas);
  let lights = [], drawn = () => {};
  const scene = new Scene(canvas, () => ({ views: lights.length ? [{ lights, ambient: null }] : [], moving: false }), () => drawn());
  // The inverse of the display's transfer function.
  const linear = code => code <= 0.04045 ? code / 12.92 : ((code + 0.055) / 1.055) ** 2.4;
  const radiance = shown => shown >= 0.999 ? 10 : (shown / (1 - shown)) ** (1 / 1.1) / 2.2;
  window.draw = async (direction, radius_deg, quality) => {
    Object.assign(LADDER[0], { shadows: 1, scale: 1, glossy: 0, ...quality });
    // The irradiance of the ground is equal for all, and so is the exposure.
    lights = [{ id: 1, direction, irradiance: [1, 1, 1].map(v => v / direction[2]), radius_deg }];
    const next = new Promise(done => { drawn = done; });
    scene.set({ sky: false, rays: false, shadows: "all" });
    await next;
    const { width, height } = canvas, pen = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
    pen.drawImage(canvas, 0, 0);
    const { data } = pen.getImageData(0, 0, width, height);
    return Float32Array.from({ length: width * height }, (_, i) => {
      const [r, g, b] = data.subarray(4 * i, 4 * i + 3).map(v => v);
      return radiance(0.2126 * linear(r / 255) + 0.7152 * linear(g / 255) + 0.0722 * linear(b / 255));
    });
  };
}

/** Returns points spread evenly over the disc. */
function disc() {
  const length = Math.hypot(...CENTRE), [x, y, z] = CENTRE.map(v => v / length), s = Math.hypot(x, y), u = [-y / s, x / s, 0], v = [-z * x / s, -z * y / s, s];
  return Array.from({ length: POINTS }, (_, k) => {
    // The points represent equal areas of the cap.
    const cos = 1 - (1 - Math.cos(RADIUS_DEG * Math.PI / 180)) * (k + 0.5) / POINTS, sin = Math.sqrt(1 - cos * cos), a = 2.399963 * k;
    return [x, y, z].map((c, i) => cos * c + sin * (Math.cos(a) * u[i] + Math.sin(a) * v[i]));
  });
}

export async function penumbra(browser, url) {
  const { context, page, faults } = await open(browser, url, { reducedMotion: "reduce" });
  await state(page, "live");
  await page.evaluate(studio);
  const errors = await page.evaluate(async ([points, centre, radius]) => {
    const hard = { search: 0, taps: 1 };
    await window.draw(centre, 0, hard);
    let mean = null;
    for (const direction of points) {
      const one = await window.draw(direction, 0, hard);
      mean = mean ? mean.map((v, i) => v + one[i] / points.length) : one.map(v => v / points.length);
    }
    const level = mean.reduce((sum, v) => sum + v, 0) / mean.length;
    const off = found => Math.sqrt(found.reduce((sum, v, i) => sum + (v - mean[i]) ** 2, 0) / mean.length) / level;
    return [off(await window.draw(centre, 0, hard)), off(await window.draw(centre, radius, { search: 0, taps: 8 })), off(await window.draw(centre, radius, { search: 12, taps: 16 }))];
  }, [disc(), CENTRE.map(v => v / Math.hypot(...CENTRE)), RADIUS_DEG]);
  const [hard, even, soft] = errors.map(v => `${(100 * v).toFixed(2)} %`);
  console.log(`against ${POINTS} points on a disc of ${RADIUS_DEG} degrees, of the mean: ${hard} hard, ${even} with even penumbras, ${soft} with those that widen`);
  check(errors[2] < 0.4 * errors[0] && errors[2] < 0.75 * errors[1], `${errors}`);
  check(faults.length === 0, faults.join("\n"));
  await context.close();
}

/** Least share of the pixels that the shadows of a renderer without a GPU change by more than five codes, with the room's 64 lights. */
const SEEN = 0.05;

/** Without a GPU: the disc of the brightest lights has their energy, does not jump, and its shadow is visible. */
export async function gathered(browser, url) {
  const { context, page, faults } = await open(browser, url, { reducedMotion: "reduce" });
  await state(page, "live");
  const { lights } = await json(page, "/v1/lights");
  const found = await page.evaluate(async lights => {
    const { Gathering } = await import("/page/gathering.js"), { luminance } = await import("/page/map.js");
    const sorted = lights.sort((a, b) => luminance(...b.irradiance) - luminance(...a.irradiance)), sum = all => all.reduce((s, { irradiance }) => s + irradiance[1], 0);
    const gathering = new Gathering(), parts = gathering.split(sorted), [disc] = parts;
    // The lights are the same, but another light is the brightest by a small difference.
    const other = sorted.reduce((far, l) => l.direction.reduce((d, v, i) => d + v * disc.direction[i], 0) < 0.3 ? far ?? l : far, null);
    const rival = { ...other, irradiance: sorted[0].irradiance.map(v => 1.05 * v) }, [kept] = gathering.split([rival, ...sorted.filter(l => l !== other)]);
    return { ratio: sum(parts) / sum(lights), share: disc.irradiance[1] / sum(lights), first: sorted[0].irradiance[1] / sum(lights),
      turned: Math.acos(Math.min(1, kept.direction.reduce((d, v, i) => d + v * disc.direction[i], 0))) * 180 / Math.PI };
  }, lights);
  check(Math.abs(found.ratio - 1) < 1e-9, `the parts have ${found.ratio} of the light`);
  check(found.share > 3 * found.first && found.turned < 2, JSON.stringify(found));
  await page.locator("#scene-canvas").scrollIntoViewIfNeeded();
  for (const [name, choice] of [["auto", "auto"], ["none", "none"]]) {
    await page.selectOption("#show-shadows", choice);
    await page.waitForSelector(`#scene-canvas[data-quality^='shadows of ${choice === "none" ? 0 : 1} ']`);
    await picture(page, "#scene-canvas", name);
  }
  const seen = await page.evaluate(() => {
    const [auto, none] = ["auto", "none"].map(name => window.pictures[name].data);
    return auto.reduce((sum, v, i) => sum + (i % 4 === 1 && Math.abs(v - none[i]) > 5), 0) / (auto.length / 4);
  });
  console.log(`the disc has ${(100 * found.share).toFixed(0)} % of the light, the brightest light ${(100 * found.first).toFixed(0)} %; its shadow changes ${(100 * seen).toFixed(1)} % of the pixels`);
  check(seen > SEEN, `a shadow on ${seen} of the pixels`);
  check(faults.length === 0, faults.join("\n"));
  await context.close();
}
