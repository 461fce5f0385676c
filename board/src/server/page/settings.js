// The settings, created from the schemas of /v1/config: a change is sent at once, and its error is shown next to its field.

import { field } from "./fields.js";

/** Time after the last keystroke or move of a slider until the change is sent, ms. */
const PAUSE = 250;

/** Groups that are open at first: those with the largest effect on the lights. */
const OPEN = ["lights"];

export class Settings extends EventTarget {
  #form; #save; #saveText; #fields = new Map(); #timers = new Map(); #serial = 0; #values = {}; #locked = false;

  /** Dispatches "denied" when the token is missing, and "changed" with the settings after a change. */
  constructor(form, save, saveText) {
    super();
    this.#form = form;
    this.#save = save;
    this.#saveText = saveText;
    form.addEventListener("submit", e => e.preventDefault());
    save.addEventListener("click", () => this.#keep());
  }

  /** Reads the settings again; fields that are being edited are not overwritten. */
  async load() {
    const answer = await fetch("/v1/config", { cache: "no-store" });
    if (answer.ok) this.#show(await answer.json());
  }

  /** Returns the value of the setting `name`; undefined before it is known. */
  value(name) { return this.#values[name]; }

  /** True if changes are not permitted. */
  set locked(locked) {
    this.#locked = locked;
    for (const field of this.#fields.values()) field.locked = locked;
    this.#save.disabled = locked;
  }

  #show({ values, settings, can_save, pending }) {
    this.#values = values;
    const names = Object.keys(settings).sort((a, b) => settings[a].position - settings[b].position);
    if (names.join() !== [...this.#fields.keys()].join()) {
      this.#fields = new Map(names.map(name => [name, field(name, settings[name], value => this.#later(name, value))]));
      const groups = new Map(names.map(name => [settings[name].group, settings[name].group_title]));
      this.#form.replaceChildren(...[...groups].map(([group, title]) => this.#group(group, title, names.filter(name => settings[name].group === group))));
      this.locked = this.#locked;
    }
    for (const name of names) this.#fields.get(name).show(settings[name], this.#timers.has(name));
    this.#save.hidden = !can_save;
    if (pending) this.#say("Accepted; it takes effect with the next frame, which has not been processed yet.");
    this.dispatchEvent(new CustomEvent("changed", { detail: settings }));
  }

  #group(group, title, names) {
    const box = document.createElement("details"), summary = document.createElement("summary");
    box.open = OPEN.includes(group);
    box.id = `group-${group}`;
    summary.textContent = title;
    box.append(summary, ...names.map(name => this.#fields.get(name).box));
    return box;
  }

  #later(name, value) {
    clearTimeout(this.#timers.get(name));
    this.#timers.set(name, setTimeout(() => {
      this.#timers.delete(name);
      this.#send(name, value);
    }, PAUSE));
  }

  async #send(name, value) {
    const wrong = this.#fields.get(name).wrong(value);
    if (wrong) return this.#fields.get(name).fail(wrong);
    const serial = ++this.#serial;
    for (const field of this.#fields.values()) field.fail("");
    this.#say("");
    const [status, answer] = await patch("/v1/config", { [name]: value });
    // The answer to a later change replaces this one.
    if (serial !== this.#serial) return;
    if (answer.settings) return this.#show(answer);
    if (status === 401) this.dispatchEvent(new Event("denied"));
    const errors = answer.errors ?? { [name]: answer.text };
    for (const one of Object.keys(errors)) this.#fields.get(one)?.reveal();
    for (const [field, text] of Object.entries(errors)) (this.#fields.get(field) ?? this.#fields.get(name)).fail(text);
    // A value that is refused because of another field's value is reset, and the other field shows the reason.
    if (!(name in errors)) {
      const texts = [...this.#fields.values()].map(f => f.text);
      await this.load();
      [...this.#fields.values()].forEach((f, i) => f.fail(texts[i]));
    }
  }

  async #keep() {
    const [, answer] = await patch("/v1/config?save=1", {});
    this.#say(answer.settings ? "Saved in the configuration file." : Object.values(answer.errors ?? { save: answer.text }).join(" "));
  }

  #say(text) {
    this.#saveText.textContent = text;
  }
}

/** Sends a change of settings; returns status and answer. An answer that is not JSON is in `text`. */
async function patch(url, wish) {
  try {
    const answer = await fetch(url, { method: "PATCH", headers: { "content-type": "application/json" }, body: JSON.stringify(wish) });
    const text = await answer.text();
    try { return [answer.status, JSON.parse(text)]; } catch { return [answer.status, { text: text.trim() }]; }
  } catch {
    return [0, { text: "not sent: the probe does not answer" }];
  }
}
