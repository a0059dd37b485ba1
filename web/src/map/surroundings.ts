// SPDX-License-Identifier: BSD-3-Clause
// Surroundings on the map: houses and other objects, and forest stands, each with its name.
import OlFeature from 'ol/Feature';
import VectorLayer from 'ol/layer/Vector';
import VectorSource from 'ol/source/Vector';
import { Circle, Fill, Stroke, Style } from 'ol/style';
import { LAYER_COLOURS } from '../colours';
import type { Shape } from '../protocol';
import { nameText } from './feature_style';
import { geometryOf } from './features';

const NAMED = 300; // with more shapes, names would hide the map

/** Read-only shapes with names. */
export class ShapeLayer extends VectorLayer<VectorSource> {
  constructor(kind: 'objects' | 'stands', zIndex: number) {
    super({ source: new VectorSource({ wrapX: false }), zIndex, declutter: true });
    const style = STYLES[kind];
    const names = new Map<string, Style>();
    this.setStyle((feature) => {
      const name = String(feature.get('name') ?? '');
      if (!name || (this.getSource()?.getFeatures().length ?? 0) > NAMED) return style;
      let label = names.get(name);
      if (!label) names.set(name, (label = new Style({ text: nameText(name, LAYER_COLOURS[kind], kind === 'objects' ? -11 : 0, '600 11.5px system-ui, sans-serif') })));
      return [style, label];
    });
  }

  show(shapes: readonly Shape[]): void {
    const source = this.getSource();
    source?.clear();
    source?.addFeatures(shapes.map(({ name, geometry }) => new OlFeature({ geometry: geometryOf(geometry), name })));
  }
}

const STYLES = {
  objects: new Style({
    stroke: new Stroke({ color: LAYER_COLOURS.objects, width: 2 }),
    fill: new Fill({ color: 'rgb(75 29 29 / 0.55)' }),
    image: new Circle({ radius: 5, fill: new Fill({ color: LAYER_COLOURS.objects }), stroke: new Stroke({ color: '#fff', width: 1.5 }), declutterMode: 'none' }),
  }),
  stands: new Style({
    stroke: new Stroke({ color: LAYER_COLOURS.stands, width: 1.5, lineDash: [2, 3] }),
    fill: new Fill({ color: 'rgb(0 122 89 / 0.12)' }),
  }),
} as const;
