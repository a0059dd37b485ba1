// SPDX-License-Identifier: BSD-3-Clause
// Map tools: select and move, draw, snap; vertices are dragged, inserted, and deleted by Alt-click.
import Collection from 'ol/Collection';
import type OlFeature from 'ol/Feature';
import { LineString, Polygon, type Geometry } from 'ol/geom';
import { altKeyOnly, singleClick } from 'ol/events/condition';
import Draw from 'ol/interaction/Draw';
import Modify from 'ol/interaction/Modify';
import Snap from 'ol/interaction/Snap';
import Translate from 'ol/interaction/Translate';
import type VectorSource from 'ol/source/Vector';
import type MapBrowserEvent from 'ol/MapBrowserEvent';
import { Style } from 'ol/style';
import type { DocumentStore } from './document';
import { GRABBED, handles, sketchStyle } from './map/feature_style';
import { dataOf, setData, featureOf } from './map/features';
import type { MapView } from './map/map_view';
import { SECTION_STYLE } from './map/section_layer';
import { LAYERS, type Feature, type Layer, type Position, type Value } from './protocol';

export type Tool = 'select' | 'source' | 'source_area' | 'line' | 'net' | 'dam' | 'zone' | 'section';

interface Drawing {
  layer: Layer;
  type: Feature['type'];
  letter: string;
}
/** Layer and shape of each drawing tool, and its shortcut key. */
export const TOOLS: Readonly<Record<Tool, Drawing | { layer: null; letter: string }>> = {
  select: { layer: null, letter: 'V' },
  source: { layer: 'sources', type: 'Point', letter: 'S' },
  source_area: { layer: 'sources', type: 'Polygon', letter: 'A' },
  line: { layer: 'lines', type: 'LineString', letter: 'L' },
  net: { layer: 'barriers', type: 'LineString', letter: 'N' },
  dam: { layer: 'dams', type: 'LineString', letter: 'D' },
  zone: { layer: 'zones', type: 'Polygon', letter: 'Z' },
  section: { layer: null, letter: 'P' },
};

const NEAR = 11; // pixels

export interface DrawListener {
  onTool(tool: Tool): void;
  onSelect(id: string): void;
  /** Properties of a new feature in a layer. */
  propertiesOf(layer: Layer): Record<string, Value>;
  onReplaced(count: number): void;
  onSection(vertices: Position[]): void;
  /** A click where the document has no feature. */
  onBeside(pixel: number[]): void;
}

export class Drawer {
  tool: Tool = 'select';
  private enabled = false;
  private asks = false; // true if sections can be drawn
  private draw: Draw | null = null;
  private gesture = 0;
  private readonly chosen = new Collection<OlFeature>();
  private readonly modify: Modify;
  private readonly translate: Translate;
  private readonly snaps: Snap[];

  constructor(
    private readonly view: MapView,
    private readonly store: DocumentStore,
    private readonly listener: DrawListener,
  ) {
    const { map, features } = view;
    this.translate = new Translate({ features: this.chosen, hitTolerance: 6, condition: (event) => !this.isNearHandle(event) });
    this.modify = new Modify({
      features: this.chosen,
      pixelTolerance: NEAR,
      condition: (event) => this.isNearHandle(event),
      deleteCondition: (event) => altKeyOnly(event) && singleClick(event),
      style: (vertex) => {
        const [x = 0, y = 0] = (vertex.getGeometry() as Geometry).getExtent();
        return this.distanceToHandle([x, y]) <= NEAR ? GRABBED : new Style();
      },
    });
    this.follow((begin, end) => {
      this.translate.on('translatestart', begin);
      this.translate.on('translateend', end);
    });
    this.follow((begin, end) => {
      this.modify.on('modifystart', begin);
      this.modify.on('modifyend', end);
    });
    map.addInteraction(this.translate);
    map.addInteraction(this.modify);
    const sources = [...LAYERS.map((layer) => features.source(layer)), features.selection.getSource() as VectorSource];
    this.snaps = sources.map((source) => new Snap({ source, pixelTolerance: 9 }));
    map.on('singleclick', (event) => this.click(event));
    map.on('pointermove', (event) => this.point(event));
    this.activate();
  }

  /** Allow editing, or only drawing a section; otherwise features are read-only. */
  enable(on: boolean, asks: boolean): void {
    this.enabled = on;
    this.asks = asks;
    this.view.features.editable = on;
    if (!on) this.use('select');
    this.activate();
  }

  use(tool: Tool): void {
    if (!this.may(tool)) return;
    const { map } = this.view;
    if (this.draw) map.removeInteraction(this.draw);
    this.snaps.forEach((snap) => map.removeInteraction(snap));
    this.draw = null;
    this.tool = tool;
    const drawing = TOOLS[tool];
    if (tool === 'section') {
      this.draw = new Draw({ type: 'LineString', style: SECTION_STYLE, stopClick: true, maxPoints: 2 });
      this.draw.on('drawend', ({ feature }) => this.cut(feature));
    } else if (drawing.layer !== null) {
      this.select('');
      const { type, layer } = drawing;
      this.draw = new Draw({ type, style: sketchStyle(layer), stopClick: true, minPoints: type === 'Polygon' ? 3 : 2 });
      this.draw.on('drawend', ({ feature }) => this.finish(drawing, feature));
    }
    if (this.draw) map.addInteraction(this.draw);
    if (this.enabled) this.snaps.forEach((snap) => map.addInteraction(snap)); // last: the map queries the latest first
    this.view.target.dataset['tool'] = tool;
    this.activate();
    this.listener.onTool(tool);
  }

  /** True if a tool may be used. */
  may(tool: Tool): boolean {
    return tool === 'select' || (tool === 'section' ? this.asks : this.enabled);
  }

  select(id: string): void {
    const found = this.view.features.find(id);
    this.view.features.select(found ? id : '');
    this.chosen.clear();
    if (found) this.chosen.push(found.feature);
    this.listener.onSelect(found ? id : '');
  }

  get selected(): string {
    return this.view.features.selected;
  }

  /** Deselect features that no longer exist after a change of the document. */
  refresh(): void {
    const { selected } = this;
    if (!selected) return;
    const found = this.view.features.find(selected);
    if (!found) this.select('');
    else if (this.chosen.item(0) !== found.feature) this.select(selected);
  }

  /** Handle Escape: cancel the drawing, else the tool, else the selection. */
  escape(): void {
    if (this.draw && this.drawing) this.draw.abortDrawing();
    else if (this.tool !== 'select') this.use('select');
    else this.select('');
  }

  /** Remove the last vertex of a drawing; false without a drawing. */
  undoVertex(): boolean {
    if (!this.draw || !this.drawing) return false;
    this.draw.removeLastPoint();
    return true;
  }

  finishDrawing(): void {
    if (this.drawing) this.draw?.finishDrawing();
  }

  removeSelected(): void {
    if (this.enabled && this.selected) this.store.remove(this.selected);
  }

  /** Move the selected feature [m]; false if none is selected. */
  nudge(dx: number, dy: number): boolean {
    const found = this.selected && this.enabled ? this.view.features.find(this.selected) : null;
    const geometry = found?.feature.getGeometry();
    if (!found || !geometry) return false;
    geometry.translate(dx, dy);
    this.write(found.feature, 'nudge');
    return true;
  }

  private get drawing(): boolean {
    const sketch = this.draw?.getOverlay().getSource()?.getFeatures() ?? [];
    return sketch.some((feature) => feature.getGeometry()?.getType() !== 'Point');
  }

  private activate(): void {
    const editing = this.enabled && this.tool === 'select';
    this.translate.setActive(editing);
    this.modify.setActive(editing);
  }

  /** Update the document while a feature is moved or reshaped; each drag is one undo step. */
  private follow(listen: (begin: () => void, end: () => void) => void): void {
    let stop = (): void => undefined;
    const begin = (): void => {
      const feature = this.chosen.item(0);
      const geometry = feature?.getGeometry();
      if (!feature || !geometry) return;
      const gesture = `drag ${++this.gesture}`;
      const write = (): void => this.write(feature, gesture);
      geometry.on('change', write);
      stop = () => {
        geometry.un('change', write);
        write();
      };
    };
    listen(begin, () => stop());
  }

  private write(feature: OlFeature, gesture: string): void {
    const before = dataOf(feature);
    const geometry = feature.getGeometry();
    const found = before && this.store.feature(before.id);
    if (!before || !geometry || !found) return;
    const after = featureOf(before.id, found.feature.properties, geometry);
    if (JSON.stringify(after.coordinates) === JSON.stringify(found.feature.coordinates)) return;
    setData(feature, after);
    this.store.replace(found.layer, after, gesture);
  }

  private finish({ layer, type }: Drawing, sketch: OlFeature): void {
    const geometry = sketch.getGeometry();
    if (!geometry) return;
    const feature = featureOf(this.store.newId(layer), this.listener.propertiesOf(layer), geometry);
    const replaced = this.store.layer(layer).filter((one) => one.type !== type).length;
    this.store.add(layer, feature);
    // Wait until the interaction has handled its last click.
    setTimeout(() => {
      this.use('select');
      this.select(feature.id);
      if (replaced) this.listener.onReplaced(replaced);
    });
  }

  private cut(sketch: OlFeature): void {
    const geometry = sketch.getGeometry();
    if (geometry instanceof LineString)
      this.listener.onSection(geometry.getCoordinates().map(([x = 0, y = 0]): Position => [x, y]));
    setTimeout(() => this.use('select'));
  }

  private click(event: MapBrowserEvent): void {
    if (this.tool !== 'select' || altKeyOnly(event)) return;
    const id = this.featureAt(event.pixel);
    this.select(id ?? '');
    if (id === undefined) this.listener.onBeside(event.pixel);
  }

  private point(event: MapBrowserEvent): void {
    if (event.dragging || this.tool !== 'select') return;
    const over = this.featureAt(event.pixel);
    const { dataset } = this.view.target;
    dataset['over'] = over === undefined ? '' : over === this.selected && this.enabled ? 'selected' : 'feature';
  }

  private featureAt(pixel: number[]): string | undefined {
    const { map } = this.view;
    const layerFilter = (layer: unknown): boolean => this.view.features.all.some((one) => one === layer);
    const found = map.forEachFeatureAtPixel(pixel, (one) => ('getId' in one ? one.getId() : undefined), { hitTolerance: 6, layerFilter });
    return found === undefined ? undefined : String(found);
  }

  private isNearHandle(event: MapBrowserEvent): boolean {
    return this.distanceToHandle(event.coordinate) <= NEAR;
  }

  /** Distance [px] to the nearest vertex, or edge midpoint, of the selected feature. */
  private distanceToHandle([x = 0, y = 0]: readonly number[]): number {
    const geometry = this.chosen.item(0)?.getGeometry();
    const resolution = this.view.map.getView().getResolution() ?? 1;
    if (!(geometry instanceof LineString || geometry instanceof Polygon)) return Infinity;
    const { vertices, middles } = handles(geometry);
    return Math.min(...[...vertices, ...middles].map(([u = 0, v = 0]) => Math.hypot(u - x, v - y) / resolution));
  }
}
