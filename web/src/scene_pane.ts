// SPDX-License-Identifier: BSD-3-Clause
// The view in three dimensions: made when it is first shown, and fed only while it is.
import { makeView, type Frame, type SceneContent, type View3d } from './view3d/view3d';

export class ScenePane {
  private view: View3d | null | undefined; // null: the browser cannot draw it
  private shown = false;

  constructor(
    private readonly parent: HTMLElement,
    private readonly content: () => SceneContent,
  ) {}

  show(): void {
    if (this.view === undefined) this.view = makeView(this.parent);
    this.shown = true;
    this.view?.show();
    this.update('trajectories', 'drape', 'layers');
  }

  /** Times of the last frames, for benchmarks. */
  get frames(): readonly Frame[] {
    return this.view?.frames ?? [];
  }

  hide(): void {
    this.shown = false;
    this.view?.hide();
  }

  dispose(): void {
    this.view?.dispose();
  }

  /** Take over what has changed; nothing while the map is shown. */
  update(...changed: (keyof SceneContent)[]): void {
    if (this.shown) this.view?.update(this.content(), changed);
  }
}
