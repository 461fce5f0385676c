// The panel "Download": the light set and the map as files, in the selected form.

/** Forms of the light set: name, file extension, description, and true if lights are fitted as discs, since the form contains their angle. */
const SETS = {
  json: ["JSON", "json", "All values of a set."],
  csv: ["CSV", "csv", "A line for each light, for a spreadsheet."],
  glb: ["glTF (.glb)", "glb", "Directional lights, +Y up; no radius and no ambient light."],
  usda: ["USD (.usda)", "usda", "Distant lights with their angles, +Y up; its dome is map.exr in the same folder.", true],
  blender: ["Blender script", "py", "Run it in Blender's text editor: a sun for each light, by its id, with its angle.", true],
};

/** Forms of the map: name, file extension, description. */
const MAPS = {
  exr: ["OpenEXR", "exr", "Radiance, 32-bit floats."],
  hdr: ["Radiance HDR", "hdr", "Radiance in 32 bits a texel, for older programs."],
  png: ["PNG", "png", "A tone-mapped picture without radiance."],
};

/** The panel's controls and links, which are updated after each change of a control. `name` is the source's name for the file names. */
export class Download {
  #parts; #name = "hemilux";

  constructor(parts) {
    this.#parts = parts;
    fill(parts.form, SETS);
    fill(parts.mapForm, MAPS);
    for (const control of [parts.form, parts.lights, parts.mapForm, parts.covers, parts.width]) control.addEventListener("input", () => this.#write());
    this.#write();
  }

  /** Sets the name of the probe's source, which becomes part of the file names. */
  set source(name) {
    const plain = `hemilux-${name.replace(/^\w+:/, "").replace(/[^\w.-]+/g, "-").replace(/\.\w+$/, "")}`;
    if (plain === this.#name) return;
    this.#name = plain;
    this.#write();
  }

  /** True if the map may not be requested. */
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
    // The name by which the USD file refers to the map.
    map.download = mapForm.value === "exr" ? "map.exr" : `${this.#name}.${mapEnding}`;
    mapText.textContent = `${mapAbout} Latitude-longitude, the zenith at the upper edge${covers.value === "sphere" ? ", dark below the horizon" : ""}.`;
  }
}

function fill(select, forms) {
  select.replaceChildren(...Object.entries(forms).map(([value, [text]]) => new Option(text, value)));
}
