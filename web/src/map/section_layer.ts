// SPDX-License-Identifier: BSD-3-Clause
// Section on the map: its line from A to B, and the position being read.
import OlFeature from 'ol/Feature';
import { LineString, Point } from 'ol/geom';
import VectorLayer from 'ol/layer/Vector';
import VectorSource from 'ol/source/Vector';
import { Circle, Fill, Stroke, Style } from 'ol/style';
import type { Position } from '../protocol';
import { nameText } from './feature_style';

const [INK, WHITE] = ['#111827', 'rgb(255 255 255 / 0.9)'];

/** Style of a section's line. */
export const SECTION_STYLE = [
  new Style({ stroke: new Stroke({ color: WHITE, width: 5 }) }),
  new Style({
    stroke: new Stroke({ color: INK, width: 2, lineDash: [10, 4, 2, 4] }),
    image: new Circle({ radius: 4, fill: new Fill({ color: INK }), stroke: new Stroke({ color: WHITE, width: 2 }) }),
  }),
];
const READ = new Style({
  image: new Circle({ radius: 6, fill: new Fill({ color: '#d55e00' }), stroke: new Stroke({ color: '#fff', width: 2 }) }),
});

export class SectionLayer extends VectorLayer<VectorSource> {
  private readonly read = new OlFeature();

  constructor(zIndex: number) {
    super({ source: new VectorSource({ wrapX: false }), zIndex, style: SECTION_STYLE });
    this.read.setStyle(READ);
  }

  show(vertices: readonly Position[]): void {
    const source = this.getSource();
    source?.clear();
    if (vertices.length < 2) return;
    const ends = [vertices[0], vertices.at(-1)].map((place, k) => {
      const end = new OlFeature(new Point(place ?? [0, 0]));
      end.setStyle([...SECTION_STYLE, new Style({ text: nameText('AB'[k] ?? '', INK, -14, '700 13px system-ui, sans-serif') })]);
      return end;
    });
    source?.addFeatures([new OlFeature(new LineString(vertices.map((place) => [...place]))), ...ends, this.read]);
    this.mark(null);
  }

  /** Mark the position at which the charts are read. */
  mark(place: Position | null): void {
    this.read.setGeometry(place ? new Point(place) : undefined);
  }
}
