// SPDX-License-Identifier: BSD-3-Clause
// Sends changes to the server: at most every 60 ms, and after the previous results, for which it waits up to 400 ms.
import type { Connection } from './connection';
import type { Difference, DocumentStore } from './document';
import { LAYERS, type Feature, type Group, type Layer, type LayerChange, type Layers } from './protocol';

const SHORTEST = 60; // [ms] minimum interval between two edits
const LONGEST = 400; // [ms] maximum wait of an edit for the previous results

export class Sender {
  /** Revision of the last edit sent. */
  revision = 0;
  private known: Layers | null = null; // layers known to the server; null after a refused edit
  private layers = new Set<Layer>();
  private groups = new Set<string>();
  private sent = -Infinity;
  private answered = true;
  private timer = 0;

  constructor(
    private readonly store: DocumentStore,
    private readonly connection: Connection,
    private readonly onSent: () => void,
  ) {}

  /** True while the document has changes unknown to the server. */
  get pending(): boolean {
    return this.layers.size + this.groups.size > 0;
  }

  start(revision: number): void {
    this.revision = revision;
    this.known = this.store.document.layers;
    this.layers.clear();
    this.groups.clear();
    this.answered = true;
  }

  add(changed: Difference): void {
    for (const layer of changed.layers) this.layers.add(layer);
    for (const group of changed.groups) this.groups.add(group);
    this.schedule();
  }

  /** Results or errors of the last edit have arrived. */
  answer(): void {
    this.answered = true;
    if (this.pending) this.schedule();
  }

  /** An edit was refused: the next edit contains the whole document, and is sent at once if later edits were pending. */
  refused(revision: number): void {
    if (!this.known) return;
    this.known = null;
    if (revision === this.revision) return;
    for (const layer of LAYERS) this.layers.add(layer);
    this.schedule();
  }

  private schedule(): void {
    window.clearTimeout(this.timer);
    const wait = this.sent + (this.answered ? SHORTEST : LONGEST) - performance.now();
    if (wait <= 0) this.flush();
    else this.timer = window.setTimeout(() => this.flush(), wait);
  }

  private flush(): void {
    if (!this.pending) return;
    const { layers, settings, variant } = this.store.document;
    const whole = this.known === null;
    const changed: Partial<Record<Layer, LayerChange>> = {};
    for (const layer of whole ? LAYERS.filter((one) => layers[one].length) : this.layers)
      changed[layer] = this.known ? change(this.known[layer], layers[layer]) : layers[layer];
    const groups: Record<string, Group> = {};
    for (const group of whole ? Object.keys(settings) : this.groups) groups[group] = settings[group] ?? {};
    this.known = layers;
    this.layers.clear();
    this.groups.clear();
    this.revision += 1;
    this.sent = performance.now();
    this.answered = false;
    this.connection.send({ type: 'edit', revision: this.revision, layers: changed, settings: groups, variant, whole });
    this.onSent();
  }
}

/** Change between states of a layer: the complete layer if features were reordered. */
function change(before: readonly Feature[], after: readonly Feature[]): LayerChange {
  const old = new Map(before.map((feature) => [feature.id, feature]));
  const now = new Set(after.map(({ id }) => id));
  const remove = before.filter(({ id }) => !now.has(id)).map(({ id }) => id);
  const kept = before.filter(({ id }) => now.has(id));
  if (!kept.every(({ id }, k) => id === after[k]?.id)) return after;
  return { set: after.filter((feature) => old.get(feature.id) !== feature), remove };
}
