// SPDX-License-Identifier: BSD-3-Clause
// Lines on the ground, nets as fences with their height, dams as walls up to their crest, and names.
import {
  BufferAttribute, BufferGeometry, CanvasTexture, DoubleSide, Group, Mesh, ShaderMaterial, Sprite, SpriteMaterial, SRGBColorSpace,
} from 'three';
import { LAYER_COLOURS, rgbOf } from '../colours';
import type { Feature, Layers, LineFeature } from '../protocol';
import { KINDS, type Kind } from './colours';
import type { Ground } from './ground';
import { Ribbons } from './ribbons';

const POST_SPACING = 10; // approximate spacing [m]
const LABEL = 13; // [CSS pixel] letter size

const FENCE_VERTEX = /* glsl */ `
  attribute vec2 place; // along the line, and above the ground [m]
  varying vec2 at;
  void main() {
    at = place;
    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
  }`;
const FENCE_FRAGMENT = /* glsl */ `
  uniform vec3 colour;
  uniform float mesh; // mesh size of a net [m]; 0 for a wall
  varying vec2 at;
  void main() {
    float alpha = 0.75;
    if (mesh > 0.0) {
      vec2 cell = vec2(at.x + at.y, at.x - at.y) / mesh; // diamond-shaped meshes
      vec2 blur = fwidth(cell);
      vec2 rope = smoothstep(0.06 + blur, vec2(0.06), abs(fract(cell) - 0.5));
      alpha = mix(0.28 + 0.6 * max(rope.x, rope.y), 0.4, clamp(2.0 * max(blur.x, blur.y) - 0.4, 0.0, 1.0));
    }
    gl_FragColor = vec4(colour, alpha);
  }`;

interface Stretch { x: number; y: number; ground: number; along: number }

/** All drawn lines of the scene. */
export class Lines {
  readonly root = new Group();
  readonly kinds: Kind[];
  private readonly ribbons: Ribbons[] = [];
  private readonly labels: Sprite[] = [];
  private readonly fences: Mesh<BufferGeometry, ShaderMaterial>[] = [];

  constructor(layers: Layers, ground: Ground) {
    this.kinds = KINDS.filter((kind) => layers[kind].some(isLine));
    for (const kind of this.kinds) {
      const strokes: number[] = [];
      const posts: number[] = [];
      for (const line of layers[kind].filter(isLine)) {
        const height = kind === 'lines' ? 0 : Math.max(Number(line.properties['height'] ?? 0), 0);
        const parts = draped(line, ground);
        for (const part of parts) {
          part.forEach((point, k) => strokes.push(point.x, point.y, point.ground + height, k, 0));
          if (height > 0) this.addFence(part, height, kind);
          if (kind === 'barriers') addPosts(part, height, posts);
        }
        const longest = parts.reduce((best, part) => (part.length > best.length ? part : best), parts[0] ?? []);
        const middle = longest[Math.floor(longest.length / 2)];
        const name = String(line.properties['name'] ?? '');
        if (middle && name) this.addLabel(name, middle, height, ground.spacing, LAYER_COLOURS[kind]);
      }
      const order = kind === 'lines' ? 2 : 5;
      this.addRibbons(strokes, order, '#ffffff', 4.5, 0.0045, 0.85);
      this.addRibbons(strokes, order, LAYER_COLOURS[kind], 2.5, 0.005);
      this.addRibbons(posts, order, LAYER_COLOURS[kind], 2, 0.005);
    }
  }

  /** Set the picture size [pixel], its pixels per CSS pixel, and the field of view [degree]. */
  setViewport(width: number, height: number, ratio: number, fov: number): void {
    for (const ribbons of this.ribbons) ribbons.setViewport(width, height, ratio);
    const pixel = (2 * Math.tan((fov * Math.PI) / 360) * ratio) / height;
    for (const label of this.labels) {
      const { w, h } = label.userData as { w: number; h: number };
      label.scale.set(w * pixel, h * pixel, 1);
    }
  }

  dispose(): void {
    for (const ribbons of this.ribbons) ribbons.dispose();
    for (const label of this.labels) {
      label.material.map?.dispose();
      label.material.dispose();
    }
    for (const fence of this.fences) {
      fence.geometry.dispose();
      fence.material.dispose();
    }
  }

  private addRibbons(points: number[], order: number, colour: string, width: number, closer: number, opacity = 1): void {
    if (points.length === 0) return;
    const ribbons = new Ribbons(Float32Array.from(points), { width, closer, colour, opacity });
    ribbons.renderOrder = order;
    this.ribbons.push(ribbons);
    this.root.add(ribbons);
  }

  private addFence(part: Stretch[], height: number, kind: Kind): void {
    const geometry = new BufferGeometry();
    const positions = part.flatMap(({ x, y, ground }) => [x, y, ground - 0.5, x, y, ground + height]);
    geometry.setAttribute('position', new BufferAttribute(Float32Array.from(positions), 3));
    geometry.setAttribute('place', new BufferAttribute(Float32Array.from(part.flatMap(({ along }) => [along, 0, along, height])), 2));
    geometry.setIndex(part.slice(1).flatMap((_, k) => [2 * k, 2 * k + 2, 2 * k + 1, 2 * k + 1, 2 * k + 2, 2 * k + 3]));
    const colour = rgbOf(LAYER_COLOURS[kind]).map((part) => part / 255);
    const fence = new Mesh(geometry, new ShaderMaterial({
      vertexShader: FENCE_VERTEX,
      fragmentShader: FENCE_FRAGMENT,
      uniforms: { colour: { value: colour }, mesh: { value: kind === 'barriers' ? Math.max(height / 4, 0.5) : 0 } },
      transparent: true,
      depthWrite: false,
      side: DoubleSide,
    }));
    fence.renderOrder = 4; // drawn after trajectories, which would hide the fence
    this.fences.push(fence);
    this.root.add(fence);
  }

  private addLabel(name: string, { x, y, ground }: Stretch, height: number, lift: number, colour: string): void {
    const { image, w, h } = drawName(name, colour);
    const map = new CanvasTexture(image);
    map.colorSpace = SRGBColorSpace;
    const sprite = new Sprite(new SpriteMaterial({ map, sizeAttenuation: false, depthTest: false, depthWrite: false }));
    sprite.center.set(0.5, -0.6);
    sprite.position.set(x, y, ground + height + 0.2 * lift);
    sprite.renderOrder = 6;
    sprite.userData = { w, h };
    this.labels.push(sprite);
    this.root.add(sprite);
  }
}

function isLine(feature: Feature): feature is LineFeature {
  return feature.type === 'LineString';
}

/** Pieces of a line on known ground, with points at least as dense as the ground mesh. */
function draped(line: LineFeature, ground: Ground): Stretch[][] {
  const parts: Stretch[][] = [];
  let part: Stretch[] = [];
  let along = 0;
  const add = (x: number, y: number): void => {
    const elevation = ground.elevation(x, y);
    if (!Number.isNaN(elevation)) part.push({ x, y, ground: elevation, along });
    else if (part.length > 0) {
      parts.push(part);
      part = [];
    }
  };
  const xs = line.coordinates.map(([x]) => x - ground.terrain.west);
  const ys = line.coordinates.map(([, y]) => y - ground.terrain.south);
  for (let k = 0; k + 1 < xs.length; k++) {
    const length = Math.hypot(xs[k + 1]! - xs[k]!, ys[k + 1]! - ys[k]!);
    const pieces = Math.min(Math.max(Math.ceil(length / ground.terrain.cell), 1), 5000);
    for (let piece = k === 0 ? 0 : 1; piece <= pieces; piece++) {
      if (piece > 0) along += length / pieces;
      add(xs[k]! + (piece / pieces) * (xs[k + 1]! - xs[k]!), ys[k]! + (piece / pieces) * (ys[k + 1]! - ys[k]!));
    }
  }
  parts.push(part);
  return parts.filter((each) => each.length > 1);
}

/** Posts of a net: vertical lines at both ends and about every 10 m. */
function addPosts(part: Stretch[], height: number, posts: number[]): void {
  const begin = part[0]!.along;
  const length = part.at(-1)!.along - begin;
  const fields = Math.max(Math.round(length / POST_SPACING), 1);
  for (let post = 0, k = 0; post <= fields; post++) {
    while (k < part.length - 1 && part[k]!.along - begin < (post / fields) * length) k++;
    const { x, y, ground } = part[k]!;
    posts.push(x, y, ground, 0, 0, x, y, ground + height, 1, 0);
  }
}

/** Picture of a name at twice the screen resolution, and its size [CSS pixel]. */
function drawName(name: string, colour: string): { image: HTMLCanvasElement; w: number; h: number } {
  const text = name.length > 40 ? `${name.slice(0, 39)}…` : name;
  const image = document.createElement('canvas');
  const pen = image.getContext('2d')!;
  const font = `600 ${LABEL}px system-ui, sans-serif`;
  pen.font = font;
  const w = Math.ceil(pen.measureText(text).width) + 14;
  const h = LABEL + 9;
  image.width = 2 * w;
  image.height = 2 * h;
  pen.scale(2, 2);
  pen.font = font;
  pen.textAlign = 'center';
  pen.textBaseline = 'middle';
  pen.fillStyle = 'rgba(255, 255, 255, 0.92)';
  pen.beginPath();
  pen.roundRect(0, 0, w, h, 5);
  pen.fill();
  pen.fillStyle = colour;
  pen.fillText(text, w / 2, h / 2 + 0.5);
  return { image, w, h };
}
