// SPDX-License-Identifier: BSD-3-Clause
// Hazard of the scenarios: annual frequencies at lines, nets and houses, classes on the map, and origin of boulders.
import { checkbox, element } from '../dom';
import type { Binary, HazardMessage, OriginsMessage } from '../protocol';
import { Chart } from '../section/chart';
import { foldedTable, tableOf } from '../tables';
import { decimal, say } from '../texts';

const [WIDTH, HEIGHT] = [320, 190]; // size of the curve [px]
const RAREST = 1e-5; // lowest frequency shown, relative to the highest

interface Actions {
  run(on: boolean): void;
  classes(on: boolean): void;
  origin(place: string): void;
}

export class HazardPanel {
  readonly root = element('div', { class: 'hazard' });
  private readonly state = element('p', { class: 'hint', attributes: { role: 'status', 'data-read': 'hazard' } });
  private readonly origin = element('section', { class: 'origins' });
  private readonly content = element('div');
  private readonly runs: HTMLInputElement;
  private readonly shows: HTMLInputElement;

  constructor(
    scenarios: number,
    private readonly actions: Actions,
  ) {
    const run = checkbox(say('app.hazard.run', { n: scenarios }), false, actions.run, { action: 'hazard' });
    const show = checkbox(say('app.hazard.classes'), true, actions.classes, { attributes: { 'data-show': 'hazard' } });
    this.runs = run.querySelector('input') as HTMLInputElement;
    this.shows = show.querySelector('input') as HTMLInputElement;
    this.root.append(
      element('h2', {}, say('app.tab.hazard')),
      element('p', { class: 'hint' }, say('app.hazard.hint')),
      run,
      show,
      this.state,
      this.origin,
      this.content,
    );
  }

  /** Set whether the scenarios run and whether their classes are shown. */
  set(running: boolean, shown: boolean, enabled: boolean): void {
    this.runs.checked = running;
    this.shows.checked = shown;
    this.runs.disabled = !enabled;
  }

  tell(text: string): void {
    this.state.textContent = text;
  }

  show(header: HazardMessage | null): void {
    this.content.replaceChildren();
    if (!header) return;
    const [scenarios, ...tables] = header.tables;
    const places = tables.map((table) => tableOf(table, header.places, this.actions.origin));
    this.content.append(
      ...(places.length ? [element('p', { class: 'hint' }, say('app.hazard.choose'))] : []),
      ...places.map((table) => element('div', { class: 'wide' }, table)),
      ...header.sentences.map((text) => element('p', { class: 'sentence' }, text)),
      ...(scenarios ? [tableOf(scenarios)] : []),
    );
  }

  showOrigins(message: Binary<OriginsMessage> | null): void {
    const header = message?.header;
    this.origin.replaceChildren();
    this.content.querySelectorAll('[data-place]').forEach((one) => one.setAttribute('aria-pressed', String((one as HTMLElement).dataset['place'] === header?.place)));
    if (!message || !header?.place) return;
    const numbers = { place: header.place, n: header.total ? decimal(Number(header.total.toPrecision(2))) : '0' };
    this.origin.append(
      element('h3', {}, say('app.hazard.origins', numbers)),
      ...(header.error ? [element('p', { class: 'alert amber' }, header.error)] : []),
      key(header.parts.map(([text, colour, cells]) => [say('app.hazard.cells', { text, cells }), colour])),
      ...header.tables.map((table) => (table.rows.length > 1 ? element('div', { class: 'wide' }, foldedTable(table, false)) : tableOf(table))),
      ...exceedance(message),
    );
  }
}

/** Chart of the annual frequency of boulders above each energy, with limits; empty without boulders. */
function exceedance(message: Binary<OriginsMessage>): Node[] {
  const [energy, ...curves] = ['energy', 'frequency', 'low', 'high'].map((name) => message.f8(`curve_${name}`)?.values);
  const [frequency, low, high] = curves;
  if (!energy || !frequency || !low || !high || !((frequency[0] ?? 0) > 0)) return [];
  const [least, most, highest] = [energy[1] ?? 1, energy.at(-1) ?? 10, 10 ** Math.ceil(Math.log10(high[0] ?? 1))];
  const shown = energy.map((value) => Math.max(value, least));
  const chart = new Chart(say('app.hazard.exceedance'), WIDTH, HEIGHT, { low: least, high: most }, { low: highest * RAREST, high: highest }, 'log');
  chart.band(shown, low, high, 'band recorded');
  chart.curve(shown, frequency, 'quantile recorded');
  return [element('div', { class: 'drawings' }, chart.root)];
}

function key(entries: readonly (readonly [string, string])[]): HTMLElement {
  const items = entries.map(([text, colour]) => {
    const patch = element('span', { class: 'patch' });
    patch.style.background = colour;
    return element('li', {}, patch, text);
  });
  return element('ul', { class: 'patches' }, ...items);
}
