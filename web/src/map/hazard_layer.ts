// SPDX-License-Identifier: BSD-3-Clause
// Hazard classes, and the cells from which boulders reach a place.
import { LAYER_COLOURS } from '../colours';
import type { Binary, HazardMessage, OriginsMessage } from '../protocol';
import { extentOf } from '../terrain';
import { PlotLayer, RasterLayer, type Plan } from './plot_layer';
import { classRaster } from './rasters';

export class HazardLayer extends RasterLayer {
  constructor(zIndex: number) {
    super(zIndex, false);
    this.setOpacity(0.75);
  }

  show(message: Binary<HazardMessage> | null): void {
    const classes = message?.u1('classes');
    if (!message || !classes) return this.display(null);
    const { west, north, cell } = message.header;
    const [ny = 0, nx = 0] = classes.shape;
    const colours = message.header.classes.map(([, colour]) => colour);
    this.display(classRaster(classes.values, nx, ny, colours), extentOf(west, north, cell, classes.shape));
  }
}

/** Source cells, coloured by their contribution to a place. */
export class OriginLayer extends PlotLayer {
  private message: Binary<OriginsMessage> | null = null;

  show(message: Binary<OriginsMessage> | null): void {
    this.message = message?.f8('x') ? message : null;
    this.redraw();
  }

  protected override paint(context: CanvasRenderingContext2D, { scale, x0, y0, pixelRatio }: Plan): void {
    const [x, y, part] = [this.message?.f8('x')?.values, this.message?.f8('y')?.values, this.message?.u1('class')?.values];
    if (!this.message || !x || !y || !part) return;
    const { cell, parts } = this.message.header;
    const side = Math.max(cell * scale, 3 * pixelRatio);
    for (let k = x.length - 1; k >= 0; k--) {
      context.fillStyle = parts[part[k] as number]?.[1] ?? LAYER_COLOURS.sources;
      context.fillRect(x0 + (x[k] as number) * scale - side / 2, y0 - (y[k] as number) * scale - side / 2, side, side);
    }
  }
}
