// SPDX-License-Identifier: BSD-3-Clause
// Window of a case or a result: its parts, and the events between them.
import type { Connection } from './connection';
import { DocumentStore, type Difference } from './document';
import { Drawer, TOOLS, type Tool } from './draw';
import { GroundDialog } from './ground_choice';
import { Hazard } from './hazard';
import { Legend } from './legend';
import { mapButtons } from './map/furniture';
import { MapView, type Shown } from './map/map_view';
import { captionOf, download, drawPicture } from './map/picture';
import { propertiesOf } from './new_features';
import { Notices } from './notices';
import { isLong, Output } from './output';
import { DisplayPanel } from './panels/display';
import { FeaturePanel } from './panels/features';
import { MessagePanel } from './panels/messages';
import { SettingsPanel } from './panels/settings';
import { StatisticsPanel } from './panels/statistics';
import { Tabs, type Tab } from './panels/tabs';
import {
  isOf,
  variantOf,
  type Position,
  type Binary,
  type CaseDocument,
  type CaseError,
  type State,
  type Text,
  type Wanted,
  type Welcome,
} from './protocol';
import { Results } from './results';
import { RunBar } from './run_bar';
import { SectionPanel } from './section/section_panel';
import { Sender } from './sender';
import { listenToKeys } from './shortcuts';
import { ScenePane } from './scene_pane';
import { Shell, type Mode } from './shell';
import { say } from './texts';
import { Toolbar } from './toolbar';
import { TopBar } from './top_bar';
import type { Snapshot } from './snapshots';
import { VariantList } from './variant_list';

const OPACITY = 0.85; // initial opacity of results

export class CaseWindow {
  readonly store = new DocumentStore();
  private readonly sender: Sender;
  private readonly shell: Shell;
  private readonly view: MapView;
  private readonly drawer: Drawer;
  private readonly tools: readonly Tool[];
  private readonly toolbar: Toolbar;
  private readonly runBar: RunBar;
  private readonly legend: Legend;
  private readonly statistics = new StatisticsPanel(
    (name) => this.selectLine(name),
    (lines) => this.chooser && this.want({ lines }),
  );
  private readonly section = new SectionPanel(
    () => this.want({ section: [] }),
    (place) => this.view.section.mark(place),
  );
  private readonly messages = new MessagePanel((error) => this.showError(error));
  private readonly hazard: Hazard;
  private readonly features: FeaturePanel;
  private readonly settings: SettingsPanel;
  private readonly display: DisplayPanel;
  private readonly tabs: Tabs;
  private readonly output: Output;
  private readonly grounds: GroundDialog;
  private readonly variants: VariantList;
  private readonly notices: Notices;
  private readonly topBar: TopBar;
  private readonly scene: ScenePane;
  readonly results: Results;
  private readonly ended = new AbortController();

  private chooser: boolean; // the user may choose the map and, in a case, edit
  private state: State = { type: 'state', revision: 0, errors: [], warnings: [] };
  mode: Mode = 'map';
  wanted: Wanted;

  constructor(
    parent: HTMLElement,
    private readonly welcome: Welcome,
    readonly connection: Connection,
    kept: Snapshot[] | null,
  ) {
    const { forms, mode } = welcome;
    this.chooser = welcome.writer && !connection.standalone;
    this.wanted = welcome.view;
    this.sender = new Sender(this.store, connection, () => this.refresh());
    this.shell = new Shell(parent);
    this.view = new MapView(this.shell.mapTarget);
    this.tools = connection.standalone ? [] : (Object.keys(TOOLS) as Tool[]).filter((tool) => this.canDraw(tool));
    this.drawer = new Drawer(this.view, this.store, {
      onTool: (tool) => this.onTool(tool),
      onSelect: (id) => this.onSelect(id),
      propertiesOf: (layer) => propertiesOf(layer, forms, this.store, this.results.cell),
      onSection: (section) => this.want({ section }),
      onBeside: (pixel) => this.hazard.choose(this.view.objectAt(pixel) || this.view.placeAt(pixel)),
      onReplaced: (count) => this.shell.say(say('app.replaced', { n: count })),
    });
    this.toolbar = new Toolbar(this.tools, (tool) => {
      this.show('map');
      this.drawer.use(tool);
      this.shell.mapTarget.focus({ preventScroll: true });
    });
    this.runBar = new RunBar((type) => connection.send({ type }), () => this.tenfold(), mode === 'case' && !connection.standalone);
    this.legend = new Legend(welcome.maps, welcome.view.map, (map) => this.want({ map }));
    this.hazard = new Hazard(welcome.scenarios, this.view, {
      want: (change) => this.want(change),
      wanted: () => this.wanted,
      onClasses: (classes) => {
        this.setVisible('overlay', classes === null && this.display.isShown('overlay'));
        this.legend.setClasses(classes);
      },
    });
    this.features = new FeaturePanel(this.store, forms, {
      select: (id) => this.drawer.select(id),
      zoom: (id) => this.view.fitFeature(id),
      remove: (id) => this.store.remove(id),
    }, this.hazard.check);
    this.variants = new VariantList(this, welcome, kept ?? undefined);
    this.settings = new SettingsPanel(this.store, forms);
    const onDisplay = {
      visible: (name: Shown, on: boolean) => this.setVisible(name, on),
      opacity: (value: number) => this.view.setOverlayOpacity(value),
      bySpeed: (on: boolean) => this.results.colourBySpeed(on),
      want: (change: Partial<Wanted>) => this.want(change),
    };
    this.display = new DisplayPanel(onDisplay, welcome.view, welcome.offers, OPACITY);
    const tab = (name: string, content: HTMLElement): Tab => ({ name, title: say(`app.tab.${name}`), content });
    const hazard = welcome.scenarios && !connection.standalone ? [tab('hazard', this.hazard.panel.root)] : [];
    const [features, display] = [tab('features', this.features.root), tab('display', this.display.root)];
    this.tabs = new Tabs(
      say('app.panel'),
      mode === 'case'
        ? [features, tab('settings', this.settings.root), display, ...hazard, tab('variants', this.variants.panel.root)]
        : [display, features],
    );
    this.display.offer('drawn_zones', forms.layers.zones !== undefined);
    this.display.setObjects(welcome.view.objects);
    this.display.setBasemap(welcome.view.basemap);
    this.display.offer('wms', welcome.wms !== null);
    if (welcome.wms) this.view.addWebMap(welcome.wms);
    this.output = new Output(connection, welcome.file.replace(/\.[^.]*$/, '') || 'case', welcome.folder);
    this.notices = new Notices(this.shell, connection, this.output);
    this.grounds = new GroundDialog(welcome.grounds, ({ name, radius }) => this.store.setGround(name, radius));
    this.topBar = new TopBar(this.shell.top, welcome, this.runBar.root, !connection.standalone, {
      show: (mode) => this.show(mode),
      undo: () => this.store.undo(),
      redo: () => this.store.redo(),
      write: (task) => this.output.open(task),
      picture: () => download(this.drawPicture(), `${welcome.file.replace(/\.[^.]*$/, '') || 'map'}.png`),
      speak: (language) => connection.speak(language),
    });
    this.scene = new ScenePane(this.shell.scenePane, () => ({
      terrain: this.results.terrain,
      shade: this.results.shade,
      trajectories: this.results.trajectories,
      drape: this.view.drape,
      layers: this.store.document.layers,
    }));
    const { shell, view, legend, statistics, scene, sender } = this;
    this.results = new Results(
      { shell, view, legend, display: this.display, statistics, scene, sender },
      {
        onBatch: () => {
          this.refresh();
          this.variants.updateCompare();
        },
        onLines: (all) => all && this.variants.updateCompare(),
        onSection: (message) => {
          const before = JSON.stringify(this.section.message?.vertices);
          this.view.section.show(message.header.vertices);
          this.section.show(message);
          this.refresh();
          if (JSON.stringify(message.header.vertices) !== before) void this.view.fitSection();
        },
      },
    );
    this.assemble();
    this.store.onChange((changed) => this.onDocument(changed));
    this.listen();
    this.load(welcome);
  }

  /** State for tests and benchmarks, as `window.rockfall`. */
  get handles(): object {
    const { sender, preliminary, results, store, view, scene } = this;
    return {
      revision: sender.revision,
      preliminary,
      batch: results.header,
      document: store.document,
      trajectories: results.trajectories?.boulder.length ?? 0,
      frames: scene.frames,
      get contours() {
        return view.contours.shown;
      },
      elevation: ([x, y]: Position) => view.elevation(x, y),
      pixelOf: (place: Position) => this.pixelOf(place),
    };
  }
  /** Stored variants, for another window of the same file that replaces this window; null for a different file. */
  variantsFor({ file, folder, mode }: Welcome): Snapshot[] | null {
    const same = file === this.welcome.file && folder === this.welcome.folder && mode === this.welcome.mode;
    return same ? this.variants.kept : null;
  }
  private pixelOf(place: Position): Position | null {
    const [x, y] = this.view.map.getPixelFromCoordinate(place) ?? [];
    if (x === undefined || y === undefined) return null;
    const { left, top } = this.shell.mapTarget.getBoundingClientRect();
    return [left + x, top + y];
  }

  dispose(): void {
    this.ended.abort();
    this.scene.dispose();
    this.view.map.setTarget(undefined);
  }

  // Messages of the server

  receive(message: Text): void {
    if (this.hazard.receive(message)) return;
    switch (message.type) {
      case 'state':
        if (message.refused) this.sender.refused(message.revision);
        if (message.revision < this.sender.revision) return;
        this.state = message;
        this.hazard.forget();
        if (message.errors.length) this.sender.answer();
        this.refresh();
        return;
      case 'role':
        this.chooser = message.writer;
        this.showRole();
        this.refresh();
        return;
      case 'document':
        this.load(message);
        return;
      case 'progress':
        if (this.chooser) this.output.progress(message);
        return;
      case 'saved':
        this.output.written(message.files, message.remark);
        return;
      case 'done':
        this.output.done(message.files);
        return;
      case 'objects':
        this.view.objects.show(message.objects);
        this.display.setObjects(message.chosen);
        this.wanted = { ...this.wanted, objects: message.chosen };
        this.view.fitAtFirst();
        return;
      case 'unfinished':
        this.notices.offer(message.runs, this.writer);
        return;
      case 'refused':
        if (message.task === 'save' || message.task === 'resume' || isLong(message.task)) this.output.refused(message.text, message.exists);
        else this.shell.notice('refused', 'red', message.text);
        return;
      case 'fault':
        this.shell.notice('fault', 'red', message.text);
        return;
      case 'welcome': // opens a new window
        return;
    }
  }

  receiveBinary(message: Binary): void {
    if (this.hazard.receiveBinary(message)) return;
    if (isOf(message, 'basemap')) {
      this.view.showBasemap(message);
      this.display.setBasemap(message.header.chosen);
      this.wanted = { ...this.wanted, basemap: message.header.chosen };
      return;
    }
    if (!variantOf(message)) return this.results.receive(message);
    this.variants.receive(message);
  }

  // Display

  /** True if results are missing, or belong to an older document or another map. */
  get preliminary(): boolean {
    const batch = this.results.header;
    const otherMap = this.chooser && batch?.overlay ? batch.overlay.name !== this.wanted.map : false;
    return !batch || batch.revision !== this.sender.revision || this.sender.pending || otherMap;
  }
  get writer(): boolean {
    return this.chooser && this.welcome.mode === 'case';
  }
  private refresh(): void {
    const { preliminary, state: { errors }, results: { header } } = this;
    const failed = errors.length > 0 && !this.sender.pending && this.state.revision >= this.sender.revision;
    const empty = failed && this.results.batch === null && this.store.layer('sources').length === 0;
    const reason = failed ? say(empty ? 'app.run.no_sources' : 'app.run.failed') : '';
    this.runBar.update(header, preliminary, reason, this.writer, this.state.running === false);
    this.shell.mark(!this.results.batch ? '' : failed ? say('app.not_current') : preliminary ? say('app.preliminary') : '');
    this.shell.hint(this.drawer.tool !== 'select' ? say(`app.hint.${this.drawer.tool}`) : empty ? say('app.hint.begin') : '');
    this.view.dim(preliminary || failed);
    this.shell.fitDock(header?.lines.length || this.store.layer('lines').length, this.section.message !== null);
    // Without sources the hint shows the next step; with errors the warnings are out of date.
    this.messages.update(empty ? [] : errors, failed ? [] : (header?.warnings ?? []), this.state.warnings);
    this.features.update(errors, this.writer);
    this.settings.update(errors, this.writer);
    this.tabs.mark('features', errors.some(({ id }) => id !== undefined));
    this.tabs.mark('settings', errors.some(({ group, id }) => group !== undefined && id === undefined));
    this.topBar.allow(this.writer && this.store.canUndo, this.writer && this.store.canRedo);
    this.variants.refresh();
  }

  private setVisible(name: Shown, on: boolean): void {
    this.view.setVisible(name, on);
    if (name === 'overlay') this.scene.update('drape');
  }

  private want(change: Partial<Wanted>): void {
    this.wanted = { ...this.wanted, ...change };
    this.connection.send({ type: 'view', ...this.wanted });
    this.refresh();
  }

  // Editing

  private canDraw(tool: Tool): boolean {
    const { layer } = TOOLS[tool];
    return layer === null || (this.welcome.mode === 'case' && this.welcome.forms.layers[layer] !== undefined);
  }

  private onDocument(changed: Difference): void {
    this.view.showDocument(this.store.document.layers);
    this.drawer.refresh();
    this.sender.add(changed);
    this.scene.update('layers');
    this.refresh();
  }

  private onTool(tool: Tool): void {
    this.toolbar.show(tool, (one) => this.drawer.may(one));
    this.refresh();
  }

  private onSelect(id: string): void {
    this.features.select(id);
    const found = this.store.feature(id);
    if (found) this.tabs.show('features');
    const name = found ? String(found.feature.properties['name'] ?? '') : '';
    this.statistics.select(name);
    if (!this.chooser) return;
    this.hazard.select(found && ['lines', 'barriers'].includes(found.layer) ? name : '');
    if (found) this.hazard.choose(name);
  }

  private selectLine(name: string): void {
    const feature = [...this.store.layer('lines'), ...this.store.layer('barriers')].find(({ properties }) => properties['name'] === name);
    if (feature) this.drawer.select(feature.id);
    else this.statistics.select(name);
  }

  private tenfold(): void {
    const { case: group = {} } = this.store.document.settings;
    const key = group['boulders_total'] === undefined ? 'boulders' : 'boulders_total';
    const known = this.welcome.forms.settings['case']?.find(({ name }) => name === key)?.default;
    const now = Number(group[key] ?? known ?? this.results.header?.total ?? 1000);
    this.store.setSetting('case', key, Math.min(now * 10, 2_000_000_000));
  }

  private showError({ id, group }: CaseError): void {
    if (id !== undefined) {
      this.drawer.select(id);
      this.view.fitFeature(id);
    } else if (group !== undefined) this.tabs.show('settings');
    this.shell.side.querySelector<HTMLElement>('[aria-invalid="true"]')?.focus();
  }

  show(mode: Mode): void {
    this.mode = mode;
    this.shell.show(mode);
    this.shell.fillDock(...(mode === 'compare' ? [this.variants.compare.table] : [this.section.root, this.messages.root, this.statistics.root]));
    this.topBar.showMode(mode);
    if (mode === 'scene') this.scene.show();
    else this.scene.hide();
    if (mode === 'map') this.view.map.updateSize();
  }

  // Frame

  private assemble(): void {
    if (this.tools.length) this.shell.tools.append(this.toolbar.root);
    this.shell.root.classList.toggle('without-tools', this.tools.length === 0);
    this.shell.mapPane.append(this.legend.root, mapButtons(this.view));
    this.shell.comparePane.append(this.variants.compare.root);
    this.shell.side.append(this.tabs.root);
    this.shell.root.append(this.output.dialog, this.grounds.dialog);
    this.show('map');
  }

  private listen(): void {
    listenToKeys(
      this.drawer,
      this.shell.mapTarget,
      this.tools,
      {
        undo: () => this.writer && this.store.undo(),
        redo: () => this.writer && this.store.redo(),
        save: () => this.welcome.mode === 'case' && !this.connection.standalone && this.output.open('save'),
        fit: () => this.view.fitResults(),
        onMap: () => this.mode === 'map',
        step: () => this.results.terrain?.cell ?? 1,
      },
      this.ended.signal,
    );
    window.addEventListener('beforeprint', () => this.print(), { signal: this.ended.signal });
    const sizes = new ResizeObserver(() => this.view.map.updateSize());
    sizes.observe(this.shell.mapTarget);
    this.ended.signal.addEventListener('abort', () => sizes.disconnect());
  }

  private load({ document, revision }: { document: CaseDocument; revision: number }): void {
    this.store.load(document);
    this.sender.start(revision);
    this.view.showDocument(this.store.document.layers);
    this.drawer.refresh();
    this.scene.update('layers');
    if (!document.layers.lines.length && !document.layers.barriers.length) this.statistics.update([]);
    this.showRole();
    this.refresh();
    const { surface = {}, impact = {} } = document.settings;
    const any = Object.keys({ ...surface, ...impact }).length > 0 || this.store.layer('zones').length > 0;
    if (!any && this.writer) this.grounds.open();
  }

  private showRole(): void {
    this.legend.enable(this.chooser);
    this.display.enable(this.chooser);
    this.hazard.enable(this.chooser);
    this.drawer.enable(this.writer, this.chooser);
    this.toolbar.show(this.drawer.tool, (one) => this.drawer.may(one));
    this.notices.show(this.welcome.mode === 'case' && !this.writer, this.writer);
  }

  /** Put a picture of the map on the printed sheet, in map or 3-D view; the browser prints it with the table. */
  private print(): void {
    const { mode } = this;
    this.show('map');
    this.view.map.renderSync();
    this.statistics.writeAll();
    for (const one of this.messages.root.querySelectorAll('details')) one.open = true;
    this.shell.printed(this.drawPicture());
    window.addEventListener('afterprint', () => this.show(mode), { once: true });
  }

  private drawPicture(): HTMLCanvasElement {
    const { hazard, preliminary, results: { header }, welcome } = this;
    return drawPicture(this.view, captionOf(welcome, header, preliminary, hazard.shownClasses));
  }
}
