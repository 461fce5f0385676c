// "Download": the light set and the map as files, in the form that is chosen.

/** The forms of the light set: what they are called, the ending of the file, what they are for, and whether lights are fitted as discs, since the form holds their angle. */
const SETS = {
  json: ["JSON", "json", "Everything that a set has."],
  csv: ["CSV", "csv", "A line for each light, for a spreadsheet."],
  glb: ["glTF (.glb)", "glb", "Directional lights, +Y up; no radius and no ambient light."],
  usda: ["USD (.usda)", "usda", "Distant lights with their angles, +Y up; names map.exr of the same folder as its dome.", true],
  blender: ["Blender script", "py", "Run it in Blender's text editor: a sun for each light, by its id, with its angle.", true],
};

/** The forms of the map. */
const MAPS = {
  exr: ["OpenEXR", "exr", "Radiance as it is, 32 bits."],
  hdr: ["Radiance HDR", "hdr", "Radiance in 32 bits a texel, for older programs."],
  png: ["PNG", "png", "A picture to look at: tone-mapped, no radiance."],
};

/** Keeps the links of the panel as its controls have it. `name` gives the source's name for the files. */
export class Download {
  #parts; #name = "hemilux";

  constructor(parts) {
    this.#parts = parts;
    fill(parts.form, SETS);
    fill(parts.mapForm, MAPS);
    for (const control of [parts.form, parts.lights, parts.mapForm, parts.covers, parts.width]) control.addEventListener("input", () => this.#write());
    this.#write();
  }

  /** The source's name becomes part of the files' names. */
  set source(name) {
    const plain = `hemilux-${name.replace(/^\w+:/, "").replace(/[^\w.-]+/g, "-").replace(/\.\w+$/, "")}`;
    if (plain === this.#name) return;
    this.#name = plain;
    this.#write();
  }

  /** Whether the map may be seen. */
  set locked(locked) {
    const { map } = this.#parts;
    if (locked) map.removeAttribute("href"); else this.#write();
    map.classList.toggle("off", locked);
  }

  #write() {
    const { form, lights, lightsError, set, setText, mapForm, covers, width, map, mapText } = this.#parts;
    const [, ending, about, soft] = SETS[form.value], count = lights.value, isRight = !lights.validity.badInput && (count === "" || /^\d+$/.test(count) && count >= 1 && count <= 50000);
    lightsError.textContent = isRight ? "" : `found ${lights.validity.badInput ? "no number" : count}, expected 1 to 50000 lights, or nothing for as many as the probe has`;
    lights.setAttribute("aria-invalid", String(!isRight));
    if (isRight) set.href = `/v1/lights?format=${form.value}${soft ? "&soft=1" : ""}${count ? `&lights=${count}` : ""}`; else set.removeAttribute("href");
    set.classList.toggle("off", !isRight);
    set.download = `${this.#name}.${ending}`;
    setText.textContent = about;
    const [, mapEnding, mapAbout] = MAPS[mapForm.value];
    map.href = `/v1/map.${mapForm.value}?covers=${covers.value}${width.value ? `&width=${width.value}` : ""}`;
    // The name by which the USD file refers to it.
    map.download = mapForm.value === "exr" ? "map.exr" : `${this.#name}.${mapEnding}`;
    mapText.textContent = `${mapAbout} Latitude-longitude, the zenith at the upper edge${covers.value === "sphere" ? ", dark below the horizon" : ""}.`;
  }
}

function fill(select, forms) {
  select.replaceChildren(...Object.entries(forms).map(([value, [text]]) => new Option(text, value)));
}
