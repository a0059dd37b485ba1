// SPDX-License-Identifier: BSD-3-Clause
// Trajectories of a message, joined with earlier messages of the same run, and the motion between two of their points.
import type { Binary, TrajectoriesMessage } from './protocol';

/** Points (n, COLUMNS): x - west, y - south, z [m], time since release [s], speed [m/s], and gravity until the next point
 * [m/s2] (0 on the ground and at rest); masses [kg]. */
export interface Trajectories { points: Float32Array; first: Uint32Array; boulder: Uint32Array; mass: Float32Array }

/** Components of a point: x, y, z, time, speed, gravity. */
export const COLUMNS = 6;

/** Write x, y, z, time and speed at a fraction (0 to 1) of the motion from the point at index a to the point at index
 * b: on a parabola or, if gravity is 0, on a straight line. */
export function between(points: Float32Array, a: number, b: number, gravity: number, part: number, to: Float32Array): void {
  const span = points[b + 3]! - points[a + 3]!;
  for (let column = 0; column < 5; column++) to[column] = points[a + column]! + part * (points[b + column]! - points[a + column]!);
  if (!(gravity > 0 && span > 0)) return;
  to[2] = to[2]! + 0.5 * gravity * span * span * part * (1 - part);
  const level = Math.hypot(points[b]! - points[a]!, points[b + 1]! - points[a + 1]!) / span;
  const rise = (points[b + 2]! - points[a + 2]!) / span + gravity * span * (0.5 - part);
  to[4] = Math.hypot(level, rise);
}

function trajectoriesOf(message: Binary<TrajectoriesMessage>): Trajectories | null {
  const [points, first, boulder, mass] = [message.f4('points'), message.u4('first'), message.u4('boulder'), message.f4('mass')];
  if (!points || !first || !boulder || !mass) return null;
  return { points: points.values, first: first.values, boulder: boulder.values, mass: mass.values };
}

/** Trajectories of a message, appended to earlier ones if the message continues their run. */
export function extended(known: Trajectories | null, message: Binary<TrajectoriesMessage>): Trajectories | null {
  const added = trajectoriesOf(message);
  return added && message.header.append && known ? joined(known, added) : added;
}

function joined(a: Trajectories, b: Trajectories): Trajectories {
  const points = new Float32Array(a.points.length + b.points.length);
  points.set(a.points);
  points.set(b.points, a.points.length);
  const offset = a.first.at(-1) ?? 0;
  return {
    points,
    first: Uint32Array.from([...a.first.slice(0, -1), ...b.first.map((k) => k + offset)]),
    boulder: Uint32Array.from([...a.boulder, ...b.boulder]),
    mass: Float32Array.from([...a.mass, ...b.mass]),
  };
}
