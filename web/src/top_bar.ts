// SPDX-License-Identifier: BSD-3-Clause
// Bar on top: which case, state of its run, map or 3-D, undo and redo, what is written, language.
import { button, element, select } from './dom';
import { icon } from './icons';
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

  /** Fill a bar; without a server nothing can be written. */
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
      attributes: { 'data-action': 'save' },
    });
    bar.append(
      element(
        'div',
        { class: 'case-name', title: folder },
        element('h1', {}, title || file || 'rockfall'),
        element('small', {}, file),
      ),
      runBar,
      element(
        'div',
        { class: 'top-actions' },
        views,
        editing && this.undo,
        editing && this.redo,
        editing && save,
        menu(say('app.more'), ...this.more(welcome, live)),
      ),
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

  /** Actions that are needed less often. */
  private more({ mode, language, languages }: Welcome, live: boolean): HTMLElement[] {
    const { write, picture, speak } = this.actions;
    const action = (name: string, text: string, act: () => void): HTMLButtonElement =>
      button(text, act, { attributes: { 'data-action': name } });
    const found: HTMLElement[] = [action('picture', say('app.picture'), picture)];
    if (!live) return found;
    if (mode === 'case')
      found.unshift(
        action('simulate', say('app.output.simulate'), () => write('simulate')),
        action('report', say('app.output.report'), () => write('report')),
        action('export', say('app.output.export'), () => write('export')),
      );
    const names = new Intl.DisplayNames([language], { type: 'language' });
    const choices = languages.map((one) => [one, names.of(one) ?? one] as const);
    return [
      ...found,
      element(
        'label',
        {},
        say('app.language'),
        select(choices, language, speak, { attributes: { 'data-action': 'language' } }),
      ),
    ];
  }
}

function step(name: 'undo' | 'redo', text: string, keys: string, action: () => void): HTMLButtonElement {
  return button(icon(name), action, {
    class: 'icon-button',
    title: `${text} (${keys.replace('Control', 'Ctrl')})`,
    attributes: { 'aria-label': text, 'aria-keyshortcuts': keys, 'data-action': name },
  });
}
