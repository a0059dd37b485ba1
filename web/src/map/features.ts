// SPDX-License-Identifier: BSD-3-Clause
// Document features as map layers.
import OlFeature from 'ol/Feature';
import GeoJSON from 'ol/format/GeoJSON';
import type { Geometry } from 'ol/geom';
import VectorLayer from 'ol/layer/Vector';
import VectorSource from 'ol/source/Vector';
import type { Style } from 'ol/style';
import { LAYERS, type Feature, type Layer, type Layers } from '../protocol';
import { featureStyles, selectedStyles } from './feature_style';

const format = new GeoJSON();
const DATA = 'rockfall'; // property with the document feature

const LABELLED = 300; // with more visible features in a layer, names would hide the map

export class FeatureLayers {
  readonly layers: Readonly<Record<Layer, VectorLayer<VectorSource>>>;
  /** Layer for the selected feature alone: dragging it does not redraw the other features. */
  readonly selection: VectorLayer<VectorSource>;
  selected = '';
  private selectedLayer: Layer = 'sources';
  private mayEdit = false;
  private shown: Layers | null = null;
  private readonly named = new Set<Layer>(LAYERS);

  constructor() {
    const order: readonly Layer[] = ['zones', 'dams', 'lines', 'barriers', 'sources'];
    this.layers = Object.fromEntries(
      order.map((name, k) => [
        name,
        makeLayer(30 + 2 * k, (feature, data, resolution) =>
          featureStyles(feature, name, data.properties, this.named.has(name), resolution),
        ),
      ]),
    ) as Record<Layer, VectorLayer<VectorSource>>;
    this.selection = makeLayer(40, (feature, data, resolution) =>
      selectedStyles(feature, this.selectedLayer, data.properties, this.mayEdit, resolution),
    );
  }

  get all(): VectorLayer<VectorSource>[] {
    return [...Object.values(this.layers), this.selection];
  }

  set editable(on: boolean) {
    this.mayEdit = on;
    this.selection.changed();
  }

  source(layer: Layer): VectorSource {
    return this.layers[layer].getSource() as VectorSource;
  }

  /** Show the features of a document. A feature being dragged keeps its geometry. */
  show(document: Layers): void {
    for (const layer of LAYERS) this.showLayer(layer, this.shown?.[layer] ?? [], document[layer]);
    this.shown = document;
  }

  find(id: string): { layer: Layer; feature: OlFeature } | null {
    const selected = id === this.selected ? this.selectedFeature : null;
    if (selected) return { layer: this.selectedLayer, feature: selected };
    for (const layer of LAYERS) {
      const feature = this.source(layer).getFeatureById(id);
      if (feature instanceof OlFeature) return { layer, feature };
    }
    return null;
  }

  select(id: string): void {
    const found = this.find(id);
    const before = this.selectedFeature;
    if (found?.feature === before && before) return;
    const { selectionSource } = this;
    selectionSource.clear();
    if (before) this.source(this.selectedLayer).addFeature(before);
    this.selected = found ? id : '';
    if (!found) return;
    this.selectedLayer = found.layer;
    this.source(found.layer).removeFeature(found.feature);
    selectionSource.addFeature(found.feature);
  }

  /** Show names only if they fit in the visible extent. */
  nameWithin(extent: number[]): void {
    for (const layer of LAYERS) {
      const fits = (this.shown?.[layer].length ?? 0) <= LABELLED || this.source(layer).getFeaturesInExtent(extent).length <= LABELLED;
      if (fits === this.named.has(layer)) continue;
      if (fits) this.named.add(layer);
      else this.named.delete(layer);
      this.layers[layer].changed();
    }
  }

  private get selectionSource(): VectorSource {
    return this.selection.getSource() as VectorSource;
  }
  private get selectedFeature(): OlFeature | null {
    return this.selectionSource.getFeatures()[0] ?? null;
  }

  private showLayer(layer: Layer, before: readonly Feature[], features: readonly Feature[]): void {
    if (before === features) return;
    const source = this.source(layer);
    const ids = new Set(features.map(({ id }) => id));
    for (const { id } of before) {
      const gone = ids.has(id) ? null : this.find(id);
      if (gone && id === this.selected) this.selectionSource.clear();
      else if (gone) source.removeFeature(gone.feature);
    }
    const known = new Set(before);
    const added: OlFeature[] = [];
    for (const feature of features) {
      if (known.has(feature)) continue;
      const shown = this.find(feature.id)?.feature;
      if (!shown) added.push(made(feature));
      else if (dataOf(shown) !== feature) {
        shown.set(DATA, feature, true);
        shown.setGeometry(geometryOf(feature));
      }
    }
    source.addFeatures(added);
  }
}

function makeLayer(
  zIndex: number,
  style: (feature: OlFeature, data: Feature, resolution: number) => Style[],
): VectorLayer<VectorSource> {
  return new VectorLayer({
    source: new VectorSource({ wrapX: false }),
    zIndex,
    declutter: true, // hides names that would overlap
    style: (feature, resolution) => {
      const data = feature instanceof OlFeature && dataOf(feature);
      return data ? style(feature, data, resolution) : [];
    },
  });
}

function made(feature: Feature): OlFeature {
  const shown = new OlFeature(geometryOf(feature));
  shown.setId(feature.id);
  shown.set(DATA, feature, true);
  return shown;
}

export function dataOf(feature: OlFeature): Feature | null {
  return (feature.get(DATA) as Feature | undefined) ?? null;
}

/** Set the document feature of an up-to-date map feature, so that `show` keeps its geometry. */
export function setData(feature: OlFeature, data: Feature): void {
  feature.set(DATA, data, true);
}

export function geometryOf(shape: { type: string; coordinates: unknown }): Geometry {
  return format.readGeometry(shape) as Geometry;
}

/** Document feature with the geometry of a map feature, rounded to millimetres. */
export function featureOf(id: string, properties: Feature['properties'], geometry: Geometry): Feature {
  return { id, ...format.writeGeometryObject(geometry, { decimals: 3 }), properties } as Feature;
}
