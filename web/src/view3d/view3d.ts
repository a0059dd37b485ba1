// SPDX-License-Identifier: BSD-3-Clause
// View of the terrain in three dimensions: trajectories, moving boulders, lines, nets and dams.
import './view3d.css';
import { DirectionalLight, HemisphereLight, Scene, WebGLRenderer } from 'three';
import { Camera } from './camera';
import { Legend, type Quantity } from './colours';
import { Ground } from './ground';
import { icon, type IconName } from './icons';
import { Lines } from './lines';
import { Paths } from './paths';
import { Player } from './player';
import type { Extent, Line3d, Say, Shade, Terrain, Trajectories } from './types';

export type { Line3d, Shade, Terrain, Trajectories } from './types';

const FRAMES = 120; // whose times are kept
const MAX_RATIO = 2; // pixels of the picture in a CSS pixel

/** View that fills its parent. Hidden at first; draws only while shown, and only when something moved. */
export class View3d {
  private readonly root = document.createElement('div');
  private readonly stage: Stage | null;

  constructor(parent: HTMLElement, say: Say) {
    this.root.className = 'view3d';
    this.root.hidden = true;
    parent.append(this.root);
    const canvas = document.createElement('canvas');
    const context = canvas.getContext('webgl2', { alpha: true, antialias: true, powerPreference: 'high-performance' });
    if (context) {
      this.root.append(canvas);
      this.stage = new Stage(this.root, canvas, context, say);
    } else {
      this.stage = null;
      this.root.classList.add('view3d-missing');
      this.root.textContent = say('app.view3d_no_webgl');
    }
  }

  setTerrain(terrain: Terrain, shade: Shade | null): void {
    this.stage?.setTerrain(terrain, shade);
  }

  setDrape(image: HTMLCanvasElement | null, extent: Extent): void {
    this.stage?.setDrape(image, extent);
  }

  setLines(lines: Line3d[]): void {
    this.stage?.setLines(lines);
  }

  setTrajectories(trajectories: Trajectories | null): void {
    this.stage?.setTrajectories(trajectories);
  }

  setColouring(by: Quantity): void {
    this.stage?.setColouring(by);
  }

  get frames(): readonly Frame[] {
    return this.stage?.frames ?? [];
  }

  show(): void {
    this.root.hidden = false;
    this.stage?.show();
  }

  hide(): void {
    this.root.hidden = true;
    this.stage?.hide();
  }

  dispose(): void {
    this.stage?.dispose();
    this.root.remove();
  }
}

/** Milliseconds of the script for a frame, the time at which the frame began, and the highest point [m] of the trajectories drawn. */
export interface Frame {
  cost: number;
  now: number;
  highest: number;
}

type Part = 'ground' | 'drape' | 'lines' | 'paths' | 'colours';

/** What a view is made of where the browser can draw it. */
class Stage {
  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  private readonly camera: Camera;
  private readonly player: Player;
  private readonly legend: Legend;
  private readonly needle: HTMLElement;
  private readonly resized = new ResizeObserver(() => this.resize());
  private ground: Ground | null = null;
  private lines: Lines | null = null;
  private paths: Paths | null = null;
  private terrain: { terrain: Terrain; shade: Shade | null } | null = null;
  private drape: { image: HTMLCanvasElement | null; extent: Extent } = { image: null, extent: [0, 0, 1, 1] };
  private drawn: Line3d[] = [];
  private trajectories: Trajectories | null = null;
  private colouring: Quantity = 'speed';
  private readonly due = new Set<Part>();
  private shown = false;
  private frame = 0; // requested, 0: none
  readonly frames: Frame[] = [];
  private before: number | null = null; // [ms] of the last frame of a movement

  constructor(private readonly root: HTMLElement, private readonly canvas: HTMLCanvasElement, context: WebGL2RenderingContext, say: Say) {
    canvas.tabIndex = 0;
    canvas.setAttribute('role', 'img');
    canvas.setAttribute('aria-label', say('app.view3d_keys'));
    this.renderer = new WebGLRenderer({ canvas, context, antialias: true, alpha: true });
    canvas.addEventListener('webglcontextrestored', () => this.request());
    const sun = new DirectionalLight('#fff6e5', 2.6);
    sun.position.set(-1, 1, 1.4);
    this.scene.add(sun, new HemisphereLight('#dfeaf5', '#a59a8a', 2.2));
    this.camera = new Camera(canvas, () => this.request());
    this.player = new Player(say, () => this.request());
    this.legend = new Legend(say, (quantity) => this.setColouring(quantity));
    const tools = document.createElement('div');
    tools.className = 'view3d-tools view3d-card';
    const button = (name: IconName, press: () => void): HTMLButtonElement => {
      const element = document.createElement('button');
      element.type = 'button';
      element.title = say(`app.view3d_${name}`);
      element.setAttribute('aria-label', element.title);
      element.append(icon(name));
      element.addEventListener('click', press);
      tools.append(element);
      return element;
    };
    button('zoom_in', () => this.camera.zoom(0.7));
    button('zoom_out', () => this.camera.zoom(1 / 0.7));
    this.needle = button('north', () => this.camera.faceNorth());
    button('whole', () => this.camera.showWhole());
    root.append(this.legend.element, tools, this.player.element);
    root.addEventListener('keydown', (event) => {
      if (event.key !== ' ' || event.target !== canvas) return;
      event.preventDefault();
      this.player.toggle();
    });
  }

  setTerrain(terrain: Terrain, shade: Shade | null): void {
    this.terrain = { terrain, shade };
    this.make('ground', 'drape', 'lines', 'paths', 'colours');
  }

  setDrape(image: HTMLCanvasElement | null, extent: Extent): void {
    this.drape = { image, extent };
    this.make('drape');
  }

  setLines(lines: Line3d[]): void {
    this.drawn = lines;
    this.make('lines');
  }

  setTrajectories(trajectories: Trajectories | null): void {
    this.trajectories = trajectories;
    this.make('paths', 'colours');
  }

  setColouring(by: Quantity): void {
    this.colouring = by;
    this.make('colours');
  }

  show(): void {
    this.shown = true;
    this.resized.observe(this.root);
    this.resize();
  }

  hide(): void {
    this.shown = false;
    this.resized.disconnect();
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    this.before = null;
  }

  dispose(): void {
    this.hide();
    this.camera.dispose();
    this.ground?.dispose();
    this.lines?.dispose();
    this.paths?.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.root;
    if (width === 0 || height === 0) return;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, MAX_RATIO));
    this.renderer.setSize(width, height);
    this.camera.resize(width, height);
    if (this.paths) this.camera.propose(this.paths.sample, this.paths.fall);
    this.setViewports();
    this.draw(performance.now()); // at once: a new size clears the picture
  }

  /** Have parts of the scene made again before the next frame: a hidden view costs nothing. */
  private make(...parts: Part[]): void {
    for (const part of parts) this.due.add(part);
    this.request();
  }

  private makeDue(): void {
    if (!this.terrain || this.due.size === 0) return;
    const due = new Set(this.due);
    this.due.clear();
    if (due.has('ground')) this.makeGround(this.terrain.terrain, this.terrain.shade);
    if (due.has('drape')) this.ground!.setDrape(this.drape.image, this.drape.extent);
    if (due.has('lines')) this.makeLines(this.ground!);
    if (due.has('paths')) this.makePaths(this.ground!);
    if (due.has('colours')) this.colour();
    this.setViewports();
  }

  private makeGround(terrain: Terrain, shade: Shade | null): void {
    if (this.ground) {
      this.scene.remove(this.ground.mesh);
      this.ground.dispose();
    }
    this.ground = new Ground(terrain, shade);
    this.scene.add(this.ground.mesh);
    this.camera.setGround(this.ground);
  }

  private makeLines(ground: Ground): void {
    if (this.lines) {
      this.scene.remove(this.lines.group);
      this.lines.dispose();
    }
    this.lines = new Lines(this.drawn, ground);
    this.scene.add(this.lines.group);
    this.legend.showKinds(this.lines.kinds);
  }

  private makePaths(ground: Ground): void {
    const first = this.paths === null;
    if (this.paths) {
      this.scene.remove(this.paths.group);
      this.paths.dispose();
      this.paths = null;
    }
    if (this.trajectories && this.trajectories.first.length > 1) {
      this.paths = new Paths(this.trajectories, ground);
      this.scene.add(this.paths.group);
      if (first) this.camera.propose(this.paths.sample, this.paths.fall);
    }
    this.player.setDuration(this.paths?.duration ?? 0);
  }

  private colour(): void {
    const { end, exceeded } = this.paths && this.trajectories ? this.paths.colourBy(this.colouring, this.trajectories.mass) : { end: 0, exceeded: false };
    this.legend.showScale(this.colouring, end, exceeded);
  }

  private setViewports(): void {
    const { width, height } = this.canvas;
    const ratio = this.renderer.getPixelRatio();
    this.paths?.ribbons.setViewport(width, height, ratio);
    this.lines?.setViewport(width, height, ratio, this.camera.eye.fov);
  }

  /** Request a frame, once until it is drawn. */
  private request(): void {
    if (this.shown && this.frame === 0) this.frame = requestAnimationFrame((now) => {
      this.frame = 0;
      this.draw(now);
    });
  }

  private draw(now: number): void {
    const begun = performance.now();
    this.makeDue();
    const { playing } = this.player;
    this.player.advance(this.before === null ? 0 : Math.min((now - this.before) / 1000, 0.25));
    this.before = playing ? now : null;
    const moving = this.camera.update(now);
    this.paths?.setTime(this.player.shown, this.camera.eye, this.canvas.clientHeight);
    (this.needle.firstElementChild as SVGElement).style.transform = `rotate(${-this.camera.heading}rad)`;
    this.noteCost(performance.now() - begun, now);
    this.renderer.render(this.scene, this.camera.eye);
    if (moving || this.player.playing) this.request();
  }

  /** Keep how long the script took to prepare a frame [ms], without the drawing, and when, for benchmarks. */
  private noteCost(cost: number, now: number): void {
    this.frames.push({ cost, now, highest: this.paths?.highest ?? -Infinity });
    if (this.frames.length > FRAMES) this.frames.shift();
  }
}
