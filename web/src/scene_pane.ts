// SPDX-License-Identifier: BSD-3-Clause
// 3-D view, created when first shown and updated only while visible.
import { makeView, type Frame, type SceneContent, type View3d } from './view3d/view3d';

export class ScenePane {
  private view: View3d | null | undefined; // null: not supported by the browser
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

  /** Adopt changes; without effect while the map is shown. */
  update(...changed: (keyof SceneContent)[]): void {
    if (this.shown) this.view?.update(this.content(), changed);
  }
}
