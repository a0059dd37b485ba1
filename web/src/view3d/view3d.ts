// SPDX-License-Identifier: BSD-3-Clause
// 3-D view of the terrain: trajectories, moving boulders, lines, nets and dams.
import './view3d.css';
import { DirectionalLight, HemisphereLight, Scene, WebGLRenderer } from 'three';
import { element, svg } from '../dom';
import { iconButton, type Icon } from '../icons';
import type { Layers } from '../protocol';
import type { Extent, Shade, Terrain } from '../terrain';
import { say } from '../texts';
import type { Trajectories } from '../trajectories';
import { Camera } from './camera';
import { Legend, type Quantity } from './colours';
import { Ground } from './ground';
import { Lines } from './lines';
import { Paths } from './paths';
import { Player } from './player';

/** Content of a scene. */
export interface SceneContent {
  terrain: Terrain | null;
  shade: Shade | null;
  trajectories: Trajectories | null;
  drape: { image: HTMLCanvasElement; extent: Extent } | null;
  layers: Layers;
}

const FRAMES = 120; // number of frames recorded
const MAX_RATIO = 2; // maximum picture pixels per CSS pixel

/** Create a view that fills its parent. If the browser cannot draw it, show an explanation and return null. */
export function makeView(parent: HTMLElement): View3d | null {
  const canvas = element('canvas', { attributes: { tabindex: '0', role: 'img', 'aria-label': say('app.view3d_keys') } });
  const context = canvas.getContext('webgl2', { alpha: true, antialias: true, powerPreference: 'high-performance' });
  const root = element('div', { class: `view3d ${context ? '' : 'view3d-missing'}` }, context ? canvas : say('app.view3d_no_webgl'));
  parent.append(root);
  return context && new View3d(root, canvas, context);
}

/** Script time of a frame [ms], its start time, and the highest trajectory point drawn [m]. */
export interface Frame {
  cost: number;
  now: number;
  highest: number;
}

type Part = keyof SceneContent | 'colours';

/** 3-D view of a terrain; it draws only while visible, and only after a change. */
export class View3d {
  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  private readonly camera: Camera;
  private readonly player: Player;
  private readonly legend: Legend;
  private readonly needle: SVGElement;
  private readonly resized = new ResizeObserver(() => this.resize());
  private ground: Ground | null = null;
  private lines: Lines | null = null;
  private paths: Paths | null = null;
  private content: SceneContent | null = null;
  private colouring: Quantity = 'speed';
  private readonly due = new Set<Part>();
  private shown = false;
  private frame = 0; // id of the requested frame; 0: none
  readonly frames: Frame[] = [];
  private before: number | null = null; // [ms] time of the last frame while moving

  constructor(private readonly root: HTMLElement, private readonly canvas: HTMLCanvasElement, context: WebGL2RenderingContext) {
    this.renderer = new WebGLRenderer({ canvas, context, antialias: true, alpha: true });
    canvas.addEventListener('webglcontextrestored', () => this.request());
    const sun = new DirectionalLight('#fff6e5', 2.6);
    sun.position.set(-1, 1, 1.4);
    this.scene.add(sun, new HemisphereLight('#dfeaf5', '#a59a8a', 2.2));
    this.camera = new Camera(canvas, () => this.request());
    this.player = new Player(() => this.request());
    this.legend = new Legend((quantity) => {
      this.colouring = quantity;
      this.make('colours');
    });
    const needle = svg('svg', { viewBox: '0 0 24 24', 'aria-hidden': 'true' }, svg('path', { d: 'M12 2l5 10H7z', fill: '#c2185b' }), svg('path', { d: 'M12 22l5-10H7z', fill: '#9aa3ad' }));
    const tool = (name: string, sign: Icon | SVGElement, press: () => void): HTMLButtonElement => iconButton(sign, say(`app.view3d_${name}`), press);
    const tools = element(
      'div',
      { class: 'view3d-tools card' },
      tool('zoom_in', 'plus', () => this.camera.zoom(0.7)),
      tool('zoom_out', 'minus', () => this.camera.zoom(1 / 0.7)),
      tool('north', needle, () => this.camera.faceNorth()),
      tool('whole', 'fit_terrain', () => this.camera.showWhole()),
    );
    this.needle = needle;
    root.append(this.legend.root, tools, this.player.root);
    root.addEventListener('keydown', (event) => {
      if (event.key !== ' ' || event.target !== canvas) return;
      event.preventDefault();
      this.player.toggle();
    });
  }

  /** Adopt changes; a new terrain rebuilds everything. */
  update(content: SceneContent, changed: readonly Part[]): void {
    const before = this.content?.terrain;
    this.content = content;
    if (content.terrain === before) this.make(...changed);
    else this.make('terrain', 'drape', 'layers', 'trajectories');
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
    this.draw(performance.now()); // immediate, because resizing clears the picture
  }

  /** Mark parts of the scene for rebuilding before the next frame; a hidden view costs nothing. */
  private make(...parts: Part[]): void {
    for (const part of parts) this.due.add(part);
    this.request();
  }

  private makeDue(): void {
    if (!this.content?.terrain || this.due.size === 0) return;
    const { terrain, shade, trajectories, drape, layers } = this.content;
    const due = new Set(this.due);
    this.due.clear();
    if (due.has('terrain') && shade) {
      this.ground = this.swap(this.ground, new Ground(terrain, shade));
      this.camera.setGround(this.ground);
    }
    if (!this.ground) return;
    if (due.has('drape')) this.ground.setDrape(drape?.image ?? null, drape?.extent ?? [0, 0, 1, 1]);
    if (due.has('layers')) {
      this.lines = this.swap(this.lines, new Lines(layers, this.ground));
      this.legend.showKinds(this.lines.kinds);
    }
    if (due.has('trajectories')) {
      const first = this.paths === null;
      this.paths = this.swap(this.paths, trajectories && trajectories.first.length > 1 ? new Paths(trajectories, this.ground) : null);
      if (first && this.paths) this.camera.propose(this.paths.sample, this.paths.fall);
      this.player.setDuration(this.paths?.duration ?? 0);
    }
    if (due.has('trajectories') || due.has('colours')) {
      const { end, exceeded } = this.paths?.colourBy(this.colouring) ?? { end: 0, exceeded: false };
      this.legend.showScale(end, exceeded);
    }
    this.setViewports();
  }

  /** Replace a part of the scene. */
  private swap<P extends Ground | Lines | Paths | null>(old: P | null, made: P): P {
    if (old) {
      this.scene.remove(old.root);
      old.dispose();
    }
    if (made) this.scene.add(made.root);
    return made;
  }

  private setViewports(): void {
    const { width, height } = this.canvas;
    const ratio = this.renderer.getPixelRatio();
    this.paths?.ribbons.setViewport(width, height, ratio);
    this.lines?.setViewport(width, height, ratio, this.camera.eye.fov);
  }

  /** Request a frame unless one is pending. */
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
    this.needle.style.transform = `rotate(${-this.camera.heading}rad)`;
    this.noteCost(performance.now() - begun, now);
    this.renderer.render(this.scene, this.camera.eye);
    if (moving || this.player.playing) this.request();
  }

  /** Record the script time [ms] and the start of a frame, for benchmarks. */
  private noteCost(cost: number, now: number): void {
    this.frames.push({ cost, now, highest: this.paths?.highest ?? -Infinity });
    if (this.frames.length > FRAMES) this.frames.shift();
  }
}
