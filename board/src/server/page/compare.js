// Comparison with another sampler on the same frames: both light sets, and a table of their scores.

import { mix } from "/client.js";
import { curves, element, milliseconds, niceAbove, percent } from "./figures.js";

/** Pause before a repeated request while another comparison runs or the probe starts, ms, and pause after a change of the controls, ms. */
const PAUSE = 2000, TYPING = 350;

/** Time for which the probe keeps a sampler after its last client, ms: a request for another sampler before that would be refused. */
const HELD = 650;

/** Largest number of lights that the other sampler may have. */
const MOST = 2048;

/** Number of pairs of sets in the drawn history, and weight of the newest pair in the smoothed flicker. */
const KEPT = 300, SMOOTHING = 0.1;

/** Colours of the probe's own sampler and of the other one. */
export const COLOURS = ["#4c9be8", "#e8a33d"];

/** Rows of the table of scores: name, explanation, format, and the values of both sets. */
const ROWS = [
  ["Lights used", "", (v, of) => `${v} of ${of}`, (score, set) => [score.lights, set.requested]],
  ["Error, shadowed", "against the frame's own map", v => `${percent(v)} %`, score => [score.shadowed]],
  ["Error, open", "against the frame's own map, without occluders", v => `${percent(v)} %`, score => [score.open]],
  ["Estimated error", "the sampler's own estimate, shadowed", v => `${percent(v)} %`, score => [score.estimated_error]],
  ["Flicker", "change per frame beyond that of the map", v => `${percent(v)} %`, (score, set, flicker) => [flicker]],
  ["Sampler's time", "", v => `${milliseconds(v)} ms`, score => [score.sample_us]],
];

export class Comparison extends EventTarget {
  /** The newest pair of light sets; null before the first one. */
  pair = null;
  #parts; #cells = []; #previous = null; #arrived = 0; #interval = 100; #flicker = [null, null]; #history = [];
  #turn = 0; #timer = 0; #run = null; #asking = null; #ended = -HELD; #asked = "";

  /** `parts`: the controls `on`, `sampler`, `lights`, and the outputs `error`, `result`, `names`, `rows`, `history`. Dispatches "pair" and "end". */
  constructor(parts) {
    super();
    this.#parts = parts;
    parts.on.addEventListener("change", () => this.#begin());
    for (const control of [parts.sampler, parts.lights]) control.addEventListener("input", () => {
      clearTimeout(this.#timer);
      this.#timer = setTimeout(() => this.#begin(), control === parts.lights ? TYPING : 0);
    });
    for (const [name, what] of ROWS) {
      const row = parts.rows.insertRow(), head = document.createElement("th");
      head.scope = "row";
      head.append(name, element("small", what));
      row.append(head);
      this.#cells.push(COLOURS.map(colour => {
        const cell = row.insertCell(), text = cell.appendChild(document.createElement("span")), bar = cell.appendChild(document.createElement("i"));
        bar.style.background = colour;
        return { cell, text, bar };
      }));
    }
  }

  /** Sets the names of the samplers that can be selected. */
  set samplers(names) {
    const select = this.#parts.sampler, chosen = select.value || "q2tree";
    if ([...select.options].map(o => o.value).join() === names.join()) return;
    select.replaceChildren(...names.map(name => new Option(name, name, false, name === chosen)));
  }

  set locked(locked) {
    for (const control of [this.#parts.on, this.#parts.sampler, this.#parts.lights]) control.disabled = locked;
    if (locked) this.#parts.on.checked = false;
    if (locked) this.#begin();
  }

  get isOn() { return this.#parts.on.checked; }

  /** Returns both sets' lights for this time, interpolated like {@link Hemilux.interpolated}; null without a pair. */
  interpolated(now) {
    if (!this.pair) return null;
    const part = this.#previous ? Math.min(1, (now - this.#arrived) / this.#interval) : 1;
    return this.pair.sets.map((set, i) => part < 1 ? mix(this.#previous.sets[i].lights, set.lights, part) : set.lights);
  }

  /** Requests pairs repeatedly until another sampler or none is selected. */
  async #begin() {
    clearTimeout(this.#timer);
    const turn = ++this.#turn;
    this.#previous = null;
    this.#flicker = [null, null];
    this.#history = [];
    this.#fail("");
    this.#asking?.abort();
    const { sampler, lights } = this.#parts, wrong = this.isOn && unfit(lights);
    if (wrong) {
      this.#fail(wrong);
      return this.#end();
    }
    while (turn === this.#turn && this.isOn) {
      while (document.hidden) await sleep(PAUSE);
      const choice = `${sampler.value} ${lights.value}`;
      if (this.#asked && this.#asked !== choice) await sleep(this.#ended + HELD - performance.now());
      if (turn !== this.#turn) return;
      this.#asked = choice;
      this.#asking = new AbortController();
      const [state, answer] = await ask(sampler.value, lights.value, this.pair?.frame, this.#asking.signal);
      this.#ended = performance.now();
      if (turn !== this.#turn) return;
      if (state === 200) { this.#take(answer); continue; }
      this.#fail(state === 400 ? answer.split(". Accepted")[0] : answer);
      if (state === 401) this.dispatchEvent(new Event("denied"));
      if (state === 400 || state === 401 || state === 403) break;
      await sleep(PAUSE);
    }
    if (turn === this.#turn) this.#end();
  }

  #end() {
    this.pair = null;
    this.#parts.result.hidden = true;
    this.dispatchEvent(new Event("end"));
  }

  #fail(text) {
    if (this.#parts.error.textContent !== text) this.#parts.error.textContent = text;
    this.#parts.lights.setAttribute("aria-invalid", String(/lights/.test(text)));
  }

  #take(pair) {
    const now = performance.now(), isNew = pair.run !== this.#run || pair.frame !== this.pair?.frame;
    const follows = isNew && pair.run === this.#run && this.pair?.sets[1].sampler === pair.sets[1].sampler;
    this.#fail("");
    if (isNew) {
      if (follows) this.#interval = Math.min(1000, Math.max(5, now - this.#arrived));
      this.#previous = follows ? this.pair : null;
      this.#arrived = now;
    }
    this.#run = pair.run;
    this.pair = pair;
    pair.scores.forEach(({ flicker }, i) => {
      const old = this.#flicker[i];
      if (flicker !== null) this.#flicker[i] = old === null ? flicker : old + SMOOTHING * (flicker - old);
    });
    this.#history.push(pair.scores.map(score => score.shadowed));
    if (this.#history.length > KEPT) this.#history.shift();
    this.#parts.result.hidden = false;
    this.#write();
    this.dispatchEvent(new CustomEvent("pair", { detail: pair }));
  }

  #write() {
    const { sets, scores } = this.pair;
    this.#parts.names.forEach((name, i) => { if (name.textContent !== sets[i].sampler) name.textContent = sets[i].sampler; });
    ROWS.forEach(([, , text, of], row) => {
      const values = sets.map((set, i) => of(scores[i], set, this.#flicker[i])), known = values.map(v => v[0]).filter(v => v !== null);
      const most = Math.max(...known, 1e-12), least = Math.min(...known);
      values.forEach((value, i) => {
        const { cell, text: words, bar } = this.#cells[row][i], found = value[0] === null ? "–" : text(...value);
        if (words.textContent !== found) words.textContent = found;
        bar.style.width = `${value[0] === null ? 0 : 100 * value[0] / most}%`;
        cell.classList.toggle("best", known.length > 1 && value[0] === least && most > 1.05 * least);
      });
    });
    this.#draw();
  }

  /** Draws the shadowed errors of both sets over time. */
  #draw() {
    const canvas = this.#parts.history, top = niceAbove(1.15 * Math.max(...this.#history.flat(), 1e-6));
    curves(canvas, KEPT, top, COLOURS.map((colour, i) => [colour, this.#history.map(both => both[i])]), { label: `${percent(top)} %` });
    const [a, b] = this.#history.at(-1), { sets } = this.pair;
    canvas.setAttribute("aria-label", `Shadowed error of the last ${this.#history.length} frames; now ${sets[0].sampler} ${percent(a)} %, ${sets[1].sampler} ${percent(b)} %`);
  }
}

const sleep = ms => new Promise(done => setTimeout(done, Math.max(0, ms)));

/** Returns the error message of the field for the number of lights; empty if its value is accepted. */
function unfit({ value, validity }) {
  const isRight = !validity.badInput && /^\d+$/.test(value) && value >= 1 && value <= MOST;
  return isRight ? "" : `found lights '${validity.badInput ? "no number" : value}', expected 1 to ${MOST}`;
}

/** Requests a pair of light sets; returns status and answer: a pair, or one line of text. */
async function ask(algorithm, lights, after, signal) {
  const query = new URLSearchParams({ algorithm, lights, ...(after === undefined ? {} : { after }) });
  try {
    const answer = await fetch(`/v1/compare?${query}`, { cache: "no-store", signal });
    return [answer.status, answer.ok ? await answer.json() : (await answer.text()).trim()];
  } catch {
    return [0, "The probe does not answer."];
  }
}
