// SPDX-License-Identifier: BSD-3-Clause
// Colours that colour-blind readers can distinguish: Okabe and Ito (2008) for layers, viridis for rasters, plasma for speeds.
import type { Layer } from './protocol';

export type Rgb = readonly [number, number, number];

export const LAYER_COLOURS: Readonly<Record<Layer | 'trees' | 'stands' | 'objects' | 'stops' | 'trajectories', string>> = {
  sources: '#d55e00',
  lines: '#0072b2',
  barriers: '#cc79a7',
  dams: '#e69f00',
  zones: '#009e73',
  trees: '#007a59',
  stands: '#006148',
  objects: '#4b1d1d',
  stops: '#111827',
  trajectories: '#1f2937',
};

/** Colour with six hexadecimal digits after `#`. */
export function rgbOf(colour: string): Rgb {
  const number = parseInt(colour.slice(1), 16);
  return [number >> 16, (number >> 8) & 255, number & 255];
}

function paletteOf(colours: string): Rgb[] {
  return colours.split(' ').map((colour) => rgbOf(`#${colour}`));
}

/** Zone colours: pale, for a translucent layer on grey. */
export const ZONE_COLOURS = paletteOf('e69f00 56b4e9 009e73 f0e442 cc79a7 0072b2 d55e00 888888');

// Every 17th colour of viridis (16 of 256).
const VIRIDIS = paletteOf(
  '440154 481a6c 472f7d 414487 39568c 31688e 2a788e 23888e 1f988b 22a884 35b779 54c568 7ad151 a5db36 d2e21b fde725',
);

// Ten colours of plasma, evenly spaced from 64 to 255, for trajectory speeds on a map in viridis.
const PLASMA = paletteOf('7e03a8 9c179e b52f8c cc4778 de5f65 ed7953 f89540 fdb42f fbd524 f0f921');

/** Colour for each position from 0 to 1. */
export type Palette = (place: number) => Rgb;
export const viridis: Palette = (place) => between(VIRIDIS, place);
export const plasma: Palette = (place) => between(PLASMA, place);

function between(colours: readonly Rgb[], place: number): Rgb {
  const at = Math.max(0, Math.min(1, place)) * (colours.length - 1);
  const k = Math.min(colours.length - 2, Math.floor(at));
  const [a, b] = [colours[k] ?? [0, 0, 0], colours[k + 1] ?? [0, 0, 0]] as const;
  const mix = (i: 0 | 1 | 2): number => Math.round(a[i] + (at - k) * (b[i] - a[i]));
  return [mix(0), mix(1), mix(2)];
}

export function css([r, g, b]: Rgb, opacity = 1): string {
  return `rgb(${r} ${g} ${b} / ${opacity})`;
}

/** Palette from left to right, as a background. */
export function gradient(palette: Palette): string {
  return `linear-gradient(to right, ${Array.from({ length: 16 }, (_, k) => css(palette(k / 15))).join(', ')})`;
}

/** Speed classes for drawing trajectories. */
export const SPEED_CLASSES = 8;

/** Scale from values to positions between 0 and 1. */
export interface ColourScale {
  low: number;
  high: number;
  scale: 'linear' | 'log';
  whole?: boolean; // values are integers
}

export function placeOf(value: number, { low, high, scale }: ColourScale): number {
  if (scale === 'log') return Math.log(value / low) / Math.log(high / low || 1);
  return high > low ? (value - low) / (high - low) : 1;
}

/** Round numbers for a legend: 1, 2, 5 times powers of ten, about six at most. */
export function ticks({ low, high, scale, whole }: ColourScale): number[] {
  if (!(high > low)) return [high];
  if (scale === 'log') {
    const found: number[] = [];
    const decades = Math.log10(high / low);
    const factors = decades > 3 ? [1] : decades > 1.5 ? [1, 3] : [1, 2, 5];
    for (let e = Math.floor(Math.log10(low)); e <= Math.log10(high); e++)
      for (const f of factors) found.push(f * 10 ** e);
    return found.filter((value) => value >= low * 0.999 && value <= high * 1.001);
  }
  const rough = Math.max((high - low) / 5, whole ? 1 : 0);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5].find((f) => f * power >= rough) ?? 10);
  const found: number[] = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high * (1 + 1e-9); k++) found.push(k * step + 0); // not -0
  return found;
}
