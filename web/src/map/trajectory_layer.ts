// SPDX-License-Identifier: BSD-3-Clause
// Trajectories in plan, and points of a single kind.
import { createEmpty, extendCoordinate } from 'ol/extent';
import { css, LAYER_COLOURS, plasma, SPEED_CLASSES } from '../colours';
import { COLUMNS, type Trajectories } from '../trajectories';
import { PlotLayer, type Plan } from './plot_layer';

const SPEED = 4; // column of the speed
const TOGETHER = 10; // trajectories per stroke
const SHORTEST = 1; // [px] nearer vertices are skipped

export class TrajectoryLayer extends PlotLayer {
  private shown: Trajectories | null = null;
  private fastest = 0;
  private bySpeed = false;

  display(trajectories: Trajectories | null, west: number, south: number): void {
    this.shown = trajectories;
    this.originX = west;
    this.originY = south;
    this.fastest = 0;
    const points = trajectories?.points ?? [];
    for (let k = SPEED; k < points.length; k += COLUMNS) this.fastest = Math.max(this.fastest, points[k] ?? 0);
    this.redraw();
  }

  colourBySpeed(on: boolean): void {
    this.bySpeed = on;
    this.redraw();
  }

  /** Maximum speed of all trajectories [m/s]. */
  get maxSpeed(): number {
    return this.fastest;
  }

  protected override paint(context: CanvasRenderingContext2D, plan: Plan): void {
    if (!this.shown) return;
    // One-pixel lines are drawn many times faster than wider lines.
    context.lineWidth = Math.max(1, Math.floor(plan.pixelRatio));
    context.lineJoin = 'round';
    const number = this.shown.first.length - 1;
    // With a single colour, each trajectory has its own stroke, so that crossings get darker; very long strokes are slow.
    const [together, classes] = this.bySpeed ? [TOGETHER, SPEED_CLASSES] : [1, 1];
    context.globalAlpha = this.bySpeed ? 0.85 : Math.max(0.12, Math.min(0.6, 3.5 / Math.sqrt(number + 1)));
    for (let t = 0; t < number; t += together)
      this.pathsOf(this.shown, t, Math.min(t + together, number), classes, plan).forEach((path, k) => {
        context.strokeStyle = this.bySpeed ? css(plasma(k / (SPEED_CLASSES - 1))) : LAYER_COLOURS.trajectories;
        context.stroke(path);
      });
  }

  /** Segments of several trajectories, as a path for each speed class. */
  private pathsOf({ points, first }: Trajectories, begin: number, behind: number, classes: number, { scale, x0, y0 }: Plan): Path2D[] {
    const paths = Array.from({ length: classes }, () => new Path2D());
    const perClass = this.fastest / classes || 1;
    for (let t = begin; t < behind; t++) {
      const end = (first[t + 1] ?? 0) * COLUMNS;
      let lastX = NaN;
      let lastY = NaN;
      let last = -1;
      for (let k = (first[t] ?? 0) * COLUMNS; k < end; k += COLUMNS) {
        const x = x0 + (points[k] as number) * scale;
        const y = y0 - (points[k + 1] as number) * scale;
        if (Math.abs(x - lastX) + Math.abs(y - lastY) < SHORTEST && k + COLUMNS < end) continue;
        const now = Math.min(classes - 1, Math.floor((points[k + SPEED] as number) / perClass));
        const path = paths[now] as Path2D;
        if (now !== last) path.moveTo(Number.isNaN(lastX) ? x : lastX, Number.isNaN(lastY) ? y : lastY);
        path.lineTo(x, y);
        [lastX, lastY, last] = [x, y, now];
      }
    }
    return paths;
  }
}

/** Points from rows of numbers that start with x and y [m] from an origin. */
export class DotLayer extends PlotLayer {
  private rows: Float32Array | Float64Array = new Float32Array();
  private columns = 2;

  constructor(
    zIndex: number,
    private readonly colour: string,
    private readonly radius: number, // [CSS pixel]
    private readonly square = false,
  ) {
    super(zIndex);
  }

  display(rows: Float32Array | Float64Array, columns: number, west = 0, south = 0): void {
    this.rows = rows;
    this.columns = columns;
    this.originX = west;
    this.originY = south;
    this.redraw();
  }

  /** Extent of the points [m]. */
  get extent(): number[] {
    const whole = createEmpty();
    for (let k = 0; k + 1 < this.rows.length; k += this.columns)
      extendCoordinate(whole, [this.originX + (this.rows[k] as number), this.originY + (this.rows[k + 1] as number)]);
    return whole;
  }

  protected override paint(context: CanvasRenderingContext2D, { scale, x0, y0, width, height, pixelRatio }: Plan): void {
    const r = this.radius * pixelRatio;
    const path = new Path2D();
    for (let k = 0; k + 1 < this.rows.length; k += this.columns) {
      const x = x0 + (this.rows[k] as number) * scale;
      const y = y0 - (this.rows[k + 1] as number) * scale;
      if (x < -r || y < -r || x > width + r || y > height + r) continue;
      if (this.square) path.rect(x - r, y - r, 2 * r, 2 * r);
      else {
        path.moveTo(x + r, y);
        path.arc(x, y, r, 0, 2 * Math.PI);
      }
    }
    context.globalAlpha = 0.8;
    context.fillStyle = this.colour;
    context.fill(path);
  }
}
