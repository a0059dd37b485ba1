// SPDX-License-Identifier: BSD-3-Clause
// Buttons and time slider of the moving boulders.
import { element, select } from '../dom';
import { icon, iconButton } from '../icons';
import { decimal, say } from '../texts';

const PACES = [0.25, 0.5, 1, 2, 4];

/** Time of the view: running, paused, or at the end, where trajectories are complete. */
export class Player {
  playing = false;
  private time = 0; // [s]
  private duration = 0;
  private readonly toggler = iconButton('play', '', () => this.toggle());
  private readonly slider = element('input', { attributes: { type: 'range', min: '0', max: '1', step: 'any' }, label: say('app.view3d_time') });
  private readonly clock = element('output');
  private readonly pace = select(
    PACES.map((pace) => [String(pace), pace < 1 ? `1/${1 / pace} ×` : `${pace} ×`] as const),
    '1',
    () => undefined,
    { title: say('app.view3d_pace'), label: say('app.view3d_pace') },
  );
  readonly root = element('div', { class: 'view3d-player card' }, this.toggler, this.slider, this.clock, this.pace);

  constructor(private readonly moved: () => void) {
    this.slider.addEventListener('input', () => {
      this.playing = false;
      this.time = Number(this.slider.value);
      this.refresh();
    });
    this.setDuration(0);
  }

  /** Time [s] at which to show boulders; null at the end. */
  get shown(): number | null {
    return this.time < this.duration ? this.time : null;
  }

  /** Set the longest time [s] of new trajectories. The current time is kept; at the end, it moves to the new end. */
  setDuration(duration: number): void {
    const atEnd = this.shown === null;
    this.duration = duration;
    this.time = atEnd ? duration : Math.min(this.time, duration);
    if (duration === 0) this.playing = false;
    this.slider.max = String(duration);
    this.root.hidden = duration === 0;
    this.refresh();
  }

  /** Play (from the start if at the end) or pause. */
  toggle(): void {
    if (this.duration === 0) return;
    if (!this.playing && this.shown === null) this.time = 0;
    this.playing = !this.playing;
    this.refresh();
  }

  /** Advance by real time [s]. */
  advance(seconds: number): void {
    if (!this.playing) return;
    this.time = Math.min(this.time + seconds * Number(this.pace.value), this.duration);
    if (this.time === this.duration) this.playing = false;
    this.refresh();
  }

  private refresh(): void {
    const word = this.playing ? 'pause' : 'play';
    const title = say(`app.view3d_${word}`);
    if (this.toggler.title !== title) {
      this.toggler.replaceChildren(icon(word));
      this.toggler.title = title;
      this.toggler.setAttribute('aria-label', title);
    }
    this.slider.value = String(this.time);
    this.clock.textContent = `${decimal(this.time, 1)} s`;
    this.slider.setAttribute('aria-valuetext', this.clock.textContent);
    this.moved();
  }
}
