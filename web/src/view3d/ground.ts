// SPDX-License-Identifier: BSD-3-Clause
// Terrain as a mesh in metres from its south-western corner, with its hillshade and a draped picture.
import {
  BufferAttribute, BufferGeometry, CanvasTexture, DataTexture, DoubleSide, LinearFilter, LinearMipmapLinearFilter, Mesh, NoColorSpace,
  RedFormat, ShaderMaterial, Vector3, Vector4, type Ray, type Texture,
} from 'three';
import { scaleEnd } from './colours';
import { elevationAt, rangeOf, type Extent, type Shade, type Terrain } from '../terrain';

const MAX_SIDE = 500; // maximum number of vertices along the longer side of the mesh
const FLAT_SHADE = 180;
const CONTOURS = 30; // approximate number of contours over the whole relief

const VERTEX = /* glsl */ `
  attribute float wall;
  uniform vec2 shadeSize, corner;
  uniform vec4 drapeBox;
  varying vec2 shadeAt, drapeAt;
  varying float isWall, height;
  void main() {
    height = position.z;
    shadeAt = vec2(position.x, corner.y - position.y) / shadeSize;
    drapeAt = vec2((position.x - drapeBox.x) / (drapeBox.z - drapeBox.x), (position.y - drapeBox.y) / (drapeBox.w - drapeBox.y));
    isWall = wall;
    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
  }`;
const FRAGMENT = /* glsl */ `
  uniform sampler2D shade, drape;
  uniform float draped, interval; // contour interval [m]
  varying vec2 shadeAt, drapeAt;
  varying float isWall, height;
  void main() {
    float light = texture2D(shade, shadeAt).r;
    vec3 colour = mix(vec3(0.22, 0.25, 0.29), vec3(0.88, 0.87, 0.84), light);
    if (draped > 0.5 && all(equal(drapeAt, clamp(drapeAt, 0.0, 1.0)))) {
      vec4 picture = texture2D(drape, drapeAt); // premultiplied
      colour = colour * (1.0 - picture.a) + picture.rgb * (0.45 + 0.6 * light);
    }
    float level = height / interval;
    float blur = fwidth(level);
    float contour = 1.0 - smoothstep(0.3, 1.3, abs(fract(level - 0.5) - 0.5) / max(blur, 1e-6));
    colour *= 1.0 - 0.14 * contour * (1.0 - smoothstep(0.12, 0.4, blur));
    gl_FragColor = vec4(isWall > 0.0 ? vec3(0.42, 0.40, 0.38) * (1.1 - 0.35 * isWall) : colour, 1.0);
  }`;

/** Terrain of the scene. */
export class Ground {
  readonly root: Mesh<BufferGeometry, ShaderMaterial>;
  readonly width: number;
  readonly depth: number;
  readonly low: number;
  readonly high: number;
  /** Distance [m] between vertices of the mesh. */
  readonly spacing: number;

  constructor(readonly terrain: Terrain, shade: Shade) {
    const { cell, nx, ny, heights } = terrain;
    this.width = nx * cell;
    this.depth = ny * cell;
    ({ low: this.low, high: this.high } = rangeOf(heights) ?? { low: 0, high: 0 });
    const step = Math.ceil(Math.max(nx, ny) / MAX_SIDE);
    this.spacing = step * cell;
    const shadeTexture = new DataTexture(shade.values.map((value) => value || FLAT_SHADE), shade.nx, shade.ny, RedFormat);
    Object.assign(shadeTexture, {
      magFilter: LinearFilter, minFilter: LinearMipmapLinearFilter, generateMipmaps: true, anisotropy: 4, unpackAlignment: 1, needsUpdate: true,
    });
    const material = new ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      side: DoubleSide,
      uniforms: {
        shade: { value: shadeTexture },
        shadeSize: { value: [shade.nx * shade.cell, shade.ny * shade.cell] },
        corner: { value: [0, this.depth] },
        drape: { value: null as Texture | null },
        drapeBox: { value: new Vector4(0, 0, 1, 1) },
        draped: { value: 0 },
        interval: { value: scaleEnd((this.high - this.low) / CONTOURS) },
      },
    });
    this.root = new Mesh(this.surface(step), material);
    this.root.frustumCulled = false;
  }

  /** Drape a picture over an extent of the terrain, or remove it. */
  setDrape(image: HTMLCanvasElement | null, [west, south, east, north]: Extent): void {
    const { drape, drapeBox, draped } = this.root.material.uniforms;
    (drape!.value as Texture | null)?.dispose();
    const texture = image && image.width > 0 && image.height > 0 ? new CanvasTexture(image) : null;
    if (texture) Object.assign(texture, { colorSpace: NoColorSpace, premultiplyAlpha: true, anisotropy: 4 });
    drape!.value = texture;
    draped!.value = texture ? 1 : 0;
    const { west: x, south: y } = this.terrain;
    (drapeBox!.value as Vector4).set(west - x, south - y, east - x, north - y);
  }

  /** Elevation [m] at x, y [m] from the south-western corner; NaN if unknown. */
  elevation(x: number, y: number): number {
    return elevationAt(this.terrain, x, y);
  }

  /** About 1,000 points on the known terrain. */
  sample(): Vector3[] {
    const { cell, nx, ny, heights } = this.terrain;
    const step = Math.max(Math.floor(Math.sqrt((nx * ny) / 1000)), 1);
    const points: Vector3[] = [];
    for (let row = 0; row < ny; row += row < ny - 1 ? Math.min(step, ny - 1 - row) : 1) {
      for (let column = 0; column < nx; column += column < nx - 1 ? Math.min(step, nx - 1 - column) : 1) {
        const height = heights[row * nx + column]!;
        if (!Number.isNaN(height)) points.push(new Vector3((column + 0.5) * cell, (ny - row - 0.5) * cell, height));
      }
    }
    return points;
  }

  /** First intersection of a ray with the terrain; null if none. */
  hit({ origin, direction }: Ray): Vector3 | null {
    const point = new Vector3();
    const longest = origin.distanceTo(new Vector3(this.width / 2, this.depth / 2, this.low)) + Math.hypot(this.width, this.depth);
    const step = Math.max(this.terrain.cell / 2, longest / 4000);
    for (let way = 0; way < longest; way += step) {
      point.copy(direction).multiplyScalar(way).add(origin);
      if (point.z < this.low - step) return null;
      if (point.z <= this.elevation(point.x, point.y)) return point;
    }
    return null;
  }

  dispose(): void {
    const { shade, drape } = this.root.material.uniforms;
    (shade!.value as Texture).dispose();
    (drape!.value as Texture | null)?.dispose();
    this.root.geometry.dispose();
    this.root.material.dispose();
  }

  /** Mesh of every `step`th elevation, without cells that have an unknown corner, and with walls down to a common base. */
  private surface(step: number): BufferGeometry {
    const { cell, nx, ny, heights } = this.terrain;
    const columns = Math.max(Math.ceil((nx - 1) / step) + 1, 1);
    const rows = Math.max(Math.ceil((ny - 1) / step) + 1, 1);
    const positions = new Float32Array(3 * columns * rows);
    for (let row = 0, at = 0; row < rows; row++) {
      const j = Math.min(row * step, ny - 1);
      for (let column = 0; column < columns; column++) {
        const i = Math.min(column * step, nx - 1);
        positions[at++] = (i + 0.5) * cell;
        positions[at++] = (ny - j - 0.5) * cell;
        positions[at++] = heights[j * nx + i]!;
      }
    }
    const known = (row: number, column: number): boolean => {
      if (row < 0 || column < 0 || row >= rows - 1 || column >= columns - 1) return false;
      const at = 3 * (row * columns + column) + 2;
      const below = at + 3 * columns;
      return positions[at]! + positions[at + 3]! + positions[below]! + positions[below + 3]! > -Infinity; // false for NaN
    };
    const index = new Uint32Array(6 * Math.max(columns - 1, 0) * Math.max(rows - 1, 0));
    const edges: number[] = []; // pairs of vertices
    let used = 0;
    for (let row = 0; row < rows - 1; row++) {
      for (let column = 0; column < columns - 1; column++) {
        if (!known(row, column)) continue;
        const a = row * columns + column;
        const b = a + 1;
        const c = a + columns;
        const d = c + 1;
        index[used++] = a; index[used++] = c; index[used++] = b;
        index[used++] = b; index[used++] = c; index[used++] = d;
        if (!known(row - 1, column)) edges.push(a, b);
        if (!known(row + 1, column)) edges.push(c, d);
        if (!known(row, column - 1)) edges.push(a, c);
        if (!known(row, column + 1)) edges.push(b, d);
      }
    }
    const base = this.low - 0.04 * Math.max(this.width, this.depth);
    const wallPositions: number[] = [];
    const wallIndex: number[] = [];
    for (let k = 0; k < edges.length; k += 2) {
      const from = columns * rows + wallPositions.length / 3;
      for (const vertex of [edges[k]!, edges[k + 1]!]) {
        const x = positions[3 * vertex]!;
        const y = positions[3 * vertex + 1]!;
        wallPositions.push(x, y, positions[3 * vertex + 2]!, x, y, base);
      }
      wallIndex.push(from, from + 1, from + 2, from + 2, from + 1, from + 3);
    }
    const all = new Float32Array(positions.length + wallPositions.length);
    for (let k = 2; k < positions.length; k += 3) if (Number.isNaN(positions[k]!)) positions[k] = this.low;
    all.set(positions);
    all.set(wallPositions, positions.length);
    const wall = new Float32Array(all.length / 3);
    for (let k = columns * rows; k < wall.length; k++) wall[k] = (k - columns * rows) % 2 ? 1 : 0.25;
    const indices = new Uint32Array(used + wallIndex.length);
    indices.set(index.subarray(0, used));
    indices.set(wallIndex, used);
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new BufferAttribute(all, 3));
    geometry.setAttribute('wall', new BufferAttribute(wall, 1));
    geometry.setIndex(new BufferAttribute(indices, 1));
    return geometry;
  }
}
