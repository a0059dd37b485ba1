// SPDX-License-Identifier: BSD-3-Clause
// Palette of the trajectories, as on the map, and legend.
import { gradient, LAYER_COLOURS, plasma } from '../colours';
import { element, select } from '../dom';
import { decimal, say } from '../texts';

const UNITS = { speed: 'm/s', energy: 'kJ', height: 'm' };
/** Quantities by which trajectories can be coloured. */
export type Quantity = keyof typeof UNITS;

/** Layers that are drawn as lines. */
export const KINDS = ['lines', 'barriers', 'dams'] as const;
export type Kind = (typeof KINDS)[number];

/** Palette as RGBA bytes of a texture with a height of one pixel. */
export function paletteBytes(size: number): Uint8Array<ArrayBuffer> {
  const bytes = new Uint8Array(4 * size).fill(255);
  for (let k = 0; k < size; k++) bytes.set(plasma(k / (size - 1)), 4 * k);
  return bytes;
}

/** Upper end of a scale: the smallest of 1, 1.5, 2, 3, 4, 5, 6, 8 times a power of ten that reaches a value. */
export function scaleEnd(value: number): number {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 1.5, 2, 3, 4, 5, 6, 8, 10].find((step) => step * power >= value * (1 - 1e-6))!;
}

/** Legend in a corner: choice of quantity, colour bar with values, and kinds of lines shown. */
export class Legend {
  private readonly choice: HTMLSelectElement;
  private readonly ticks = element('div', { class: 'view3d-ticks' });
  private readonly note = element('div', { class: 'view3d-note' }, say('app.view3d_enlarged'));
  private readonly kinds = element('ul');
  private readonly scale: HTMLElement;
  readonly root: HTMLElement;

  constructor(choose: (quantity: Quantity) => void) {
    const choices = Object.entries(UNITS).map(([name, unit]) => [name, `${say(`app.view3d_${name}`)} [${unit}]`] as const);
    this.choice = select(choices, 'speed', (name) => choose(name as Quantity), { label: say('app.view3d_colour') });
    const bar = element('div', { class: 'view3d-bar', style: `background: ${gradient(plasma)}` });
    this.scale = element('div', {}, this.choice, bar, this.ticks);
    this.root = element('div', { class: 'view3d-legend card' }, this.scale, this.kinds, this.note);
    this.showScale(0, false);
    this.showKinds([]);
  }

  /** Show the scale of the quantity up to `end`; `exceeded` if values are larger. No scale without values. */
  showScale(end: number, exceeded: boolean): void {
    const texts = [0, 0.5, 1].map((part) => decimal(Number((part * end).toPrecision(3))));
    if (exceeded) texts[2] = `≥ ${texts[2]}`;
    this.ticks.replaceChildren(...texts.map((text) => element('span', {}, text)));
    this.scale.hidden = this.note.hidden = end === 0;
    this.root.hidden = this.scale.hidden && this.kinds.hidden;
  }

  /** List the kinds of drawn lines. */
  showKinds(kinds: readonly Kind[]): void {
    const items = kinds.map((kind) =>
      element('li', {}, element('span', { class: `view3d-swatch view3d-${kind}`, style: `color: ${LAYER_COLOURS[kind]}` }), say(`app.view3d_${kind.slice(0, -1)}`)),
    );
    this.kinds.replaceChildren(...items);
    this.kinds.hidden = kinds.length === 0;
    this.root.hidden = this.scale.hidden && this.kinds.hidden;
  }
}
