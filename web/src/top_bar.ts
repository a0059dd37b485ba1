// SPDX-License-Identifier: BSD-3-Clause
// Top bar: case, state of its run, map or 3-D, undo and redo, output, language.
import { button, element, select } from './dom';
import { icon, iconButton } from './icons';
import type { Task, Welcome } from './protocol';
import { menu, type Mode } from './shell';
import { say } from './texts';

interface Actions {
  show(mode: Mode): void;
  undo(): void;
  redo(): void;
  write(task: Task): void;
  picture(): void;
  speak(language: string): void;
}

export class TopBar {
  private readonly undo: HTMLButtonElement;
  private readonly redo: HTMLButtonElement;
  private readonly views = new Map<Mode, HTMLButtonElement>();

  /** Fill the bar; without a server it offers no output. */
  constructor(
    bar: HTMLElement,
    welcome: Welcome,
    runBar: HTMLElement,
    live: boolean,
    private readonly actions: Actions,
  ) {
    const { title, file, folder, mode } = welcome;
    const editing = mode === 'case' && live;
    this.undo = step('undo', say('app.undo'), 'Control+Z', actions.undo);
    this.redo = step('redo', say('app.redo'), 'Control+Shift+Z', actions.redo);
    const views = element(
      'div',
      { class: 'segmented', attributes: { role: 'group', 'aria-label': say('app.view') } },
      this.view('map'),
      this.view('scene'),
    );
    const save = button([icon('save'), say('app.output.save')], () => actions.write('save'), {
      class: 'primary',
      title: `${say('app.output.title.save')} (Ctrl+S)`,
      action: 'save',
    });
    const name = element('h1', {}, title || file || 'rockfall');
    const edits = editing ? [this.undo, this.redo, save] : [];
    bar.append(
      element('div', { class: 'case-name', title: folder }, name, element('small', {}, file)),
      runBar,
      element('div', { class: 'top-actions' }, views, ...edits, menu(say('app.more'), ...this.more(welcome, live))),
    );
  }

  showMode(mode: Mode): void {
    for (const [name, made] of this.views) made.setAttribute('aria-pressed', String(name === mode));
  }

  allow(undo: boolean, redo: boolean): void {
    this.undo.disabled = !undo;
    this.redo.disabled = !redo;
  }

  private view(mode: Mode): HTMLButtonElement {
    const made = button(say(`app.view.${mode}`), () => this.actions.show(mode), {
      attributes: { 'data-view': mode, 'aria-pressed': 'false' },
    });
    this.views.set(mode, made);
    return made;
  }

  /** Menu of less frequent actions. */
  private more({ mode, language, languages }: Welcome, live: boolean): HTMLElement[] {
    const { write, picture, speak } = this.actions;
    const shot = button(say('app.picture'), picture, { action: 'picture' });
    if (!live) return [shot];
    const tasks: Task[] = mode === 'case' ? ['simulate', 'report', 'export'] : [];
    const names = new Intl.DisplayNames([language], { type: 'language' });
    const choices = languages.map((one) => [one, names.of(one) ?? one] as const);
    return [
      ...tasks.map((task) => button(say(`app.output.${task}`), () => write(task), { action: task })),
      shot,
      element('label', {}, say('app.language'), select(choices, language, speak, { action: 'language' })),
    ];
  }
}

function step(name: 'undo' | 'redo', label: string, keys: string, action: () => void): HTMLButtonElement {
  const title = `${label} (${keys.replace('Control', 'Ctrl')})`;
  return iconButton(name, label, action, { title, action: name, attributes: { 'aria-keyshortcuts': keys } });
}
