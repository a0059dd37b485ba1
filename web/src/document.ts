// SPDX-License-Identifier: BSD-3-Clause
// Edited document, as snapshots that share unchanged parts, with undo and redo.
import { LAYERS, type CaseDocument, type Feature, type Group, type Layer, type SettingValue, type Value } from './protocol';

const KEPT = 200; // undo steps
const EMPTY: CaseDocument = {
  settings: {},
  layers: { sources: [], lines: [], barriers: [], dams: [], zones: [] },
  variant: '',
};

/** Layers and groups that differ between two documents. */
export interface Difference {
  layers: Layer[];
  groups: string[];
}

export class DocumentStore {
  private now: CaseDocument = EMPTY;
  private past: CaseDocument[] = [];
  private future: CaseDocument[] = [];
  private gesture = '';
  private last = 0; // newest id
  private readonly listeners: ((changed: Difference) => void)[] = [];

  get document(): CaseDocument {
    return this.now;
  }
  get canUndo(): boolean {
    return this.past.length > 0;
  }
  get canRedo(): boolean {
    return this.future.length > 0;
  }

  onChange(listener: (changed: Difference) => void): void {
    this.listeners.push(listener);
  }

  /** Start with a document from the server, without undo steps and without a notification. */
  load(document: CaseDocument): void {
    const layers = { ...EMPTY.layers, ...document.layers };
    this.now = { ...document, layers };
    this.past = [];
    this.future = [];
    this.gesture = '';
  }

  /** Adopt a changed document. All changes within a gesture, such as a drag, form a single undo step. */
  change(next: CaseDocument, gesture = ''): void {
    const before = this.now;
    if (next === before) return;
    if (!gesture || gesture !== this.gesture) {
      this.past.push(before);
      if (this.past.length > KEPT) this.past.shift();
    }
    this.future = [];
    this.show(next, gesture);
  }

  undo(): void {
    this.step(this.past, this.future);
  }
  redo(): void {
    this.step(this.future, this.past);
  }

  layer(layer: Layer): readonly Feature[] {
    return this.now.layers[layer];
  }
  feature(id: string): { layer: Layer; feature: Feature } | null {
    for (const layer of LAYERS) {
      const feature = this.layer(layer).find((one) => one.id === id);
      if (feature) return { layer, feature };
    }
    return null;
  }

  setLayer(layer: Layer, features: readonly Feature[], gesture = ''): void {
    this.change({ ...this.now, layers: { ...this.now.layers, [layer]: features } }, gesture);
  }
  add(layer: Layer, feature: Feature): void {
    // Sources are either points or polygons: new sources replace those of the other kind.
    const kept = this.layer(layer).filter((one) => one.type === feature.type);
    this.setLayer(layer, [...kept, feature]);
  }
  replace(layer: Layer, feature: Feature, gesture = ''): void {
    this.setLayer(layer, this.layer(layer).map((one) => (one.id === feature.id ? feature : one)), gesture);
  }
  remove(id: string): void {
    const found = this.feature(id);
    if (found) this.setLayer(found.layer, this.layer(found.layer).filter((one) => one.id !== id));
  }

  /** Set a property; undefined restores its default. */
  setProperty(id: string, name: string, value: Value | undefined): void {
    const found = this.feature(id);
    if (found) this.replace(found.layer, { ...found.feature, properties: withValue(found.feature.properties, name, value) });
  }
  /** Set a key of the case; undefined restores its default. */
  setSetting(group: string, key: string, value: SettingValue | undefined): void {
    const changed: Group = withValue(this.now.settings[group] ?? {}, key, value);
    this.change({ ...this.now, settings: { ...this.now.settings, [group]: changed } });
  }

  /** Set the ground of a document without one, and the rock radius if the ground needs it. */
  setGround(ground: string, radius: number | null): void {
    const surface: Group = radius === null ? { ground } : { ground, uniform_mean_radius: radius };
    this.change({ ...this.now, settings: { ...this.now.settings, surface } });
  }

  /** A new id; ids of removed features are not reused, because undo may restore them. */
  newId(layer: Layer): string {
    const letter = layer.slice(0, 1);
    for (const { id } of LAYERS.flatMap((name) => this.layer(name)))
      this.last = Math.max(this.last, Number(/^[a-z](\d+)$/.exec(id)?.[1] ?? 0));
    return `${letter}${++this.last}`;
  }

  private step(from: CaseDocument[], to: CaseDocument[]): void {
    const next = from.pop();
    if (!next) return;
    to.push(this.now);
    this.show(next, '');
  }

  private show(next: CaseDocument, gesture: string): void {
    const changed = difference(this.now, next);
    this.now = next;
    this.gesture = gesture;
    for (const listener of this.listeners) listener(changed);
  }
}

function difference(before: CaseDocument, after: CaseDocument): Difference {
  const groups = new Set([...Object.keys(before.settings), ...Object.keys(after.settings)]);
  return {
    layers: LAYERS.filter((layer) => {
      const [old, now] = [before.layers[layer], after.layers[layer]];
      return old !== now && old.length + now.length > 0; // no difference if both are empty, even if a layer is missing
    }),
    groups: [...groups].filter((group) => before.settings[group] !== after.settings[group]),
  };
}

function withValue<V>(values: Readonly<Record<string, V>>, name: string, value: V | undefined): Record<string, V> {
  const { [name]: _, ...rest } = values;
  return value === undefined ? rest : { ...rest, [name]: value };
}
