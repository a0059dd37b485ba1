// SPDX-License-Identifier: BSD-3-Clause
// Two states side by side: synchronised maps, and a table of both states and their difference.
import type { ColourScale } from './colours';
import { button, element, select } from './dom';
import { Legend } from './legend';
import { MapView } from './map/map_view';
import { estimate, percent, QUANTITIES } from './panels/statistics';
import { hasStatistics, type BackgroundMessage, type Binary, type Estimate, type LineStatistics, type OverlayHeader } from './protocol';
import { decimal, rounded, say, sayOr, supportedDecimals } from './texts';
import { difference, type Snapshot } from './snapshots';
import type { Shade, Terrain } from './terrain';

class Side {
  readonly root = element('div', { class: 'compare-side' });
  readonly view: MapView;
  private readonly target = element('div', { class: 'map' });
  private readonly choice = element('div', { class: 'compare-choice' });
  private offered = '';
  private background: Binary<BackgroundMessage> | null = null;

  constructor(
    private readonly letter: string,
    terrain: Terrain,
    private readonly shade: Shade | null,
  ) {
    this.root.append(this.target, this.choice);
    this.view = new MapView(this.target);
    this.view.setTerrain(terrain, shade);
  }

  show(snapshot: Snapshot, scale: ColourScale | null): void {
    this.view.showDocument(snapshot.document.layers);
    const { batch, overlay, background } = snapshot;
    if (background !== this.background) this.view.setBackground(background, this.shade?.cell ?? 1);
    this.background = background;
    this.view.setResult(batch?.overlay ?? null, overlay?.values ?? null, overlay?.shape ?? []);
    this.view.dim(!batch?.complete);
    if (scale) this.view.paintResult(scale);
    this.view.setTrajectories(snapshot.trajectories);
  }

  offer(names: readonly string[], chosen: number, action: (index: number) => void): void {
    const offered = JSON.stringify([names, chosen]);
    if (offered === this.offered) return;
    this.offered = offered;
    const choices = names.map((name, k) => [String(k), name] as const);
    const about = { label: say('app.compare.side', { side: this.letter }), attributes: { 'data-side': this.letter } };
    const box = select(choices, String(chosen), (value) => action(Number(value)), about);
    this.choice.replaceChildren(element('b', {}, this.letter), box);
  }
}

export class CompareView {
  readonly root = element('div', { class: 'compare' });
  readonly table = element('div', { class: 'statistics compare-table' });
  private sides: readonly [Side, Side] | null = null;
  private states: readonly Snapshot[] = [];
  private chosen: [number, number] = [0, 0];
  private readonly legend = new Legend([], '', () => undefined);

  constructor(
    private readonly onClose: () => void,
    private readonly onChoice: (chosen: Snapshot) => void,
  ) {
    this.legend.root.classList.add('small');
  }

  /** Compare two states; option 0 is the present state. */
  open(terrain: Terrain, shade: Shade | null, states: readonly Snapshot[], a: number, b: number): void {
    if (!this.sides) {
      this.sides = [new Side('A', terrain, shade), new Side('B', terrain, shade)];
      const [left, right] = this.sides;
      right.view.map.setView(left.view.map.getView());
      const close = button(say('app.compare.close'), this.onClose, { class: 'compare-close', action: 'close-compare' });
      this.root.append(left.root, right.root, this.legend.root, close);
    }
    this.chosen = [a, b];
    for (const one of [states[a], states[b]]) if (one) this.onChoice(one);
    this.update(states);
    this.sides.forEach(({ view }) => view.map.updateSize());
    this.sides[0].view.fitResults();
  }

  /** Update the list of states. */
  update(states: readonly Snapshot[]): void {
    this.states = states;
    const [i, j] = this.chosen;
    const [a, b] = [states[i], states[j]];
    if (!this.sides || !a || !b) return;
    const scale = common(a.batch?.overlay ?? null, b.batch?.overlay ?? null);
    const names = states.map(({ name }) => name);
    this.sides.forEach((side, k) => {
      side.show(k === 0 ? a : b, scale);
      side.offer(names, this.chosen[k] ?? 0, (index) => {
        const chosen = this.states[index];
        this.chosen[k] = index;
        if (chosen) this.onChoice(chosen);
        this.update(this.states);
      });
    });
    this.legend.setResult(scale);
    this.legend.root.hidden = scale === null;
    this.table.replaceChildren(tableOf(a, b));
  }
}

/** Result with the common scale of two results of the same map, or the only result; null if the maps differ. */
function common(a: OverlayHeader | null, b: OverlayHeader | null): OverlayHeader | null {
  if (!a || !b || a.name !== b.name) return a && b ? null : (a ?? b);
  return {
    ...a,
    low: Math.min(a.low, b.low),
    high: Math.max(a.high, b.high),
    scale: a.scale === 'log' || b.scale === 'log' ? 'log' : 'linear',
  };
}

const NONE: Estimate = [null, null, null];

interface Row {
  label: string;
  unit: string;
  decimals: number;
  of: (line: LineStatistics) => Estimate;
}

function tableOf(a: Snapshot, b: Snapshot): HTMLElement {
  if (!a.batch || !b.batch) return element('p', { class: 'empty' }, say('app.variants.running'));
  const all = [a.batch.lines.filter(hasStatistics), b.batch.lines.filter(hasStatistics)];
  const names = [...new Set(all.flat().map(({ name }) => name))];
  if (!names.length) return element('p', { class: 'empty' }, say('app.statistics.none'));
  const rows = rowsOf(all.flat());
  const titles = [say('app.statistics.line'), say('app.compare.quantity'), `A: ${a.name}`, `B: ${b.name}`, say('app.compare.difference')];
  const head = element('thead', {}, element('tr', {}, ...titles.map((text) => element('th', { attributes: { scope: 'col' } }, text))));
  const bodies = names.map((name) => {
    const [left, right] = all.map((lines) => lines.find((line) => line.name === name));
    const rowOf = ({ label, unit, decimals, of }: Row, k: number): HTMLElement => {
      const [x, y] = [left ? of(left) : NONE, right ? of(right) : NONE];
      return element(
        'tr',
        {},
        k === 0 && element('th', { attributes: { scope: 'rowgroup', rowspan: rows.length } }, name),
        element('td', {}, label, element('span', { class: 'unit' }, ` ${unit}`)),
        element('td', {}, estimate(x, decimals)),
        element('td', {}, estimate(y, decimals)),
        element('td', { class: 'difference' }, change(difference(x, y), decimals)),
      );
    };
    return element('tbody', { attributes: { 'data-line': name } }, ...rows.map(rowOf));
  });
  return element('table', {}, element('caption', { class: 'hidden-text' }, say('app.compare.caption')), head, ...bodies);
}

function rowsOf(lines: readonly LineStatistics[]): Row[] {
  const fraction: Row = { label: say('app.statistics.fraction'), unit: '%', decimals: 1, of: (line) => percent(line.fraction) };
  const others = QUANTITIES.flatMap((name) => {
    const first = lines.map((line) => line.quantities[name]).find((one) => one !== undefined);
    if (!first) return [];
    return (['mean', 'q95'] as const).map((part): Row => ({
      label: `${sayOr(`app.quantity.${name}`, first.label)}, ${say(`app.statistics.${part}`)}`,
      unit: first.unit,
      decimals: first.decimals,
      of: (line) => line.quantities[name]?.[part] ?? NONE,
    }));
  });
  return [fraction, ...others];
}

/** Difference with its sign; grey if its interval contains zero. */
function change(value: Estimate, decimals: number): HTMLElement {
  const [middle, low, high] = value;
  if (middle === null) return element('span', { class: 'estimate none' }, '–');
  const shown = supportedDecimals(value, decimals);
  const signed = (one: number | null): string =>
    one === null ? '?' : `${one > 0 ? '+' : one < 0 ? '−' : ''}${rounded(Math.abs(one), shown)}`;
  const open = low === null || high === null || (low <= 0 && high >= 0);
  const number = element('b', {}, middle === 0 ? decimal(0) : signed(middle));
  return element('span', { class: `estimate ${open ? 'open' : 'clear'}` }, number, element('small', {}, `${signed(low)} … ${signed(high)}`));
}
