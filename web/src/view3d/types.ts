// SPDX-License-Identifier: BSD-3-Clause
// Data that the view in three dimensions takes.

/** Words of the page in its language. */
export type Say = (key: string, values?: object) => string;

/** Elevations [m] of cells: row 0 is north, NaN is unknown. West and south [m] in the terrain's own system. */
export interface Terrain { west: number; south: number; cell: number; nx: number; ny: number; heights: Float32Array }

/** Hillshade 1..255, 0 is unknown, from the north-west corner of the terrain. */
export interface Shade { cell: number; nx: number; ny: number; values: Uint8Array }

/** Points (n, COLUMNS): x - west, y - south, z [m], time since release [s], speed [m/s], and gravity on the way to the next point [m/s2]: 0 on
 * the ground and at rest; masses [kg]. */
export interface Trajectories { points: Float32Array; first: Uint32Array; boulder: Uint32Array; mass: Float32Array }

/** A drawn line: x and y [m] in the terrain's own system, height [m] above the ground. */
export interface Line3d { name: string; kind: 'line' | 'barrier' | 'dam'; x: number[]; y: number[]; height: number }

/** West, south, east and north [m] in the terrain's own system. */
export type Extent = [west: number, south: number, east: number, north: number];
