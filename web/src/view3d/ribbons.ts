// SPDX-License-Identifier: BSD-3-Clause
// Lines with a width in pixels, in one draw call per kind. Each point has two vertices, which the shader moves sideways.
// Instances per segment would be many times slower in software renderers, which draw instances one by one.
import {
  BufferAttribute, BufferGeometry, DataTexture, DoubleSide, InterleavedBuffer, InterleavedBufferAttribute, LinearFilter, Mesh, ShaderMaterial,
  Sphere, Vector2,
} from 'three';
import { rgbOf } from '../colours';
import { paletteBytes } from './colours';

/** Components of a point: x, y, z [m], time [s], value. A decrease in time starts a new line. */
export const STRIDE = 5;

const VERTEX = /* glsl */ `
  attribute vec4 before, after; // neighbours on the line: x, y, z, time
  attribute vec2 state;         // time, value
  uniform vec2 viewport; // [pixel]
  uniform float width;   // [pixel]
  uniform float closer;  // fraction of the distance by which lines are drawn in front of the ground
  varying float time, value, edge;

  /** Direction on the screen from one point to another, which may be behind the camera. */
  vec2 direction(vec4 from, vec4 to) {
    float nearest = 1e-3 * from.w;
    if (to.w < nearest) to = mix(from, to, (from.w - nearest) / (from.w - to.w));
    vec2 way = (to.xy / to.w - from.xy / from.w) * viewport;
    return dot(way, way) > 1e-8 ? normalize(way) : vec2(0.0);
  }

  void main() {
    time = state.x;
    value = state.y;
    edge = (gl_VertexID & 1) == 0 ? -1.0 : 1.0;
    vec4 seen = modelViewMatrix * vec4(position, 1.0);
    gl_Position = projectionMatrix * vec4(seen.xyz * (1.0 - closer), 1.0);
    if (gl_Position.w <= 0.0) return;
    mat4 matrix = projectionMatrix * modelViewMatrix;
    vec2 along = vec2(0.0);
    if (before.w <= time) along -= direction(gl_Position, matrix * vec4(before.xyz, 1.0));
    if (after.w >= time) along += direction(gl_Position, matrix * vec4(after.xyz, 1.0));
    along = dot(along, along) > 1e-4 ? normalize(along) : vec2(1.0, 0.0);
    gl_Position.xy += vec2(-along.y, along.x) * edge * width / viewport * gl_Position.w;
  }`;
const FRAGMENT = /* glsl */ `
  uniform float now, fading, end, opacity, ahead;
  uniform vec3 colour;
  uniform sampler2D palette;
  varying float time, value, edge;
  void main() {
    float age = now - time;
    #ifdef PALETTE
      vec3 tone = texture2D(palette, vec2(clamp(value / end, 0.0, 1.0) * 0.996 + 0.002, 0.5)).rgb;
      tone *= 1.0 - 0.5 * smoothstep(0.45, 1.0, abs(edge)); // a dark edge keeps yellow legible on bright ground
      float seen = age < 0.0 ? ahead : mix(4.0 * ahead, 1.0, exp(-age / 1.5));
      gl_FragColor = vec4(tone, opacity * mix(1.0, seen, fading));
    #else
      gl_FragColor = vec4(colour, opacity);
    #endif
  }`;

/** Appearance of lines. Without `colour`, the palette colours them by value; `ahead` is the opacity of the future part,
 * `coarse` the time [s] between points drawn far away. */
export interface RibbonStyle { width: number; closer: number; colour?: string; opacity?: number; ahead?: number; coarse?: number }

/** Lines through points with STRIDE numbers each. */
export class Ribbons extends Mesh<BufferGeometry, ShaderMaterial> {
  private readonly buffer: InterleavedBuffer;
  private readonly fine: BufferAttribute;
  private readonly coarse: BufferAttribute;

  constructor(points: Float32Array, private readonly style: RibbonStyle) {
    super(new BufferGeometry(), new ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      transparent: true,
      depthWrite: false,
      side: DoubleSide,
      defines: style.colour ? {} : { PALETTE: '' },
      uniforms: {
        viewport: { value: new Vector2(1, 1) },
        width: { value: style.width },
        closer: { value: style.closer },
        colour: { value: rgbOf(style.colour ?? '#000000').map((part) => part / 255) },
        opacity: { value: style.opacity ?? 1 },
        now: { value: 0 },
        fading: { value: 0 },
        ahead: { value: style.ahead ?? 1 },
        end: { value: 1 },
        palette: { value: null as DataTexture | null },
      },
    }));
    if (!style.colour) {
      const palette = new DataTexture(paletteBytes(256), 256, 1);
      Object.assign(palette, { magFilter: LinearFilter, minFilter: LinearFilter, needsUpdate: true });
      this.material.uniforms.palette!.value = palette;
    }
    // Two extra vertices at each end give the previous and next vertices constant offsets.
    const count = points.length / STRIDE;
    const vertices = new Float32Array((2 * count + 4) * STRIDE);
    for (let k = 0; k < count; k++) {
      const at = k * STRIDE;
      for (let column = 0; column < STRIDE; column++) vertices[2 * at + 2 * STRIDE + column] = vertices[2 * at + 3 * STRIDE + column] = points[at + column]!;
    }
    vertices[3] = vertices[STRIDE + 3] = Infinity; // time before the first point: another line
    vertices[vertices.length - 2] = vertices[vertices.length - STRIDE - 2] = -Infinity;
    this.buffer = new InterleavedBuffer(vertices, STRIDE);
    for (const [name, size, offset] of [['before', 4, 0], ['position', 3, 2 * STRIDE], ['state', 2, 2 * STRIDE + 3], ['after', 4, 4 * STRIDE]] as const) {
      this.geometry.setAttribute(name, new InterleavedBufferAttribute(this.buffer, size, offset));
    }
    this.fine = segments(points, 0);
    this.coarse = style.coarse ? segments(points, style.coarse) : this.fine;
    this.geometry.setIndex(this.fine);
    this.geometry.boundingSphere = new Sphere(); // skips its computation: nothing is culled, renderOrder sorts
    this.frustumCulled = false;
  }

  /** Set the values of all points; values of `end` and above get the last colour. */
  setValues(values: Float32Array, end: number): void {
    const { array } = this.buffer;
    values.forEach((value, k) => {
      array[(2 * k + 2) * STRIDE + 4] = array[(2 * k + 3) * STRIDE + 4] = value;
    });
    this.material.uniforms.end!.value = end;
    this.buffer.needsUpdate = true;
  }

  /** Draw all points, or only points separated by a minimum time, which suffices far away. */
  setDetail(fine: boolean): void {
    this.geometry.setIndex(fine ? this.fine : this.coarse);
  }

  /** Show the lines at a time [s]: faint ahead, fading behind; complete lines if null. */
  setTime(now: number | null): void {
    this.material.uniforms.now!.value = now ?? 0;
    this.material.uniforms.fading!.value = now === null ? 0 : 1;
  }

  /** Set the picture size [pixel] and its pixels per CSS pixel. */
  setViewport(width: number, height: number, ratio: number): void {
    (this.material.uniforms.viewport!.value as Vector2).set(width, height);
    this.material.uniforms.width!.value = this.style.width * ratio;
  }

  override dispose(): void {
    super.dispose();
    (this.material.uniforms.palette!.value as DataTexture | null)?.dispose();
    this.geometry.dispose();
    this.material.dispose();
  }
}

/** Triangles between points of a line that are at least a time [s] apart, and the ends of the line. */
function segments(points: Float32Array, apart: number): BufferAttribute {
  const count = points.length / STRIDE;
  const index = new Uint32Array(6 * count);
  let used = 0;
  for (let k = 1, kept = 0; k < count; k++) {
    const time = points[k * STRIDE + 3]!;
    const begins = time < points[(k - 1) * STRIDE + 3]!;
    const ends = k + 1 === count || points[(k + 1) * STRIDE + 3]! < time;
    if (!begins && !ends && time - points[kept * STRIDE + 3]! < apart) continue;
    if (!begins) for (const vertex of [2 * kept, 2 * kept + 1, 2 * k, 2 * k, 2 * kept + 1, 2 * k + 1]) index[used++] = vertex;
    kept = k;
  }
  return new BufferAttribute(index.slice(0, used), 1);
}
