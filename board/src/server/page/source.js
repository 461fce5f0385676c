// The source of bursts: its name, and the selection of another source where the token permits it.

export class SourceChoice {
  #select; #text; #busy = false; #name = "";

  /** `changed` is called when another source is in use. */
  constructor(select, text, changed) {
    this.#select = select;
    this.#text = text;
    select.addEventListener("change", () => this.#switch(changed));
    select.addEventListener("focus", () => this.load());
  }

  set locked(locked) {
    this.#select.disabled = locked;
    if (!locked) this.load();
  }

  /** The name of the source in use, from the status. */
  set name(name) {
    if (name === this.#name) return;
    this.#name = name;
    if (!this.#busy) this.load();
  }

  /** Reads the list of sources again. */
  async load() {
    if (this.#busy) return;
    try {
      const answer = await fetch("/v1/source", { cache: "no-store" });
      if (answer.ok) this.#show(await answer.json());
    } catch { /* The state of the page says that the probe does not answer. */ }
  }

  #show({ source, choices }) {
    const names = choices.includes(source) ? choices : [source, ...choices];
    if ([...this.#select.options].map(o => o.value).join("\n") !== names.join("\n")) this.#select.replaceChildren(...names.map(name => new Option(name, name)));
    this.#select.value = this.#name = source;
  }

  async #switch(changed) {
    const source = this.#select.value;
    this.#busy = true;
    this.#text.textContent = `Opening ${source}…`;
    let error = "";
    try {
      const answer = await fetch("/v1/source", { method: "PATCH", headers: { "content-type": "application/json" }, body: JSON.stringify({ source }) });
      if (!answer.ok) {
        const text = await answer.text();
        try { error = JSON.parse(text).errors.source; } catch { error = text.trim(); }
      }
    } catch { error = "The probe does not answer."; }
    this.#busy = false;
    this.#text.textContent = error;
    if (error) this.load(); else changed();
  }
}
