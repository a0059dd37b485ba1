// SPDX-License-Identifier: BSD-3-Clause
// Settings of the case: the most used keys, and all others in their groups.
import { element } from '../dom';
import type { DocumentStore } from '../document';
import { Form, labelOf } from '../forms';
import type { CaseError, Field, Forms } from '../protocol';
import { decimal, say, sayOr } from '../texts';
import { applies } from '../volume_keys';

// Most used keys, in the order in which an engineer fills them in.
const COMMON: readonly (readonly [group: string, keys: readonly string[]])[] = [
  ['boulder', ['volume', 'volume_mean', 'volume_std', 'volume_min', 'volume_max', 'volume_exponent', 'volumes', 'density']],
  ['release', ['drop_height']],
  ['surface', ['ground', 'uniform_mean_radius', 'uniform_rg', 'method']],
  ['impact', ['table', 'sets']],
  ['case', ['boulders', 'boulders_total', 'seed']],
];

interface Section {
  group: string;
  form: Form;
  root: HTMLElement;
}

export class SettingsPanel {
  readonly root = element('div', { class: 'settings' });
  private readonly common: Section[];
  private readonly others: Section[];
  private shown: readonly unknown[] = [];
  private readonly search = element('input', {
    attributes: { type: 'search', 'aria-label': say('app.settings.search'), placeholder: say('app.settings.search') },
  });

  constructor(
    private readonly store: DocumentStore,
    forms: Forms,
  ) {
    const isCommon = (group: string, field: Field): boolean =>
      COMMON.some(([name, keys]) => name === group && keys.includes(field.name));
    this.common = COMMON.flatMap(([group, keys]) => {
      const fields = keys.flatMap((key) => forms.settings[group]?.find(({ name }) => name === key) ?? []);
      return fields.length ? [this.section(group, fields, 'section')] : [];
    });
    this.others = Object.entries(forms.settings).flatMap(([group, fields]) => {
      const rest = fields.filter((field) => !isCommon(group, field));
      return rest.length ? [this.section(group, rest, 'details')] : [];
    });
    this.search.addEventListener('input', () => this.filter());
    const [common, others] = [this.common, this.others].map((sections) => sections.map(({ root }) => root)) as [HTMLElement[], HTMLElement[]];
    const all = element('details', { class: 'all-settings' }, element('summary', {}, say('app.settings.all')), this.search, ...others);
    this.root.append(...common, all);
  }

  update(errors: readonly CaseError[], editable: boolean): void {
    const { settings } = this.store.document;
    const now = [settings, errors, editable] as const;
    if (now.every((one, k) => one === this.shown[k])) return; // unchanged, as while a shape is dragged
    this.shown = now;
    for (const { group, form, root } of [...this.common, ...this.others]) {
      const found = errors.filter((error) => error.group === group && error.key).map(({ key = '', text }) => [key, text] as const);
      form.update(settings[group] ?? {}, new Map(found), editable);
      if (root instanceof HTMLDetailsElement && found.some(([key]) => form.fields.some(({ name }) => name === key))) {
        root.open = true;
        root.closest<HTMLDetailsElement>('details.all-settings')?.setAttribute('open', '');
      }
    }
    this.hideUnused();
  }

  /** Hide keys that have no effect in the case. */
  private hideUnused(): void {
    const { boulder = {}, case: run = {} } = this.store.document.settings;
    const inTotal = run['boulders_total'] !== undefined;
    for (const { group, form } of this.common) {
      form.filter(({ name }) => {
        if (name === 'boulders') return run['boulders'] !== undefined || !inTotal;
        if (name === 'boulders_total') return inTotal;
        return group !== 'boulder' || applies(name, boulder, String(boulder['volume'] ?? 'fixed'));
      });
    }
  }

  private filter(): void {
    const words = this.search.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const { group, form, root } of this.others) {
      const number = form.filter((field) =>
        words.every((word) => `${group} ${field.name} ${labelOf(field)} ${field.meaning}`.toLowerCase().includes(word)),
      );
      root.hidden = number === 0;
      if (root instanceof HTMLDetailsElement) root.open = words.length > 0;
    }
  }

  private section(group: string, fields: readonly Field[], kind: 'section' | 'details'): Section {
    const form = new Form(fields, (name, value) => this.store.setSetting(group, name, value));
    const title = sayOr(`app.group.${group}`, group);
    const heading =
      kind === 'details'
        ? element('summary', {}, title, element('span', { class: 'count' }, decimal(fields.length)))
        : element('h2', {}, title);
    return { group, form, root: element(kind, { attributes: { 'data-group': group } }, heading, form.root) };
  }
}
