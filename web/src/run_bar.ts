// SPDX-License-Identifier: BSD-3-Clause
// State of the run: number of boulders, duration; pause, resume, ten times as many boulders.
import { button, element } from './dom';
import { icon, iconButton } from './icons';
import type { BatchMessage } from './protocol';
import { duration, say } from './texts';

export class RunBar {
  readonly root = element('div', { class: 'run-bar', label: say('app.run.label'), attributes: { role: 'group' } });
  private readonly text = element('span', { class: 'run-text', attributes: { 'aria-live': 'off' } });
  private readonly bar = element('progress', { attributes: { max: '1', 'aria-label': say('app.run.label') } });
  private readonly toggle: HTMLButtonElement;
  private readonly tenfold: HTMLButtonElement;
  private running = false;

  constructor(
    turn: (to: 'run' | 'stop') => void,
    more: () => void,
    private readonly live: boolean,
  ) {
    this.toggle = iconButton('pause', '', () => turn(this.running ? 'stop' : 'run'), { action: 'pause' });
    this.tenfold = button('×10', more, { title: say('app.run.tenfold'), action: 'tenfold' });
    this.root.append(element('div', { class: 'run-state' }, this.text, this.bar));
    if (live) this.root.append(this.toggle, this.tenfold);
  }

  /** Show a batch. If it is missing or out of date, show that results are awaited, or why there are none. */
  update(batch: BatchMessage | null, preliminary: boolean, reason: string, writer: boolean, paused: boolean): void {
    const failed = reason !== '';
    const current = batch !== null && !preliminary;
    this.running = current ? batch.running : !failed && !paused;
    const done = current && batch.complete ? 'complete' : 'paused';
    const state = failed ? 'failed' : current ? (batch.running && !batch.complete ? 'running' : done) : paused ? done : 'waiting';
    this.root.dataset['state'] = this.live ? state : 'complete';
    this.text.textContent = failed ? reason : current ? this.describe(batch) : say(paused ? 'app.run.paused' : 'app.run.waiting');
    if (current) this.bar.value = batch.total ? batch.boulders / batch.total : 0;
    else if (!failed && !paused) this.bar.removeAttribute('value');
    else this.bar.value = 0;
    const label = say(this.running ? 'app.run.pause' : 'app.run.go_on');
    this.toggle.replaceChildren(icon(this.running ? 'pause' : 'play'));
    this.toggle.title = label;
    this.toggle.setAttribute('aria-label', label);
    this.toggle.disabled = !writer || state === 'complete' || state === 'failed';
    this.tenfold.disabled = !writer || failed;
  }

  private describe({ boulders, total, complete, seconds, seconds_left }: BatchMessage): string {
    if (complete)
      return this.live
        ? say('app.run.complete', { n: boulders, time: duration(seconds) })
        : say('app.run.of_result', { n: boulders });
    const left =
      seconds_left !== null && seconds_left > 1
        ? say('app.run.left', { time: duration(seconds_left) })
        : duration(seconds);
    return `${say('app.run.part', { n: boulders, total })} · ${this.running ? left : say('app.run.paused')}`;
  }
}
