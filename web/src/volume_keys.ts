// SPDX-License-Identifier: BSD-3-Clause
// Keys of each volume distribution; other keys are only shown if given.
import type { Values } from './forms';

const OF_DISTRIBUTION: Readonly<Record<string, readonly string[]>> = {
  fixed: ['volume_mean'],
  normal: ['volume_mean', 'volume_std'],
  lognormal: ['volume_mean', 'volume_std'],
  uniform: ['volume_min', 'volume_max'],
  pareto: ['volume_min', 'volume_max', 'volume_exponent'],
  list: ['volumes'],
  source: ['volume_spread'],
};
const ALL = new Set(Object.values(OF_DISTRIBUTION).flat());

/** True if the distribution uses a key, or if the values contain the key. */
export function applies(name: string, values: Values, distribution: string): boolean {
  return !ALL.has(name) || values[name] !== undefined || (OF_DISTRIBUTION[distribution] ?? []).includes(name);
}
