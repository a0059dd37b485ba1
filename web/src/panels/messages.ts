// SPDX-License-Identifier: BSD-3-Clause
// Messages on the case and the model: errors and model warnings in red, probable mistakes in amber.
import { button, element } from '../dom';
import { icon } from '../icons';
import type { CaseError } from '../protocol';
import { say } from '../texts';

interface Message {
  kind: 'error' | 'model' | 'check';
  text: string;
  error?: CaseError;
}

export class MessagePanel {
  readonly root = element('div', { class: 'messages', attributes: { role: 'status' } });
  private shown = '';

  constructor(private readonly onError: (error: CaseError) => void) {}

  update(errors: readonly CaseError[], model: readonly string[], checks: readonly string[]): void {
    const next = JSON.stringify([errors, model, checks]);
    if (next === this.shown) return; // avoids repetition by screen readers
    this.shown = next;
    const open = this.root.querySelector('details[open].red') !== null;
    const red: Message[] = [
      ...errors.map((error): Message => ({ kind: 'error', text: error.text, error })),
      ...model.map((text): Message => ({ kind: 'model', text })),
    ];
    const amber = checks.map((text): Message => ({ kind: 'check', text }));
    this.root.replaceChildren(
      ...[this.strip('red', red, open), this.strip('amber', amber, false)].filter((strip) => strip !== null),
    );
    this.root.hidden = !this.root.firstChild;
  }

  /** A line with the first message; it unfolds to show all, so that the map keeps its size. */
  private strip(colour: 'red' | 'amber', messages: readonly Message[], open: boolean): HTMLElement | null {
    const [first, ...others] = messages;
    if (!first) return null;
    const count = others.length > 0 && element('span', { class: 'count' }, `+${others.length}`);
    const head = element('summary', { title: first.text }, icon('warning'), this.line(first), count);
    const strip = element('details', { class: `alert ${colour}` }, head, ...others.map((message) => this.line(message)));
    strip.open = open;
    return strip;
  }

  private line({ kind, text, error }: Message): HTMLElement {
    const show =
      error &&
      (error.id !== undefined || error.key !== undefined) &&
      button(say('app.show_place'), () => this.onError(error), { class: 'link' });
    return element('p', { attributes: { 'data-message': kind } }, text, ' ', show ?? null);
  }
}
