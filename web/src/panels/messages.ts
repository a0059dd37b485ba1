// SPDX-License-Identifier: BSD-3-Clause
// What the case and the model have to say: errors and the model's warnings in red, likely mistakes in amber.
import { button, element } from '../dom';
import { icon } from '../icons';
import type { CaseError } from '../protocol';
import { say } from '../texts';

export class MessagePanel {
  readonly root = element('div', { class: 'messages', attributes: { role: 'status' } });
  private shown = '';

  constructor(private readonly onError: (error: CaseError) => void) {}

  update(errors: readonly CaseError[], model: readonly string[], checks: readonly string[]): void {
    const next = JSON.stringify([errors, model, checks]);
    if (next === this.shown) return; // a screen reader would say it again
    this.shown = next;
    this.root.replaceChildren(
      ...errors.map((error) => this.error(error)),
      ...model.map((text) => element('p', { class: 'alert red', attributes: { 'data-message': 'model' } }, icon('warning'), text)),
      ...checks.map((text) => element('p', { class: 'alert amber', attributes: { 'data-message': 'check' } }, icon('warning'), text)),
    );
    this.root.hidden = !this.root.firstChild;
  }

  private error(error: CaseError): HTMLElement {
    const place = error.id ?? error.key;
    return element('p', { class: 'alert red', attributes: { 'data-message': 'error' } }, icon('warning'), element('span', {}, error.text), place !== undefined && button(say('app.show_place'), () => this.onError(error), { class: 'link' }));
  }
}
