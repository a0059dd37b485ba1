// SPDX-License-Identifier: BSD-3-Clause
// Display settings of the map: layers, opacity of the result, number and colour of trajectories.
import { LAYER_COLOURS } from '../colours';
import { checkbox, element, labelled, select } from '../dom';
import type { Shown } from '../map/map_view';
import type { Wanted, Welcome } from '../protocol';
import { decimal, say } from '../texts';
import { swatch } from './features';

const RESULTS: readonly Shown[] = ['overlay', 'trajectories', 'stops'];
const CASE: readonly Shown[] = ['sources', 'lines', 'barriers', 'dams', 'drawn_zones', 'background_sources', 'zones', 'trees', 'stands', 'objects'];
const GROUND: readonly Shown[] = ['contours', 'basemap', 'wms'];
const HIDDEN_AT_FIRST: readonly Shown[] = ['stops', 'contours'];
const NUMBERS = [0, 20, 50, 100, 200, 500, 1000];

interface Actions {
  visible(name: Shown, on: boolean): void;
  opacity(value: number): void;
  bySpeed(on: boolean): void;
  want(change: Partial<Wanted>): void;
}

export class DisplayPanel {
  readonly root = element('div', { class: 'display' });
  private readonly rows = new Map<Shown, HTMLElement>();
  private readonly number: HTMLSelectElement;
  private readonly objects: HTMLSelectElement;
  private readonly basemap: HTMLSelectElement;

  constructor(actions: Actions, view: Wanted, offers: Welcome['offers'], opacity: number) {
    const { trajectories } = view;
    const row = (name: Shown): HTMLElement => {
      const label = element('span', {}, colourOf(name), say(`app.show.${name}`));
      const made = checkbox(label, !HIDDEN_AT_FIRST.includes(name), (on) => actions.visible(name, on), {
        attributes: { 'data-show': name },
      });
      this.rows.set(name, made);
      return made;
    };
    const slider = element('input', { attributes: { type: 'range', min: '0.1', max: '1', step: '0.05', value: opacity } });
    slider.addEventListener('input', () => actions.opacity(Number(slider.value)));
    const known = [...new Set([...NUMBERS, trajectories])].sort((a, b) => a - b);
    this.number = select(
      known.map((n) => [String(n), decimal(n)] as const),
      String(trajectories),
      (value) => actions.want({ trajectories: Number(value) }),
      { action: 'trajectories' },
    );
    const choice = (action: 'objects' | 'basemap', labels: readonly string[]): HTMLSelectElement =>
      select([['', say('app.display.none')], ...labels.map((label) => [label, label] as const)], view[action], (label) => actions.want({ [action]: label }), { action });
    this.objects = choice('objects', offers.objects);
    this.basemap = choice('basemap', offers.basemaps);
    this.root.append(
      element('h2', {}, say('app.display.results')),
      ...RESULTS.map(row),
      labelled(say('app.display.opacity'), slider),
      labelled(say('app.display.trajectories'), this.number),
      checkbox(say('app.display.by_speed'), false, actions.bySpeed, { attributes: { 'data-show': 'by_speed' } }),
      element('h2', {}, say('app.display.ground')),
      ...GROUND.map(row),
      labelled(say('app.display.basemap'), this.basemap, true),
      element('p', { class: 'hint' }, say('app.display.basemap_hint')),
      element('h2', {}, say('app.display.case')),
      ...CASE.map(row),
      labelled(say('app.display.objects'), this.objects, true),
      element('p', { class: 'hint' }, say('app.display.objects_hint')),
    );
    for (const name of ['zones', 'background_sources', 'trees', 'stands'] as const) this.offer(name, false); // initially
  }

  /** Allow the choice of the number of trajectories and of the object layer. */
  enable(on: boolean): void {
    this.number.disabled = this.objects.disabled = this.basemap.disabled = !on;
  }

  /** True if a layer is switched on. */
  isShown(name: Shown): boolean {
    return this.rows.get(name)?.querySelector('input')?.checked ?? true;
  }

  /** Set the label of the object layer. */
  setObjects(label: string): void {
    this.objects.value = label;
    this.offer('objects', label !== '');
  }

  /** Set the label of the basemap. */
  setBasemap(label: string): void {
    this.basemap.value = label;
    this.offer('basemap', label !== '');
  }

  /** Show the switch of a layer only if the case has the layer. */
  offer(name: Shown, offered: boolean): void {
    const row = this.rows.get(name);
    if (row) row.hidden = !offered;
  }
}

function colourOf(name: Shown): HTMLElement | null {
  const layer = name === 'background_sources' ? 'sources' : name === 'drawn_zones' ? 'zones' : name;
  return name !== 'zones' && layer in LAYER_COLOURS ? swatch(layer as keyof typeof LAYER_COLOURS) : null;
}
