// The probe's map: radiance over the hemisphere and what of it is unseen or clipped. A texel is a degree or so; row 0 is the zenith's, column 0
// begins at azimuth 180 degrees and azimuth falls to the right.

/** @typedef {{width: number, height: number, texels: Float32Array}} Map rows of three floats a texel */

/** Radiance of a code over the mean's: what /v1/map.jpg says. */
const RATIOS = Float32Array.from({ length: 256 }, (_, code) => (code / Math.max(0.5, 255 - code)) ** 2);

/** Fetches the map, or null where the probe has none yet. Throws when it may not be seen. */
export async function fetchMap() {
  const answer = await fetch("/v1/map.jpg", { cache: "no-store" });
  if (!answer.ok) return refused(answer);
  const grey = Number(answer.headers.get("hemilux-grey")) || 1, { width, height, data } = await pixels(await answer.blob());
  const texels = new Float32Array(3 * width * height);
  for (let i = 0, k = 0; i < data.length; i += 4, k += 3) {
    for (let c = 0; c < 3; c++) texels[k + c] = grey * RATIOS[data[i + c]];
  }
  return { width, height, texels };
}

/** The codes of a picture as they are in the file. */
async function pixels(blob) {
  const picture = await createImageBitmap(blob, { colorSpaceConversion: "none" }), { width, height } = picture;
  const pen = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
  pen.drawImage(picture, 0, 0);
  picture.close();
  return { width, height, data: pen.getImageData(0, 0, width, height).data };
}

/** The map with what the lens does not see continued from what it sees, for a background: each texel without light has that of the one above. */
export function continued({ width, height, texels }) {
  const filled = texels.slice();
  for (let i = 3 * width; i < filled.length; i += 3) {
    // Codes next to black are what the JPEG makes of its edge.
    if (luminance(filled[i], filled[i + 1], filled[i + 2]) < 1e-3 * luminance(filled[i - 3 * width], filled[i + 1 - 3 * width], filled[i + 2 - 3 * width])) {
      filled.copyWithin(i, i - 3 * width, i - 3 * width + 3);
    }
  }
  return { width, height, texels: filled };
}

/** Fetches the mask: for each texel 0 unseen, 128 seen, 255 clipped. */
export async function fetchMask() {
  const answer = await fetch("/v1/mask.png", { cache: "no-store" });
  if (!answer.ok) return refused(answer);
  const { width, height, data } = await pixels(await answer.blob()), codes = new Uint8Array(width * height);
  for (let i = 0; i < codes.length; i++) codes[i] = data[4 * i];
  return { width, height, codes };
}

function refused(answer) {
  if (answer.status === 401 || answer.status === 403) throw new Error("not allowed");
  return null;
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
