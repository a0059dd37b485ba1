// SPDX-License-Identifier: BSD-3-Clause
// Creation of elements by calls. Texts never pass through innerHTML, so names need no escaping.

type Child = Node | string | null | undefined | false;
export interface Options {
  class?: string;
  id?: string;
  title?: string;
  hidden?: boolean;
  style?: string;
  /** Name of a control's action. */
  action?: string;
  label?: string;
  /** Attributes passed on unchanged: aria-..., data-..., role, for. */
  attributes?: Record<string, string | number>;
}

function fill(made: Element, { action, label, attributes }: Options, children: readonly Child[]): void {
  const all = { ...attributes, ...(action && { 'data-action': action }), ...(label && { 'aria-label': label }) };
  for (const [name, value] of Object.entries(all)) made.setAttribute(name, String(value));
  made.append(...children.filter((child): child is Node | string => typeof child === 'string' || child instanceof Node));
}

export function element<Tag extends keyof HTMLElementTagNameMap>(
  tag: Tag,
  options: Options = {},
  ...children: Child[]
): HTMLElementTagNameMap[Tag] {
  const made = document.createElement(tag);
  if (options.class) made.className = options.class;
  if (options.id) made.id = options.id;
  if (options.title) made.title = options.title;
  if (options.hidden) made.hidden = true;
  if (options.style) made.style.cssText = options.style;
  fill(made, options, children);
  return made;
}

export function button(label: Child | Child[], action: () => void, options: Options = {}): HTMLButtonElement {
  const made = element('button', options, ...(Array.isArray(label) ? label : [label]));
  made.type = 'button';
  made.addEventListener('click', action);
  return made;
}

export function svg<Tag extends keyof SVGElementTagNameMap>(
  tag: Tag,
  attributes: Record<string, string | number>,
  ...children: Child[]
): SVGElementTagNameMap[Tag] {
  const made = document.createElementNS('http://www.w3.org/2000/svg', tag);
  fill(made, { attributes }, children);
  return made;
}

/** Options of a list; `choices` are pairs of value and text. */
export function options(choices: readonly (readonly [string, string])[]): HTMLOptionElement[] {
  return choices.map(([value, text]) => element('option', { attributes: { value } }, text));
}

/** Create a drop-down list. */
export function select(
  choices: readonly (readonly [string, string])[],
  chosen: string,
  action: (value: string) => void,
  given: Options = {},
): HTMLSelectElement {
  const made = element('select', given, ...options(choices));
  made.value = chosen;
  made.addEventListener('change', () => action(made.value));
  return made;
}

/** Create a check box with a label. */
export function checkbox(text: Child, checked: boolean, action: (checked: boolean) => void, given: Options = {}): HTMLLabelElement {
  const box = element('input', { ...given, class: '', attributes: { type: 'checkbox', ...given.attributes } });
  box.checked = checked;
  box.addEventListener('change', () => action(box.checked));
  return element('label', { class: `check ${given.class ?? ''}` }, box, typeof text === 'string' ? element('span', {}, text) : text);
}

/** Control with its label in front or, if `wide`, above. */
export function labelled(text: string, control: HTMLElement, wide = false): HTMLElement {
  control.id ||= uniqueId('control');
  return element('div', { class: wide ? 'field wide' : 'field' }, element('label', { attributes: { for: control.id } }, text), control);
}

/** List of colours and their meanings. */
export function patches(entries: readonly (readonly [text: string, colour: string])[], style = ''): HTMLUListElement {
  const items = entries.map(([text, colour]) => element('li', {}, element('span', { class: 'patch', style: `background: ${colour}` }), text));
  return element('ul', { class: style }, ...items);
}

/** Counter for unique element ids. */
let count = 0;
export function uniqueId(prefix: string): string {
  return `${prefix}-${++count}`;
}
