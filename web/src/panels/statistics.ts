// SPDX-License-Identifier: BSD-3-Clause
// Statistics at the lines, with 95 % intervals and small distributions.
import { element, svg } from '../dom';
import type { Estimate, LineStatistics, QuantityStatistics } from '../protocol';
import { decimal, rounded, say, sayOr, supportedDecimals } from '../texts';

export const QUANTITIES = ['speed', 'energy_total', 'passing_height'] as const;

/** A value to the digits that its interval supports, and the interval below it. */
export function estimate(value: Estimate, decimals: number): HTMLElement {
  const [middle, low, high] = value;
  if (middle === null) return element('span', { class: 'estimate none' }, '–');
  const shown = supportedDecimals(value, decimals);
  const interval = low === null && high === null ? '' : `${limit(low, shown)} – ${limit(high, shown)}`;
  return element('span', { class: 'estimate' }, element('b', {}, rounded(middle, shown)), element('small', {}, interval));
}

function limit(value: number | null, decimals: number): string {
  return value === null ? '?' : rounded(value, decimals);
}

/** Distribution as bars, with a mark at the 95 % quantile. */
export function histogram({ counts, edges, q95: [q95], label, unit }: QuantityStatistics): SVGSVGElement {
  const [width, height] = [66, 28];
  const most = Math.max(...counts, 1);
  const first = edges[0] ?? 0;
  const last = edges.at(-1) ?? 1;
  const x = (value: number): number => (width * (value - first)) / (last - first || 1);
  const bars = counts.map((count, k) => {
    const [left, right] = [x(edges[k] ?? 0), x(edges[k + 1] ?? 0)];
    const top = height - 1 - ((height - 3) * count) / most;
    return count ? `M${left.toFixed(1)} ${height - 1}V${top.toFixed(1)}H${Math.max(left + 0.5, right - 0.6).toFixed(1)}V${height - 1}Z` : '';
  });
  const range = `${label}: ${decimal(Number(first.toPrecision(2)))} – ${decimal(Number(last.toPrecision(2)))} ${unit}`;
  const drawing = svg('svg', { viewBox: `0 0 ${width} ${height}`, class: 'histogram', role: 'img', 'aria-label': range },
    svg('path', { d: bars.join(''), class: 'bars' }), svg('path', { d: `M0 ${height - 0.5}H${width}`, class: 'axis' }));
  const title = svg('title', {});
  title.textContent = range;
  drawing.append(title);
  if (q95 !== null) drawing.append(svg('path', { d: `M${x(q95).toFixed(1)} 0V${height - 1}`, class: 'mark' }));
  return drawing;
}

/** Bar of a fraction in per cent, with its interval. */
function fractionBar([value, low, high]: Estimate): SVGSVGElement {
  const bar = svg('svg', { viewBox: '0 0 100 6', class: 'fraction-bar', preserveAspectRatio: 'none', 'aria-hidden': 'true' }, svg('rect', { x: 0, y: 0, width: 100, height: 6, class: 'track' }));
  if (value !== null) bar.append(svg('rect', { x: 0, y: 0, width: value, height: 6, class: 'value' }));
  if (low !== null && high !== null) bar.append(svg('rect', { x: low, y: 0, width: Math.max(0.8, high - low), height: 6, class: 'interval' }));
  return bar;
}

/** Fraction passing in per cent: 0 and 100 only where it is exactly so. */
export function percent([value, low, high]: Estimate): Estimate {
  const of = (part: number | null): number | null => (part === null ? null : 100 * part);
  return [of(value), of(low), of(high)];
}

export class StatisticsPanel {
  readonly root = element('div', { class: 'statistics' });
  private lines: readonly LineStatistics[] = [];
  private selected = '';

  constructor(private readonly onChosen: (name: string) => void) {}

  update(lines: readonly LineStatistics[]): void {
    this.lines = lines;
    this.show();
  }

  /** Mark the line of this name. */
  select(name: string): void {
    this.selected = name;
    this.show();
  }

  private show(): void {
    this.root.replaceChildren(this.lines.length ? this.table() : element('p', { class: 'empty' }, say('app.statistics.none')));
  }

  private table(): HTMLTableElement {
    const known = QUANTITIES.map((name) => ({ name, of: this.lines.map((line) => line.quantities[name]).find((one) => one !== undefined) })).filter(({ of }) => of !== undefined);
    const heads = known.map(({ name, of }) => element('th', { attributes: { colspan: '3', scope: 'colgroup' } }, sayOr(`app.quantity.${name}`, of?.label ?? name), element('span', { class: 'unit' }, ` ${of?.unit ?? ''}`)));
    const parts = known.flatMap(() => [element('th', { class: 'group-start', attributes: { scope: 'col' } }, say('app.statistics.mean')), element('th', { attributes: { scope: 'col' } }, say('app.statistics.q95')), element('th', { class: 'plot', attributes: { scope: 'col' } }, element('span', { class: 'hidden-text' }, say('app.statistics.distribution')))]);
    const head = element('thead', {},
      element('tr', {}, element('th', { attributes: { rowspan: '2', scope: 'col' } }, say('app.statistics.line')), element('th', { attributes: { rowspan: '2', scope: 'col' } }, say('app.statistics.fraction'), element('span', { class: 'unit' }, ' %')), ...heads),
      element('tr', {}, ...parts));
    return element('table', {}, element('caption', { class: 'hidden-text' }, say('app.statistics.caption')), head, element('tbody', {}, ...this.lines.map((line) => this.row(line, known.map(({ name }) => name)))));
  }

  private row(line: LineStatistics, names: readonly string[]): HTMLTableRowElement {
    const fraction = percent(line.fraction);
    const cells = names.flatMap((name) => {
      const quantity = line.quantities[name];
      const title = sayOr(`app.quantity.${name}`, quantity?.label ?? name);
      const cell = (part: 'mean' | 'q95'): HTMLElement =>
        element('td', { class: part === 'mean' ? 'group-start' : '', attributes: { 'data-quantity': name, 'data-part': part, 'data-label': `${title} [${quantity?.unit ?? ''}], ${say(`app.statistics.${part}`)}` } }, quantity ? estimate(quantity[part], quantity.decimals) : '–');
      return [cell('mean'), cell('q95'), element('td', { class: 'plot' }, quantity && line.n > 1 ? histogram(quantity) : '')];
    });
    const name = element('button', { class: 'line-name', attributes: { type: 'button' } }, element('span', { class: `swatch ${line.kind}s` }), element('span', {}, line.name));
    name.addEventListener('click', () => this.onChosen(line.name));
    return element('tr', { class: line.name === this.selected ? 'selected' : '', attributes: { 'data-line': line.name } },
      element('th', { attributes: { scope: 'row' } }, name, element('small', {}, say('app.statistics.n', { n: line.n }))),
      element('td', { class: 'fraction', attributes: { 'data-part': 'fraction', 'data-label': `${say('app.statistics.fraction')} [%]` } }, estimate(fraction, 1), fractionBar(fraction)),
      ...cells);
  }
}
