// SPDX-License-Identifier: BSD-3-Clause
// Trajectories of a message, and those of several messages of the same run as one.
import type { Binary, TrajectoriesMessage } from './protocol';
import type { Trajectories } from './view3d/view3d';

function trajectoriesOf(message: Binary<TrajectoriesMessage>): Trajectories | null {
  const [points, first, boulder, mass] = [
    message.f4('points'),
    message.u4('first'),
    message.u4('boulder'),
    message.f4('mass'),
  ];
  if (!points || !first || !boulder || !mass) return null;
  return { points: points.values, first: first.values, boulder: boulder.values, mass: mass.values };
}

/** Trajectories of a message, behind those known of the same run if it continues them. */
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
