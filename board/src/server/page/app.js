// Entry point of the page: receives light sets as events, and requests pictures and the status while the page is visible.

import { Hemilux } from "/client.js";
import { Calibration } from "./calibration.js";
import { Burst } from "./burst.js";
import { Comparison } from "./compare.js";
import { Download } from "./download.js";
import { fixed } from "./figures.js";
import { continued, fetchMap, fetchMask } from "./map.js";
import { Numbers } from "./numbers.js";
import { Scene } from "./scene.js";
import { Settings } from "./settings.js";
import { Sky } from "./sky.js";
import { useIt } from "./snippets.js";
import { SourceChoice } from "./source.js";
import { Table } from "./table.js";
import { Times } from "./times.js";

/** Largest number of lights that the page requests: more dots could not be distinguished. */
const LIGHTS = 512;

/** Pauses between two requests for the map, for the mask, for the status and for the exposures, ms. */
const MAP_PAUSE = 400, MASK_PAUSE = 1000, STATUS_PAUSE = 1000, BURST_PAUSE = 3000;

/** Longest time for which the other requests and drawings of the page wait for the picture of the sky, ms. */
const SKY_FIRST = 1000;

const by = id => document.getElementById(id);
const sleep = ms => new Promise(done => setTimeout(done, ms));
const isStill = matchMedia("(prefers-reduced-motion: reduce)");

const sky = new Sky(by("sky-canvas"), by("sky-tip")), otherSky = new Sky(by("sky-canvas-2"), by("sky-tip-2"));
const numbers = new Numbers(by("tiles")), times = new Times(by("latency"));
const settings = new Settings(by("settings-form"), by("save"), by("save-text"));
const table = new Table(by("rows"), by("rows-text"), by("list").querySelector("details"));
const burst = new Burst(by("burst")), calibration = new Calibration();
const names = [...document.querySelectorAll("[data-of]")];
const comparison = new Comparison({
  on: by("compare-on"), sampler: by("compare-sampler"), lights: by("compare-lights"), error: by("compare-error"), result: by("compare-result"),
  names: [by("compare-first"), by("compare-second")], rows: by("compare-rows"), history: by("compare-history"),
});

const source = new SourceChoice(by("source"), by("source-text"), () => look());
const download = new Download({
  form: by("set-form"), lights: by("set-count"), lightsError: by("set-count-error"), set: by("set-link"), setText: by("set-text"),
  mapForm: by("map-form"), covers: by("map-covers"), width: by("map-width"), map: by("map-link"), mapText: by("map-text"),
});

/** Functions that resolve the pending promises of `ready`. */
const wakeUp = [];

/** `mayAll`: whether this page may get pictures and change settings; null before that is known. */
let probe = null, scene = null, known = null, status = null, answers = false, mayAll = null, changed = -1, shown = () => {};

function connect() {
  if (probe || document.hidden) return;
  probe = new Hemilux(location.origin, { ambient: "own", lights: LIGHTS });
  probe.addEventListener("set", ({ detail: set }) => take(set));
  probe.addEventListener("state", ({ detail: state }) => { tell(state); if (state === "lost") look(); });
}

function take(set) {
  if (!comparison.pair) sky.lights = set.lights;
  numbers.take(set);
  times.take(set);
  table.take(set);
  count(set);
  if (set.stale) tell("stale");
  scene?.draw();
}

/** Shows the number of lights. The sets of this page have at most LIGHTS lights; the status has the number of the probe's own set. */
function count(set) {
  const all = status?.last && status.run === set.run ? status.last : null;
  const isThinned = set.lights.length >= LIGHTS && all;
  numbers.count(isThinned ? all.lights : set.lights.length, settings.value("lights"), set.sampler);
}

function tell(state) {
  const set = probe?.latest, stale = set?.stale;
  // A probe whose camera is missing answers, but has no set to send.
  if (state === "lost" && answers) state = status.fault || !status.last ? "fault" : "again";
  const [word, text] = {
    live: () => ["Live", ""],
    stale: () => ["Stale", `the last frame is ${fixed(stale.age_ms / 1000, 1)} s old: ${stale.reason}`],
    fault: () => ["No light", status.fault ?? "the probe answers and waits for its first frame."],
    again: () => ["Connecting", "the probe answers; the stream of light sets is being opened again."],
    lost: () => ["Lost", set ? "the probe does not answer; the page shows its last set. Trying again…" : "the probe does not answer. Trying again…"],
  }[state]();
  const isNew = by("state").dataset.state !== state;
  by("state").dataset.state = document.body.dataset.state = state;
  by("state-word").textContent = word;
  by("state-text").textContent = text || (status ? `${status.source}, run ${status.run}` : "");
  document.title = state === "live" ? "hemilux" : `${word}: hemilux`;
  if (isNew && state === "live") wake();
}

/** Continues the request loops that wait in `ready`. */
function wake() {
  wakeUp.splice(0).forEach(go => go());
}

/** Waits until pictures may be requested. */
async function ready() {
  while (document.hidden || !mayAll || probe?.state !== "live") {
    await Promise.race([new Promise(go => wakeUp.push(go)), sleep(1000)]);
  }
}

/** Repeats `work` with a pause of `pause` ms while the page is visible. */
async function repeat(pause, work) {
  for (;;) {
    await ready();
    try { await work(); } catch { await look(); await sleep(500); }
    await sleep(pause);
  }
}

async function look() {
  let found;
  try {
    const answer = await fetch("/v1/status", { cache: "no-store" });
    if (!answer.ok) throw new Error(answer.statusText);
    found = await answer.json();
    answers = true;
  } catch {
    answers = false;
    if (probe?.state === "lost") tell("lost");
    return;
  }
  const isNewRun = status?.run !== found.run;
  status = found;
  numbers.status(found);
  times.status(found);
  source.name = download.source = found.source;
  if (mayAll !== found.allowed) {
    mayAll = found.allowed;
    settings.locked = comparison.locked = calibration.locked = source.locked = download.locked = !mayAll;
    by("login").hidden = mayAll;
    if (!mayAll) forget();
    wake();
  }
  if (isNewRun || changed !== found.changes) {
    await settings.load();
    changed = found.changes;
  }
  if (probe && (isNewRun || probe.state !== "stale")) tell(probe.state);
}

/** Removes pictures from the page when they may no longer be requested. */
function forget() {
  known = sky.map = sky.mask = otherSky.map = otherSky.mask = null;
  if (scene) scene.map = null;
  burst.clear();
  calibration.clear();
}

async function logIn(event) {
  event.preventDefault();
  by("login-error").textContent = "";
  try {
    const answer = await fetch("/login", { method: "POST", body: new URLSearchParams({ token: by("token").value }) });
    if (answer.status === 401) by("login-error").textContent = "That is not the token.";
    else if (!answer.ok) by("login-error").textContent = (await answer.text()).trim();
    else by("token").value = "";
  } catch { by("login-error").textContent = "The probe does not answer."; }
  await look();
}

/** Creates the lit scene with the options that its controls show. */
function lightScene() {
  try {
    scene = new Scene(by("scene-canvas"), supply, ({ rate, shadows, moving }) => {
      const text = `${moving && rate ? `${rate.toFixed(0)} pictures/s, ` : ""}${shadows > 1 ? `shadows of ${shadows} lights` : shadows ? "one shadow, of the brightest lights" : "no shadows"}`;
      if (by("scene-rate").textContent !== text) by("scene-rate").textContent = text;
    });
    scene.set({ sky: by("show-sky").checked, rays: by("show-rays").checked, shadows: by("show-shadows").value });
    scene.exposure = by("exposure").valueAsNumber;
    if (known) scene.map = continued(known);
  } catch (error) {
    by("scene-none").textContent = error.message;
    by("scene-none").hidden = false;
  }
}

/** Returns the lights for this time: interpolated between two sets, unless the user prefers reduced motion. */
function supply(now) {
  const set = probe?.latest, moving = probe?.state === "live" && !isStill.matches, { pair } = comparison;
  if (pair) {
    const lights = isStill.matches ? pair.sets.map(s => s.lights) : comparison.interpolated(now);
    return { views: pair.sets.map((s, i) => ({ lights: [...lights[i]], ambient: s.ambient_sh })), moving };
  }
  if (!set) return { views: [], moving: false };
  const lights = isStill.matches ? [...set.lights] : [...probe.interpolated(now)];
  return { views: [{ lights: settings.value("soft") ? lights.map(faced) : lights, ambient: set.ambient_sh }], moving };
}

/** Returns a light fitted as a disc, with the irradiance that a surface facing the disc receives. */
function faced(light) {
  const part = (1 + Math.cos(Math.min(90, light.radius_deg) * Math.PI / 180)) / 2;
  return { ...light, irradiance: light.irradiance.map(v => v * part) };
}

/** Shows two skies and two scenes during a comparison. */
function showPair({ detail: { sets } }) {
  document.body.classList.add("comparing");
  [sky, otherSky].forEach((one, i) => { one.lights = sets[i].lights; });
  for (const name of names) {
    const text = `${sets[name.dataset.of].sampler}, ${sets[name.dataset.of].lights.length} lights`;
    if (name.textContent !== text) name.textContent = text;
  }
  scene?.draw();
}

function showOne() {
  document.body.classList.remove("comparing");
  if (probe?.latest) sky.lights = probe.latest.lights;
  scene?.draw();
}

const skies = act => [sky, otherSky].forEach(act);

function controls() {
  by("login").addEventListener("submit", logIn);
  for (const radio of document.querySelectorAll("[name=view]")) radio.addEventListener("change", () => skies(one => { one.view = radio.value; }));
  by("exposure").addEventListener("input", e => {
    const ev = e.target.valueAsNumber;
    by("exposure-text").textContent = `${ev > 0 ? "+" : ev < 0 ? "−" : ""}${Math.abs(ev).toFixed(1)} EV`;
    skies(one => { one.exposure = ev; });
    if (scene) scene.exposure = ev;
  });
  by("show-dots").addEventListener("change", e => skies(one => { one.dots = e.target.checked; }));
  by("show-marks").addEventListener("change", e => skies(one => { one.marks = e.target.checked; }));
  for (const [id, option] of [["show-sky", "sky"], ["show-rays", "rays"]]) {
    by(id).addEventListener("change", e => scene?.set({ [option]: e.target.checked }));
  }
  by("show-shadows").addEventListener("change", e => scene?.set({ shadows: e.target.value }));
  settings.addEventListener("denied", look);
  settings.addEventListener("changed", ({ detail }) => {
    comparison.samplers = detail.sampler.enum;
    // Without the debug picture, the link leads to the setting that enables it.
    by("screenshot").href = detail.gui.value ? "/screenshot" : "#set-gui";
  });
  by("screenshot").addEventListener("click", () => { if (by("screenshot").hash) by("group-other").open = true; });
  useIt({ choice: by("use-choice"), note: by("use-note"), text: by("use-text"), copy: by("use-copy"), told: by("use-told") });
  comparison.addEventListener("denied", look);
  comparison.addEventListener("pair", showPair);
  comparison.addEventListener("end", showOne);
  document.addEventListener("visibilitychange", () => {
    // Browsers limit the connections to a server: a hidden page closes its connection.
    if (document.hidden) { probe?.close(); probe = null; } else { connect(); wake(); }
  });
}

controls();
settings.locked = comparison.locked = source.locked = download.locked = true;
connect();
look();
setInterval(() => { if (!document.hidden) look(); }, STATUS_PAUSE);
repeat(MAP_PAUSE, async () => {
  const map = await fetchMap();
  if (!map || !mayAll) return;
  known = map;
  skies(one => { one.map = map; });
  if (scene) scene.map = continued(map);
  else requestAnimationFrame(() => setTimeout(shown));
});
// The sky is drawn first, if there is a map: without a GPU the scene takes long to create, and the probe makes one picture at a time.
Promise.race([new Promise(done => { shown = done; }), sleep(SKY_FIRST)]).then(() => {
  repeat(MASK_PAUSE, async () => { const mask = await fetchMask(); if (mask && mayAll) skies(one => { one.mask = mask; }); });
  repeat(MAP_PAUSE, () => calibration.refresh());
  repeat(BURST_PAUSE, () => burst.load());
  setTimeout(lightScene);
});
