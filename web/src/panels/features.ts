// SPDX-License-Identifier: BSD-3-Clause
// Drawn features: a list by layer, and the properties of the selected feature.
import { LineString, Polygon } from 'ol/geom';
import { LAYER_COLOURS } from '../colours';
import { button, element } from '../dom';
import type { DocumentStore } from '../document';
import { Form } from '../forms';
import { icon } from '../icons';
import { LAYERS, type CaseError, type Feature, type Forms, type Layer, type Layers } from '../protocol';
import { decimal, say } from '../texts';
import { applies } from '../volume_keys';

const LONG = 30; // with more features the list has its own scroll bar

interface Actions {
  select(id: string): void;
  zoom(id: string): void;
  remove(id: string): void;
}

export class FeaturePanel {
  readonly root = element('div', { class: 'features' });
  private readonly list = element('div', { class: 'feature-list' });
  private readonly properties = element('section', { class: 'properties', attributes: { 'aria-live': 'off' } });
  private readonly hint = element('p', { class: 'hint' }, say('app.features.hint'));
  private form: { id: string; layer: Layer; form: Form; size: HTMLElement } | null = null;
  private selected = '';
  private listed: Partial<Layers> = {};
  private marked = ''; // features with errors
  private readonly buttons = new Map<string, HTMLButtonElement>();
  private errors: readonly CaseError[] = [];
  private editable = false;

  constructor(
    private readonly store: DocumentStore,
    private readonly forms: Forms,
    private readonly actions: Actions,
    below: HTMLElement, // properties of the selected feature
  ) {
    this.root.append(this.properties, below, element('h2', {}, say('app.features.title')), this.hint, this.list);
  }

  update(errors: readonly CaseError[], editable: boolean): void {
    this.errors = errors;
    this.editable = editable;
    this.hint.hidden = !editable;
    this.showList();
    this.showProperties();
  }

  select(id: string): void {
    this.selected = id;
    this.showList();
    this.showProperties();
    const row = this.buttons.get(id);
    if (!row) return;
    // Scroll the list, not the panel, so that the properties at the top of the panel stay visible.
    const above = row.offsetTop - this.list.scrollTop;
    if (above < 0 || above > this.list.clientHeight - row.offsetHeight) this.list.scrollTop = row.offsetTop - this.list.clientHeight / 2;
    this.properties.scrollIntoView({ block: 'nearest' });
  }

  /** List the features. Only changed rows are updated, so that clicks work while a shape is dragged. */
  private showList(): void {
    const shown = LAYERS.filter((layer) => this.store.layer(layer).length > 0);
    const wrong = new Set(this.errors.map(({ id, layer }) => `${layer ?? ''} ${id ?? ''}`));
    const isWrong = (layer: Layer, id: string): boolean => wrong.has(`${layer} ${id}`) || wrong.has(` ${id}`);
    const same = shown.every((layer) => sameIds(this.listed[layer], this.store.layer(layer)));
    if (!same || shown.length !== this.list.querySelectorAll('section').length) this.makeList(shown);
    for (const layer of shown) {
      const before = this.listed[layer];
      this.store.layer(layer).forEach((feature, k) => {
        if (same && before?.[k] === feature && this.marked === '' && wrong.size === 0) return;
        const made = this.buttons.get(feature.id);
        made?.replaceChildren(nameOf(layer, feature, k), ...(isWrong(layer, feature.id) ? [icon('warning')] : []));
        made?.classList.toggle('wrong', isWrong(layer, feature.id));
      });
    }
    this.marked = [...wrong].join();
    this.listed = this.store.document.layers;
    this.list.querySelector('[aria-pressed="true"]')?.setAttribute('aria-pressed', 'false');
    this.buttons.get(this.selected)?.setAttribute('aria-pressed', 'true');
  }

  private makeList(shown: readonly Layer[]): void {
    const focused = document.activeElement instanceof HTMLElement ? document.activeElement.dataset['feature'] : undefined;
    this.buttons.clear();
    this.list.classList.toggle('long', shown.some((layer) => this.store.layer(layer).length > LONG));
    const sections = shown.map((layer) => {
      const count = element('span', { class: 'count' }, decimal(this.store.layer(layer).length));
      const title = element('h3', {}, swatch(layer), say(`app.layer.${layer}`), count);
      const items = this.store.layer(layer).map(({ id }) => element('li', {}, this.item(id)));
      return element('section', {}, title, element('ul', {}, ...items));
    });
    this.list.replaceChildren(...(sections.length ? sections : [element('p', { class: 'empty' }, say('app.features.none'))]));
    if (focused) this.buttons.get(focused)?.focus();
  }

  private item(id: string): HTMLButtonElement {
    const show = (): void => {
      this.actions.select(id);
      this.actions.zoom(id);
    };
    const made = button([], show, { attributes: { 'data-feature': id, 'aria-pressed': 'false' } });
    this.buttons.set(id, made);
    return made;
  }

  private showProperties(): void {
    const found = this.store.feature(this.selected);
    this.properties.hidden = !found;
    if (!found) {
      this.form = null;
      this.properties.replaceChildren();
      return;
    }
    const { layer, feature } = found;
    if (this.form?.id !== feature.id || this.form.layer !== layer) this.makeForm(layer, feature);
    const errors = this.errors.filter((error) => error.id === feature.id);
    const fields = new Set(this.forms.layers[layer]?.map(({ name }) => name));
    this.form?.form.update(feature.properties, new Map(errors.map(({ key = '', text }) => [key, text])), this.editable);
    this.form?.form.filter(({ name }) => applies(name, feature.properties, String(feature.properties['volume'] ?? '')));
    if (this.form) this.form.size.textContent = sizeOf(feature);
    const others = errors
      .filter((error) => !error.key || !fields.has(error.key))
      .map(({ text }) => element('p', { class: 'alert red' }, icon('warning'), text));
    this.properties.querySelectorAll(':scope > .alert').forEach((old) => old.remove());
    this.properties.append(...others);
  }

  private makeForm(layer: Layer, feature: Feature): void {
    const form = new Form(this.forms.layers[layer] ?? [], (name, value) => {
      if (!Array.isArray(value)) this.store.setProperty(feature.id, name, value);
    });
    const size = element('span', { class: 'size' });
    const heading = element('h2', {}, swatch(layer), say(`app.layer.one.${layer}`), size);
    const zoom = button([icon('target'), say('app.zoom_to')], () => this.actions.zoom(feature.id));
    const remove = button([icon('trash'), say('app.delete')], () => this.actions.remove(feature.id), { class: 'danger', action: 'delete' });
    const actions = element('div', { class: 'actions' }, zoom, this.editable && remove);
    this.form = { id: feature.id, layer, form, size };
    this.properties.replaceChildren(heading, form.root, actions);
  }
}

function sameIds(before: readonly Feature[] | undefined, after: readonly Feature[]): boolean {
  return before === after || (before?.length === after.length && after.every(({ id }, k) => before[k]?.id === id));
}

export function swatch(layer: keyof typeof LAYER_COLOURS): HTMLElement {
  return element('span', { class: `swatch ${layer}`, style: `--colour: ${LAYER_COLOURS[layer]}` });
}

export function nameOf(layer: Layer, feature: Feature, index: number): string {
  const { name } = feature.properties;
  return name === undefined || name === '' ? `${say(`app.layer.one.${layer}`)} ${index + 1}` : String(name);
}

/** Position, length or area of a shape. */
function sizeOf(feature: Feature): string {
  if (feature.type === 'Point') return feature.coordinates.map((value) => decimal(value, 1)).join(' / ');
  if (feature.type === 'Polygon') return `${decimal(new Polygon(feature.coordinates).getArea(), 0)} m²`;
  const length = new LineString(feature.coordinates).getLength();
  return `${decimal(length, length < 100 ? 1 : 0)} m`;
}
