// SPDX-License-Identifier: BSD-3-Clause
// Buttons and slider of the time in which boulders move.
import { icon, type IconName } from './icons';
import type { Say } from './types';

const PACES = [0.25, 0.5, 1, 2, 4];

/** Time of the view: runs, rests, or is at the end, where whole trajectories show. */
export class Player {
  readonly element = document.createElement('div');
  playing = false;
  private time = 0; // [s]
  private duration = 0;
  private readonly button = document.createElement('button');
  private readonly slider = document.createElement('input');
  private readonly clock = document.createElement('output');
  private readonly format = new Intl.NumberFormat(document.documentElement.lang || undefined, { minimumFractionDigits: 1, maximumFractionDigits: 1 });
  private readonly pace = document.createElement('select');

  constructor(private readonly say: Say, private readonly moved: () => void) {
    this.element.className = 'view3d-player view3d-card';
    this.button.type = 'button';
    this.button.addEventListener('click', () => this.toggle());
    Object.assign(this.slider, { type: 'range', min: '0', max: '1', step: 'any' });
    this.slider.setAttribute('aria-label', say('app.view3d_time'));
    this.slider.addEventListener('input', () => {
      this.playing = false;
      this.time = Number(this.slider.value);
      this.refresh();
    });
    this.pace.setAttribute('aria-label', say('app.view3d_pace'));
    this.pace.title = say('app.view3d_pace');
    for (const pace of PACES) this.pace.add(new Option(pace < 1 ? `1/${1 / pace} ×` : `${pace} ×`, String(pace), pace === 1, pace === 1));
    this.element.append(this.button, this.slider, this.clock, this.pace);
    this.setDuration(0);
  }

  /** Time [s] at which boulders are to be shown; null at the end. */
  get shown(): number | null {
    return this.time < this.duration ? this.time : null;
  }

  /** Take over the longest time [s] of new trajectories. A time that is shown stays, the end becomes the new end. */
  setDuration(duration: number): void {
    const atEnd = this.shown === null;
    this.duration = duration;
    this.time = atEnd ? duration : Math.min(this.time, duration);
    if (duration === 0) this.playing = false;
    this.slider.max = String(duration);
    this.element.hidden = duration === 0;
    this.refresh();
  }

  /** Play, from the beginning if at the end, or pause. */
  toggle(): void {
    if (this.duration === 0) return;
    if (!this.playing && this.shown === null) this.time = 0;
    this.playing = !this.playing;
    this.refresh();
  }

  /** Let seconds of the wall clock pass. */
  advance(seconds: number): void {
    if (!this.playing) return;
    this.time = Math.min(this.time + seconds * Number(this.pace.value), this.duration);
    if (this.time === this.duration) this.playing = false;
    this.refresh();
  }

  private refresh(): void {
    const word = this.playing ? 'pause' : 'play';
    if (this.button.dataset.word !== word) {
      this.button.dataset.word = word;
      this.button.replaceChildren(icon(word satisfies IconName));
      this.button.title = this.say(`app.view3d_${word}`);
      this.button.setAttribute('aria-label', this.button.title);
    }
    this.slider.value = String(this.time);
    this.clock.textContent = `${this.format.format(this.time)} s`;
    this.slider.setAttribute('aria-valuetext', this.clock.textContent);
    this.moved();
  }
}
