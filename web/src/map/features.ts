// SPDX-License-Identifier: BSD-3-Clause
// Features of the document as layers of the map.
import OlFeature from 'ol/Feature';
import { LineString, Point, Polygon, type Geometry } from 'ol/geom';
import VectorLayer from 'ol/layer/Vector';
import VectorSource from 'ol/source/Vector';
import { LAYERS, type Feature, type Layer, type Layers, type Position } from '../protocol';
import { featureStyles } from './feature_style';

const DATA = 'rockfall'; // property of a map's feature that holds the document's

export class FeatureLayers {
  readonly layers: Readonly<Record<Layer, VectorLayer<VectorSource>>>;
  selected = '';
  editable = false;

  constructor() {
    const make = (name: Layer, k: number): VectorLayer<VectorSource> =>
      new VectorLayer({
        source: new VectorSource({ wrapX: false }),
        zIndex: 30 + 2 * k,
        updateWhileInteracting: true,
        updateWhileAnimating: true,
        style: (feature, resolution) => {
          const data = feature instanceof OlFeature && dataOf(feature);
          return data
            ? featureStyles(feature, name, data.properties, data.id === this.selected, this.editable, resolution)
            : [];
        },
      });
    const order: readonly Layer[] = ['zones', 'dams', 'lines', 'barriers', 'sources'];
    this.layers = Object.fromEntries(order.map((name, k) => [name, make(name, k)])) as Record<
      Layer,
      VectorLayer<VectorSource>
    >;
  }

  source(layer: Layer): VectorSource {
    return this.layers[layer].getSource() as VectorSource;
  }

  /** Show the features of a document. One that is under the hand keeps its geometry. */
  show(document: Layers): void {
    for (const layer of LAYERS) this.showLayer(layer, document[layer]);
  }

  find(id: string): { layer: Layer; feature: OlFeature } | null {
    for (const layer of LAYERS) {
      const feature = this.source(layer).getFeatureById(id);
      if (feature instanceof OlFeature) return { layer, feature };
    }
    return null;
  }

  select(id: string): void {
    this.selected = id;
    for (const layer of LAYERS) this.layers[layer].changed();
  }

  private showLayer(layer: Layer, features: readonly Feature[]): void {
    const source = this.source(layer);
    const ids = new Set(features.map(({ id }) => id));
    for (const shown of source.getFeatures()) if (!ids.has(String(shown.getId()))) source.removeFeature(shown);
    for (const feature of features) {
      const shown = source.getFeatureById(feature.id);
      if (!(shown instanceof OlFeature)) source.addFeature(made(feature));
      else if (dataOf(shown) !== feature) {
        shown.set(DATA, feature, true);
        shown.setGeometry(geometryOf(feature));
      }
    }
  }
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

/** Note that a map's feature shows this one already, so that `show` leaves its geometry alone. */
export function setData(feature: OlFeature, data: Feature): void {
  feature.set(DATA, data, true);
}

function geometryOf(feature: Feature): Geometry {
  switch (feature.type) {
    case 'Point':
      return new Point(feature.coordinates);
    case 'LineString':
      return new LineString(feature.coordinates);
    case 'Polygon':
      return new Polygon(feature.coordinates);
  }
}

/** A feature of the document with a geometry of the map, to the millimetre. */
export function featureOf(id: string, properties: Feature['properties'], geometry: Geometry): Feature {
  const position = ([x = 0, y = 0]: readonly number[]): Position => [
    Math.round(x * 1000) / 1000,
    Math.round(y * 1000) / 1000,
  ];
  if (geometry instanceof Point)
    return { id, type: 'Point', coordinates: position(geometry.getCoordinates()), properties };
  if (geometry instanceof LineString)
    return { id, type: 'LineString', coordinates: geometry.getCoordinates().map(position), properties };
  if (geometry instanceof Polygon)
    return {
      id,
      type: 'Polygon',
      coordinates: geometry.getCoordinates().map((ring) => ring.map(position)),
      properties,
    };
  throw new TypeError(`no feature is a ${geometry.getType()}`);
}
