// SPDX-License-Identifier: BSD-3-Clause
// Sends changes of the document: at most every 60 ms, and while a shape is dragged not before the results of the last ones are here.
import type { Connection } from './connection';
import type { Difference, DocumentStore } from './document';
import type { Feature, Group, Layer } from './protocol';

const SHORTEST = 60; // ms between two edits
const LONGEST = 400; // ms that an edit waits for results of the one before

export class Sender {
  /** Revision of the last edit sent. */
  revision = 0;
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

  /** True while the document has changes that the server does not know. */
  get pending(): boolean {
    return this.layers.size + this.groups.size > 0;
  }

  start(revision: number): void {
    this.revision = revision;
    this.layers.clear();
    this.groups.clear();
    this.answered = true;
  }

  add(changed: Difference): void {
    for (const layer of changed.layers) this.layers.add(layer);
    for (const group of changed.groups) this.groups.add(group);
    this.schedule();
  }

  /** Results, or errors, of the last edit have come. */
  answer(): void {
    this.answered = true;
    if (this.pending) this.schedule();
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
    const changed: Partial<Record<Layer, readonly Feature[]>> = {};
    for (const layer of this.layers) changed[layer] = layers[layer];
    const groups: Record<string, Group> = {};
    for (const group of this.groups) groups[group] = settings[group] ?? {};
    this.layers.clear();
    this.groups.clear();
    this.revision += 1;
    this.sent = performance.now();
    this.answered = false;
    this.connection.send({ type: 'edit', revision: this.revision, layers: changed, settings: groups, variant });
    this.onSent();
  }
}
