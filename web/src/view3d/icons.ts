// SPDX-License-Identifier: BSD-3-Clause
// Icons of the buttons.

const SHAPES = {
  play: 'M7 4.5v15l12-7.5z',
  pause: 'M6 5h4v14H6zM14 5h4v14h-4z',
  zoom_in: 'M11 5h2v6h6v2h-6v6h-2v-6H5v-2h6z',
  zoom_out: 'M5 11h14v2H5z',
  whole: 'M4 4h6v2H6v4H4zM14 4h6v6h-2V6h-4zM4 14h2v4h4v2H4zM18 14h2v6h-6v-2h4zM9 9h6v6H9z',
  north: 'M12 2l5 10H7z',
} as const;

export type IconName = keyof typeof SHAPES;

/** An icon of 24 units that takes the colour of the text. */
export function icon(name: IconName): SVGSVGElement {
  const space = 'http://www.w3.org/2000/svg';
  const svg = document.createElementNS(space, 'svg');
  svg.setAttribute('viewBox', '0 0 24 24');
  svg.setAttribute('aria-hidden', 'true');
  const path = document.createElementNS(space, 'path');
  path.setAttribute('d', SHAPES[name]);
  path.setAttribute('fill', 'currentColor');
  svg.append(path);
  if (name === 'north') {
    const south = document.createElementNS(space, 'path');
    south.setAttribute('d', 'M12 22l5-10H7z');
    south.setAttribute('fill', '#9aa3ad');
    path.setAttribute('fill', '#c2185b');
    svg.append(south);
  }
  return svg;
}
