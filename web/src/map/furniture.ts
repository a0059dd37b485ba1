// SPDX-License-Identifier: BSD-3-Clause
// Controls of a map: zoom and fit, north arrow, scale bar, coordinates and elevation under the pointer.
import { element, svg } from '../dom';
import { iconButton, type Icon } from '../icons';
import { decimal, say } from '../texts';
import type { MapView } from './map_view';
import { scaleBar } from './scale';

/** Map buttons and north arrow. */
export function mapButtons(view: MapView): HTMLElement {
  const made = (name: Icon, key: string, action: () => void): HTMLButtonElement =>
    iconButton(name, say(key), action, { class: '', action: name });
  const arrow = svg(
    'svg',
    { viewBox: '0 0 28 40', class: 'north', role: 'img', 'aria-label': say('app.map.north') },
    svg('path', { d: 'M14 12 21.5 37 14 32 6.5 37Z', class: 'needle' }),
    svg('path', { d: 'M14 12V32L6.5 37Z', class: 'half' }),
    svg('text', { x: 14, y: 9.5, 'text-anchor': 'middle' }, say('app.map.north_letter')),
  );
  return element(
    'div',
    { class: 'map-buttons' },
    arrow,
    element(
      'div',
      { class: 'card', label: say('app.map.buttons'), attributes: { role: 'group' } },
      made('plus', 'app.map.zoom_in', () => view.zoom(1)),
      made('minus', 'app.map.zoom_out', () => view.zoom(-1)),
      made('fit_terrain', 'app.map.fit_terrain', () => view.fitTerrain()),
      made('fit_results', 'app.map.fit_results', () => view.fitResults()),
    ),
  );
}

/** Bar below a map: coordinates, elevation, CRS, scale. */
export class MapBar {
  readonly root = element('div', { class: 'map-bar' });
  private readonly place = element('span', { class: 'place', attributes: { 'data-read': 'place' } });
  private readonly bar = element('span', { class: 'scale-bar' });
  private readonly length = element('span', { class: 'scale-length' });

  constructor(view: MapView, crs: string) {
    this.root.append(
      this.place,
      element('span', { class: 'crs' }, crs),
      element('span', { class: 'scale-box' }, this.length, this.bar),
    );
    view.map.on('pointermove', (event) => {
      const [x = 0, y = 0] = event.coordinate;
      this.read(x, y, view.elevation(x, y));
    });
    view.target.addEventListener('pointerleave', () => (this.place.textContent = ''));
    view.map.on('postrender', () => this.scale(view.map.getView().getResolution() ?? 1));
  }

  private read(x: number, y: number, z: number | null): void {
    const height = z === null ? '' : say('app.map.elevation', { z: decimal(z, 1) });
    this.place.textContent = `${decimal(x, 1)} / ${decimal(y, 1)}   ${height}`;
  }

  private scale(resolution: number): void {
    const { metres, pixels } = scaleBar(resolution, 120);
    this.bar.style.width = `${pixels}px`;
    this.length.textContent = metres >= 1000 ? `${decimal(metres / 1000)} km` : `${decimal(metres)} m`;
  }
}
