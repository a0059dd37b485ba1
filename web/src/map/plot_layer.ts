// SPDX-License-Identifier: BSD-3-Clause
// Map layers that paint themselves: rasters placed by a transform, and plots redrawn with each change of data or view.
import Layer from 'ol/layer/Layer';
import type { FrameState } from 'ol/Map';
import type Source from 'ol/source/Source';
import { element } from '../dom';
import type { Extent } from '../terrain';

/** Canvas in its own container, as the map's renderer and the picture export require. */
abstract class CanvasLayer extends Layer<Source> {
  protected canvas = element('canvas');
  private readonly box = element('div', { class: 'ol-layer plot-layer' }, this.canvas);

  constructor(zIndex: number) {
    super({ zIndex });
  }

  override render(frame: FrameState): HTMLElement {
    this.box.style.opacity = String(this.getOpacity());
    this.place(frame);
    return this.box;
  }

  protected abstract place(frame: FrameState): void;

  protected moveCanvas(scaleX: number, scaleY: number, x: number, y: number): void {
    this.canvas.style.transform = `matrix(${scaleX}, 0, 0, ${scaleY}, ${x}, ${y})`;
  }

  protected swapCanvas(canvas: HTMLCanvasElement): void {
    if (canvas === this.canvas) return;
    this.canvas.replaceWith(canvas);
    this.canvas = canvas;
  }
}

/** Raster with one pixel per cell; panning and zooming move the canvas without redrawing. */
export class RasterLayer extends CanvasLayer {
  private extent: Extent | null = null;

  constructor(
    zIndex: number,
    private readonly smooth: boolean,
  ) {
    super(zIndex);
  }

  display(canvas: HTMLCanvasElement | null, extent: Extent | null = null): void {
    this.extent = extent;
    if (canvas) this.swapCanvas(canvas);
    this.canvas.classList.toggle('cells', !this.smooth);
    this.canvas.hidden = canvas === null;
    this.changed();
  }

  get area(): Extent | null {
    return this.extent;
  }

  protected override place({ size, viewState }: FrameState): void {
    if (!this.extent) return;
    const [west, south, east, north] = this.extent;
    const [x, y] = viewState.center as [number, number];
    const [width, height] = size as [number, number];
    const { resolution } = viewState;
    this.moveCanvas(
      (east - west) / this.canvas.width / resolution,
      (north - south) / this.canvas.height / resolution,
      (west - x) / resolution + width / 2,
      (y - north) / resolution + height / 2,
    );
  }
}

/** Transformation from [m] east and north of an origin to canvas pixels. */
export interface Plan {
  scale: number;
  x0: number;
  y0: number;
  width: number;
  height: number;
  pixelRatio: number;
}

interface View {
  x: number;
  y: number;
  resolution: number;
  width: number;
  height: number;
  pixelRatio: number;
}

const FRAME = 10; // [ms] while the view moves, slower plots are shifted instead of redrawn

/** Plot of points or lines with coordinates in [m] from an origin. */
export abstract class PlotLayer extends CanvasLayer {
  protected originX = 0;
  protected originY = 0;
  private drawn: View | null = null;
  private outdated = true;
  private cost = 0;

  protected abstract paint(context: CanvasRenderingContext2D, plan: Plan): void;

  /** Repaint in the next frame. */
  redraw(): void {
    this.outdated = true;
    this.changed();
  }

  protected override place({ size, viewState, viewHints, pixelRatio }: FrameState): void {
    const [x, y] = viewState.center as [number, number];
    const [width, height] = size as [number, number];
    const view: View = { x, y, resolution: viewState.resolution, width, height, pixelRatio };
    const moving = viewHints.some((hint) => hint > 0);
    const drawn = this.drawn;
    const same = drawn !== null && (Object.keys(view) as (keyof View)[]).every((key) => view[key] === drawn[key]);
    if (same && !this.outdated) return;
    if (drawn && moving && this.cost > FRAME && !this.outdated) {
      const scale = drawn.resolution / view.resolution;
      const shiftX = (drawn.x - view.x) / view.resolution + (width - drawn.width * scale) / 2;
      const shiftY = (view.y - drawn.y) / view.resolution + (height - drawn.height * scale) / 2;
      this.moveCanvas(scale / pixelRatio, scale / pixelRatio, shiftX, shiftY);
      return;
    }
    const begun = performance.now();
    this.draw(view);
    this.cost = performance.now() - begun;
    this.drawn = view;
    this.outdated = false;
  }

  private draw(view: View): void {
    const { width, height, pixelRatio } = view;
    this.canvas.width = Math.round(width * pixelRatio);
    this.canvas.height = Math.round(height * pixelRatio);
    this.moveCanvas(1 / pixelRatio, 1 / pixelRatio, 0, 0);
    const context = this.canvas.getContext('2d');
    if (!context) return;
    const scale = pixelRatio / view.resolution;
    this.paint(context, {
      scale,
      x0: (this.originX - view.x) * scale + this.canvas.width / 2,
      y0: (view.y - this.originY) * scale + this.canvas.height / 2,
      width: this.canvas.width,
      height: this.canvas.height,
      pixelRatio,
    });
  }
}
