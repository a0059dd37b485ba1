// SPDX-License-Identifier: BSD-3-Clause
// Icons of the page, drawn on a square of 20 units: strokes and fills.
import { button, svg, type Options } from './dom';

const STROKES = {
  select: 'M5 3v13l3.6-3.4 2.3 5 2-.9-2.3-4.9H15.4Z',
  source: 'M10 3.5v3M10 13.5v3M3.5 10h3M13.5 10h3M10 7.2a2.8 2.8 0 1 1 0 5.6a2.8 2.8 0 1 1 0-5.6Z',
  source_area: 'M4 7 11 3.5 16.5 8.5 14 16 5.5 15Z M8 8.5h.01M11.5 8h.01M9 12h.01M12.5 11.5h.01',
  line: 'M3.5 15.5 8 8l4.5 3.5L16.5 4.5',
  net: 'M3.5 5.5v10M16.5 4.5v10M3.5 6 16.5 5M3.5 15 16.5 14M7.8 5.7v9M12.1 5.3v9M3.5 10.5 16.5 9.5',
  dam: 'M2.5 15.5h15L12.5 6h-5Z M5.5 15.5l3-5.5M9.5 15.5l2-4',
  zone: 'M4 5.5 10.5 3.5 16.5 7 15 15.5 7 16.5Z M6 10l5.5-6M7 15 16 6M11 16l5-5.5',
  section: 'M3 15.5 6 13l2.5 1.5 3-7 2.5 3 3-5M3 17.5h14M3 4.5h.01M3 8h.01M3 11.5h.01',
  undo: 'M7.5 4.5 4 8l3.5 3.5M4.5 8H12a4 4 0 0 1 0 8H8',
  redo: 'M12.5 4.5 16 8l-3.5 3.5M15.5 8H8a4 4 0 0 0 0 8h4',
  pause: 'M7.5 5v10M12.5 5v10',
  play: 'M6.5 4.5 15 10l-8.5 5.5Z',
  plus: 'M10 4.5v11M4.5 10h11',
  minus: 'M4.5 10h11',
  fit_terrain: 'M3.5 7.5v-4h4M16.5 7.5v-4h-4M3.5 12.5v4h4M16.5 12.5v4h-4M6.5 13l3-5 2 3 1-1.5 1.5 3.5Z',
  fit_results: 'M3.5 7.5v-4h4M16.5 7.5v-4h-4M3.5 12.5v4h4M16.5 12.5v4h-4M10 7.5a2.5 2.5 0 1 1 0 5a2.5 2.5 0 1 1 0-5Z',
  trash: 'M4 6h12M8 6V4h4v2M5.5 6l.8 10.5h7.4L14.5 6M8.5 9v4.5M11.5 9v4.5',
  target: 'M10 2.5v4M10 13.5v4M2.5 10h4M13.5 10h4M10 5.5a4.5 4.5 0 1 1 0 9a4.5 4.5 0 1 1 0-9Z',
  save: 'M4 4h9.5L16 6.5V16H4Z M7 4v4h5.5V4M6.5 16v-5h7v5',
  more: 'M10 4.5h.01M10 10h.01M10 15.5h.01',
  close: 'M5 5l10 10M15 5 5 15',
  warning: 'M10 3 17.5 16h-15Z M10 8v4M10 14h.01',
  bookmark: 'M5.5 3.5h9v13L10 13l-4.5 3.5Z',
  up: 'M5 12.5 10 7.5l5 5',
  down: 'M5 7.5l5 5 5-5',
  help: 'M7.5 7.5a2.5 2.5 0 1 1 3.6 2.2c-.8.4-1.1.9-1.1 1.8M10 14.5h.01',
} as const;

export type Icon = keyof typeof STROKES;

export function icon(name: Icon): SVGSVGElement {
  return svg('svg', { viewBox: '0 0 20 20', class: 'icon', 'aria-hidden': 'true' }, svg('path', { d: STROKES[name] }));
}

/** Button with only an icon; `title` adds to its label. */
export function iconButton(sign: Icon | SVGElement, label: string, action: () => void, options: Options = {}): HTMLButtonElement {
  return button(typeof sign === 'string' ? icon(sign) : sign, action, { class: 'icon-button', title: label, label, ...options });
}
