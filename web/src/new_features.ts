// SPDX-License-Identifier: BSD-3-Clause
// Initial properties of drawn features.
import type { DocumentStore } from './document';
import { LAYERS, type Layer, type Value, type Welcome } from './protocol';

/** Initial properties of drawn features, by layer. */
const INITIAL: Readonly<Record<Layer, Readonly<Record<string, Value>>>> = {
  sources: {},
  lines: {},
  zones: { mean_radius: 0.3 },
  barriers: { height: 4, capacity: 1000 },
  dams: { height: 5, crest_width: 2 }, // higher on coarse cells, see damHeight
};
const LETTERS: Readonly<Partial<Record<Layer, string>>> = {
  lines: 'L',
  barriers: 'N',
  dams: 'D',
  zones: 'Z',
  sources: 'S',
};

/** Height of a new dam [m] whose faces have the width that the cells require, on slopes up to about 30 degrees. */
function damHeight(cell: number): number {
  return Math.min(10, Math.max(5, Math.ceil(3 * cell)));
}

/** Properties of a new feature: a unique name and default values, which depend on the cell size [m]. */
export function propertiesOf(
  layer: Layer,
  forms: Welcome['forms'],
  store: DocumentStore,
  cell: number,
): Record<string, Value> {
  const fields = new Set(forms.layers[layer]?.map(({ name }) => name));
  const used = new Set(LAYERS.flatMap((one) => store.layer(one).map(({ properties }) => properties['name'])));
  let n = 1;
  while (used.has(`${LETTERS[layer]}${n}`)) n++;
  const own = layer === 'dams' ? { height: damHeight(cell) } : {};
  return Object.fromEntries(
    Object.entries({ name: `${LETTERS[layer]}${n}`, ...INITIAL[layer], ...own }).filter(([name]) => fields.has(name)),
  );
}
