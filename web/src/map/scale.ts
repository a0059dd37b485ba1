// SPDX-License-Identifier: BSD-3-Clause
// Scale bar: its length in metres, a round number, and in pixels.

export interface ScaleBar {
  metres: number;
  pixels: number;
}

/** The longest round bar of at most this many pixels. */
export function scaleBar(resolution: number, most: number): ScaleBar {
  const longest = most * resolution;
  const power = 10 ** Math.floor(Math.log10(longest));
  const metres = power * ([5, 2, 1].find((factor) => factor * power <= longest) ?? 1);
  return { metres, pixels: metres / resolution };
}
