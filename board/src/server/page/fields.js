// The fields of the settings: label, control, explanation, and error message.

/** Number of values of a setting above which its slider is logarithmic. */
const LINEAR = 100;

/** Creates a row for a setting with label, control, explanation and error message; `change` is called with each new value, undefined for none. */
export function field(name, schema, change) {
  const box = document.createElement("div"), row = make("div", { className: "row" }), id = `set-${name}`;
  const control = kind(schema)(id, schema, change);
  const label = make("label", { className: "name", htmlFor: id, textContent: schema.title });
  const hint = make("p", { className: "hint", id: `${id}-hint` }), error = make("p", { className: "error", id: `${id}-error` });
  error.setAttribute("role", "alert");
  row.append(label, ...control.parts);
  box.append(row, hint, error);
  for (const part of control.parts) part.setAttribute("aria-describedby", `${hint.id} ${error.id}`);
  const fail = text => {
    error.textContent = text;
    control.parts.forEach(part => part.setAttribute("aria-invalid", String(Boolean(text))));
  };
  let known = schema, shown, isLocked = false, isFixed = false;
  const lock = () => control.parts.forEach(part => { part.disabled = isLocked || isFixed; });
  const show = (schema, isBusy) => {
    known = schema;
    box.classList.toggle("unused", !schema.in_use);
    const why = schema.readOnly ? `Fixed: ${schema.reason}.` : "";
    hint.textContent = [schema.description, range(schema), why].filter(Boolean).join(" ");
    isFixed = Boolean(schema.readOnly);
    lock();
    const value = JSON.stringify([schema.value, schema.current]);
    // An error message stays until it is corrected or the value changes.
    if (isBusy || (error.textContent && value === shown)) return;
    shown = value;
    control.show(schema);
    fail("");
  };
  const reveal = () => { const group = box.closest("details"); if (group) group.open = true; };
  return {
    box, fail, show, reveal, wrong: value => wrong(value, known, control.parts[0]), get text() { return error.textContent; },
    set locked(locked) { isLocked = locked; lock(); },
  };
}

/** Returns the error of a value, one line with the value that was found and the values that are accepted; empty if the value is accepted. */
function wrong(value, schema, { value: text, validity }) {
  const { items, minimum: least, maximum: most, unit = "" } = { ...schema, ...schema.items }, isWhole = [].concat(schema.type).includes("integer");
  if (schema.enum || value === null || typeof value === "boolean") return "";
  const expected = items || schema.items ? `1 to ${schema.maxItems} rising numbers from ${least} to ${most} ${unit} with commas between them, or nothing`
    : `${isWhole ? "a whole number" : "a number"} from ${least} to ${most} ${unit}`;
  const isIn = v => v >= least && v <= most && (!isWhole || Number.isInteger(v));
  const isRight = value !== undefined && [].concat(value).every(isIn)
    && (!Array.isArray(value) || value.length <= schema.maxItems && value.every((v, i) => i === 0 || v > value[i - 1]));
  return isRight ? "" : `found ${validity.badInput ? "no number" : text === "" ? "nothing" : text}, expected ${expected}`.trim();
}

function range({ minimum, maximum, unit, items, maxItems }) {
  const { minimum: least, maximum: most } = items ?? { minimum, maximum };
  return least === undefined ? "" : `${items ? `1 to ${maxItems} times, ` : ""}${least} to ${most}${unit ? ` ${unit}` : ""}.`;
}

function kind({ type, enum: words, group }) {
  if (words) return choice;
  if (type === "boolean") return toggle;
  if ([].concat(type).includes("array")) return list;
  if ([].concat(type).includes("null")) return optional;
  return group === "budgets" ? plain : number;
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

/** Creates a number field with a slider, which is logarithmic for a setting with many values. */
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

/** Creates a number field without a slider. */
function plain(id, _, change) {
  const input = make("input", { id, type: "number", step: "any" });
  input.addEventListener("input", () => change(input.value === "" ? undefined : input.valueAsNumber));
  const show = ({ minimum, maximum, value }) => Object.assign(input, { min: minimum, max: maximum, value });
  return { parts: [input], show };
}

/** Creates a field for numbers separated by commas; if it is empty, the source's own values apply and are shown in grey. */
function list(id, _, change) {
  const input = make("input", { id, type: "text", inputMode: "decimal", autocomplete: "off", spellcheck: false });
  input.addEventListener("input", () => {
    const numbers = input.value.split(/[,;\s]+/).filter(Boolean).map(Number);
    change(numbers.some(Number.isNaN) ? undefined : numbers.length ? numbers : null);
  });
  const show = ({ value, current }) => {
    input.placeholder = (current ?? []).join(", ");
    input.value = value?.join(", ") ?? "";
  };
  return { parts: [input], show };
}

/** Creates a number field that may be empty for no value. */
function optional(id, schema, change) {
  const isWhole = [].concat(schema.type).includes("integer");
  const input = make("input", { id, type: "number", step: isWhole ? 1 : "any", placeholder: isWhole ? "automatic" : "off" });
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
