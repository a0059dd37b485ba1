// SPDX-License-Identifier: BSD-3-Clause
// Dialogs for writing the case, its report and its layers, with progress, and a question before a file is replaced.
import type { Connection } from './connection';
import { button, element, labelled, uniqueId } from './dom';
import type { LongTask, Progress, Task } from './protocol';
import { duration, say } from './texts';

export class Output {
  readonly dialog = element('dialog', { class: 'output' });
  private task: Task = 'save';
  private saved: readonly string[] = []; // files saved for the running task
  private remark = ''; // note on the saved files
  private cancelled = false;
  private readonly title = element('h2', { id: uniqueId('dialog') });
  private readonly name = element('input', {
    id: uniqueId('name'),
    attributes: { type: 'text', autocomplete: 'off', spellcheck: 'false', maxlength: '100', 'data-field': 'file_name' },
  });
  private readonly files = element('p', { class: 'hint' });
  private readonly message = element('div', { class: 'dialog-message', attributes: { role: 'status' } });
  private readonly buttons = element('div', { class: 'actions' });

  constructor(
    private readonly connection: Connection,
    name: string,
    private readonly folder: string,
  ) {
    this.name.value = name;
    const field = labelled(say('app.output.name'), this.name, true);
    const form = element('form', {}, this.title, field, this.files, this.message, this.buttons);
    form.addEventListener('submit', (event) => {
      event.preventDefault();
      this.send(false);
    });
    this.name.addEventListener('input', () => this.ask());
    this.dialog.setAttribute('aria-labelledby', this.title.id);
    this.dialog.append(form);
  }

  open(task: Task): void {
    this.task = task;
    this.title.textContent = say(`app.output.title.${task}`);
    this.name.readOnly = false;
    this.ask();
    if (!this.dialog.open) this.dialog.showModal();
    this.name.select();
  }

  /** Continue a stopped run. */
  resume(name: string): void {
    this.name.value = name;
    this.open('simulate');
    this.connection.send({ type: 'resume', name });
    this.wait();
  }

  refused(text: string, exists: boolean): void {
    this.name.readOnly = false;
    this.tell(element('p', { class: `alert ${exists || this.cancelled ? 'amber' : 'red'}` }, text));
    this.cancelled = false;
    const overwrite = button(say('app.output.overwrite'), () => this.send(true), { class: 'danger', action: 'overwrite' });
    this.offer(exists ? overwrite : this.submit());
  }

  progress({ task, phase, done, total, seconds_left }: Progress): void {
    if (!this.dialog.open) this.open(task);
    if (this.cancelled) return;
    this.name.readOnly = true;
    const bar = element('progress', { attributes: { max: String(total || 1) } });
    if (total) bar.value = done;
    const left = seconds_left === null ? '' : say('app.run.left', { time: duration(seconds_left) });
    this.tell(element('p', {}, phase), bar, element('p', { class: 'hint' }, left));
    this.buttons.replaceChildren(this.stop());
  }

  /** The case has been written: a long task (report, export, run) continues, other tasks are done. */
  written(files: readonly string[], remark: string): void {
    this.remark = remark;
    if (isLong(this.task)) this.saved = files;
    else this.done(files);
  }

  done(files: readonly string[]): void {
    files = [...this.saved, ...files];
    this.saved = [];
    this.tell(
      element('p', { class: 'alert good' }, say('app.output.written', { folder: this.folder })),
      element('ul', { class: 'files' }, ...files.map((file) => element('li', {}, file))),
      ...(this.remark ? [element('p', { class: 'alert amber' }, this.remark)] : []),
    );
    this.buttons.replaceChildren(
      button(say('app.close'), () => this.dialog.close(), { class: 'primary', action: 'close-dialog' }),
    );
  }

  private ask(): void {
    this.files.textContent = say(`app.output.hint.${this.task}`, { name: this.name.value || '…', folder: this.folder });
    this.tell();
    this.offer(this.submit());
  }

  private send(overwrite: boolean): void {
    const name = this.name.value.trim();
    if (!name) {
      this.name.focus();
      return;
    }
    this.connection.send({ type: this.task, name, overwrite });
    this.wait();
  }

  private wait(): void {
    this.name.readOnly = true;
    this.tell(element('p', { class: 'hint' }, say('app.output.working')));
    this.cancelled = false;
    this.saved = [];
    this.buttons.replaceChildren(this.task === 'save' ? '' : this.stop());
  }

  /** Button that cancels the task after its present step. */
  private stop(): HTMLButtonElement {
    const cancel = (): void => {
      this.cancelled = true;
      made.disabled = true;
      this.connection.send({ type: 'cancel' });
      this.tell(element('p', { class: 'hint' }, say('app.output.cancelling')));
    };
    const made = button(say('app.cancel'), cancel, { action: 'cancel' });
    return made;
  }

  private submit(): HTMLButtonElement {
    return element('button', { class: 'primary', action: 'write', attributes: { type: 'submit' } }, say(`app.output.${this.task}`));
  }

  private offer(action: HTMLButtonElement): void {
    this.buttons.replaceChildren(button(say('app.cancel'), () => this.dialog.close()), action);
  }

  private tell(...children: HTMLElement[]): void {
    this.message.replaceChildren(...children);
  }
}

/** True for tasks that report progress. */
export function isLong(task: string): task is LongTask {
  return task === 'report' || task === 'export' || task === 'simulate';
}
