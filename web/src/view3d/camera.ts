// SPDX-License-Identifier: BSD-3-Clause
// Camera: rotates about, zooms to and moves with the point under the pointer, and stays above the ground.
import { MathUtils, PerspectiveCamera, Raycaster, Vector2, Vector3 } from 'three';
import { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
import type { Ground } from './ground';

const PLAYER = 70; // [CSS pixel] height of the player at the bottom
const LEGEND = 150; // [CSS pixel] height of the legend at the top of a narrow picture
const NARROW = 600; // [CSS pixel] maximum width of a narrow picture
const FLIGHT = 350; // [ms] duration of a change of view
const MARGIN = 1.08; // size of the complete view, relative to the terrain
const STEEP = MathUtils.degToRad(62); // angle of the first view from the vertical
const ASIDE = MathUtils.degToRad(38); // plan angle from the fall line, so that the relief is visible

interface Pose { target: Vector3; theta: number; phi: number; radius: number }

/** Camera above a terrain whose z axis points up. */
export class Camera {
  readonly eye = new PerspectiveCamera(40, 1, 1, 1e5);
  /** True once the user has chosen a view; new trajectories then keep the view. */
  chosen = false;
  private readonly controls: OrbitControls;
  private readonly pointer = new Raycaster();
  private flight: { from: Pose; to: Pose; begun: number } | null = null;
  private ground: Ground | null = null;

  constructor(private readonly canvas: HTMLCanvasElement, private readonly moved: () => void) {
    this.eye.up.set(0, 0, 1);
    // Added before the controls' listeners, so that they use the distance to the ground under the pointer.
    canvas.addEventListener('wheel', (event) => this.anchor(event, true), { passive: true });
    canvas.addEventListener('pointerdown', (event) => this.anchor(event, false));
    this.controls = new OrbitControls(this.eye, canvas);
    Object.assign(this.controls, {
      zoomToCursor: true, enableDamping: true, dampingFactor: 0.18, maxPolarAngle: 0.55 * Math.PI, minDistance: 4, keyPanSpeed: 30,
    });
    this.controls.listenToKeyEvents(canvas);
    this.controls.addEventListener('start', () => this.take());
    this.controls.addEventListener('change', moved);
    canvas.addEventListener('dblclick', (event) => this.focus(event));
    canvas.addEventListener('keydown', (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (event.key === '+' || event.key === '=') this.zoom(0.8);
      else if (event.key === '-') this.zoom(1.25);
      else if (event.key === 'n') this.faceNorth();
      else if (event.key === 'Home') this.showWhole();
      else if (event.key.startsWith('Arrow')) this.take();
      else return;
      event.preventDefault();
    });
  }

  /** Viewing direction [radian], clockwise from north. */
  get heading(): number {
    return Math.atan2(this.controls.target.x - this.eye.position.x, this.controls.target.y - this.eye.position.y);
  }

  /** Adopt a terrain. If its extent is new, show all of it, looking up the slope. */
  setGround(ground: Ground): void {
    const before = this.ground;
    this.ground = ground;
    this.controls.maxDistance = 5 * Math.hypot(ground.width, ground.depth);
    const sameSize = before?.width === ground.width && before.depth === ground.depth;
    if (sameSize && before.terrain.west === ground.terrain.west && before.terrain.south === ground.terrain.south) return;
    this.chosen = false;
    this.place(this.poseOf(ground.sample(), besideOf(slopeOf(ground)), STEEP));
  }

  /** Show points as large as possible, looking up their direction of fall, unless the user has chosen a view. */
  propose(points: Vector3[], fall: Vector3): void {
    if (!this.chosen) this.place(this.poseOf(points, besideOf(fall), STEEP));
  }

  showWhole(): void {
    if (!this.ground) return;
    const { theta, phi } = this.pose();
    this.fly(this.poseOf(this.ground.sample(), theta, Math.min(phi, STEEP)));
  }

  faceNorth(): void {
    this.fly({ ...this.pose(), theta: 0 });
  }

  /** Multiply the distance by a factor. */
  zoom(factor: number): void {
    const from = this.flight?.to ?? this.pose();
    this.fly({ ...from, radius: MathUtils.clamp(from.radius * factor, this.controls.minDistance, this.controls.maxDistance) });
  }

  resize(width: number, height: number): void {
    this.eye.aspect = width / height;
    this.eye.updateProjectionMatrix();
  }

  /** Move to the present pose; return true while the camera is moving. */
  update(now: number): boolean {
    if (this.flight) {
      const { from, to, begun } = this.flight;
      const part = Math.min((now - begun) / FLIGHT, 1);
      const eased = 1 - (1 - part) ** 3;
      const turn = MathUtils.euclideanModulo(to.theta - from.theta + Math.PI, 2 * Math.PI) - Math.PI;
      if (part === 1) this.flight = null;
      this.place({
        target: from.target.clone().lerp(to.target, eased),
        theta: from.theta + eased * turn,
        phi: from.phi + eased * (to.phi - from.phi),
        radius: from.radius * (to.radius / from.radius) ** eased,
      });
      return part < 1;
    }
    const moving = this.controls.update();
    this.stayAbove();
    return moving;
  }

  dispose(): void {
    this.controls.dispose();
  }

  /** The user takes control of the camera: end a change of view. */
  private take(): void {
    this.flight = null;
    this.chosen = true;
  }

  private fly(to: Pose): void {
    this.chosen = true;
    const instant = matchMedia('(prefers-reduced-motion: reduce)').matches;
    this.flight = { from: this.pose(), to, begun: performance.now() - (instant ? FLIGHT : 0) };
    this.moved();
  }

  private focus(event: MouseEvent): void {
    const target = this.hit(event);
    if (target) this.fly({ ...this.pose(), target, radius: Math.max(this.eye.position.distanceTo(target) / 2, this.controls.minDistance) });
  }

  /** Move the pivot of the camera to the distance of the ground under the pointer. */
  private anchor(event: MouseEvent, zooms: boolean): void {
    this.controls.screenSpacePanning = zooms;
    const point = this.hit(event);
    if (!point || this.flight) return;
    const forward = this.eye.getWorldDirection(new Vector3());
    const distance = point.sub(this.eye.position).dot(forward);
    if (distance > this.controls.minDistance) this.controls.target.copy(this.eye.position).addScaledVector(forward, distance);
  }

  private hit(event: MouseEvent): Vector3 | null {
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    this.pointer.setFromCamera(new Vector2((2 * (event.clientX - left)) / width - 1, 1 - (2 * (event.clientY - top)) / height), this.eye);
    return this.ground?.hit(this.pointer.ray) ?? null;
  }

  private pose(): Pose {
    const offset = this.eye.position.clone().sub(this.controls.target);
    const radius = offset.length();
    return { target: this.controls.target.clone(), theta: Math.atan2(offset.x, -offset.y), phi: Math.acos(offset.z / radius), radius };
  }

  private place({ target, theta, phi, radius }: Pose): void {
    this.controls.enableDamping = false; // discard inertia from an earlier movement
    this.controls.update();
    this.controls.enableDamping = true;
    this.controls.target.copy(target);
    this.eye.position.copy(target).addScaledVector(outward(theta, phi), radius);
    this.eye.lookAt(target);
    this.stayAbove();
    this.controls.update();
    this.moved();
  }

  /** Pose that shows all points from a direction, centred in the picture. */
  private poseOf(points: Vector3[], theta: number, phi: number): Pose {
    const back = outward(theta, phi);
    const right = new Vector3(Math.cos(theta), Math.sin(theta), 0);
    const up = back.clone().cross(right);
    const { clientWidth, clientHeight } = this.canvas;
    const bottomPart = Math.min(PLAYER / Math.max(clientHeight, 1), 0.3);
    const topPart = clientWidth < NARROW ? Math.min(LEGEND / Math.max(clientHeight, 1), 0.3) : 0;
    const slope = Math.tan(MathUtils.degToRad(this.eye.fov / 2));
    const slopeUp = (slope * (1 - bottomPart - topPart)) / MARGIN;
    const slopeRight = (slope * this.eye.aspect) / MARGIN;
    const target = points.reduce((sum, point) => sum.add(point), new Vector3()).divideScalar(Math.max(points.length, 1));
    let radius = 10 * this.controls.minDistance;
    for (let round = 0; round < 4; round++) { // the centre depends on the distance
      const [left, rightmost, bottom, top] = [Infinity, -Infinity, Infinity, -Infinity].map((worst, side) => points.reduce((so, point) => {
        const offset = point.clone().sub(target);
        const seen = (offset.dot(side < 2 ? right : up) * radius) / Math.max(radius - offset.dot(back), 0.1 * radius);
        return side % 2 ? Math.max(so, seen) : Math.min(so, seen);
      }, worst)) as [number, number, number, number];
      if (points.length > 0) target.addScaledVector(right, (left + rightmost) / 2).addScaledVector(up, (bottom + top) / 2);
      radius = 10 * this.controls.minDistance;
      for (const point of points) {
        const offset = point.clone().sub(target);
        radius = Math.max(radius, offset.dot(back) + Math.max(Math.abs(offset.dot(right)) / slopeRight, Math.abs(offset.dot(up)) / slopeUp));
      }
    }
    return { target: target.addScaledVector(up, (topPart - bottomPart) * slope * radius), theta, phi, radius };
  }

  private stayAbove(): void {
    const { ground, eye } = this;
    if (!ground) return;
    const clearance = Math.max(2, 0.3 * ground.spacing);
    const elevation = ground.elevation(eye.position.x, eye.position.y);
    const lowest = (Number.isNaN(elevation) ? ground.low : elevation) + clearance;
    if (eye.position.z < lowest) {
      eye.position.z = lowest;
      eye.lookAt(this.controls.target);
    }
    const size = Math.hypot(ground.width, ground.depth, ground.high - ground.low);
    const height = Number.isNaN(elevation) ? size : eye.position.z - elevation;
    eye.near = MathUtils.clamp(height / 20, 0.5, 20);
    eye.far = eye.position.distanceTo(this.controls.target) + 2 * size + eye.position.distanceTo(new Vector3(ground.width / 2, ground.depth / 2, ground.low));
    eye.updateProjectionMatrix();
    eye.updateMatrixWorld();
  }
}

/** Unit vector from the target to the camera: theta anticlockwise from south, phi from the vertical. */
function outward(theta: number, phi: number): Vector3 {
  return new Vector3(Math.sin(phi) * Math.sin(theta), -Math.sin(phi) * Math.cos(theta), Math.cos(phi));
}

/** Direction (theta) of the first view: from the foot of the slope, slightly from the side. */
function besideOf(fall: Vector3): number {
  return (fall.x === 0 && fall.y === 0 ? 0 : Math.atan2(fall.x, -fall.y)) + ASIDE;
}

/** Mean downhill direction. */
function slopeOf({ terrain }: Ground): Vector3 {
  const { nx, ny, heights } = terrain;
  const step = Math.max(Math.floor(Math.min(nx, ny) / 60), 1);
  const fall = new Vector3();
  for (let row = 0; row + step < ny; row += step) {
    for (let column = 0; column + step < nx; column += step) {
      const at = row * nx + column;
      const dx = heights[at + step]! - heights[at]!;
      const dy = heights[at]! - heights[at + step * nx]!;
      if (!Number.isNaN(dx + dy)) fall.add(new Vector3(-dx, -dy, 0));
    }
  }
  return fall;
}
