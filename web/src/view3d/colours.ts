// SPDX-License-Identifier: BSD-3-Clause
// Palette of the trajectories, which is that of the map, and the legend.
import { css, LAYER_COLOURS, plasma } from '../colours';
import type { Say } from './types';

/** What colours a trajectory. */
export type Quantity = 'speed' | 'energy' | 'height';

export const QUANTITIES: readonly Quantity[] = ['speed', 'energy', 'height'];
export const UNITS: Record<Quantity, string> = { speed: 'm/s', energy: 'kJ', height: 'm' };

/** Colours of what is drawn besides terrain and trajectories. */
export const KINDS = { line: LAYER_COLOURS.lines, barrier: LAYER_COLOURS.barriers, dam: LAYER_COLOURS.dams } as const;

const STEPS = 16; // of the bar

/** The palette as RGBA bytes of a texture one pixel high. */
export function paletteBytes(size: number): Uint8Array<ArrayBuffer> {
  const bytes = new Uint8Array(4 * size).fill(255);
  for (let k = 0; k < size; k++) bytes.set(plasma(k / (size - 1)), 4 * k);
  return bytes;
}

/** Upper end of a scale: the first of 1, 1.5, 2, 3, 4, 5, 6, 8 times a power of ten that is not below a value. */
export function scaleEnd(value: number): number {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 1.5, 2, 3, 4, 5, 6, 8, 10].find((step) => step * power >= value * (1 - 1e-6))!;
}

/** Legend in a corner: quantity to choose, colour bar with values, and kinds of lines that are shown. */
export class Legend {
  readonly element = document.createElement('div');
  private readonly choice = document.createElement('select');
  private readonly scale = document.createElement('div');
  private readonly ticks = document.createElement('div');
  private readonly note = document.createElement('div');
  private readonly kinds = document.createElement('ul');

  constructor(private readonly say: Say, choose: (quantity: Quantity) => void) {
    this.element.className = 'view3d-legend view3d-card';
    this.choice.setAttribute('aria-label', say('app.view3d_colour'));
    for (const quantity of QUANTITIES) this.choice.add(new Option(`${say(`app.view3d_${quantity}`)} [${UNITS[quantity]}]`, quantity));
    this.choice.addEventListener('change', () => choose(this.choice.value as Quantity));
    const bar = document.createElement('div');
    bar.className = 'view3d-bar';
    const steps = Array.from({ length: STEPS }, (_, k) => css(plasma(k / (STEPS - 1))));
    bar.style.background = `linear-gradient(to right, ${steps.join(', ')})`;
    this.ticks.className = 'view3d-ticks';
    this.note.className = 'view3d-note';
    this.note.textContent = say('app.view3d_enlarged');
    this.scale.append(this.choice, bar, this.ticks);
    this.element.append(this.scale, this.kinds, this.note);
    this.showScale('speed', 0, false);
    this.showKinds([]);
  }

  /** Show the scale of a quantity up to `end`, which the largest values may exceed; none without values. */
  showScale(quantity: Quantity, end: number, exceeded: boolean): void {
    this.choice.value = quantity;
    const format = new Intl.NumberFormat(document.documentElement.lang || undefined, { maximumSignificantDigits: 3 });
    const texts = [0, 0.5, 1].map((part) => format.format(part * end));
    if (exceeded) texts[2] = `≥ ${texts[2]}`;
    this.ticks.replaceChildren(...texts.map((text) => Object.assign(document.createElement('span'), { textContent: text })));
    this.scale.hidden = this.note.hidden = end === 0;
    this.hideIfEmpty();
  }

  /** List the kinds of lines that are drawn. */
  showKinds(kinds: (keyof typeof KINDS)[]): void {
    this.kinds.replaceChildren(...kinds.map((kind) => {
      const item = document.createElement('li');
      const swatch = document.createElement('span');
      swatch.className = `view3d-swatch view3d-${kind}`;
      swatch.style.color = KINDS[kind];
      item.append(swatch, this.say(`app.view3d_${kind}`));
      return item;
    }));
    this.kinds.hidden = kinds.length === 0;
    this.hideIfEmpty();
  }

  private hideIfEmpty(): void {
    this.element.hidden = this.scale.hidden && this.kinds.hidden;
  }
}
