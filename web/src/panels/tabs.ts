// SPDX-License-Identifier: BSD-3-Clause
// Tabs of the side panel; arrow keys switch between them.
import { button, element } from '../dom';

export interface Tab {
  name: string;
  title: string;
  content: HTMLElement;
}

export class Tabs {
  readonly root = element('div', { class: 'tabs' });
  private readonly buttons = new Map<string, HTMLButtonElement>();
  private readonly pages = new Map<string, HTMLElement>();

  constructor(label: string, tabs: readonly Tab[]) {
    const list = element('div', { class: 'tab-list', attributes: { role: 'tablist', 'aria-label': label } });
    this.root.append(list);
    for (const { name, title, content } of tabs) {
      const tab = button(title, () => this.show(name), {
        id: `tab-${name}`,
        attributes: { role: 'tab', 'aria-controls': `page-${name}`, 'data-tab': name },
      });
      const page = element('div', { class: 'tab-page', id: `page-${name}`, attributes: { role: 'tabpanel', 'aria-labelledby': tab.id } }, content);
      this.buttons.set(name, tab);
      this.pages.set(name, page);
      list.append(tab);
      this.root.append(page);
    }
    list.addEventListener('keydown', (event) => this.move(event));
    this.show(tabs[0]?.name ?? '');
  }

  show(name: string): void {
    for (const [one, tab] of this.buttons) {
      tab.setAttribute('aria-selected', String(one === name));
      tab.tabIndex = one === name ? 0 : -1;
    }
    for (const [one, page] of this.pages) page.hidden = one !== name;
  }

  /** Mark a tab that contains an error. */
  mark(name: string, marked: boolean): void {
    this.buttons.get(name)?.classList.toggle('has-error', marked);
  }

  private move(event: KeyboardEvent): void {
    const step = event.key === 'ArrowRight' ? 1 : event.key === 'ArrowLeft' ? -1 : 0;
    if (!step) return;
    event.preventDefault();
    event.stopPropagation();
    const all = [...this.buttons.values()];
    const next = all[(all.findIndex((tab) => tab.tabIndex === 0) + step + all.length) % all.length];
    next?.click();
    next?.focus();
  }
}
