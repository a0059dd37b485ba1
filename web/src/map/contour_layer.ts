// SPDX-License-Identifier: BSD-3-Clause
// Contours of the terrain; every fifth is thicker and shows its elevation.
import { contours } from 'd3-contour';
import { ticks } from '../colours';
import { decimal } from '../texts';
import { rangeOf, type Terrain } from '../terrain';
import { PlotLayer, type Plan } from './plot_layer';

const [COLOUR, HALO] = ['#7a5a36', 'rgb(255 255 255 / 0.85)'];
const LINES = 40; // approximate maximum number of contours
const INDEX = 5; // every fifth contour is thicker
const TOUCH = 1e-6; // distance of the points tested on both sides of a contour [cells]
const ROOM = 160; // minimum length of a contour with a label [px]

interface Contour {
  elevation: number;
  index: boolean;
  /** Coordinates [m] from the south-western corner. */
  parts: Float32Array[];
}

/** Interval of contours [m]: 1, 2 or 5 times a power of ten. */
export function intervalOf(low: number, high: number): number {
  const [first = 0, second = 1] = ticks({ low: 0, high: (5 * (high - low)) / LINES || 5, scale: 'linear' });
  return Math.max(second - first, 1);
}

/** Contours between cell centres; none along the edges of the known terrain. */
export function contoursOf({ heights, nx, ny, cell }: Terrain): Contour[] {
  const { low, high } = rangeOf(heights) ?? { low: 0, high: 0 };
  if (!(high > low)) return [];
  const interval = intervalOf(low, high);
  const levels = Array.from({ length: Math.floor(high / interval) - Math.ceil(low / interval) + 1 }, (_, k) => (Math.ceil(low / interval) + k) * interval);
  const isUnknown = (x: number, y: number): boolean => {
    const [i, j] = [Math.floor(x - 0.5), Math.floor(y - 0.5)];
    if (i < 0 || j < 0 || i > nx - 2 || j > ny - 2) return true;
    return [0, 1, nx, nx + 1].some((step) => Number.isNaN(heights[j * nx + i + step] as number));
  };
  // Next to missing elevations, a contour would follow the centres of the last known cells.
  const atEdge = (x: number, y: number): boolean => isUnknown(x - TOUCH, y - TOUCH) || isUnknown(x + TOUCH, y + TOUCH);
  const trace = contours().size([nx, ny]);
  return levels.map((elevation) => {
    const parts: Float32Array[] = [];
    for (const ring of trace.contour(heights as unknown as number[], elevation).coordinates.flat()) {
      let part: number[] = [];
      const end = (): void => {
        if (part.length > 2) parts.push(Float32Array.from(part));
        part = [];
      };
      ring.forEach(([x = 0, y = 0], k) => {
        const [u = x, v = y] = ring[k - 1] ?? [];
        if (k && atEdge((x + u) / 2, (y + v) / 2)) end();
        part.push(x * cell, (ny - y) * cell);
      });
      end();
    }
    return { elevation, index: Math.round(elevation / interval) % INDEX === 0, parts };
  });
}

export class ContourLayer extends PlotLayer {
  private terrain: Terrain | null = null;
  private lines: Contour[] | null = null;

  constructor(zIndex: number) {
    super(zIndex);
    this.setVisible(false);
  }

  display(terrain: Terrain): void {
    this.terrain = terrain;
    this.lines = null;
    [this.originX, this.originY] = [terrain.west, terrain.south];
    this.redraw();
  }

  /** Elevation of each contour, and its vertices [m], for tests. */
  get shown(): { elevation: number; vertices: [number, number][] }[] {
    const verticesOf = (part: Float32Array): [number, number][] =>
      Array.from({ length: part.length / 2 }, (_, k) => [this.originX + (part[2 * k] ?? 0), this.originY + (part[2 * k + 1] ?? 0)]);
    return (this.lines ?? []).map(({ elevation, parts }) => ({ elevation, vertices: parts.flatMap(verticesOf) }));
  }

  protected override paint(context: CanvasRenderingContext2D, plan: Plan): void {
    if (!this.terrain) return;
    this.lines ??= contoursOf(this.terrain); // computed when first shown
    const { scale, x0, y0, pixelRatio } = plan;
    context.lineJoin = 'round';
    context.strokeStyle = COLOUR;
    for (const { index, parts } of this.lines) {
      const path = new Path2D();
      for (const part of parts)
        for (let k = 0; k < part.length; k += 2) {
          const [x, y] = [x0 + (part[k] as number) * scale, y0 - (part[k + 1] as number) * scale];
          if (k) path.lineTo(x, y);
          else path.moveTo(x, y);
        }
      context.globalAlpha = index ? 0.85 : 0.5;
      context.lineWidth = (index ? 1.3 : 0.7) * pixelRatio;
      context.stroke(path);
    }
    context.globalAlpha = 1;
    for (const line of this.lines) if (line.index) for (const part of line.parts) label(context, plan, part, decimal(line.elevation));
  }
}

/** Label the middle of the visible part of a contour with its elevation, upright. */
function label(context: CanvasRenderingContext2D, { scale, x0, y0, width, height, pixelRatio }: Plan, part: Float32Array, text: string): void {
  const places: [number, number][] = [];
  let length = 0;
  for (let k = 0; k < part.length; k += 2) {
    const [x, y] = [x0 + (part[k] as number) * scale, y0 - (part[k + 1] as number) * scale];
    if (x < 0 || y < 0 || x > width || y > height) continue;
    const [u, v] = places.at(-1) ?? [x, y];
    length += Math.hypot(x - u, y - v);
    places.push([x, y]);
  }
  if (length < ROOM * pixelRatio) return;
  const near = (step: number): [number, number] => places[Math.max(0, Math.min(places.length - 1, (places.length >> 1) + step))] ?? [0, 0];
  const [[x, y], before, after] = [near(0), near(-3), near(3)];
  const angle = Math.atan2(after[1] - before[1], after[0] - before[0]);
  context.save();
  context.translate(x, y);
  context.rotate(Math.abs(angle) > Math.PI / 2 ? angle + Math.PI : angle);
  context.font = `${11 * pixelRatio}px system-ui, sans-serif`;
  context.textAlign = 'center';
  context.textBaseline = 'middle';
  context.lineWidth = 3.5 * pixelRatio;
  context.strokeStyle = HALO;
  context.strokeText(text, 0, 0);
  context.fillStyle = COLOUR;
  context.fillText(text, 0, 0);
  context.restore();
}
