// SPDX-License-Identifier: BSD-3-Clause
// Feature styles: a colour for each layer, a white halo, and handles of a selected feature.
import type OlFeature from 'ol/Feature';
import { LineString, MultiPoint, Point, Polygon } from 'ol/geom';
import { Circle, Fill, RegularShape, Stroke, Style, Text } from 'ol/style';
import { css, LAYER_COLOURS, rgbOf } from '../colours';
import type { Layer, Value } from '../protocol';

const HALO = 'rgb(255 255 255 / 0.85)';
const ACCENT = '#0b57d0';

function stroke(colour: string, width: number, extra: { lineDash?: number[]; lineCap?: CanvasLineCap } = {}): Stroke {
  return new Stroke({ color: colour, width, ...extra });
}

const LABEL_COLOURS: Readonly<Record<Layer, string>> = {
  sources: '#8f3f00',
  lines: '#00507d',
  barriers: '#7a2f5c',
  dams: '#6b4600',
  zones: '#00664a',
};

/** Name with a white halo. */
export function nameText(text: string, colour: string, offsetY: number, font = '600 12px system-ui, sans-serif'): Text {
  const halo = stroke('rgb(255 255 255 / 0.9)', 3.5);
  return new Text({ text, font, offsetY, overflow: true, fill: new Fill({ color: colour }), stroke: halo });
}

function label(name: Value | undefined, layer: Layer, offsetY: number): Style[] {
  if (name === undefined || name === '') return [];
  return [new Style({ text: nameText(String(name), LABEL_COLOURS[layer], offsetY), zIndex: 5 })];
}

function translucent(colour: string, percent: number): string {
  return css(rgbOf(colour), percent / 100);
}

/** Width of a dam at its base [m]. */
function footWidth(properties: Readonly<Record<string, Value>>): number {
  const number = (name: string, otherwise: number): number =>
    typeof properties[name] === 'number' ? (properties[name] as number) : otherwise;
  return number('crest_width', 0) + (2 * number('height', 0)) / Math.tan((number('slope', 45) * Math.PI) / 180);
}

function makeStyles(layer: Exclude<Layer, 'dams'>, wide: number): Style[] {
  const colour = LAYER_COLOURS[layer];
  switch (layer) {
    case 'sources':
      return [
        new Style({
          image: new Circle({ radius: 6.5 + wide, fill: new Fill({ color: colour }), stroke: stroke('#fff', 2), declutterMode: 'none' }),
          stroke: stroke(colour, 2 + wide),
          fill: new Fill({ color: translucent(colour, 25) }),
          zIndex: 4,
        }),
      ];
    case 'zones':
      return [
        new Style({
          stroke: stroke(colour, 2 + wide, { lineDash: [7, 4] }),
          fill: new Fill({ color: translucent(colour, 16) }),
        }),
      ];
    case 'lines':
      return [
        new Style({ stroke: stroke(HALO, 5 + wide) }),
        new Style({ stroke: stroke(colour, 2.5 + wide), zIndex: 3 }),
      ];
    case 'barriers':
      return [
        new Style({ stroke: stroke(HALO, 7 + wide) }),
        new Style({ stroke: stroke(colour, 4 + wide), zIndex: 2 }),
        new Style({ stroke: stroke('#7a2f5c', 4 + wide, { lineDash: [1.5, 7], lineCap: 'butt' }), zIndex: 3 }), // posts
      ];
  }
}

const made = new Map<string, Style[]>();

/** Styles of a shape, shared within a layer because each style caches its own picture. */
function shapeStyles(
  layer: Layer,
  properties: Readonly<Record<string, Value>>,
  selected: boolean,
  resolution: number,
): Style[] {
  const wide = selected ? 1 : 0;
  if (layer === 'dams') {
    const foot = footWidth(properties) / resolution;
    return [
      new Style({ stroke: stroke(translucent(LAYER_COLOURS.dams, 45), Math.max(foot, 7), { lineCap: 'butt' }) }),
      new Style({ stroke: stroke('#8a5a00', 2 + wide), zIndex: 2 }),
    ];
  }
  const key = `${layer} ${wide}`;
  let styles = made.get(key);
  if (!styles) made.set(key, (styles = makeStyles(layer, wide)));
  return styles;
}

/** Vertices, and edge midpoints that can be dragged to add a vertex. */
export function handles(geometry: LineString | Polygon): { vertices: number[][]; middles: number[][] } {
  const ring = geometry instanceof Polygon ? (geometry.getCoordinates()[0] ?? []) : geometry.getCoordinates();
  const middles = ring
    .slice(1)
    .map(([x = 0, y = 0], k) => [(x + (ring[k]?.[0] ?? 0)) / 2, (y + (ring[k]?.[1] ?? 0)) / 2]);
  return { vertices: ring, middles };
}

const VERTEX = new RegularShape({
  points: 4,
  radius: 6.5,
  angle: Math.PI / 4,
  fill: new Fill({ color: '#fff' }),
  stroke: stroke(ACCENT, 2),
  declutterMode: 'none',
});
const MIDDLE = new Circle({ declutterMode: 'none', radius: 3.5, fill: new Fill({ color: '#fff' }), stroke: stroke(ACCENT, 1.5) });
const RING = new Circle({ declutterMode: 'none', radius: 11, stroke: stroke(ACCENT, 2.5) });

function handleStyles(geometry: unknown): Style[] {
  if (geometry instanceof Point) return [new Style({ image: RING, zIndex: 6 })];
  if (!(geometry instanceof LineString || geometry instanceof Polygon)) return [];
  const { vertices, middles } = handles(geometry);
  return [
    new Style({ geometry: new MultiPoint(middles), image: MIDDLE, zIndex: 6 }),
    new Style({ geometry: new MultiPoint(vertices), image: VERTEX, zIndex: 7 }),
  ];
}

/** Styles of a feature, optionally with its name. */
export function featureStyles(
  feature: OlFeature,
  layer: Layer,
  properties: Readonly<Record<string, Value>>,
  named: boolean,
  resolution: number,
): Style[] {
  const shape = shapeStyles(layer, properties, false, resolution);
  return named ? [...shape, ...label(properties['name'], layer, offsetOf(feature))] : shape;
}

/** Styles of the selected feature; handles only if it can be edited. */
export function selectedStyles(
  feature: OlFeature,
  layer: Layer,
  properties: Readonly<Record<string, Value>>,
  editable: boolean,
  resolution: number,
): Style[] {
  const styles = [
    ...shapeStyles(layer, properties, true, resolution),
    ...label(properties['name'], layer, offsetOf(feature)),
  ];
  if (editable) return [...styles, ...handleStyles(feature.getGeometry())];
  return [new Style({ stroke: stroke(translucent(ACCENT, 70), 13), image: RING }), ...styles];
}

/** Distance from a shape to its name [px]. */
function offsetOf(feature: OlFeature): number {
  return feature.getGeometry() instanceof Point ? -16 : -12;
}

/** Style of the shape being drawn. */
export function sketchStyle(layer: Layer): Style[] {
  const colour = LAYER_COLOURS[layer];
  const dot = new Circle({ radius: 5, fill: new Fill({ color: colour }), stroke: stroke('#fff', 2) });
  return [
    new Style({ stroke: stroke(HALO, 5) }),
    new Style({
      stroke: stroke(colour, 2.5, { lineDash: [8, 5] }),
      fill: new Fill({ color: translucent(colour, 18) }),
      image: dot,
    }),
  ];
}

export const GRABBED = new Style({
  image: new Circle({ radius: 7, fill: new Fill({ color: ACCENT }), stroke: stroke('#fff', 2) }),
});
