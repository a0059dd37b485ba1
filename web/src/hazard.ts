// SPDX-License-Identifier: BSD-3-Clause
// Hazard of the scenarios in the window: classes, sources of the boulders that reach a place, and design check of a net.
import { element } from './dom';
import type { MapView } from './map/map_view';
import { HazardPanel } from './panels/hazard';
import { isOf, type Binary, type HazardMessage, type Text, type Wanted } from './protocol';
import { foldedTable, tableOf } from './tables';
import { say } from './texts';

interface Listener {
  want(change: Partial<Wanted>): void;
  wanted(): Wanted;
  /** Hazard classes to show instead of a result map; null: none. */
  onClasses(classes: HazardMessage['classes'] | null): void;
}

export class Hazard {
  readonly panel: HazardPanel;
  /** Design check of the selected net, below its properties. */
  readonly check = element('section', { class: 'net-check', hidden: true, attributes: { 'aria-live': 'off' } });
  private message: Binary<HazardMessage> | null = null;
  private classes = true;
  private net: Extract<Text, { type: 'net' }> | null = null;

  constructor(
    scenarios: number,
    private readonly view: MapView,
    private readonly listener: Listener,
  ) {
    this.panel = new HazardPanel(scenarios, {
      run: (hazard) => this.run(hazard),
      classes: (on) => {
        this.classes = on;
        this.refresh();
      },
      origin: (place) => this.choose(listener.wanted().origin === place ? '' : place),
    });
  }

  /** Request the sources of boulders that reach a place; no effect unless the hazard is computed. */
  choose(origin: string): void {
    if (this.listener.wanted().hazard && origin !== this.listener.wanted().origin) this.listener.want({ origin });
  }

  /** Select a net or line for the design check; '': none. */
  select(net: string): void {
    if (net !== this.listener.wanted().net) this.listener.want({ net });
    if (!net) this.showNet(null);
  }

  receive(message: Text): boolean {
    if (message.type === 'net') this.showNet(message.net === this.listener.wanted().net ? message : null);
    else if (message.type === 'hazard_begun') this.panel.tell(say('app.hazard.running'));
    else if (message.type === 'hazard_refused') {
      this.panel.tell(message.text);
    } else return false;
    return true;
  }

  receiveBinary(message: Binary): boolean {
    if (isOf(message, 'hazard')) {
      this.message = message;
      this.panel.tell('');
      this.panel.show(message.header);
      this.showNet(this.net);
      this.refresh();
    } else if (isOf(message, 'origins')) {
      this.panel.tell('');
      this.view.origins.show(message);
      this.panel.showOrigins(message);
    } else return false;
    return true;
  }

  /** Discard the results, because an edit has made them out of date. */
  forget(): void {
    if (!this.message) return;
    this.message = null;
    this.panel.show(null);
    this.panel.showOrigins(null);
    this.view.origins.show(null);
    this.refresh();
  }

  /** Classes shown on the map; null: none. */
  get shownClasses(): HazardMessage['classes'] | null {
    return this.classes ? (this.message?.header.classes ?? null) : null;
  }

  enable(on: boolean): void {
    this.panel.set(this.listener.wanted().hazard, this.classes, on);
  }

  private run(hazard: boolean): void {
    this.listener.want({ hazard, origin: hazard ? this.listener.wanted().origin : '' });
    this.panel.tell(hazard ? say('app.hazard.waiting') : '');
    if (!hazard) this.forget();
  }

  private refresh(): void {
    this.view.hazard.show(this.shownClasses && this.message);
    this.listener.onClasses(this.shownClasses);
  }

  private showNet(net: Extract<Text, { type: 'net' }> | null): void {
    this.net = net;
    const yearly = net ? (this.message?.header.nets[net.net] ?? []) : [];
    const tables = [...(net?.tables ?? []), ...yearly];
    const [single, several] = [tables.filter(({ rows }) => rows.length === 1), tables.filter(({ rows }) => rows.length > 1)];
    const open = [...this.check.querySelectorAll('details')].map((one) => one.open);
    this.check.hidden = tables.length === 0;
    this.check.replaceChildren(
      element('h3', {}, say('app.net.title')),
      ...single.map((table) => tableOf(table)),
      ...several.map((table, k) => foldedTable(table, open[k] ?? true)),
      ...(this.listener.wanted().hazard ? [] : [element('p', { class: 'hint' }, say('app.net.hint'))]),
    );
  }
}
