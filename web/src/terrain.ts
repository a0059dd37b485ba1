// SPDX-License-Identifier: BSD-3-Clause
// Terrain of the page in its own CRS [m]: cell elevations and hillshade.

/** Elevations [m] of cells; row 0 is the northernmost, NaN is unknown. `west` and `south` in [m]. */
export interface Terrain { west: number; south: number; cell: number; nx: number; ny: number; heights: Float32Array }

/** Hillshade from 1 to 255 (0: unknown), starting at the terrain's north-western corner. */
export interface Shade { cell: number; nx: number; ny: number; values: Uint8Array }

/** West, south, east and north [m]. */
export type Extent = [west: number, south: number, east: number, north: number];

/** Extent of cells from their north-western corner. */
export function extentOf(west: number, north: number, cell: number, [ny = 0, nx = 0]: readonly number[]): Extent {
  return [west, north - ny * cell, west + nx * cell, north];
}

export interface Range {
  low: number;
  high: number;
}

/** Minimum and maximum without NaN; null if there are no numbers. */
export function rangeOf(...all: readonly ArrayLike<number>[]): Range | null {
  const range = { low: Infinity, high: -Infinity };
  for (const numbers of all)
    for (let k = 0; k < numbers.length; k++) {
      const value = numbers[k] as number;
      if (value < range.low) range.low = value;
      if (value > range.high) range.high = value;
    }
  return range.low <= range.high ? range : null;
}

/** Elevation [m] interpolated between cell centres, at x, y [m] from the south-western corner; NaN if unknown. */
export function elevationAt({ cell, nx, ny, heights }: Terrain, x: number, y: number): number {
  if (!(x >= 0 && y >= 0 && x <= nx * cell && y <= ny * cell)) return NaN;
  const column = Math.min(Math.max(x / cell - 0.5, 0), nx - 1);
  const row = Math.min(Math.max(ny - 0.5 - y / cell, 0), ny - 1);
  const left = Math.min(Math.floor(column), Math.max(nx - 2, 0));
  const upper = Math.min(Math.floor(row), Math.max(ny - 2, 0));
  const [right, down] = [column - left, row - upper];
  const at = upper * nx + left;
  const below = ny > 1 ? at + nx : at;
  const next = nx > 1 ? 1 : 0;
  return (1 - down) * ((1 - right) * heights[at]! + right * heights[at + next]!) + down * ((1 - right) * heights[below]! + right * heights[below + next]!);
}
