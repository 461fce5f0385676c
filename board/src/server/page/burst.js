// The panel with the pictures of a burst, shortest exposure first.

import { duration } from "./figures.js";

/** Width of a picture of an exposure, pixels; a click shows the full size. */
const WIDTH = 320;

export class Burst {
  #box; #urls = [];

  constructor(box) { this.#box = box; }

  /** Fetches the pictures of all exposures one after the other: the probe makes one at a time. */
  async load() {
    for (let i = 0, count = 1; i < count; i++) {
      const answer = await fetch(`/v1/image/${i}?width=${WIDTH}`, { cache: "no-store" });
      if (answer.status === 401) throw new Error("not allowed");
      if (!answer.ok) return;
      count = Number(answer.headers.get("hemilux-exposures")) || 1;
      this.#show(i, await answer.blob(), Number(answer.headers.get("hemilux-exposure-s")));
      while (this.#box.children.length > count) this.#box.lastChild.remove();
    }
  }

  clear() {
    this.#urls.forEach(URL.revokeObjectURL);
    this.#urls = [];
    this.#box.replaceChildren();
  }

  #show(i, blob, seconds) {
    const text = duration(seconds);
    if (!this.#box.children[i]) {
      const figure = document.createElement("figure"), link = document.createElement("a");
      Object.assign(link, { href: `/v1/image/${i}`, target: "_blank" });
      link.append(document.createElement("img"));
      figure.append(link, document.createElement("figcaption"));
      this.#box.append(figure);
    }
    const [image, caption] = this.#box.children[i].querySelectorAll("img, figcaption");
    const old = this.#urls[i];
    image.src = this.#urls[i] = URL.createObjectURL(blob);
    image.alt = `Exposure of ${text}`;
    caption.textContent = text;
    if (old) URL.revokeObjectURL(old);
  }
}
