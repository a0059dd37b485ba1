// SPDX-License-Identifier: BSD-3-Clause
// The view in three dimensions: made when it is first shown, and fed only while it is.
import type { Extent } from './map/plot_layer';
import type { Layers } from './protocol';
import { say } from './texts';
import { View3d, type Frame, type Line3d, type Shade, type Terrain, type Trajectories } from './view3d/view3d';

/** Present content of a scene. */
export interface SceneContent {
  terrain: Terrain | null;
  shade: Shade | null;
  trajectories: Trajectories | null;
  drape: { image: HTMLCanvasElement; extent: Extent } | null;
  layers: Layers;
}

const KINDS = { lines: 'line', barriers: 'barrier', dams: 'dam' } as const;

export class ScenePane {
  private view: View3d | null = null;
  private terrain: Terrain | null = null;
  private shown = false;

  constructor(
    private readonly parent: HTMLElement,
    private readonly content: () => SceneContent,
  ) {}

  show(): void {
    this.view ??= new View3d(this.parent, say);
    this.shown = true;
    this.view.show();
    this.update('terrain', 'trajectories', 'drape', 'layers');
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
    if (!this.view || !this.shown) return;
    const { terrain, shade, trajectories, drape, layers } = this.content();
    if (terrain && terrain !== this.terrain) this.view.setTerrain(terrain, shade);
    this.terrain = terrain;
    if (changed.includes('trajectories')) this.view.setTrajectories(trajectories);
    if (changed.includes('drape')) this.view.setDrape(drape?.image ?? null, drape?.extent ?? [0, 0, 0, 0]);
    if (changed.includes('layers')) this.view.setLines(linesOf(layers));
  }
}

function linesOf(layers: Layers): Line3d[] {
  return (['lines', 'barriers', 'dams'] as const).flatMap((layer) =>
    layers[layer].flatMap((feature): Line3d[] => {
      if (feature.type !== 'LineString') return [];
      const { name = '', height = 0 } = feature.properties;
      const [x, y] = [0, 1].map((k) => feature.coordinates.map((position) => position[k] ?? 0)) as [number[], number[]];
      return [{ name: String(name), kind: KINDS[layer], x, y, height: Number(height) }];
    }),
  );
}
