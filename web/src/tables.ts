// SPDX-License-Identifier: BSD-3-Clause
// Tables of the program, with texts as cells: identical to the tables on its pages and in the terminal.
import { button, element } from './dom';
import type { TableEntry } from './protocol';

function cell(text: string): (Node | string)[] {
  const [first = '', ...others] = text.split('\n');
  return [first, ...others.map((line) => element('small', {}, line))];
}

/** A single-row table, shown as a list with a line for each non-empty column. */
function pairsOf(caption: string, head: readonly string[], row: readonly string[], firstOf: typeof cell): HTMLElement {
  const lines = head.map((title, k) => [title, row[k] ?? ''] as const).filter(([title, text]) => title && text && text !== '-');
  return element(
    'table',
    { class: 'product pairs' },
    element('caption', {}, caption),
    element('tbody', {}, ...lines.map(([title, text], k) => element('tr', {}, element('th', { attributes: { scope: 'row' } }, title), element('td', {}, ...(k ? cell : firstOf)(text))))),
  );
}

/** Table that unfolds below its caption. */
export function foldedTable(entry: TableEntry, open: boolean): HTMLElement {
  const box = element('details', {}, element('summary', {}, entry.caption || (entry.head[0] ?? '')), tableOf({ ...entry, caption: '' }));
  box.open = open;
  return box;
}

/** Table; names in the first column that occur in `choices` become buttons that call `choose`. */
export function tableOf({ caption, head, rows }: TableEntry, choices: readonly string[] = [], choose = (_: string): void => undefined): HTMLElement {
  const firstOf = (name: string): (Node | string)[] =>
    choices.includes(name) ? [button(name, () => choose(name), { class: 'line-name', attributes: { 'data-place': name } })] : cell(name);
  if (rows.length === 1) return pairsOf(caption, head, rows[0] ?? [], firstOf);
  return element(
    'table',
    { class: 'product' },
    caption && element('caption', {}, caption),
    element('thead', {}, element('tr', {}, ...head.map((text) => element('th', { attributes: { scope: 'col' } }, text)))),
    element(
      'tbody',
      {},
      ...rows.map(([name = '', ...others]) =>
        element('tr', {}, element('th', { attributes: { scope: 'row' } }, ...firstOf(name)), ...others.map((text) => element('td', {}, ...cell(text)))),
      ),
    ),
  );
}
