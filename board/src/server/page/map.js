// The probe's map: radiance over the hemisphere, and its unseen and clipped parts. A texel is about one degree wide; row 0 is at the zenith,
// column 0 begins at azimuth 180 degrees, and the azimuth decreases to the right.

/** @typedef {{width: number, height: number, texels: Float32Array}} Map rows of three floats per texel */

/** Radiance of each code of /v1/map.jpg, relative to the geometric mean. */
const RATIOS = Float32Array.from({ length: 256 }, (_, code) => (code / Math.max(0.5, 255 - code)) ** 2);

/** Fetches the probe's map; null where the probe has none yet. Throws if the map may not be requested. */
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

/** Returns the codes of the picture in `blob` without a colour conversion. */
async function pixels(blob) {
  const picture = await createImageBitmap(blob, { colorSpaceConversion: "none" }), { width, height } = picture;
  const pen = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
  pen.drawImage(picture, 0, 0);
  picture.close();
  return { width, height, data: pen.getImageData(0, 0, width, height).data };
}

/** Returns the map with a continuation of its unseen part, for a background: each texel without light has the radiance of the texel above. */
export function continued({ width, height, texels }) {
  const filled = texels.slice();
  for (let i = 3 * width; i < filled.length; i += 3) {
    // Codes near black are artefacts of the JPEG compression at the edge.
    if (luminance(filled[i], filled[i + 1], filled[i + 2]) < 1e-3 * luminance(filled[i - 3 * width], filled[i + 1 - 3 * width], filled[i + 2 - 3 * width])) {
      filled.copyWithin(i, i - 3 * width, i - 3 * width + 3);
    }
  }
  return { width, height, texels: filled };
}

/** Fetches the mask of the map: for each texel 0 for unseen, 128 for seen, 255 for clipped. */
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

/** Returns the geometric mean of the positive luminances of the map's texels, which is displayed as mid-grey. */
export function adaptation({ texels }) {
  let sum = 0, count = 0;
  for (let i = 0; i < texels.length; i += 3) {
    const y = luminance(texels[i], texels[i + 1], texels[i + 2]);
    if (y > 0) { sum += Math.log(y); count++; }
  }
  return count ? Math.exp(sum / count) : 1;
}

/** sRGB codes of linear values from 0 to 1 in steps of 1/4096. */
const CODES = Uint8ClampedArray.from({ length: 4097 }, (_, i) => {
  const v = i / 4096;
  return 255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055);
});

/** Returns the display codes of all texels of the map by the sigmoid of Naka and Rushton on luminance, as in the probe's own pictures. */
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

/** Returns a CSS colour with the hue of a light, at full brightness. */
export function screenColour(rgb) {
  const top = Math.max(...rgb, 1e-20);
  return `rgb(${rgb.map(v => CODES[Math.max(0, v / top) * 4096 | 0]).join(" ")})`;
}
