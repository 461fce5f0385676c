// The probe's map: radiance over the hemisphere and what of it is unseen or clipped. A texel is a degree or so; row 0 is the zenith's, column 0
// begins at azimuth 180 degrees and azimuth falls to the right.

/** @typedef {{width: number, height: number, texels: Float32Array}} Map rows of three floats a texel */

/** Fetches the map, or null where the probe has none yet. Throws when it may not be seen. */
export async function fetchMap() {
  const answer = await fetch("/v1/map.hdr", { cache: "no-store" });
  if (!answer.ok) return refused(answer);
  const sphere = decodeRadiance(new Uint8Array(await answer.arrayBuffer()));
  const height = sphere.height >> 1;
  return { width: sphere.width, height, texels: sphere.texels.subarray(0, 3 * sphere.width * height) };
}

/** Fetches the mask: for each texel 0 unseen, 128 seen, 255 clipped. */
export async function fetchMask() {
  const answer = await fetch("/v1/mask.png", { cache: "no-store" });
  if (!answer.ok) return refused(answer);
  const picture = await createImageBitmap(await answer.blob(), { colorSpaceConversion: "none" });
  const { width, height } = picture;
  const pen = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
  pen.drawImage(picture, 0, 0);
  const codes = new Uint8Array(width * height), pixels = pen.getImageData(0, 0, width, height).data;
  for (let i = 0; i < codes.length; i++) codes[i] = pixels[4 * i];
  return { width, height, codes };
}

function refused(answer) {
  if (answer.status === 401 || answer.status === 403) throw new Error("not allowed");
  return null;
}

/** Radiance's RGBE format [Ward 1991], rows run-length coded or flat, top row first. */
export function decodeRadiance(bytes) {
  let at = 0;
  const line = () => {
    const end = bytes.indexOf(10, at);
    if (end < 0) throw new Error("a Radiance file without an end of line");
    const text = String.fromCharCode(...bytes.subarray(at, end));
    at = end + 1;
    return text;
  };
  while (line() !== "");
  const [, height, width] = (/^-Y (\d+) \+X (\d+)$/.exec(line()) ?? []).map(Number);
  if (!(width > 0 && height > 0 && width * height <= 1 << 24)) throw new Error("a Radiance file of another size or orientation");
  const texels = new Float32Array(3 * width * height), row = new Uint8Array(4 * width);
  for (let y = 0; y < height; y++) {
    at = readRow(bytes, at, row, width);
    for (let x = 0; x < width; x++) {
      const e = row[4 * x + 3], scale = e ? 2 ** (e - 136) : 0;
      for (let c = 0; c < 3; c++) texels[3 * (y * width + x) + c] = row[4 * x + c] * scale;
    }
  }
  return { width, height, texels };
}

function readRow(bytes, at, row, width) {
  const coded = bytes[at] === 2 && bytes[at + 1] === 2 && (bytes[at + 2] << 8 | bytes[at + 3]) === width;
  if (!coded) {
    row.set(bytes.subarray(at, at + row.length));
    return at + row.length;
  }
  at += 4;
  for (let c = 0; c < 4; c++) {
    for (let x = 0; x < width;) {
      const code = bytes[at++], run = code > 128, count = run ? code - 128 : code;
      if (!(count > 0) || x + count > width) throw new Error("a Radiance file with a broken row");
      for (let i = 0; i < count; i++, x++) row[4 * x + c] = bytes[run ? at : at + i];
      at += run ? 1 : count;
    }
  }
  return at;
}

export const luminance = (r, g, b) => 0.2126 * r + 0.7152 * g + 0.0722 * b;

/** Geometric mean of the luminance of what is lit: what becomes mid-grey. */
export function adaptation({ texels }) {
  let sum = 0, count = 0;
  for (let i = 0; i < texels.length; i += 3) {
    const y = luminance(texels[i], texels[i + 1], texels[i + 2]);
    if (y > 0) { sum += Math.log(y); count++; }
  }
  return count ? Math.exp(sum / count) : 1;
}

/** sRGB codes of linear 0 to 1 in steps of 1/4096. */
const CODES = Uint8ClampedArray.from({ length: 4097 }, (_, i) => {
  const v = i / 4096;
  return 255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055);
});

/** Display codes of all texels: the sigmoid of Naka and Rushton on luminance, as the probe's own pictures have it. */
export function toneMap({ texels }, grey) {
  const out = new Uint8Array(texels.length);
  for (let i = 0; i < texels.length; i += 3) {
    const y = luminance(texels[i], texels[i + 1], texels[i + 2]);
    if (!(y > 0)) continue;
    const ratio = (y / grey) ** 0.8, scale = 4096 * ratio / (ratio + 1) / y;
    for (let c = i; c < i + 3; c++) out[c] = CODES[Math.min(4096, texels[c] * scale) | 0];
  }
  return out;
}

/** A colour for the screen with the hue of a light, as bright as it gets. */
export function screenColour(rgb) {
  const top = Math.max(...rgb, 1e-20);
  return `rgb(${rgb.map(v => CODES[Math.max(0, v / top) * 4096 | 0]).join(" ")})`;
}
