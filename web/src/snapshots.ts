// SPDX-License-Identifier: BSD-3-Clause
// Variants: stored states with document, statistics and picture; differences of estimates.
import {
  isOf,
  variantOf,
  type BackgroundMessage,
  type BatchMessage,
  type Binary,
  type CaseDocument,
  type Estimate,
} from './protocol';
import { extended, type Trajectories } from './trajectories';

/** A state of the page that can be viewed again. */
export interface Snapshot {
  name: string;
  document: CaseDocument;
  batch: BatchMessage | null; // null for a variant that has not run
  overlay: { values: Float32Array; shape: number[] } | null;
  trajectories: Trajectories | null;
  background: Binary<BackgroundMessage> | null;
}

/** A variant of the case that has not run. */
export function unrun(document: CaseDocument): Snapshot {
  return { name: document.variant, document, batch: null, overlay: null, trajectories: null, background: null };
}

/** Snapshots in which a message has replaced the results of its variant. */
export function withResults(snapshots: readonly Snapshot[], message: Binary): Snapshot[] {
  const variant = variantOf(message);
  return snapshots.map((one) => {
    if (one.document.variant !== variant || one.name !== variant) return one;
    if (isOf(message, 'batch')) return { ...one, batch: message.header, overlay: message.f4('overlay') };
    if (isOf(message, 'trajectories')) return { ...one, trajectories: extended(one.trajectories, message) };
    return isOf(message, 'background') ? { ...one, background: message } : one;
  });
}

/**
 * Difference b - a of two estimates, with a 95 % interval from their intervals (square-and-add,
 * Zou and Donner 2008). The estimates are assumed independent; since boulders of equal number
 * share random numbers, the true interval is narrower.
 */
export function difference([a, aLow, aHigh]: Estimate, [b, bLow, bHigh]: Estimate): Estimate {
  if (a === null || b === null) return [null, null, null];
  const apart = b - a;
  if (aLow === null || aHigh === null || bLow === null || bHigh === null) return [apart, null, null];
  return [apart, apart - Math.hypot(b - bLow, aHigh - a), apart + Math.hypot(bHigh - b, a - aLow)];
}
