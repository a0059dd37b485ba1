// SPDX-License-Identifier: BSD-3-Clause
// Legend on the map: the result shown, its colours with round numbers, and the other colours.
import { css, gradient, placeOf, plasma, ticks, viridis, type ColourScale, type Palette } from './colours';
import { element, options, patches } from './dom';
import { zoneColour } from './map/rasters';
import type { MapName, OverlayHeader } from './protocol';
import { decimal, say, sayOr, unitText } from './texts';

export class Legend {
  readonly root = element('section', { class: 'legend card', label: say('app.legend.title') });
  private readonly choice: HTMLSelectElement;
  private readonly ramp = element('div', { class: 'ramp-box' });
  private readonly classes = element('div', { class: 'class-box', hidden: true });
  private readonly speeds = element('div', { class: 'ramp-box' });
  private readonly zones = element('details', { class: 'zone-legend' });
  private unfolded = false; // the list has all maps

  /** Without a choice of maps, the legend shows the name of the current map. */
  constructor(
    private readonly maps: readonly MapName[],
    private shown: string,
    onMap: (name: string) => void,
  ) {
    this.choice = element('select', { attributes: { 'aria-label': say('app.legend.map'), 'data-action': 'map' } });
    this.list();
    this.choice.addEventListener('change', () => {
      if (this.choice.value === FOLD) this.fold(!this.unfolded);
      else onMap((this.shown = this.choice.value));
    });
    this.root.append(this.choice, this.ramp, this.classes, this.speeds, this.zones);
    this.speeds.hidden = true;
    this.zones.hidden = true;
  }

  /** Allow the choice of another map, or show only the name. */
  enable(on: boolean): void {
    this.choice.disabled = !on;
  }

  setResult(header: OverlayHeader | null): void {
    if (header && this.choice.disabled) {
      this.shown = header.name;
      this.list();
    }
    const name = header && !this.maps.length ? [element('p', {}, withUnit(nameOfMap(header), header.unit))] : [];
    this.ramp.replaceChildren(...(header ? [...name, ramp(header, header.unit, viridis)] : []));
  }

  /** List all maps or only the most used, and reopen the list if the browser supports it. */
  private fold(unfolded: boolean): void {
    this.unfolded = unfolded;
    this.list();
    try {
      this.choice.showPicker();
    } catch {
      this.choice.focus(); // the next key or click opens the list
    }
  }

  /** List at most LISTED maps, including the current map; if unfolded, then the others and the interval limits. */
  private list(): void {
    const { maps, shown, unfolded } = this;
    const plain = maps.filter(({ name }) => !LIMIT.test(name));
    const common = COMMON.flatMap((name) => plain.find((map) => map.name === name) ?? []);
    const ranked = maps.filter(({ name }) => name === shown && !COMMON.includes(name)).concat(common, plain);
    const first = new Set([...new Set(ranked)].slice(0, LISTED));
    const group = (key: string, some: readonly MapName[]): HTMLElement[] =>
      some.length ? [element('optgroup', { attributes: { label: say(key) } }, ...mapOptions(some))] : [];
    const rest = maps.filter((map) => !first.has(map));
    const further = [
      ...group('app.legend.others', rest.filter(({ name }) => !LIMIT.test(name))),
      ...group('app.legend.limits', rest.filter(({ name }) => LIMIT.test(name))),
    ];
    this.choice.replaceChildren(
      ...options([['', say('app.legend.no_map')]]),
      ...mapOptions([...first]),
      ...(unfolded ? further : []),
      ...options(rest.length ? [[FOLD, say(unfolded ? 'app.legend.fewer' : 'app.legend.more')]] : []),
    );
    this.choice.value = shown;
  }

  /** Show hazard classes instead of the result; null: the result. */
  setClasses(classes: readonly (readonly [name: string, colour: string])[] | null): void {
    this.ramp.hidden = this.choice.hidden = classes !== null;
    this.classes.hidden = classes === null;
    this.classes.replaceChildren(element('p', {}, say('app.legend.hazard')), patches((classes ?? []).slice(1), 'patches'));
  }

  setSpeeds(fastest: number | null): void {
    this.speeds.hidden = fastest === null || !(fastest > 0);
    if (fastest)
      this.speeds.replaceChildren(
        element('p', {}, withUnit(say('app.legend.speed'), 'm/s')),
        ramp({ low: 0, high: fastest, scale: 'linear' }, 'm/s', plasma),
      );
  }

  setZones(zones: readonly { name: string }[] | null): void {
    this.zones.hidden = !zones?.length;
    this.zones.open = window.innerWidth > 760;
    const entries = (zones ?? []).map(({ name }, k) => [name, css(zoneColour(k), 0.55)] as const);
    this.zones.replaceChildren(element('summary', {}, say('app.layer.zones')), patches(entries));
  }
}

const FOLD = '+'; // option that switches between all maps and the most used
const LISTED = 12; // maximum number of maps in the short list
// Most used maps, which have names in every language.
const COMMON = [
  'passages', 'reach_probability', 'deposits', 'energy_q95', 'energy_mean', 'energy_max',
  'speed_q95', 'speed_max_map', 'passing_height_q95', 'passing_height_max', 'energy_line_angle_max', 'travel_time_min',
];
const LIMIT = /_(low|high)$/; // suffix of a map of interval limits

function mapOptions(maps: readonly MapName[]): HTMLOptionElement[] {
  return options(maps.map((map) => [map.name, withUnit(nameOfMap(map), map.unit)] as const));
}

/** Name of a result map. */
export function nameOfMap({ name, label }: { name: string; label: string }): string {
  return sayOr(`app.result.${name}`, label);
}

export function withUnit(label: string, unit: string): string {
  return unit ? `${label} [${unitText(unit)}]` : label;
}

/** Colour bar with round numbers. */
function ramp(scale: ColourScale, unit: string, palette: Palette): HTMLElement {
  const bar = element('div', { class: 'ramp', style: `background: ${gradient(palette)}` });
  const numbers = spread(scale).map(({ text, place }) => element('span', { style: `left: ${100 * place}%` }, text));
  const [low, high] = [scale.low, scale.high].map((end) => decimal(Number(end.toPrecision(3))));
  const label = `${low} – ${high} ${unit}`;
  return element('div', { class: 'scale', label, attributes: { role: 'img' } }, bar, element('div', { class: 'ticks' }, ...numbers));
}

interface Tick {
  text: string;
  place: number;
}

const LETTER = 0.033; // width of a digit, in widths of a 200-pixel bar

/** Round numbers and their positions on the bar, except those that would touch the previous number. */
export function spread(scale: ColourScale): Tick[] {
  const found: Tick[] = [];
  for (const value of ticks(scale)) {
    const place = Math.max(0, Math.min(1, placeOf(value, scale)));
    const text = decimal(Number(value.toPrecision(3)));
    const last = found.at(-1);
    if (!last || place - last.place > (LETTER * (text.length + last.text.length)) / 2 + 0.02)
      found.push({ text, place });
  }
  return found;
}
