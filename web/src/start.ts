// SPDX-License-Identifier: BSD-3-Clause
// Start page without a case: recent files.
import { button, element } from './dom';
import type { Welcome } from './protocol';
import { say } from './texts';

export function startPage({ recent, version }: Welcome, open: (index: number) => void): HTMLElement {
  const items = recent.map(({ name, folder }, k) => {
    const about = [element('b', {}, name), element('small', {}, folder)];
    return element('li', {}, button(about, () => open(k), { class: 'recent', attributes: { 'data-recent': k } }));
  });
  return element(
    'main',
    { class: 'start' },
    element('h1', {}, 'rockfall', element('small', {}, version)),
    element('p', {}, say('app.start.hint')),
    element('pre', {}, 'rockfall app case.nml\nrockfall app dem.tif\nrockfall app result.nc'),
    element('h2', {}, say('app.start.recent')),
    recent.length ? element('ul', {}, ...items) : element('p', { class: 'empty' }, say('app.start.none')),
  );
}
