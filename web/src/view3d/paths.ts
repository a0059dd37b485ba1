// SPDX-License-Identifier: BSD-3-Clause
// Trajectories as lines, and boulders that move along them.
import {
  BufferAttribute, Color, DodecahedronGeometry, Group, InstancedBufferAttribute, InstancedMesh, MeshLambertMaterial, Vector3,
  type PerspectiveCamera,
} from 'three';
import { plasma } from '../colours';
import { between, COLUMNS, type Trajectories } from '../trajectories';
import { scaleEnd, type Quantity } from './colours';
import type { Ground } from './ground';
import { Ribbons, STRIDE } from './ribbons';

const DENSITY = 2700; // [kg/m3] gives the drawn size of a boulder
const SAG = 0.06; // [m] maximum distance of a parabola from its drawn chords
const SHORTEST = 0.1; // [s] minimum duration of a drawn hop; shorter hops are at most 12 mm high
const OFF = 0.02; // [m] points nearer to the motion between their neighbours are omitted
const COARSE = 0.45; // [s] between points drawn far away; the parabola is then up to 0.25 m above the chord
const DETAIL = 0.2; // [m] pixel size below which all points are drawn
const MIN_RADIUS = 3.5; // [pixel] minimum drawn radius of a boulder
const SAMPLE = 50; // every SAMPLE-th point is used to place the camera
const MOST = 0.995; // quantile of the values at the upper end of the palette

/** Trajectories with as few points as their motion needs, and positions of the boulders over time. */
export class Paths {
  readonly root = new Group();
  readonly duration: number;
  readonly highest: number = -Infinity; // maximum z of the drawn points [m]
  /** Sample of trajectory points [m], and the sum of the vectors from start to end. */
  readonly sample: Vector3[] = [];
  readonly fall = new Vector3();
  readonly ribbons: Ribbons;
  private readonly points: Float32Array<ArrayBuffer>; // STRIDE numbers per point
  private readonly speed: Float32Array;
  private readonly length: Float32Array; // length along the path [m]
  private readonly first: Uint32Array;
  private readonly radius: Float32Array; // [m]
  private readonly boulders: InstancedMesh<DodecahedronGeometry, MeshLambertMaterial>;
  private readonly placed: Float32Array; // transformation matrices of the boulders
  private readonly coloured: Float32Array;
  private end = 1;

  constructor(private readonly trajectories: Trajectories, private readonly ground: Ground) {
    const { points, speed, first } = resampled(trajectories);
    this.points = points;
    this.speed = speed;
    this.first = first;
    this.length = new Float32Array(speed.length);
    this.radius = trajectories.mass.map((mass) => Math.cbrt((3 * mass) / (4 * Math.PI * DENSITY)));
    let duration = 0;
    for (let k = 0, path = 0; k < speed.length; k++) {
      while (k >= first[path + 1]!) path++;
      const at = k * STRIDE;
      const [x, y, z] = [points[at]!, points[at + 1]!, points[at + 2]!];
      if (k > first[path]!) {
        const back = at - STRIDE;
        this.length[k] = this.length[k - 1]! + Math.hypot(x - points[back]!, y - points[back + 1]!, z - points[back + 2]!);
      }
      this.highest = Math.max(this.highest, z);
      duration = Math.max(duration, points[at + 3]!);
      const last = k + 1 === first[path + 1]!;
      if (last || k === first[path]! || k % SAMPLE === 0) this.sample.push(new Vector3(x, y, z));
      this.fall.addScaledVector(this.sample.at(-1)!, last ? 1 : k === first[path]! ? -1 : 0);
    }
    this.duration = duration;
    this.ribbons = new Ribbons(points, { width: 1.8, closer: 0.002, ahead: Math.min(Math.max(6 / first.length, 0.015), 0.12), coarse: COARSE });
    this.ribbons.renderOrder = 3;
    this.boulders = new InstancedMesh(rock(), new MeshLambertMaterial({ flatShading: true }), Math.max(first.length - 1, 1));
    this.boulders.count = first.length - 1;
    this.placed = this.boulders.instanceMatrix.array.fill(0) as Float32Array;
    this.coloured = new Float32Array(3 * Math.max(first.length - 1, 1));
    this.boulders.instanceColor = new InstancedBufferAttribute(this.coloured, 3);
    this.boulders.frustumCulled = false;
    this.root.add(this.boulders, this.ribbons);
  }

  /** Colour by a quantity; return the upper end of the scale, and whether values exceed it. */
  colourBy(quantity: Quantity): { end: number; exceeded: boolean } {
    const { points, speed, first, trajectories: { mass } } = this;
    const values = new Float32Array(speed.length);
    for (let path = 0; path + 1 < first.length; path++) {
      for (let k = first[path]!; k < first[path + 1]!; k++) {
        const at = k * STRIDE;
        if (quantity === 'speed') values[k] = speed[k]!;
        else if (quantity === 'energy') values[k] = (0.5 * mass[path]! * speed[k]! ** 2) / 1000;
        else values[k] = Math.max(points[at + 2]! - this.ground.elevation(points[at]!, points[at + 1]!), 0) || 0; // 0 on unknown ground
        points[at + 4] = values[k]!;
      }
    }
    const sorted = values.toSorted();
    this.end = scaleEnd(sorted[Math.floor(MOST * (values.length - 1))] ?? 0);
    this.ribbons.setValues(values, this.end);
    return { end: this.end, exceeded: (sorted.at(-1) ?? 0) > this.end };
  }

  /** Place the boulders at a time [s], with a minimum size in pixels; null: at the ends of their paths. */
  setTime(time: number | null, camera: PerspectiveCamera, pictureHeight: number): void {
    this.ribbons.setTime(time);
    const { points, first, placed, coloured, length } = this;
    const pixel = (2 * Math.tan((camera.fov * Math.PI) / 360)) / pictureHeight; // pixel size [m] at 1 m distance
    const { x: eyeX, y: eyeY, z: eyeZ } = camera.position;
    let nearest = Infinity;
    for (const point of this.sample) nearest = Math.min(nearest, camera.position.distanceToSquared(point));
    this.ribbons.setDetail(pixel * Math.sqrt(nearest) < DETAIL);
    // Numbers are written directly to the render buffers, which avoids objects per boulder and frame.
    for (let path = 0; path + 1 < first.length; path++) {
      const last = first[path + 1]! - 1;
      const k = time === null ? last : this.pointBefore(path, time);
      const next = Math.min(k + 1, last);
      const a = k * STRIDE;
      const b = next * STRIDE;
      const [x, y, z] = [points[a]!, points[a + 1]!, points[a + 2]!];
      const east = points[b]! - x;
      const north = points[b + 1]! - y;
      const span = points[b + 3]! - points[a + 3]!;
      const part = span > 0 && time !== null ? Math.min(Math.max((time - points[a + 3]!) / span, 0), 1) : 0;
      const centreX = x + part * east;
      const centreY = y + part * north;
      let centreZ = z + part * (points[b + 2]! - z);
      const away = Math.hypot(centreX - eyeX, centreY - eyeY, centreZ - eyeZ);
      const radius = Math.max(this.radius[path]!, MIN_RADIUS * pixel * away);
      centreZ += 0.8 * radius; // trajectories follow the underside of boulders
      const upright = 0.2 * (1 + (path % 3)); // mostly forward roll
      const norm = 1 / Math.hypot(north, east, upright);
      const [u, v, w] = [-north * norm, east * norm, upright * norm];
      const angle = path + (length[k]! + part * (length[next]! - length[k]!)) / (2 * radius);
      const [sine, cosine] = [radius * Math.sin(angle), radius * Math.cos(angle)];
      const rest = radius - cosine;
      const at = 16 * path; // matrix columns: rotation about the axis (u, v, w) times the radius, then the position
      placed[at] = rest * u * u + cosine;
      placed[at + 1] = rest * u * v + sine * w;
      placed[at + 2] = rest * u * w - sine * v;
      placed[at + 4] = rest * u * v - sine * w;
      placed[at + 5] = rest * v * v + cosine;
      placed[at + 6] = rest * v * w + sine * u;
      placed[at + 8] = rest * u * w + sine * v;
      placed[at + 9] = rest * v * w - sine * u;
      placed[at + 10] = rest * w * w + cosine;
      placed[at + 12] = centreX;
      placed[at + 13] = centreY;
      placed[at + 14] = centreZ;
      placed[at + 15] = 1;
      const value = (points[a + 4]! + part * (points[b + 4]! - points[a + 4]!)) / this.end;
      const shade = 3 * Math.round(SHADES * Math.min(Math.max(value, 0), 1) || 0);
      for (let channel = 0; channel < 3; channel++) coloured[3 * path + channel] = PALETTE[shade + channel]!;
    }
    this.boulders.instanceMatrix.needsUpdate = true;
    this.boulders.instanceColor!.needsUpdate = true;
  }

  dispose(): void {
    this.ribbons.dispose();
    this.boulders.geometry.dispose();
    this.boulders.material.dispose();
    this.boulders.dispose();
  }

  /** Index of the last point of a path at or before a time. */
  private pointBefore(path: number, time: number): number {
    let low = this.first[path]!;
    let high = this.first[path + 1]! - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.points[middle * STRIDE + 3]! <= time) low = middle;
      else high = middle - 1;
    }
    return low;
  }
}

const SHADES = 255;
/** Palette in linear light, slightly brightened. */
const PALETTE = Float32Array.from({ length: SHADES + 1 }, (_, k) => k).reduce((palette, k) => {
  const [red, green, blue] = plasma(k / SHADES);
  new Color().setRGB(red / 255, green / 255, blue / 255, 'srgb').lerp(new Color('white'), 0.12).toArray(palette, 3 * k);
  return palette;
}, new Float32Array(3 * (SHADES + 1)));

/** Faceted block of radius 1. */
function rock(): DodecahedronGeometry {
  const geometry = new DodecahedronGeometry(1, 0);
  const position = geometry.getAttribute('position') as BufferAttribute;
  for (let k = 0; k < position.count; k++) {
    const [x, y, z] = [position.getX(k), position.getY(k), position.getZ(k)];
    const dent = 0.92 + 0.16 * Math.sin(5 * x + 3 * y) * Math.cos(4 * z - 2 * x); // equal at all copies of a vertex
    position.setXYZ(k, x * dent, y * dent * 0.95, z * dent * 0.85);
  }
  geometry.computeVertexNormals();
  return geometry;
}

/** Resample points so that chords follow the motion: omit points that lie on the motion between their neighbours, and
 * insert points in long gaps. Contacts are kept. A path with a single point gets a second. */
function resampled({ points, first }: Trajectories): { points: Float32Array<ArrayBuffer>; speed: Float32Array; first: Uint32Array } {
  let data = new Float32Array(1024);
  let used = 0;
  const speeds: number[] = [];
  const firsts = new Uint32Array(first.length);
  const add = (from: Float32Array, at = 0, later = 0): void => {
    if (used + STRIDE > data.length) {
      const longer = new Float32Array(2 * data.length);
      longer.set(data);
      data = longer;
    }
    for (let column = 0; column < 4; column++) data[used + column] = from[at + column]!;
    data[used + 3]! += later;
    used += STRIDE;
    speeds.push(from[at + 4]!);
  };
  const point = new Float32Array(COLUMNS);
  for (let path = 0; path + 1 < first.length; path++) {
    const begin = first[path]! * COLUMNS;
    const last = (first[path + 1]! - 1) * COLUMNS;
    add(points, begin);
    let kept = begin;
    let mixed = false; // gravity differs between points omitted since the last kept point
    for (let at = begin + COLUMNS; at <= last; at += COLUMNS) {
      if (at !== last && isSpare(points, kept, at)) {
        mixed ||= points[at + 5] !== points[kept + 5];
        continue;
      }
      const span = points[at + 3]! - points[kept + 3]!;
      const gravity = mixed ? 0 : points[kept + 5]!;
      const pieces = Math.min(Math.ceil(span / chord(gravity)), 64);
      for (let k = 1; k < pieces; k++) {
        between(points, kept, at, gravity, k / pieces, point);
        add(point);
      }
      add(points, at);
      kept = at;
      mixed = false;
    }
    // Add a second, later point; otherwise the next path would continue from the first.
    if (begin === last) add(points, begin, 1e-3);
    firsts[path + 1] = used / STRIDE;
  }
  return { points: data.slice(0, used), speed: Float32Array.from(speeds), first: firsts };
}

/** Duration [s] of a chord for part of a parabola; unlimited for straight motion. */
function chord(gravity: number): number {
  return gravity > 0 ? Math.sqrt((8 * SAG) / gravity) : Infinity;
}

const there = new Float32Array(COLUMNS);

/** True if a point can be omitted: the motion from the kept point to the next point is short, and passes through this point or is invisible. */
function isSpare(points: Float32Array, kept: number, at: number): boolean {
  const next = at + COLUMNS;
  const span = points[next + 3]! - points[kept + 3]!;
  const short = span < SHORTEST;
  const gravity = short ? 0 : points[kept + 5]!;
  if (!short && (gravity !== points[at + 5] || span > chord(gravity) || points[next + 3] === points[at + 3] || points[at + 3] === points[kept + 3]))
    return false;
  between(points, kept, next, gravity, span > 0 ? (points[at + 3]! - points[kept + 3]!) / span : 0, there);
  return Math.hypot(there[0]! - points[at]!, there[1]! - points[at + 1]!, there[2]! - points[at + 2]!) <= (short ? SAG : OFF);
}
