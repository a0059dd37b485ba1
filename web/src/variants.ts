// SPDX-License-Identifier: BSD-3-Clause
// Variants: states that were kept, with their document, statistics and picture; and how two differ.
import type { BatchMessage, CaseDocument, Estimate } from './protocol';
import type { Trajectories } from './view3d/view3d';

/** A state of the page that can be looked at. */
export interface Snapshot {
  name: string;
  document: CaseDocument;
  batch: BatchMessage;
  overlay: { values: Float32Array; shape: number[] } | null;
  trajectories: Trajectories | null;
}

/**
 * Difference b - a of two estimates with a 95 % interval from theirs (square-and-add, Zou and Donner 2008).
 * It takes the two for independent; boulders of the same numbers make the true one narrower.
 */
export function difference([a, aLow, aHigh]: Estimate, [b, bLow, bHigh]: Estimate): Estimate {
  if (a === null || b === null) return [null, null, null];
  const apart = b - a;
  if (aLow === null || aHigh === null || bLow === null || bHigh === null) return [apart, null, null];
  return [apart, apart - Math.hypot(b - bLow, aHigh - a), apart + Math.hypot(bHigh - b, a - aLow)];
}
