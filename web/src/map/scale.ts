// SPDX-License-Identifier: BSD-3-Clause
// Length of the scale bar: a round number of metres, and its pixels.

export interface ScaleBar {
  metres: number;
  pixels: number;
}

/** Longest scale bar with a round length and at most this many pixels. */
export function scaleBar(resolution: number, most: number): ScaleBar {
  const longest = most * resolution;
  const power = 10 ** Math.floor(Math.log10(longest));
  const metres = power * ([5, 2, 1].find((factor) => factor * power <= longest) ?? 1);
  return { metres, pixels: metres / resolution };
}
