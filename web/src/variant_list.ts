// SPDX-License-Identifier: BSD-3-Clause
// Variants in the window: variants of the case and stored variants, their list, and the comparison of two.
import { CompareView } from './compare';
import type { Connection } from './connection';
import type { DocumentStore } from './document';
import { VariantPanel } from './panels/variants';
import type { Binary, CaseDocument, Wanted, Welcome } from './protocol';
import type { Results } from './results';
import type { Mode } from './shell';
import { say } from './texts';
import { unrun, withResults, type Snapshot } from './snapshots';

/** The window, as the list of variants uses it. */
interface Host {
  readonly store: DocumentStore;
  readonly results: Results;
  readonly connection: Connection;
  readonly writer: boolean;
  readonly preliminary: boolean;
  readonly wanted: Wanted;
  readonly mode: Mode;
  show(mode: Mode): void;
}

export class VariantList {
  readonly panel: VariantPanel;
  readonly compare = new CompareView(
    () => this.host.show('map'),
    (chosen) => this.run(chosen),
  );

  constructor(
    private readonly host: Host,
    private readonly welcome: Welcome,
    public kept: Snapshot[] = welcome.variants.map(unrun),
  ) {
    this.panel = new VariantPanel({
      keep: (name) => this.keep(name),
      compare: (k) => this.openCompare(k + 1),
      restore: (k) => this.take(this.kept[k]?.document),
      forget: (k) => this.set(this.kept.filter((_, one) => one !== k)),
      base: () => this.take(welcome.base),
    });
  }

  refresh(): void {
    const { store, results, writer, preliminary } = this.host;
    const based = this.welcome.base ? store.document.variant : null;
    this.panel.update(this.kept, results.batch !== null && !preliminary, writer, based);
  }

  /** Adopt the results of a variant. */
  receive(message: Binary): void {
    this.set(withResults(this.kept, message));
    this.updateCompare();
  }

  updateCompare(): void {
    if (this.host.mode === 'compare') this.compare.update(this.states());
  }

  private set(kept: Snapshot[]): void {
    this.kept = kept;
    this.refresh();
  }

  private states(): Snapshot[] {
    const now = this.snapshot(say('app.variants.present'));
    return now ? [now, ...this.kept] : this.kept;
  }

  private snapshot(name: string): Snapshot | null {
    const { batch, trajectories, background } = this.host.results;
    if (!batch) return null;
    return { name, document: this.host.store.document, batch: batch.header, overlay: batch.f4('overlay'), trajectories, background };
  }

  private keep(name: string): boolean {
    const now = this.snapshot(name);
    if (!now || this.host.preliminary) return false;
    this.set([...this.kept, now]);
    return true;
  }

  /** Run a variant, unless it already has results for the current map. */
  private run({ name, document, batch }: Snapshot): void {
    if (name === document.variant && !(batch && (batch.overlay?.name ?? '') === this.host.wanted.map))
      this.host.connection.send({ type: 'compare', variant: name });
  }

  private take(document: CaseDocument | null | undefined): void {
    if (!document) return;
    this.host.store.change(document);
    this.host.show('map');
  }

  private openCompare(index: number): void {
    const { terrain, shade } = this.host.results;
    if (!terrain) return;
    this.host.show('compare');
    this.compare.open(terrain, shade, this.states(), index, 0);
  }
}
