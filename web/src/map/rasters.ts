// SPDX-License-Identifier: BSD-3-Clause
// Rasters as canvases with one pixel per cell: hillshade, zones, results.
import { placeOf, rgbOf, viridis, ZONE_COLOURS, type ColourScale, type Rgb } from '../colours';
import { element } from '../dom';

/** Opaque pixel as little-endian RGBA. */
function pixel([r, g, b]: Rgb): number {
  return ((255 << 24) | (b << 16) | (g << 8) | r) >>> 0;
}

function paint(width: number, height: number, colourOf: (k: number) => number, canvas = element('canvas')): HTMLCanvasElement {
  if (canvas.width !== width) canvas.width = width;
  if (canvas.height !== height) canvas.height = height;
  const image = new ImageData(width, height);
  const pixels = new Uint32Array(image.data.buffer);
  for (let k = 0; k < pixels.length; k++) pixels[k] = colourOf(k);
  canvas.getContext('2d')?.putImageData(image, 0, 0);
  return canvas;
}

/** Light hillshade that keeps colours readable; transparent without data. */
export function hillshade(values: Uint8Array, nx: number, ny: number): HTMLCanvasElement {
  const greys = Uint32Array.from({ length: 256 }, (_, shade) => {
    const grey = Math.round(124 + 131 * (shade / 255) ** 0.85);
    return shade === 0 ? 0 : pixel([grey, grey, grey]);
  });
  return paint(nx, ny, (k) => greys[values[k] as number] as number);
}

export function zoneColour(index: number): Rgb {
  return ZONE_COLOURS[index % ZONE_COLOURS.length] as Rgb;
}

/** Zone colours; cells without a zone are transparent. */
export function zoneRaster(values: Uint8Array, nx: number, ny: number, zones: readonly { value: number }[]): HTMLCanvasElement {
  const colours = new Uint32Array(256);
  zones.forEach(({ value }, k) => (colours[value] = pixel(zoneColour(k))));
  return paint(nx, ny, (k) => colours[values[k] as number] as number);
}

/** Picture from red, green, blue and alpha values. */
export function picture(rgba: Uint8Array, nx: number, ny: number): HTMLCanvasElement {
  const canvas = element('canvas');
  [canvas.width, canvas.height] = [nx, ny];
  canvas.getContext('2d')?.putImageData(new ImageData(new Uint8ClampedArray(rgba), nx, ny), 0, 0);
  return canvas;
}

/** Classes in CSS colours; the first class is transparent. */
export function classRaster(values: Uint8Array, nx: number, ny: number, colours: readonly string[]): HTMLCanvasElement {
  const pixels = colours.map((colour) => pixel(rgbOf(colour)));
  return paint(nx, ny, (k) => (values[k] ? (pixels[values[k] as number] ?? 0) : 0));
}

const STEPS = 256;
const RAMP = Uint32Array.from({ length: STEPS }, (_, k) => pixel(viridis(k / (STEPS - 1))));

/** Paint a result on a canvas with its colour scale; transparent without data. */
export function paintResult(values: Float32Array, nx: number, ny: number, scale: ColourScale, canvas: HTMLCanvasElement): void {
  const colourOf = (k: number): number => {
    const value = values[k] as number;
    if (Number.isNaN(value)) return 0;
    return RAMP[Math.round(Math.max(0, Math.min(1, placeOf(value, scale))) * (STEPS - 1))] ?? 0;
  };
  paint(nx, ny, colourOf, canvas);
}
