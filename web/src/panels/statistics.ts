// SPDX-License-Identifier: BSD-3-Clause
// Statistics at the lines, with 95 % intervals and small distributions.
import { button, element, svg } from '../dom';
import { hasStatistics, type Estimate, type Line, type LineStatistics, type QuantityStatistics } from '../protocol';
import { decimal, rounded, say, sayOr, supportedDecimals } from '../texts';

const FEW = 30; // with at most this many lines, all are written
const MOST = 200; // maximum number of visible lines reported to the server
const PAUSE = 80; // [ms] after scrolling, before visible lines are reported

export const QUANTITIES = ['speed', 'energy_total', 'passing_height'] as const;

/** Value rounded to the digits that its interval supports, with the interval below. */
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

/** Bar chart of a distribution, with a mark at the 95 % quantile. */
export function histogram({ counts, range: [first, last], q95: [q95], label, unit }: QuantityStatistics): SVGSVGElement {
  const [width, height] = [66, 28];
  const most = Math.max(...counts, 1);
  const x = (value: number): number => (width * (value - first)) / (last - first || 1);
  const bars = counts.map((count, k) => {
    const [left, right] = [k, k + 1].map((edge) => (width * edge) / counts.length) as [number, number];
    const top = height - 1 - ((height - 3) * count) / most;
    return count
      ? `M${left.toFixed(1)} ${height - 1}V${top.toFixed(1)}H${Math.max(left + 0.5, right - 0.6).toFixed(1)}V${height - 1}Z`
      : '';
  });
  const about = `${label}: ${decimal(Number(first.toPrecision(2)))} – ${decimal(Number(last.toPrecision(2)))} ${unit}`;
  const drawing = svg(
    'svg',
    { viewBox: `0 0 ${width} ${height}`, class: 'histogram', role: 'img', 'aria-label': about },
    svg('path', { d: bars.join(''), class: 'bars' }),
    svg('path', { d: `M0 ${height - 0.5}H${width}`, class: 'axis' }),
    svg('title', {}, about),
  );
  if (q95 !== null) drawing.append(svg('path', { d: `M${x(q95).toFixed(1)} 0V${height - 1}`, class: 'mark' }));
  return drawing;
}

/** Bar for a fraction in per cent, with its interval. */
function fractionBar([value, low, high]: Estimate): SVGSVGElement {
  const bar = svg(
    'svg',
    { viewBox: '0 0 100 6', class: 'fraction-bar', preserveAspectRatio: 'none', 'aria-hidden': 'true' },
    svg('rect', { x: 0, y: 0, width: 100, height: 6, class: 'track' }),
  );
  if (value !== null) bar.append(svg('rect', { x: 0, y: 0, width: value, height: 6, class: 'value' }));
  if (low !== null && high !== null)
    bar.append(svg('rect', { x: low, y: 0, width: Math.max(0.8, high - low), height: 6, class: 'interval' }));
  return bar;
}

/** Passing fraction in per cent. */
export function percent([value, low, high]: Estimate): Estimate {
  const of = (part: number | null): number | null => (part === null ? null : 100 * part);
  return [of(value), of(low), of(high)];
}

/** Row of a line. Its head stays when numbers change, so that clicks and focus are not lost. Its numbers are written only
 * while it is visible, because there may be thousands of rows. */
interface Row {
  root: HTMLTableRowElement;
  update(line: LineStatistics): void;
}

export class StatisticsPanel {
  readonly root = element('div', { class: 'statistics' });
  private shape = '';
  private selected = '';
  private rows = new Map<string, Row>();
  private lines = new Map<string, Line | LineStatistics>();
  private readonly visible = new Set<string>();
  private timer = 0;
  private readonly seen = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) {
      const name = (target as HTMLElement).dataset['line'] ?? '';
      if (isIntersecting) {
        this.visible.add(name);
        this.write(name);
      } else {
        this.visible.delete(name);
        target.classList.add('unwritten'); // its numbers may be outdated when it reappears
      }
    }
    window.clearTimeout(this.timer);
    this.timer = window.setTimeout(() => this.onSeen([...this.visible].slice(0, MOST)), PAUSE);
  });

  constructor(
    private readonly onChosen: (name: string) => void,
    private readonly onSeen: (lines: string[]) => void,
  ) {}

  update(lines: readonly (Line | LineStatistics)[]): void {
    const shape = JSON.stringify(lines.map(({ name, kind }) => [name, kind]));
    if (shape !== this.shape)
      this.root.replaceChildren(
        lines.length ? this.table(lines) : element('p', { class: 'empty' }, say('app.statistics.none')),
      );
    this.shape = shape;
    this.lines = new Map(lines.map((line) => [line.name, line]));
    for (const name of lines.length > FEW ? this.visible : this.lines.keys()) this.write(name);
  }

  /** Write the numbers of all lines for printing. */
  writeAll(): void {
    for (const name of this.lines.keys()) this.write(name);
  }

  private write(name: string): void {
    const line = this.lines.get(name);
    const row = this.rows.get(name);
    if (line && hasStatistics(line)) row?.update(line);
    else row?.root.classList.add('unwritten'); // its numbers arrive once the server knows that it is visible
  }

  /** Highlight the line with this name. */
  select(name: string): void {
    this.rows.get(this.selected)?.root.classList.remove('selected');
    this.selected = name;
    const root = this.rows.get(name)?.root;
    root?.classList.add('selected');
    if (this.rows.size > FEW) root?.scrollIntoView({ block: 'nearest' });
  }

  private table(lines: readonly (Line | LineStatistics)[]): HTMLTableElement {
    const known = QUANTITIES.flatMap((name) => {
      const first = lines.map((line) => (hasStatistics(line) ? line.quantities[name] : undefined)).find((one) => one !== undefined);
      return first ? [{ name, title: sayOr(`app.quantity.${name}`, first.label), unit: first.unit }] : [];
    });
    const column = (title: string, unit: string, attributes: Record<string, string>): HTMLElement =>
      element('th', { attributes }, title, element('span', { class: 'unit' }, unit));
    const tall = { rowspan: '2', scope: 'col' };
    const [line, fraction] = [column(say('app.statistics.line'), '', tall), column(say('app.statistics.fraction'), ' %', tall)];
    const heads = known.map(({ title, unit }) => column(title, ` ${unit}`, { colspan: '3', scope: 'colgroup' }));
    const attributes = { scope: 'col' };
    const parts = known.flatMap(() => [
      element('th', { class: 'group-start', attributes }, say('app.statistics.mean')),
      element('th', { attributes }, say('app.statistics.q95')),
      element('th', { class: 'plot', label: say('app.statistics.distribution'), attributes }),
    ]);
    const head = element('thead', {}, element('tr', {}, line, fraction, ...heads), element('tr', {}, ...parts));
    this.seen.disconnect();
    this.visible.clear();
    this.rows = new Map(lines.map((line) => [line.name, this.row(line, known)]));
    if (lines.length > FEW) for (const { root } of this.rows.values()) this.seen.observe(root);
    const body = element('tbody', {}, ...[...this.rows.values()].map(({ root }) => root));
    return element('table', {}, element('caption', { class: 'hidden-text' }, say('app.statistics.caption')), head, body);
  }

  private row({ name, kind }: Line, known: readonly { name: string; title: string; unit: string }[]): Row {
    const about = [element('span', { class: `swatch ${kind}s` }), element('span', {}, name)];
    const chosen = button(about, () => this.onChosen(name), { class: 'line-name' });
    const number = element('small');
    const cell = (style: string, part: string, label: string, quantity: Record<string, string> = {}): HTMLElement =>
      element('td', { class: style, attributes: { ...quantity, 'data-part': part, 'data-label': label } });
    const fraction = cell('fraction', 'fraction', `${say('app.statistics.fraction')} [%]`);
    let cells: { name: string; mean: HTMLElement; q95: HTMLElement; plot: HTMLElement }[] = [];
    const makeCells = (): typeof cells => known.map(({ name, title, unit }) => {
      const of = (part: 'mean' | 'q95', style: string): HTMLElement =>
        cell(style, part, `${title} [${unit}], ${say(`app.statistics.${part}`)}`, { 'data-quantity': name });
      return { name, mean: of('mean', 'group-start'), q95: of('q95', ''), plot: element('td', { class: 'plot' }) };
    });
    const style = name === this.selected ? 'selected' : '';
    const head = element('th', { attributes: { scope: 'row' } }, chosen, number);
    const root = element('tr', { class: style, attributes: { 'data-line': name } }, head);
    const update = (line: LineStatistics): void => {
      if (!cells.length) {
        cells = makeCells();
        root.append(fraction, ...cells.flatMap(({ mean, q95, plot }) => [mean, q95, plot]));
      }
      root.classList.remove('unwritten');
      number.textContent = say('app.statistics.n', { n: line.n });
      const passing = percent(line.fraction);
      fraction.replaceChildren(estimate(passing, 1), fractionBar(passing));
      for (const cell of cells) {
        const quantity = line.quantities[cell.name];
        if (!quantity) continue;
        cell.mean.replaceChildren(estimate(quantity.mean, quantity.decimals));
        cell.q95.replaceChildren(estimate(quantity.q95, quantity.decimals));
        cell.plot.replaceChildren(...(line.n > 1 ? [histogram(quantity)] : []));
      }
    };
    return { root, update };
  }
}
