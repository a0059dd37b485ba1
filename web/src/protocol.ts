// SPDX-License-Identifier: BSD-3-Clause
// Messages between the page and the server, and parsing of binary messages.

export type Layer = 'sources' | 'lines' | 'barriers' | 'dams' | 'zones';
export const LAYERS: readonly Layer[] = ['sources', 'lines', 'barriers', 'dams', 'zones'];

export type Value = number | string | boolean;
export type SettingValue = Value | Value[];
export type Position = [number, number];

interface Shaped<Type extends string, Coordinates> {
  readonly id: string;
  readonly type: Type;
  readonly coordinates: Coordinates;
  readonly properties: Readonly<Record<string, Value>>;
}
export type LineFeature = Shaped<'LineString', Position[]>;
export type Feature = Shaped<'Point', Position> | LineFeature | Shaped<'Polygon', Position[][]>;

export type Group = Readonly<Record<string, SettingValue>>;
export type Settings = Readonly<Record<string, Group>>;
export type Layers = Readonly<Record<Layer, readonly Feature[]>>;
/** Edited document: settings as written in the case, and drawn features. */
export interface CaseDocument {
  readonly settings: Settings;
  readonly layers: Layers;
  readonly variant: string; // name of the edited variant; '' for the base case
}

/** A key of the case, or a property of a feature. */
export interface Field {
  name: string;
  kind: 'real' | 'integer' | 'text' | 'logical' | 'count'; // count: an integer or a word
  list: boolean;
  default: SettingValue | null;
  allowed: string;
  choices: string[] | null;
  min: number | null;
  max: number | null;
  unit: string;
  meaning: string;
  read_only: boolean;
}
export interface Forms {
  settings: Record<string, Field[]>;
  layers: Partial<Record<Layer, Field[]>>; // layers without fields are not drawn
}
export interface MapName {
  name: string;
  label: string;
  unit: string;
}

export type LongTask = 'report' | 'export' | 'simulate';
export type Task = 'save' | LongTask;

/** A complete layer, or its changes since the last message. */
export type LayerChange = readonly Feature[] | { set: readonly Feature[]; remove: readonly string[] };

/** Messages from the page to the server. */
export type Request =
  | { type: 'hello'; key: string; language: string }
  | {
      type: 'edit';
      revision: number;
      layers: Partial<Record<Layer, LayerChange>>;
      settings: Record<string, Group>;
      variant: string;
      whole: boolean; // has all layers and groups, as required after a refused edit
    }
  | { type: 'compare'; variant: string }
  | ({ type: 'view' } & Wanted)
  | { type: 'run' | 'stop' | 'cancel' | 'take_over' }
  | { type: Task; name: string; overwrite: boolean }
  | { type: 'resume'; name: string }
  | { type: 'open_recent'; index: number };

/** Requested results: a map, a number of trajectories and, if there are many lines, the visible ones. */
export interface Wanted {
  map: string;
  trajectories: number;
  lines: readonly string[];
  section: readonly Position[]; // vertices of the section
  objects: string; // label in `Welcome.offers`; '': none
  basemap: string;
  net: string; // line or barrier for the design check
  hazard: boolean; // compute the hazard of the scenarios
  origin: string; // place for which the contributing sources are shown
}
/** Web map service added by the user. */
export interface WebMap {
  url: string;
  layers: string;
  crs: string; // CRS of the terrain
}
/** Ground for a document without ground; `radius` [m] of its rocks if the ground needs it. */
export interface GroundChoice {
  name: string;
  radius: number | null;
}
export interface Welcome {
  type: 'welcome';
  mode: 'case' | 'result' | 'start';
  writer: boolean;
  version: string;
  title: string;
  file: string;
  folder: string;
  language: string;
  languages: string[];
  texts: Record<string, string>;
  recent: { name: string; folder: string }[];
  document: CaseDocument;
  base: CaseDocument | null; // the case without its variants, if it has any
  variants: CaseDocument[];
  revision: number;
  forms: Forms;
  grounds: GroundChoice[];
  maps: MapName[];
  scenarios: number; // number of scenarios available for a hazard
  offers: { objects: string[]; basemaps: string[] };
  wms: WebMap | null;
  view: Wanted;
}
export interface CaseError {
  text: string;
  layer?: Layer;
  id?: string;
  group?: string;
  key?: string;
}
export interface State {
  type: 'state';
  running?: boolean; // false if paused
  revision: number;
  errors: CaseError[];
  warnings: string[];
  refused?: boolean; // true if the edit was refused: the server keeps an older document
}
export interface Progress {
  type: 'progress';
  task: LongTask;
  phase: string;
  done: number;
  total: number;
  seconds_left: number | null;
}
export type Text =
  | Welcome
  | State
  | Progress
  | { type: 'role'; writer: boolean }
  | { type: 'document'; document: CaseDocument; revision: number } // document changed in another window
  | { type: 'done'; task: LongTask; files: string[] }
  | { type: 'net'; net: string; revision: number; tables: TableEntry[] }
  | { type: 'hazard_begun'; revision: number }
  | { type: 'hazard_refused'; revision: number; text: string }
  | { type: 'objects'; chosen: string; objects: Shape[] }
  | { type: 'unfinished'; runs: { name: string; boulders: number }[] } // runs that can be resumed
  | { type: 'refused'; task: string; text: string; exists: boolean }
  | { type: 'saved'; files: string[]; remark: string; document_revision: number }
  | { type: 'fault'; text: string };

export interface TerrainMessage {
  type: 'terrain';
  west: number;
  north: number;
  cell: number;
  nx: number;
  ny: number;
  crs: string;
  full_cell: number; // cell size of the simulated terrain [m]
  shade_cell: number;
}
export interface BackgroundMessage {
  type: 'background';
  variant?: string;
  zones: { value: number; name: string }[];
  sources: number;
  trees: number;
  stands: Shape[];
}
/** Named shape that cannot be edited, with GeoJSON geometry. */
export interface Shape {
  name: string;
  geometry: { type: string; coordinates: unknown };
}
/** Value with its 95 % interval; null if withheld. */
export type Estimate = [number | null, number | null, number | null];
export interface QuantityStatistics {
  label: string;
  unit: string;
  factor: number;
  decimals: number;
  mean: Estimate;
  q95: Estimate;
  max: number | null;
  counts: number[];
  range: [number, number]; // range of the bins
}
export interface Line {
  name: string;
  kind: 'line' | 'barrier';
}
export interface LineStatistics extends Line {
  n: number;
  fraction: Estimate;
  quantities: Record<string, QuantityStatistics>;
}
export function hasStatistics(line: Line | LineStatistics): line is LineStatistics {
  return 'n' in line;
}
export interface OverlayHeader {
  name: string;
  label: string;
  unit: string;
  west: number;
  north: number;
  cell: number;
  low: number;
  high: number;
  scale: 'linear' | 'log';
  whole: boolean; // values are counts
}
export interface BatchMessage {
  type: 'batch';
  revision: number;
  variant?: string; // variant of the case, run in addition to the document
  boulders: number;
  total: number;
  complete: boolean;
  running: boolean;
  seconds: number;
  seconds_left: number | null;
  warnings: string[];
  ended: Record<string, number>;
  lines: (Line | LineStatistics)[]; // with many lines, only visible lines have statistics at first
  overlay: OverlayHeader | null;
}
/** Statistics of further lines, for the boulders of an earlier batch. */
export interface LinesMessage {
  type: 'lines';
  revision: number;
  variant?: string;
  boulders: number;
  lines: LineStatistics[];
}
export interface TrajectoriesMessage {
  type: 'trajectories';
  revision: number;
  variant?: string;
  append: boolean;
  count: number;
}
/** Section in SI units; its arrays are columns of `rockfall section`. */
export interface SectionMessage {
  type: 'section';
  revision: number;
  vertices: Position[];
  within: number;
  error: string;
  quantities: Record<string, { unit: string; factor: number; decimals: number }>;
  lines: { name: string; kind: 'line' | 'barrier' | 'dam'; distance: number; height: number | null; q95: Record<string, (number | null)[]> }[];
}
/** Table as texts; lines within a cell are separated by line feeds. */
export interface TableEntry {
  caption: string;
  head: string[];
  rows: string[][];
}
export interface HazardMessage {
  type: 'hazard';
  revision: number;
  west: number;
  north: number;
  cell: number;
  classes: [name: string, colour: string][];
  tables: TableEntry[]; // first of the scenarios, then of places
  sentences: string[];
  nets: Record<string, TableEntry[]>;
  places: string[];
}
export interface BasemapMessage {
  type: 'basemap';
  chosen: string;
  extent: [west: number, east: number, south: number, north: number];
}
export interface OriginsMessage {
  type: 'origins';
  revision: number;
  place: string;
  error: string;
  cell: number;
  total: number; // annual number of boulders that reach the place
  tables: TableEntry[]; // energies and heights by return period, also of the segments of a line
  parts: [text: string, colour: string, cells: number][];
}
export type BinaryHeader = TerrainMessage | BackgroundMessage | BatchMessage | LinesMessage | TrajectoriesMessage | SectionMessage | HazardMessage | OriginsMessage | BasemapMessage;

const KINDS = { f4: Float32Array, f8: Float64Array, u1: Uint8Array, u4: Uint32Array, i4: Int32Array };
type Kind = keyof typeof KINDS;
interface ArrayHeader {
  name: string;
  dtype: Kind;
  shape: number[];
  offset: number;
}
export type TypedArray = Float32Array | Float64Array | Uint8Array | Uint32Array | Int32Array;
export interface Grid<A extends TypedArray = TypedArray> {
  values: A;
  shape: number[];
}

/** A header and its arrays, which are views of the message buffer. */
export class Binary<Header extends BinaryHeader = BinaryHeader> {
  constructor(
    readonly header: Header,
    private readonly arrays: ReadonlyMap<string, Grid>,
  ) {}

  f4(name: string): Grid<Float32Array> | null {
    return this.array(name, Float32Array);
  }
  f8(name: string): Grid<Float64Array> | null {
    return this.array(name, Float64Array);
  }
  u1(name: string): Grid<Uint8Array> | null {
    return this.array(name, Uint8Array);
  }
  u4(name: string): Grid<Uint32Array> | null {
    return this.array(name, Uint32Array);
  }

  private array<A extends TypedArray>(name: string, kind: abstract new (...args: never[]) => A): Grid<A> | null {
    const found = this.arrays.get(name);
    if (!found) return null;
    if (!(found.values instanceof kind)) throw new TypeError(`${this.header.type}: array ${name} is of another type`);
    return { values: found.values, shape: found.shape };
  }
}

const decoder = new TextDecoder();

/** Parse a binary message (header length, header, arrays) without copying the arrays. */
export function decode(message: ArrayBuffer): Binary {
  const length = new DataView(message).getUint32(0, true);
  const header = JSON.parse(decoder.decode(new Uint8Array(message, 4, length))) as BinaryHeader & {
    arrays: ArrayHeader[];
  };
  const payload = 8 * Math.ceil((4 + length) / 8);
  const arrays = new Map<string, Grid>();
  for (const { name, dtype, shape, offset } of header.arrays) {
    const size = shape.reduce((product, n) => product * n, 1);
    arrays.set(name, { values: new KINDS[dtype](message, payload + offset, size), shape });
  }
  return new Binary(header, arrays);
}

/** Name of the variant to which results belong; '' for the document. */
export function variantOf({ header }: Binary): string {
  return ('variant' in header ? header.variant : undefined) ?? '';
}

/** Narrow a binary message to its type. */
export function isOf<Type extends BinaryHeader['type']>(
  message: Binary,
  type: Type,
): message is Binary<Extract<BinaryHeader, { type: Type }>> {
  return message.header.type === type;
}
