// SPDX-License-Identifier: BSD-3-Clause
// Elements made by calls. Texts never pass through innerHTML, so names need no escaping.

type Child = Node | string | null | false;
interface Options {
  class?: string;
  id?: string;
  title?: string;
  hidden?: boolean;
  /** Attributes as they are: aria-..., data-..., role, for. */
  attributes?: Record<string, string>;
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
  for (const [name, value] of Object.entries(options.attributes ?? {})) made.setAttribute(name, value);
  made.append(...children.filter((child): child is Node | string => child !== null && child !== false));
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
  ...children: Node[]
): SVGElementTagNameMap[Tag] {
  const made = document.createElementNS('http://www.w3.org/2000/svg', tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, String(value));
  made.append(...children);
  return made;
}

/** A select box; `choices` are pairs of value and text. */
export function select(
  choices: readonly (readonly [string, string])[],
  chosen: string,
  action: (value: string) => void,
  options: Options = {},
): HTMLSelectElement {
  const made = element(
    'select',
    options,
    ...choices.map(([value, text]) => element('option', { attributes: { value } }, text)),
  );
  made.value = chosen;
  made.addEventListener('change', () => action(made.value));
  return made;
}

/** A check box with its label. */
export function checkbox(
  text: Child,
  checked: boolean,
  action: (checked: boolean) => void,
  options: Options = {},
): HTMLLabelElement {
  const box = element('input', { attributes: { type: 'checkbox', ...options.attributes } });
  box.checked = checked;
  box.addEventListener('change', () => action(box.checked));
  return element(
    'label',
    { class: `check ${options.class ?? ''}` },
    box,
    typeof text === 'string' ? element('span', {}, text) : text,
  );
}

/** A number of the page that only one element has. */
let count = 0;
export function uniqueId(prefix: string): string {
  return `${prefix}-${++count}`;
}
