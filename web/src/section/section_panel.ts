// SPDX-License-Identifier: BSD-3-Clause
// Section by two clicks: profile with trajectories and nets, and speeds, energies and heights along it.
import { LineString } from 'ol/geom';
import { element } from '../dom';
import { iconButton } from '../icons';
import { withUnit } from '../legend';
import type { Binary, Position, SectionMessage } from '../protocol';
import { rangeOf } from '../terrain';
import { decimal, rounded, say } from '../texts';
import { Chart } from './chart';

const [WIDTH, PROFILE, SMALL] = [520, 300, 104]; // chart sizes [px]
const ENLARGED = [1, 2, 5, 10]; // vertical exaggerations for flat profiles
const LEAST = 0.25; // minimum fraction of the chart height that a profile fills

export class SectionPanel {
  readonly root = element('section', { class: 'section-panel', hidden: true, label: say('app.section.title') });
  private readonly title = element('h3');
  private readonly reading = element('p', { class: 'reading', attributes: { 'data-read': 'section' } });
  private readonly drawings = element('div', { class: 'drawings' });
  private charts: Chart[] = [];
  private shown: Binary<SectionMessage> | null = null;

  constructor(
    close: () => void,
    private readonly onPlace: (place: Position | null) => void,
  ) {
    const end = iconButton('close', say('app.section.close'), close, { action: 'close-section' });
    this.root.append(element('header', {}, this.title, this.reading, end), this.drawings);
    this.drawings.addEventListener('pointermove', ({ target, clientX }) => {
      const chart = this.charts.find(({ root }) => target instanceof Node && root.contains(target));
      if (chart) this.read(chart.distanceAt(clientX));
    });
    this.drawings.addEventListener('pointerleave', () => this.read(null));
  }

  get message(): SectionMessage | null {
    return this.shown?.header ?? null;
  }

  /** Show a section, or remove it if the message has no vertices. */
  show(message: Binary<SectionMessage> | null): void {
    const vertices = message?.header.vertices ?? [];
    this.root.hidden = vertices.length === 0;
    this.shown = vertices.length ? message : null;
    this.charts = [];
    if (!message || !vertices.length) return;
    const { error, within } = message.header;
    const length = new LineString([...vertices]).getLength();
    this.title.textContent = say('app.section.about', { length: decimal(length, 0), within });
    if (!error) this.charts = [this.profile(message, length), ...this.quantities(message, length)];
    const [first, ...others] = this.charts.map(({ root }) => root);
    this.drawings.replaceChildren(
      ...(error ? [element('p', { class: 'alert amber' }, error)] : []),
      ...(first ? [first, element('div', { class: 'stack' }, ...others), this.key()] : []),
    );
    this.read(null);
  }

  private numbers(name: string): Float64Array {
    return this.shown?.f8(name)?.values ?? new Float64Array();
  }

  /** Chart of the ground with trajectories and nets, at true scale if the profile is steep enough. */
  private profile(message: Binary<SectionMessage>, length: number): Chart {
    const distance = this.numbers('distance');
    const ground = this.numbers('elevation');
    const paths = message.f4('paths')?.values ?? new Float32Array();
    const even = (start: number): Float32Array => Float32Array.from({ length: paths.length / 2 }, (_, k) => paths[2 * k + start] as number);
    const [along, up] = [even(0), even(1)];
    const range = rangeOf(ground, up) ?? { low: 0, high: 1 };
    const [across, room] = Chart.room(WIDTH, PROFILE);
    const relief = Math.max(range.high - range.low, 1);
    const fitOf = (n: number): number => Math.min(across / length, room / (n * relief));
    const times = ENLARGED.find((n) => n * fitOf(n) * relief > LEAST * room) ?? (ENLARGED.at(-1) as number);
    const fit = fitOf(times);
    const middle = (range.low + range.high) / 2;
    const half = room / (fit * times) / 2;
    const title = withUnit(say('app.section.profile'), 'm') + (times > 1 ? `, ${say('app.section.enlarged', { times })}` : '');
    const chart = new Chart(title, WIDTH, PROFILE, { low: 0, high: across / fit }, { low: middle - half, high: middle + half });
    chart.curve(along, up, 'path');
    chart.curve(distance, ground, 'ground');
    message.header.lines.forEach(({ name, distance: at, kind, height }, k) => {
      chart.line(at, name, k % 4);
      const foot = interpolated(at, distance, ground);
      if (kind === 'barrier' && height !== null && foot !== null) chart.upright(at, foot, foot + height, 'net');
    });
    return chart;
  }

  private quantities({ header }: Binary<SectionMessage>, length: number): Chart[] {
    const distance = this.numbers('distance');
    return Object.entries(header.quantities).map(([name, { unit, factor }]) => {
      const shown = (column: string): Float64Array => this.numbers(column).map((value) => factor * value);
      const of = (value: number | null): number | null => (value === null ? null : factor * value);
      const marks = header.lines.map((line) => ({ at: line.distance, numbers: (line.q95[name] ?? []).map(of) }));
      const known = marks.flatMap(({ numbers }) => numbers.filter((value) => value !== null));
      const curves = ['cell', 'recorded'].map((source) => {
        const [value, low, high] = ['', '_low', '_high'].map((end) => shown(`${source}_${name}_q95${end}`)) as [Float64Array, Float64Array, Float64Array];
        const most = shown(`${source === 'cell' ? 'corridor' : source}_${name}_max`);
        return { source, value, low, high, most };
      });
      const top = rangeOf(known, ...curves.flatMap(({ value, high, most }) => [value, high, most]))?.high ?? 1;
      const title = withUnit(say(`app.quantity.${name}`), unit);
      const chart = new Chart(title, WIDTH, SMALL, { low: 0, high: length }, { low: 0, high: top || 1 });
      for (const { source, value, low, high, most } of curves) {
        chart.band(distance, low, high, `band ${source}`);
        chart.curve(distance, most, `most ${source}`);
        chart.curve(distance, value, `quantile ${source}`);
      }
      for (const { at, numbers } of marks) {
        chart.line(at, '');
        chart.mark(at, numbers, 'at-line');
      }
      return chart;
    });
  }

  private key(): HTMLElement {
    const entries = ['quantile cell', 'most cell', 'quantile recorded', 'most recorded', 'at-line'];
    const items = entries.map((style) => {
      const key = style.replace(' ', '_').replace('-', '_');
      return element('li', {}, element('span', { class: `sample ${style}` }), say(`app.section.key.${key}`));
    });
    return element('ul', { class: 'key' }, ...items);
  }

  /** Show the numbers at the station nearest to a distance, and its position on the map. */
  private read(distance: number | null): void {
    const at = this.numbers('distance');
    const known = distance !== null && at.length > 0 && distance >= 0 && distance <= (at[at.length - 1] ?? 0);
    const k = known ? at.reduce((best, one, i) => (Math.abs(one - distance) < Math.abs((at[best] ?? 0) - distance) ? i : best), 0) : -1;
    for (const chart of this.charts) chart.read(k < 0 ? null : (at[k] ?? 0));
    this.onPlace(k < 0 ? null : [this.numbers('x')[k] ?? 0, this.numbers('y')[k] ?? 0]);
    this.reading.textContent = k < 0 ? '' : this.sentence(k, at[k] ?? 0);
  }

  private sentence(k: number, distance: number): string {
    const parts = [say('app.section.at', { distance: decimal(distance, 0), z: decimal(this.numbers('elevation')[k] ?? NaN, 0) })];
    for (const [name, { unit, factor, decimals }] of Object.entries(this.shown?.header.quantities ?? {})) {
      const at = (column: string): number => factor * (this.numbers(column)[k] ?? NaN);
      const all = ['cell', 'recorded'].map((source) => ['', '_low', '_high'].map((end) => at(`${source}_${name}_q95${end}`)));
      const [value, low, high] = (all.find(([one]) => !Number.isNaN(one)) ?? []).map((one) => rounded(one, decimals));
      const most = [at(`corridor_${name}_max`), at(`recorded_${name}_max`)].find((one) => !Number.isNaN(one));
      const numbers = { value: value ? `${value} (${low} – ${high})` : '–', most: most === undefined ? '–' : rounded(most, decimals), unit };
      parts.push(say('app.section.numbers', { name: say(`app.quantity.${name}`), ...numbers }));
    }
    return parts.join(' · ');
  }
}

/** Value interpolated between stations; null outside. */
function interpolated(at: number, x: ArrayLike<number>, y: ArrayLike<number>): number | null {
  for (let k = 1; k < x.length; k++) {
    const [left, right] = [x[k - 1] as number, x[k] as number];
    if (at < left || at > right) continue;
    const value = (y[k - 1] as number) + ((at - left) / (right - left || 1)) * ((y[k] as number) - (y[k - 1] as number));
    return Number.isNaN(value) ? null : value;
  }
  return null;
}
