// SPDX-License-Identifier: BSD-3-Clause
// Map of the terrain in its own CRS [m]: hillshade, zones, results, trajectories, features.
import OlMap from 'ol/Map';
import View from 'ol/View';
import { defaults as defaultInteractions } from 'ol/interaction/defaults';
import type Geometry from 'ol/geom/Geometry';
import { buffer, containsExtent, createEmpty, extend, getHeight, getWidth, isEmpty } from 'ol/extent';
import ImageLayer from 'ol/layer/Image';
import type ImageWMS from 'ol/source/ImageWMS';
import Projection from 'ol/proj/Projection';
import { LAYER_COLOURS, type ColourScale } from '../colours';
import { element } from '../dom';
import type { BackgroundMessage, BasemapMessage, Binary, Layers, OverlayHeader, WebMap } from '../protocol';
import { elevationAt, extentOf, type Extent, type Shade, type Terrain } from '../terrain';
import type { Trajectories } from '../trajectories';
import { ContourLayer } from './contour_layer';
import { FeatureLayers } from './features';
import { HazardLayer, OriginLayer } from './hazard_layer';
import { RasterLayer } from './plot_layer';
import { hillshade, paintResult, picture, zoneRaster } from './rasters';
import { SectionLayer } from './section_layer';
import { ShapeLayer } from './surroundings';
import { webMapSource } from './web_map';
import { DotLayer, TrajectoryLayer } from './trajectory_layer';

/** Layers that can be switched on and off. */
export type Shown = keyof MapView['switched'];

const CODE = 'rockfall:terrain'; // code of the terrain's CRS
const FIRST = 40; // minimum number of cells in the initial view
const PADDING = 28; // margin around the fitted extent [px]
const TAG = 44; // margin above the map for the label "preliminary"
const LEGEND = 156; // margin on a phone, for the legend

export class MapView {
  readonly map: OlMap;
  readonly features = new FeatureLayers();
  readonly trajectories = new TrajectoryLayer(20);
  private readonly shade = new RasterLayer(0, true);
  private readonly zones = new RasterLayer(5, false);
  private readonly overlay = new RasterLayer(10, false);
  private readonly trees = new DotLayer(12, LAYER_COLOURS.trees, 1.8);
  private readonly sources = new DotLayer(14, LAYER_COLOURS.sources, 1.4, true);
  private readonly stops = new DotLayer(22, LAYER_COLOURS.stops, 1.3);
  readonly section = new SectionLayer(45);
  readonly hazard = new HazardLayer(10);
  readonly origins = new OriginLayer(39);
  readonly objects = new ShapeLayer('objects', 24);
  private readonly basemap = new RasterLayer(2, true);
  readonly contours = new ContourLayer(21);
  private readonly stands = new ShapeLayer('stands', 13);
  readonly switched = {
    zones: this.zones,
    overlay: this.overlay,
    stands: this.stands,
    trees: this.trees,
    contours: this.contours,
    background_sources: this.sources,
    trajectories: this.trajectories,
    stops: this.stops,
    objects: this.objects,
    basemap: this.basemap,
    wms: new ImageLayer<ImageWMS>({ zIndex: 1 }),
    sources: this.features.layers.sources,
    lines: this.features.layers.lines,
    barriers: this.features.layers.barriers,
    dams: this.features.layers.dams,
    drawn_zones: this.features.layers.zones,
  };
  private readonly overlayCanvas = element('canvas');
  private overlayOpacity = 0.85;
  private preliminary = false;
  private terrain: Terrain | null = null;
  private moved = false; // set once the user moves the view
  private result: { header: OverlayHeader; values: Float32Array; shape: number[] } | null = null;

  constructor(readonly target: HTMLElement) {
    this.map = new OlMap({
      target,
      controls: [],
      interactions: defaultInteractions({ altShiftDragRotate: false, pinchRotate: false, doubleClickZoom: false }),
      layers: [this.shade, ...Object.values(this.switched), this.hazard, this.origins, this.features.selection, this.section],
    });
    this.map.on('change:size', () => this.fitAtFirst()); // after a panel folds or a phone turns
    this.map.on('moveend', ({ frameState }) => {
      if (frameState?.extent) this.features.nameWithin(frameState.extent);
    });
    for (const event of ['wheel', 'pointerdown', 'keydown'])
      target.addEventListener(event, () => (this.moved = true), { passive: true });
    this.zones.setOpacity(0.28);
    this.stops.setVisible(false);
    this.overlay.setOpacity(this.overlayOpacity);
  }

  /** Show a terrain; `shared` is the view of another map that moves with this map. */
  setTerrain(terrain: Terrain, shade: Shade | null, shared?: View): void {
    this.terrain = terrain;
    this.contours.display(terrain);
    const extent = this.terrainExtent();
    if (shade)
      this.shade.display(hillshade(shade.values, shade.nx, shade.ny), extentOf(terrain.west, extent[3], shade.cell, [shade.ny, shade.nx]));
    const [west, south, east, north] = extent;
    const around = Math.max(east - west, north - south) / 2;
    const projection = new Projection({ code: CODE, units: 'm', extent });
    this.map.setView(
      shared ??
        new View({
          projection,
          center: [(west + east) / 2, (south + north) / 2],
          resolution: around / 300,
          minResolution: 0.01,
          maxResolution: around / 60,
          enableRotation: false,
          constrainOnlyCenter: true,
          extent: [west - around, south - around, east + around, north + around],
        }),
    );
  }

  /** Show the parts of a case that are not drawn features: zones (on hillshade cells), sources, trees. */
  setBackground(message: Binary<BackgroundMessage> | null, cell: number): void {
    const [, , , north] = this.terrainExtent();
    const { west } = this.terrainOrThrow();
    const zones = message?.u1('zones');
    if (message && zones) {
      const [ny = 0, nx = 0] = zones.shape;
      const image = zoneRaster(zones.values, nx, ny, message.header.zones);
      this.zones.display(image, extentOf(west, north, cell, zones.shape));
    } else this.zones.display(null);
    this.sources.display(message?.f8('sources')?.values ?? new Float64Array(), 2);
    this.stands.show(message?.header.stands ?? []);
    this.trees.display(message?.f8('trees')?.values ?? new Float64Array(), 3);
  }

  /** Add the user's web map service. */
  addWebMap(given: WebMap): void {
    this.switched.wms.setSource(webMapSource(given, CODE));
  }

  /** Show a picture instead of the hillshade; without a picture, show the hillshade again. */
  showBasemap(message: Binary<BasemapMessage>): void {
    const rgba = message.u1('rgba');
    if (!rgba) return this.basemap.display(null);
    const [west, east, south, north] = message.header.extent;
    this.basemap.display(picture(rgba.values, rgba.shape[1] ?? 0, rgba.shape[0] ?? 0), [west, south, east, north]);
  }

  showDocument(layers: Layers): void {
    this.features.show(layers);
    if (this.terrain) this.features.nameWithin(this.map.getView().calculateExtent());
  }

  setResult(header: OverlayHeader | null, values: Float32Array | null, shape: number[]): void {
    this.result = header && values ? { header, values, shape } : null;
    this.paintResult(header);
  }

  /** Redraw the result with a new scale. */
  paintResult(scale: ColourScale | null): void {
    if (!this.result || !scale) {
      this.overlay.display(null);
      return;
    }
    const { header: { west, north, cell }, values, shape } = this.result;
    paintResult(values, shape[1] ?? 0, shape[0] ?? 0, scale, this.overlayCanvas);
    this.overlay.display(this.overlayCanvas, extentOf(west, north, cell, shape));
  }

  /** Image and extent of the result. */
  get drape(): { image: HTMLCanvasElement; extent: Extent } | null {
    const extent = this.overlay.area;
    return extent && this.overlay.getVisible() ? { image: this.overlayCanvas, extent } : null;
  }

  setTrajectories(trajectories: Trajectories | null): void {
    const { west, south } = this.terrainOrThrow();
    this.trajectories.display(trajectories, west, south);
  }

  setStops(stops: Float32Array | null): void {
    const { west, south } = this.terrainOrThrow();
    this.stops.display(stops ?? new Float32Array(), 2, west, south);
  }

  setOverlayOpacity(opacity: number): void {
    this.overlayOpacity = opacity;
    this.dim(this.preliminary);
  }

  /** Dim the pictures while they show an older state. */
  dim(preliminary: boolean): void {
    this.preliminary = preliminary;
    const factor = preliminary ? 0.45 : 1;
    this.overlay.setOpacity(this.overlayOpacity * factor);
    this.trajectories.setOpacity(factor);
    this.stops.setOpacity(factor);
  }

  setVisible(name: Shown, visible: boolean): void {
    this.switched[name].setVisible(visible);
  }

  /** Fit sources, lines, nets, dams and results, or the terrain if there are none, until the user moves the view. */
  fitAtFirst(): void {
    if (this.terrain && !this.moved) this.fit(this.contentExtent() ?? this.terrainExtent());
  }
  /** Name of the object, such as a house, at a pixel; '' if none. */
  objectAt(pixel: number[]): string {
    const found = this.map.getFeaturesAtPixel(pixel, { hitTolerance: 4, layerFilter: (layer) => layer === this.objects });
    return String(found[0]?.get('name') ?? '');
  }

  /** Place at a pixel, as X,Y [m] for `Wanted.origin`. */
  placeAt(pixel: number[]): string {
    return this.map.getCoordinateFromPixel(pixel).map((value) => value.toFixed(1)).join(',');
  }

  fitTerrain(): void {
    this.moved = true;
    this.fit(this.terrainExtent());
  }
  /** Fit the map to the results or, without results, to the terrain. */
  fitResults(): void {
    this.moved = true;
    this.fit(this.resultExtent() ?? this.terrainExtent());
  }
  fitFeature(id: string): void {
    const geometry: Geometry | undefined = this.features.find(id)?.feature.getGeometry();
    this.moved = true;
    if (geometry)
      this.map.getView().fit(geometry.getExtent(), { padding: [90, 90, 90, 90], minResolution: (this.terrain?.cell ?? 1) / 6, duration: 250 });
  }
  /** Fit the view to a section that is partly hidden, once the panels have their final size. */
  async fitSection(): Promise<void> {
    await new Promise(requestAnimationFrame);
    this.map.updateSize();
    const extent = this.section.getSource()?.getExtent() ?? createEmpty();
    if (isEmpty(extent) || containsExtent(this.map.getView().calculateExtent(), extent)) return;
    this.moved = true;
    this.fit(extent as Extent);
  }
  zoom(steps: number): void {
    this.moved = true;
    const view = this.map.getView();
    view.animate({ resolution: view.getConstrainedResolution((view.getResolution() ?? 1) / 1.6 ** steps) ?? 1, duration: 150 });
  }

  /** Elevation at a point, interpolated between cell centres; null if unknown. */
  elevation(x: number, y: number): number | null {
    if (!this.terrain) return null;
    const value = elevationAt(this.terrain, x - this.terrain.west, y - this.terrain.south);
    return Number.isNaN(value) ? null : value;
  }

  private contentExtent(): Extent | null {
    const { zones, ...drawn } = this.features.layers;
    const whole = createEmpty();
    for (const layer of [...Object.values(drawn), this.features.selection]) {
      const extent = layer.getSource()?.getExtent();
      if (extent) extend(whole, extent);
    }
    extend(whole, this.objects.getSource()?.getExtent() ?? createEmpty());
    extend(whole, this.sources.extent);
    extend(whole, this.resultExtent() ?? createEmpty());
    const room = Math.max(FIRST * this.terrainOrThrow().cell - Math.max(getWidth(whole), getHeight(whole)), 0) / 2;
    return isEmpty(whole) ? null : (buffer(whole, room) as Extent);
  }

  private resultExtent(): Extent | null {
    const shown = this.result;
    if (!shown) return null;
    const { header: { west, north, cell }, values, shape: [ny = 0, nx = 0] } = shown;
    let [left, right, top, bottom] = [nx, -1, ny, -1];
    for (let k = 0; k < values.length; k++) {
      if (Number.isNaN(values[k])) continue;
      const [i, j] = [k % nx, Math.floor(k / nx)];
      left = Math.min(left, i);
      right = Math.max(right, i);
      top = Math.min(top, j);
      bottom = Math.max(bottom, j);
    }
    return right < 0
      ? null
      : [west + left * cell, north - (bottom + 1) * cell, west + (right + 1) * cell, north - top * cell];
  }

  private fit(extent: Extent): void {
    const size = this.map.getSize() ?? [300, 300];
    const top = (size[0] ?? 0) < 500 ? LEGEND : TAG;
    this.map.getView().fit(extent, { size, padding: [top, PADDING, PADDING, PADDING] });
  }

  private terrainExtent(): Extent {
    const { west, south, cell, nx, ny } = this.terrainOrThrow();
    return [west, south, west + nx * cell, south + ny * cell];
  }

  private terrainOrThrow(): Terrain {
    if (!this.terrain) throw new Error('the terrain has not come yet');
    return this.terrain;
  }
}
