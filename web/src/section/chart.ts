// SPDX-License-Identifier: BSD-3-Clause
// Curves over the distance along a section, or over energies: axes with round numbers, bands, steps and marks.
import { ticks } from '../colours';
import { svg } from '../dom';
import type { Range } from '../terrain';
import { decimal } from '../texts';

type Numbers = ArrayLike<number>;
const [LEFT, RIGHT, TOP, BOTTOM] = [46, 8, 16, 18]; // margins of the axes [px]

/** Chart with axes; curves are added by its methods. */
export class Chart {
  readonly root: SVGSVGElement;
  private readonly cursor = svg('path', { class: 'cursor' });

  constructor(
    readonly title: string,
    private readonly width: number,
    private readonly height: number,
    private readonly along: Range,
    private readonly up: Range,
    private readonly scale: 'linear' | 'log' = 'linear', // scale of both axes
  ) {
    this.root = svg('svg', { viewBox: `0 0 ${width} ${height}`, role: 'img', 'aria-label': title });
    const [right, foot] = [width - RIGHT, height - BOTTOM];
    for (const value of ticks({ ...up, scale })) {
      const y = this.y(value);
      this.root.append(svg('path', { d: `M${LEFT} ${y}H${right}`, class: 'grid' }));
      this.text(LEFT - 5, y + 3.5, decimal(value), 'end');
    }
    for (const value of ticks({ ...along, scale })) {
      this.root.append(svg('path', { d: `M${this.x(value)} ${foot}v4`, class: 'axis' }));
      this.text(this.x(value), height - 4, decimal(value), 'middle');
    }
    this.root.append(svg('path', { d: `M${LEFT} ${foot}H${right}`, class: 'axis' }), this.cursor);
    this.text(LEFT, TOP - 5, title, 'start', 'title');
  }

  /** Size of the plot area in a chart of this size. */
  static room(width: number, height: number): [across: number, up: number] {
    return [width - LEFT - RIGHT, height - TOP - BOTTOM];
  }

  x(distance: number): number {
    return LEFT + this.fraction(distance, this.along) * (this.width - LEFT - RIGHT);
  }
  y(value: number): number {
    const foot = this.height - BOTTOM;
    return foot - this.fraction(value, this.up) * (foot - TOP);
  }
  private fraction(value: number, { low, high }: Range): number {
    if (this.scale === 'log') return Math.log(Math.max(value, low) / low) / Math.log(high / low);
    return (value - low) / (high - low || 1);
  }

  /** Draw a curve with gaps at missing numbers. */
  curve(x: Numbers, y: Numbers, style: string): void {
    this.add(this.points(x, y, 0, x.length), style);
  }

  /** Fill the area between two curves where both are known. */
  band(x: Numbers, low: Numbers, high: Numbers, style: string): void {
    const known = (k: number): boolean => !Number.isNaN((low[k] as number) + (high[k] as number));
    let d = '';
    for (let k = 0; k < x.length; k++) {
      const begin = k;
      while (k < x.length && known(k)) k++;
      if (k - begin < 2) continue;
      const back = Array.from({ length: k - begin }, (_, i) => this.at(x[k - 1 - i], low[k - 1 - i]));
      d += `${this.points(x, high, begin, k)}L${back.join('L')}Z`;
    }
    this.add(d, style);
  }

  /** Draw a value and its interval at a position. */
  mark(x: number, [value, low, high]: readonly (number | null)[], style: string): void {
    if (value == null) return;
    const [at, y] = [this.x(x), this.y(value)];
    this.add(`M${at} ${y - 4}l4 4l-4 4l-4-4Z`, style);
    if (low != null && high != null) this.add(`M${at} ${this.y(low)}V${this.y(high)}`, `${style} bar`);
  }

  /** Draw a named vertical line across the chart at a distance. */
  line(x: number, name: string, level = 0): void {
    this.add(`M${this.x(x)} ${TOP}V${this.height - BOTTOM}`, 'place');
    if (name) this.text(this.x(x) + 3, TOP + 9 + 11 * level, name, 'start', 'name');
  }

  /** Draw a vertical line from one height to another, for example a net. */
  upright(x: number, low: number, high: number, style: string): void {
    this.add(`M${this.x(x)} ${this.y(low)}V${this.y(high)}`, style);
  }

  /** Mark the distance at which the chart is read; null: none. */
  read(distance: number | null): void {
    this.cursor.setAttribute('d', distance === null ? '' : `M${this.x(distance)} ${TOP}V${this.height - BOTTOM}`);
  }

  /** Distance along the section for a screen position. */
  distanceAt(clientX: number): number {
    const { left, width } = this.root.getBoundingClientRect();
    const at = ((clientX - left) / width) * this.width;
    return this.along.low + ((at - LEFT) / (this.width - LEFT - RIGHT)) * (this.along.high - this.along.low);
  }

  private add(d: string, style: string): void {
    if (d) this.root.insertBefore(svg('path', { d, class: style }), this.cursor);
  }

  private text(x: number, y: number, text: string, anchor: string, style = ''): void {
    this.root.append(svg('text', { x, y, 'text-anchor': anchor, class: style }, text));
  }

  private points(x: Numbers, y: Numbers, begin: number, end: number): string {
    let d = '';
    let drawing = false;
    for (let k = begin; k < end; k++) {
      const known = !Number.isNaN(y[k] as number) && !Number.isNaN(x[k] as number);
      if (known) d += `${drawing ? 'L' : 'M'}${this.at(x[k], y[k])}`;
      drawing = known;
    }
    return d;
  }

  private at(x = 0, y = 0): string {
    return `${this.x(x).toFixed(1)} ${this.y(y).toFixed(1)}`;
  }
}
