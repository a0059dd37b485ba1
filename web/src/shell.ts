// SPDX-License-Identifier: BSD-3-Clause
// Frame of the window: top bar, tools, map, statistics below the map, side panel.
import { element } from './dom';
import { icon, iconButton } from './icons';
import { say } from './texts';

export type Mode = 'map' | 'scene' | 'compare';

export class Shell {
  readonly root = element('div', { class: 'window' });
  readonly top = element('header', { class: 'top' });
  readonly notices = element('div', { class: 'notices' });
  readonly tools = element('div', { class: 'tool-strip' });
  readonly mapTarget = element('div', { class: 'map', id: 'map', label: say('app.map.label'), attributes: { tabindex: '0', role: 'application' } });
  readonly mapPane = element('section', { class: 'pane map-pane' }, this.mapTarget);
  readonly scenePane = element('section', { class: 'pane scene-pane', hidden: true, label: say('app.view.scene') });
  readonly comparePane = element('section', { class: 'pane compare-pane', hidden: true, label: say('app.view.compare') });
  readonly stage = element('main', { class: 'stage' }, this.mapPane, this.scenePane, this.comparePane);
  readonly dock = element('section', { class: 'dock', attributes: { 'aria-labelledby': 'dock-title' } });
  readonly side = element('aside', { class: 'side' });
  readonly tag = element('p', { class: 'tag', attributes: { role: 'status' }, hidden: true });
  private readonly dockNote = element('span', { class: 'dock-note' });
  readonly dockTag = element('span', { class: 'tag', hidden: true });
  private readonly dockBody = element('div', { class: 'dock-body' });
  private readonly toast = element('div', { class: 'toast', attributes: { role: 'status' } });
  private readonly sheet = element('div', { class: 'sheet' });
  private timer = 0;

  constructor(parent: HTMLElement) {
    const folds = (): void => {
      const folded = this.root.classList.toggle('dock-folded');
      fold.replaceChildren(icon(folded ? 'up' : 'down'));
      fold.setAttribute('aria-expanded', String(!folded));
    };
    const fold = iconButton('down', say('app.statistics.fold'), folds, { attributes: { 'aria-expanded': 'true' } });
    const title = element('h2', { id: 'dock-title' }, say('app.statistics.title'));
    this.dock.append(element('header', {}, title, this.dockTag, this.dockNote, fold), this.dockBody);
    this.mapPane.append(this.tag);
    this.root.append(this.top, this.notices, this.tools, this.stage, this.sheet, this.dock, this.side, this.toast);
    parent.replaceChildren(this.root);
  }

  /** Set the picture that replaces the map in print. */
  printed(picture: HTMLCanvasElement): void {
    this.sheet.replaceChildren(picture);
  }

  fillDock(...content: HTMLElement[]): void {
    this.dockBody.replaceChildren(...content);
  }

  /** Set the text in the title of the dock. */
  noteDock(text: string): void {
    this.dockNote.textContent = text;
    this.dockNote.title = text;
  }

  /** Set the heights of the statistics table and the section; without both, the map fills the space. */
  fitDock(lines: number, section: boolean): void {
    this.root.style.setProperty('--dock-most', section ? '54vh' : '42vh');
    this.root.style.setProperty('--dock', section ? '440px' : `${lines ? 134 + 43 * lines : 104}px`);
  }

  show(mode: Mode): void {
    this.mapPane.hidden = mode !== 'map';
    this.scenePane.hidden = mode !== 'scene';
    this.comparePane.hidden = mode !== 'compare';
    this.root.dataset['mode'] = mode;
  }

  /** Dim outdated content and label it. */
  mark(text: string): void {
    for (const tag of [this.tag, this.dockTag]) {
      tag.hidden = !text;
      tag.textContent = text;
    }
    this.root.classList.toggle('preliminary', text !== '');
  }

  /** Show the next step as a hint on the map. */
  hint(text: string): void {
    this.mapPane.dataset['hint'] = text;
  }

  say(text: string): void {
    this.toast.textContent = text;
    this.toast.classList.add('shown');
    window.clearTimeout(this.timer);
    this.timer = window.setTimeout(() => this.toast.classList.remove('shown'), 5000);
  }

  /** Notice across the window, for example about a second tab; it replaces an earlier notice of the same name. */
  notice(name: string, kind: 'red' | 'amber', text: string, action: HTMLButtonElement | null = null): void {
    this.clearNotice(name);
    this.notices.append(
      element(
        'div',
        { class: `alert ${kind}`, attributes: { role: 'alert', 'data-notice': name } },
        icon('warning'),
        element('span', {}, text),
        action,
        iconButton('close', say('app.close'), () => this.clearNotice(name), { title: '' }),
      ),
    );
  }

  clearNotice(name: string): void {
    this.clearNotices((one) => one === name);
  }

  clearNotices(those: (name: string) => boolean): void {
    for (const one of this.notices.querySelectorAll<HTMLElement>('[data-notice]'))
      if (those(one.dataset['notice'] ?? '')) one.remove();
  }
}

/** Button that opens a list of actions. */
export function menu(label: string, ...items: HTMLElement[]): HTMLDetailsElement {
  const list = element('div', { class: 'menu-list card' }, ...items);
  const box = element(
    'details',
    { class: 'menu' },
    element('summary', { title: label, attributes: { 'aria-label': label } }, icon('more')),
    list,
  );
  list.addEventListener('click', (event) => {
    if (event.target instanceof HTMLElement && event.target.closest('button')) box.open = false;
  });
  box.addEventListener('keydown', (event) => {
    if (event.key !== 'Escape' || !box.open) return;
    event.stopPropagation();
    box.open = false;
    box.querySelector('summary')?.focus();
  });
  box.addEventListener('focusout', (event) => {
    if (event.relatedTarget instanceof Node && !box.contains(event.relatedTarget)) box.open = false;
  });
  return box;
}
