// SPDX-License-Identifier: BSD-3-Clause
// List of stored variants: store, compare, restore, delete.
import { button, element } from '../dom';
import { icon, iconButton } from '../icons';
import { say } from '../texts';
import type { Snapshot } from '../snapshots';

interface Actions {
  keep(name: string): boolean;
  compare(index: number): void;
  restore(index: number): void;
  forget(index: number): void;
  /** Use the case without variants as the document. */
  base(): void;
}

export class VariantPanel {
  readonly root = element('div', { class: 'variants' });
  private readonly list = element('ul', { class: 'variant-list' });
  private readonly name = element('input', {
    attributes: { type: 'text', maxlength: '60', 'aria-label': say('app.variants.name'), 'data-field': 'variant_name' },
  });
  private readonly keepButton: HTMLButtonElement;
  private number = 0;
  private listed = '';

  constructor(private readonly actions: Actions) {
    this.keepButton = button([icon('bookmark'), say('app.variants.keep')], () => this.keep(), { class: 'primary', action: 'keep-variant' });
    this.name.addEventListener('keydown', (event) => {
      if (event.key === 'Enter') this.keep();
    });
    this.root.append(
      element('h2', {}, say('app.variants.title')),
      element('p', { class: 'hint' }, say('app.variants.hint')),
      element('div', { class: 'keep-row' }, this.name, this.keepButton),
      this.list,
    );
    this.suggest();
  }

  /** `based`: name of the variant behind the present state; '' for the base case, null if the case has no variants. */
  update(variants: readonly Snapshot[], canKeep: boolean, canRestore: boolean, based: string | null): void {
    this.keepButton.disabled = !canKeep;
    const listed = JSON.stringify([variants.map(({ name }) => name), canRestore, based]);
    if (listed === this.listed) return; // rebuilding the list would lose clicks
    this.listed = listed;
    const base = element(
      'li',
      { class: based === '' ? 'present' : '', attributes: { 'data-variant': '' } },
      element('span', { class: 'variant-name' }, say('app.variants.base')),
      canRestore && button(say('app.variants.restore'), () => this.actions.base(), { action: 'base' }),
    );
    const isPresent = ({ name, document }: Snapshot): boolean => based !== '' && name === document.variant && name === based;
    this.list.replaceChildren(
      ...(based === null ? [] : [base]),
      ...variants.map((variant, k) =>
        element(
          'li',
          { class: isPresent(variant) ? 'present' : '', attributes: { 'data-variant': variant.name } },
          element('span', { class: 'variant-name' }, variant.name),
          button(say('app.variants.compare'), () => this.actions.compare(k), { action: 'compare' }),
          canRestore && button(say('app.variants.restore'), () => this.actions.restore(k), { title: say('app.variants.restore_hint'), action: 'restore' }),
          iconButton('close', say('app.variants.forget'), () => this.actions.forget(k)),
        ),
      ),
    );
  }

  private keep(): void {
    if (this.keepButton.disabled) return;
    if (this.actions.keep(this.name.value.trim() || this.name.placeholder)) this.suggest();
  }

  private suggest(): void {
    this.number += 1;
    this.name.value = '';
    this.name.placeholder = say('app.variants.suggested', { n: this.number });
  }
}
