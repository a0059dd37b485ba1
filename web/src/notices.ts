// SPDX-License-Identifier: BSD-3-Clause
// Notices across the window that need an answer: another tab has write access, or runs were stopped.
import type { Connection } from './connection';
import { button } from './dom';
import type { Output } from './output';
import type { Shell } from './shell';
import { say } from './texts';

export class Notices {
  private unfinished: readonly { name: string; boulders: number }[] = [];

  constructor(
    private readonly shell: Shell,
    private readonly connection: Connection,
    private readonly output: Output,
  ) {}

  /** Offer to take over a case that is read-only in this window. */
  show(reads: boolean, writer: boolean): void {
    const take = button(say('app.take_over'), () => this.connection.send({ type: 'take_over' }), { action: 'take-over' });
    if (reads && !this.connection.standalone) this.shell.notice('role', 'amber', say('app.reader'), take);
    else this.shell.clearNotice('role');
    this.offer(this.unfinished, writer);
  }

  /** Offer to continue stopped runs. */
  offer(runs: readonly { name: string; boulders: number }[], writer: boolean): void {
    this.unfinished = runs;
    const known = new Set(runs.map(({ name }) => `unfinished ${name}`));
    this.shell.clearNotices((name) => name.startsWith('unfinished ') && !known.has(name));
    for (const { name, boulders } of writer ? runs : []) {
      const resume = button(say('app.resume'), () => this.output.resume(name), { action: 'resume' });
      this.shell.notice(`unfinished ${name}`, 'amber', say('app.unfinished', { name, n: boulders }), resume);
    }
  }
}
