// The settings, made from what /v1/config says of each: a change is sent at once, and what is wrong with it stands beside its field.

/** Time after the last keystroke or move of a slider until it is sent, ms. */
const PAUSE = 250;

/** Those that come first, and a name that says more than the short one. */
const ORDER = ["sampler", "lights", "tolerance", "ambient", "extrapolation"], TITLES = { gui: "Debug picture" };

/** Above so many values a slider's steps grow with the value. */
const LINEAR = 100;

export class Settings extends EventTarget {
  #form; #save; #saveText; #fields = new Map(); #timers = new Map(); #serial = 0; #values = {};

  /** Dispatches "denied" when the token is missing, and "changed" with the settings after a change. */
  constructor(form, save, saveText) {
    super();
    this.#form = form;
    this.#save = save;
    this.#saveText = saveText;
    form.addEventListener("submit", e => e.preventDefault());
    save.addEventListener("click", () => this.#keep());
  }

  /** Reads the settings anew; what somebody is typing stays. */
  async load() {
    const answer = await fetch("/v1/config", { cache: "no-store" });
    if (answer.ok) this.#show(await answer.json());
  }

  /** The value of a setting, undefined before it is known. */
  value(name) { return this.#values[name]; }

  /** Whether changes are let through. */
  set locked(locked) {
    for (const control of this.#form.querySelectorAll("input, select")) control.disabled = locked;
    this.#save.disabled = locked;
    this.#form.dataset.locked = locked;
  }

  #show({ values, settings, can_save, pending }) {
    this.#values = values;
    const place = name => ORDER.includes(name) ? ORDER.indexOf(name) : ORDER.length;
    const names = Object.keys(settings).sort((a, b) => place(a) - place(b));
    if (names.join() !== [...this.#fields.keys()].join()) {
      this.#fields = new Map(names.map(name => [name, field(name, settings[name], value => this.#later(name, value))]));
      this.#form.replaceChildren(...[...this.#fields.values()].map(f => f.box));
      if (this.#form.dataset.locked === "true") this.locked = true;
    }
    for (const name of names) this.#fields.get(name).show(settings[name], this.#timers.has(name));
    this.#save.hidden = !can_save;
    if (pending) this.#say("Accepted; it takes effect with the next frame, which has not come yet.");
    this.dispatchEvent(new CustomEvent("changed", { detail: settings }));
  }

  #later(name, value) {
    clearTimeout(this.#timers.get(name));
    this.#timers.set(name, setTimeout(() => {
      this.#timers.delete(name);
      this.#send(name, value);
    }, PAUSE));
  }

  async #send(name, value) {
    if (value === undefined) return this.#fields.get(name).fail("found no number");
    const serial = ++this.#serial;
    for (const field of this.#fields.values()) field.fail("");
    this.#say("");
    const [status, answer] = await patch("/v1/config", { [name]: value });
    // A later change answers for all.
    if (serial !== this.#serial) return;
    if (answer.settings) return this.#show(answer);
    if (status === 401) this.dispatchEvent(new Event("denied"));
    const errors = answer.errors ?? { [name]: answer.text };
    for (const [field, text] of Object.entries(errors)) (this.#fields.get(field) ?? this.#fields.get(name)).fail(text);
    // A choice that does not go together with another field's value is taken back, and that field says why.
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

/** Status and answer of a change; an answer that is no JSON is its `text`. */
async function patch(url, wish) {
  try {
    const answer = await fetch(url, { method: "PATCH", headers: { "content-type": "application/json" }, body: JSON.stringify(wish) });
    const text = await answer.text();
    try { return [answer.status, JSON.parse(text)]; } catch { return [answer.status, { text: text.trim() }]; }
  } catch {
    return [0, { text: "not sent: the probe does not answer" }];
  }
}

/** A row with label, control, explanation and place for an error; `change` is called with each new value, undefined for none. */
function field(name, schema, change) {
  const box = document.createElement("div"), row = make("div", { className: "row" }), id = `set-${name}`;
  const control = kind(schema)(id, schema, change);
  const label = make("label", { className: "name", htmlFor: id, textContent: TITLES[name] ?? name[0].toUpperCase() + name.slice(1).replaceAll("_", " ") });
  const hint = make("p", { className: "hint", id: `${id}-hint` }), error = make("p", { className: "error", id: `${id}-error` });
  error.setAttribute("role", "alert");
  row.append(label, ...control.parts);
  box.append(row, hint, error);
  for (const part of control.parts) part.setAttribute("aria-describedby", `${hint.id} ${error.id}`);
  const fail = text => {
    error.textContent = text;
    control.parts.forEach(part => part.setAttribute("aria-invalid", String(Boolean(text))));
  };
  let shown;
  const show = (schema, isBusy) => {
    hint.textContent = `${schema.description} ${range(schema)}`;
    const value = JSON.stringify(schema.value);
    // What is wrong stays to be seen until it is mended or the value changes.
    if (isBusy || (error.textContent && value === shown)) return;
    shown = value;
    control.show(schema);
    fail("");
  };
  return { box, fail, show, get text() { return error.textContent; } };
}

function range({ minimum, maximum, unit }) {
  return minimum === undefined ? "" : `${minimum} to ${maximum}${unit ? ` ${unit}` : ""}.`;
}

function kind({ type, enum: words }) {
  if (words) return choice;
  if (type === "boolean") return toggle;
  return [].concat(type).includes("null") ? optional : number;
}

function choice(id, { enum: words }, change) {
  const select = make("select", { id });
  select.append(...words.map(word => make("option", { value: word, textContent: word })));
  select.addEventListener("change", () => change(select.value));
  return { parts: [select], show: ({ value }) => { select.value = value; } };
}

function toggle(id, _, change) {
  const box = make("input", { id, type: "checkbox" });
  box.addEventListener("change", () => change(box.checked));
  return { parts: [box], show: ({ value }) => { box.checked = value; } };
}

/** A number with a slider; where there are many values the slider is logarithmic. */
function number(id, schema, change) {
  const input = make("input", { id, type: "number" }), slider = make("input", { type: "range", min: 0, max: 1, step: 0.001 });
  slider.setAttribute("aria-label", `${id.slice(4)}, roughly`);
  const scale = { least: 0, most: 1 };
  const isLog = () => scale.most - scale.least > LINEAR;
  const to = v => isLog() ? Math.log((v - scale.least) + 1) / Math.log(scale.most - scale.least + 1) : (v - scale.least) / (scale.most - scale.least);
  const from = p => isLog() ? scale.least + (scale.most - scale.least + 1) ** p - 1 : scale.least + p * (scale.most - scale.least);
  input.addEventListener("input", () => {
    if (input.value !== "") slider.value = to(input.valueAsNumber);
    change(input.value === "" ? undefined : input.valueAsNumber);
  });
  slider.addEventListener("input", () => {
    input.valueAsNumber = schema.type === "integer" ? Math.round(from(slider.valueAsNumber)) : Number(from(slider.valueAsNumber).toPrecision(3));
    change(input.valueAsNumber);
  });
  const show = ({ minimum, maximum, value, type }) => {
    Object.assign(scale, { least: minimum, most: maximum });
    Object.assign(input, { min: minimum, max: maximum, step: type === "integer" ? 1 : "any" });
    input.value = value;
    slider.value = to(value);
  };
  return { parts: [input, slider], show };
}

/** A number that may be left out: an empty field is none. */
function optional(id, _, change) {
  const input = make("input", { id, type: "number", step: "any", placeholder: "off" });
  input.addEventListener("input", () => change(input.validity.badInput ? undefined : input.value === "" ? null : input.valueAsNumber));
  const show = ({ minimum, maximum, value }) => {
    Object.assign(input, { min: minimum, max: maximum });
    input.value = value ?? "";
  };
  return { parts: [input], show };
}

function make(name, properties) {
  return Object.assign(document.createElement(name), properties);
}
