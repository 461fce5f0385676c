// Calibration of lens, vignetting, response and lux. The probe keeps the readings; files are written by "Save" alone.

import { Outline } from "./outline.js";

const by = id => document.getElementById(id);
const sleep = ms => new Promise(done => setTimeout(done, ms));

/** Pause between two searches for a board, ms. */
const PAUSE = 150;

export class Calibration {
  #state = null; #part = "lens"; #locked = true; #isTaking = false; #isBusy = false; #url = null; #outline;

  constructor() {
    this.#outline = new Outline(by("cal-marks"));
    this.#outline.onCircle = circle => this.#do({ do: "circle", ...circle, field_deg: this.#field });
    for (const choice of document.querySelectorAll("[name=cal-part]")) choice.addEventListener("change", () => this.#choose(choice.value));
    const press = (id, act) => by(id).addEventListener("click", act);
    press("cal-start", () => this.#isTaking ? this.#stop() : this.#take());
    press("cal-compute", () => { this.#stop(); this.#do({ do: "compute" }, "Computing…"); });
    press("cal-find", () => this.#do({ do: "find-circle", field_deg: this.#field }));
    press("cal-screen", () => this.#do({ do: "screen" }));
    press("cal-flat", () => this.#do({ do: "flat" }));
    press("cal-fit", () => this.#do({ do: "fit-vignetting" }));
    press("cal-response", () => this.#do({ do: "response" }, "Computing…"));
    press("cal-measure", () => this.#measure());
    press("cal-undo", () => this.#undo());
    press("cal-save", () => this.#save());
    by("cal-method").addEventListener("change", () => this.#show());
    by("cal-open").addEventListener("toggle", () => this.#isOpen && this.load());
  }

  set locked(is) {
    this.#locked = is;
    for (const control of by("calibration").querySelectorAll("button, input, select")) control.disabled = is;
    if (is) this.#stop();
    else this.#show();
  }

  get #isOpen() { return by("cal-open").open && !this.#locked; }
  get #field() { return Number(by("cal-field").value) || 180; }

  /** Requests the state of the calibration, which other clients may have changed. */
  async load() {
    if (this.#isOpen && !this.#isBusy) await this.#ask("GET");
  }

  /** Shows the camera's present picture; called repeatedly. */
  async refresh() {
    if (!this.#isOpen || this.#isBusy) return;
    const answer = await fetch("/v1/image/0", { cache: "no-store" }), count = Number(answer.headers.get("hemilux-exposures")) || 1;
    const middle = count > 2 ? await fetch(`/v1/image/${Math.floor(count / 2)}`, { cache: "no-store" }) : answer;
    if (!middle.ok) return;
    const old = this.#url, url = URL.createObjectURL(await middle.blob());
    by("cal-image").src = this.#url = url;
    if (old) URL.revokeObjectURL(old);
  }

  clear() {
    if (this.#url) URL.revokeObjectURL(this.#url);
    this.#url = null;
    by("cal-image").removeAttribute("src");
  }

  #choose(part) {
    this.#part = part;
    if (part !== "lens") this.#stop();
    by("cal-error").textContent = "";
    for (const controls of document.querySelectorAll("[data-part]")) controls.hidden = controls.dataset.part !== part;
    this.#show();
  }

  #stop() {
    this.#isTaking = false;
    by("cal-start").textContent = "Take pictures";
  }

  async #take() {
    if (!await this.#do({ do: "start", kind: by("cal-kind").value, board: by("cal-board").value })) return;
    this.#isTaking = true;
    by("cal-start").textContent = "Stop";
    while (this.#isTaking && this.#isOpen) {
      await this.#ask("POST", { do: "look" });
      await sleep(PAUSE);
    }
    this.#stop();
  }

  #measure() {
    const lux = Number(by("cal-lux").value), reading = by("cal-class").value.trim();
    if (by("cal-method").value === "direct") return this.#do({ do: "direct", lux, class: reading || null });
    const outline = this.#outline.patch;
    return this.#do({ do: "patch", outline, reflectance: Number(by("cal-reflectance").value), lux, class: reading || null });
  }

  #undo() {
    if (this.#part === "photometric" && by("cal-method").value === "patch" && this.#outline.undoPatch()) return;
    this.#do({ do: "undo", part: this.#part });
  }

  async #save() {
    this.#stop();
    if (!await this.#do({ do: "save", force: by("cal-force").checked }, "Saving…")) return;
    by("cal-text").textContent = "Saved: it takes effect at the next start of the probe.";
    by("cal-force").checked = false;
    this.#outline.clearPatch();
  }

  /** Sends an action of the calibration; one action runs at a time. Returns true if it succeeded. */
  async #do(action, text = "") {
    by("cal-text").textContent = text;
    const done = await this.#ask("POST", action);
    if (text && by("cal-text").textContent === text) by("cal-text").textContent = "";
    return done;
  }

  async #ask(method, action) {
    while (this.#isBusy) await sleep(50);
    this.#isBusy = true;
    try {
      const options = action ? { method, body: JSON.stringify(action), headers: { "content-type": "application/json" } } : { method };
      const answer = await fetch("/v1/calibration", { ...options, cache: "no-store" });
      const document = await answer.json();
      const why = answer.ok ? "" : Object.values(document.errors ?? { do: "the probe refused" }).join(" ");
      if (answer.ok) this.#state = document;
      if (action) by("cal-error").textContent = why;
      return answer.ok;
    } catch {
      if (action) by("cal-error").textContent = "The probe does not answer.";
      return false;
    } finally {
      this.#isBusy = false;
      this.#show();
    }
  }

  #show() {
    const state = this.#state, isPatch = this.#part === "photometric" && by("cal-method").value === "patch";
    by("cal-reflectance-of").hidden = by("cal-patch-hint").hidden = !isPatch;
    this.#outline.takesPatch = isPatch;
    this.#outline.draw({ state, part: this.#part });
    if (this.#locked) return;
    by("cal-compute").disabled = (state?.guide?.views ?? 0) < 3;
    by("cal-save").disabled = !state?.unsaved || !state.can_save;
    by("cal-save").title = state && !state.can_save ? "The probe was started without a lens file to write" : "";
    by("cal-advice").textContent = this.#part === "lens" && state?.guide ? advice(state.guide) : "";
    const rows = state ? RESULTS[this.#part](state) : [];
    by("cal-result").replaceChildren(...rows.flatMap(([name, value]) => {
      const box = document.createElement("div"), term = document.createElement("dt"), figure = document.createElement("dd");
      [term.textContent, figure.textContent] = [name, value];
      box.append(term, figure);
      return [box];
    }));
  }
}

function advice({ views, advice, lacking }) {
  const missing = lacking ? ` The board has not been at ${lacking}.` : " The view is covered.";
  return `${views} pictures. ${advice[0].toUpperCase()}${advice.slice(1)}.${views ? missing : ""}`;
}

const fixed = (v, digits) => Number(v).toFixed(digits);
const percent = v => `${fixed(100 * v, 1)} %`;

/** For each part of the calibration, the rows of a table: name and value of each known result. */
const RESULTS = {
  lens({ guide, lens }) {
    const rows = guide ? [["Pictures", guide.views], ["View covered", percent(guide.share)]] : [];
    if (lens?.method !== "board") return rows;
    const worst = Math.max(...lens.uncertainty_deg.map(([, v]) => v));
    return [...rows, ["Error", `${fixed(lens.rms_px, 3)} px`], ["Covered up to", `${fixed(lens.covered_deg, 1)}°`], ["Uncertain by at most", `${fixed(worst, 3)}°`]];
  },
  circle({ circle, lens }) {
    if (!circle) return [];
    const worst = lens?.uncertainty_deg ? Math.max(...lens.uncertainty_deg.map(([, v]) => v)) : 0;
    return [["Centre", circle.centre.map(v => fixed(v, 1)).join(", ")], ["Radius", `${fixed(circle.radius, 1)} px`], ["Uncertain by up to", `${fixed(worst, 1)}°`]];
  },
  vignetting({ vignetting: { readings, fitted } }) {
    const rows = [["Readings", readings.length]];
    if (readings.length) rows.push(["Up to", `${fixed(Math.max(...readings.map(([theta]) => theta)), 0)}°`]);
    return fitted ? [...rows, ["Fit within", percent(fitted.rms)], ["Worst", percent(fitted.largest)]] : rows;
  },
  response({ response }) {
    return response ? response.neighbours.map(n => [`Ratio ${fixed(n.declared, 2)}`, `${fixed(n.estimated, 2)}, within ${percent(n.disagreement)}`]) : [];
  },
  photometric({ photometric }) {
    return photometric.map(r => [`${r.class}, ${r.method}`, `${Number(r.factor).toPrecision(4)} lux within ${percent(r.uncertainty)}`]);
  },
};
