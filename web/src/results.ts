// SPDX-License-Identifier: BSD-3-Clause
// Distribution of terrain, background, results and trajectories from the server to the views.
import type { Legend } from './legend';
import { MapBar } from './map/furniture';
import type { MapView } from './map/map_view';
import type { DisplayPanel } from './panels/display';
import type { StatisticsPanel } from './panels/statistics';
import { hasStatistics, isOf, type BackgroundMessage, type BatchMessage, type Binary, type LinesMessage, type SectionMessage } from './protocol';
import type { ScenePane } from './scene_pane';
import type { Sender } from './sender';
import type { Shell } from './shell';
import { decimal, sayOr } from './texts';
import type { Shade, Terrain } from './terrain';
import { extended, type Trajectories } from './trajectories';

export interface Parts {
  readonly shell: Shell;
  readonly view: MapView;
  readonly legend: Legend;
  readonly display: DisplayPanel;
  readonly statistics: StatisticsPanel;
  readonly scene: ScenePane;
  readonly sender: Sender;
}

export interface ResultListener {
  onBatch(): void;
  /** Statistics of further lines have arrived; `all` if none are missing. */
  onLines(all: boolean): void;
  onSection(message: Binary<SectionMessage>): void;
}

export class Results {
  terrain: Terrain | null = null;
  shade: Shade | null = null;
  cell = 1; // cell size of the simulated terrain [m]
  background: Binary<BackgroundMessage> | null = null;
  batch: Binary<BatchMessage> | null = null;
  trajectories: Trajectories | null = null;
  private bySpeed = false;

  constructor(
    private readonly parts: Parts,
    private readonly listener: ResultListener,
  ) {}

  get header(): BatchMessage | null {
    return this.batch?.header ?? null;
  }

  receive(message: Binary): void {
    if (isOf(message, 'terrain')) this.setTerrain(message);
    else if (isOf(message, 'background')) this.setBackground(message);
    else {
      if ('revision' in message.header && message.header.revision < this.parts.sender.revision) return; // older state
      if (isOf(message, 'lines')) this.addLines(message.header);
      else if (isOf(message, 'batch')) this.setBatch(message);
      else if (isOf(message, 'section')) this.listener.onSection(message);
      else if (isOf(message, 'trajectories')) this.setTrajectories(extended(this.trajectories, message));
    }
  }

  colourBySpeed(on: boolean): void {
    const { view, legend } = this.parts;
    this.bySpeed = on;
    view.trajectories.colourBySpeed(on);
    legend.setSpeeds(on ? view.trajectories.maxSpeed : null);
  }

  private setTerrain(message: Binary<Extract<Binary['header'], { type: 'terrain' }>>): void {
    const { west, north, cell, nx, ny, crs, shade_cell, full_cell } = message.header;
    this.cell = full_cell;
    const heights = message.f4('heights');
    const shade = message.u1('shade');
    if (!heights) return;
    const first = this.terrain === null;
    this.terrain = { west, south: north - ny * cell, cell, nx, ny, heights: heights.values };
    this.shade = shade && { cell: shade_cell, nx: shade.shape[1] ?? 0, ny: shade.shape[0] ?? 0, values: shade.values };
    this.parts.view.setTerrain(this.terrain, this.shade);
    if (first) this.parts.shell.mapPane.append(new MapBar(this.parts.view, crs).root);
    this.parts.view.map.updateSize();
    this.parts.view.fitAtFirst();
    this.parts.scene.update('terrain');
    if (first) this.markDrawn('terrain');
  }

  private setBackground(message: Binary<BackgroundMessage>): void {
    const { view, legend, display } = this.parts;
    const { zones, sources, trees, stands } = message.header;
    const cells = message.u1('zones');
    this.background = message;
    view.setBackground(message, this.shade?.cell ?? 1);
    legend.setZones(cells ? zones : null);
    display.offer('zones', cells !== null);
    display.offer('background_sources', sources > 0);
    display.offer('trees', trees > 0);
    display.offer('stands', stands.length > 0);
    view.fitAtFirst();
  }

  private setBatch(message: Binary<BatchMessage>): void {
    const { header } = message;
    const first = this.batch === null;
    if (this.batch?.header.revision !== header.revision) {
      this.setTrajectories(null);
      this.markDrawn('first results', header.revision);
    }
    if (header.complete) this.markDrawn('all results', header.revision);
    this.batch = message;
    this.parts.sender.answer();
    const overlay = message.f4('overlay');
    this.parts.view.setResult(header.overlay, overlay?.values ?? null, overlay?.shape ?? []);
    this.parts.view.setStops(message.f4('stops')?.values ?? null);
    if (first || header.complete) this.parts.view.fitAtFirst();
    this.parts.legend.setResult(header.overlay);
    this.parts.statistics.update(header.lines);
    this.parts.shell.noteDock(endedText(header));
    this.parts.scene.update('drape');
    this.listener.onBatch();
  }

  /** Add statistics of further lines to the results shown. */
  private addLines({ revision, boulders, lines }: LinesMessage): void {
    const shown = this.batch?.header;
    if (!shown || shown.revision !== revision || shown.boulders !== boulders) return;
    const added = new Map(lines.map((line) => [line.name, line]));
    shown.lines = shown.lines.map((line) => added.get(line.name) ?? line);
    this.parts.statistics.update(shown.lines);
    this.listener.onLines(shown.lines.every(hasStatistics));
  }

  /** Mark in the browser's timeline when the latest data are visible on the map, for benchmarks. */
  private markDrawn(what: string, revision = 0): void {
    performance.clearMarks(what);
    this.parts.view.map.once('postrender', () =>
      requestAnimationFrame(() => performance.mark(what, { detail: revision })),
    );
  }

  private setTrajectories(trajectories: Trajectories | null): void {
    this.trajectories = trajectories;
    if (!this.terrain) return;
    this.parts.view.setTrajectories(trajectories);
    this.parts.legend.setSpeeds(this.bySpeed ? this.parts.view.trajectories.maxSpeed : null);
    this.parts.scene.update('trajectories');
  }
}

/** Text on the outcomes of boulders, most frequent first. */
function endedText({ ended, boulders }: BatchMessage): string {
  const percent = (n: number): string =>
    n < 0.0005 * boulders ? `< ${decimal(0.1, 1)}` : decimal((100 * n) / boulders, 1);
  return Object.entries(ended)
    .filter(([, n]) => n > 0)
    .sort(([, a], [, b]) => b - a)
    .map(([status, n]) => `${sayOr(`app.status.${status}`, status)} ${percent(n)} %`)
    .join(' · ');
}
