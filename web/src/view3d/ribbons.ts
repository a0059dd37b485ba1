// SPDX-License-Identifier: BSD-3-Clause
// Lines of a width in pixels, all of a kind in one draw call: each segment is an instance of a quadrangle.
import {
  BufferAttribute, DataTexture, InstancedBufferGeometry, InstancedInterleavedBuffer, InterleavedBufferAttribute, LinearFilter, Mesh,
  ShaderMaterial, Vector2,
} from 'three';
import { paletteBytes } from './colours';

/** Numbers of each point: x, y, z [m], time [s], value. Where time falls, a new line begins. */
export const STRIDE = 5;

const VERTEX = /* glsl */ `
  attribute vec3 from, to;
  attribute vec2 fromState, toState; // time, value
  uniform vec2 viewport; // [pixel]
  uniform float width;   // [pixel]
  uniform float closer;  // fraction of the distance by which lines come before the ground they lie on
  varying float time, value, edge;
  void main() {
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0); // outside
    vec4 a = modelViewMatrix * vec4(from, 1.0);
    vec4 b = modelViewMatrix * vec4(to, 1.0);
    float near = projectionMatrix[3][2] / (1.0 - projectionMatrix[2][2]);
    if (toState.x < fromState.x || (a.z > near && b.z > near)) return;
    if (a.z > near) a = mix(a, b, (near - a.z) / (b.z - a.z));
    if (b.z > near) b = mix(b, a, (near - b.z) / (a.z - b.z));
    a.xyz *= 1.0 - closer;
    b.xyz *= 1.0 - closer;
    vec4 clipA = projectionMatrix * a;
    vec4 clipB = projectionMatrix * b;
    vec2 along = (clipB.xy / clipB.w - clipA.xy / clipA.w) * viewport;
    float reach = length(along);
    along = reach > 1e-3 ? along / reach : vec2(1.0, 0.0);
    gl_Position = position.x > 0.5 ? clipB : clipA;
    gl_Position.xy += vec2(-along.y, along.x) * position.y * width / viewport * gl_Position.w;
    vec2 state = position.x > 0.5 ? toState : fromState;
    time = state.x;
    value = state.y;
    edge = position.y;
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
      tone *= 1.0 - 0.5 * smoothstep(0.45, 1.0, abs(edge)); // a dark rim keeps yellow legible on bright ground
      float seen = age < 0.0 ? ahead : mix(4.0 * ahead, 1.0, exp(-age / 1.5));
      gl_FragColor = vec4(tone, opacity * mix(1.0, seen, fading));
    #else
      gl_FragColor = vec4(colour, opacity);
    #endif
  }`;

/** Appearance of lines: coloured by value through the palette if no colour is given; `ahead` is the opacity of what comes later. */
export interface RibbonStyle { width: number; closer: number; colour?: string; opacity?: number; ahead?: number }

/** Lines through points of STRIDE numbers. */
export class Ribbons extends Mesh<InstancedBufferGeometry, ShaderMaterial> {
  private readonly buffer: InstancedInterleavedBuffer;

  constructor(points: Float32Array, private readonly style: RibbonStyle) {
    super(new InstancedBufferGeometry(), new ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      transparent: true,
      depthWrite: false,
      side: 2,
      defines: style.colour ? {} : { PALETTE: '' },
      uniforms: {
        viewport: { value: new Vector2(1, 1) },
        width: { value: style.width },
        closer: { value: style.closer },
        colour: { value: rgb(style.colour ?? '#000000') },
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
    this.buffer = new InstancedInterleavedBuffer(points, STRIDE);
    this.geometry.setAttribute('position', new BufferAttribute(new Float32Array([0, -1, 0, 0, 1, 0, 1, -1, 0, 1, 1, 0]), 3));
    this.geometry.setIndex([0, 2, 1, 1, 2, 3]);
    for (const [name, size, offset] of [['from', 3, 0], ['fromState', 2, 3], ['to', 3, STRIDE], ['toState', 2, STRIDE + 3]] as const) {
      this.geometry.setAttribute(name, new InterleavedBufferAttribute(this.buffer, size, offset));
    }
    this.geometry.instanceCount = Math.max(points.length / STRIDE - 1, 0);
    this.frustumCulled = false;
  }

  /** Take over values written to the points; `end` is the value of the last colour. */
  setValues(end: number): void {
    this.material.uniforms.end!.value = end;
    this.buffer.needsUpdate = true;
  }

  /** Show the lines at a time [s]: faint ahead of it, fading behind; whole lines if null. */
  setTime(now: number | null): void {
    this.material.uniforms.now!.value = now ?? 0;
    this.material.uniforms.fading!.value = now === null ? 0 : 1;
  }

  /** Take over the size [pixel] of the picture, and the number of its pixels in a CSS pixel. */
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

function rgb(colour: string): [number, number, number] {
  return [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16) / 255) as [number, number, number];
}
