// SPDX-License-Identifier: BSD-3-Clause
// Picture of the map: its canvases stacked, with title, legend, scale and north arrow.
import { css, viridis } from '../colours';
import { nameOfMap, spread, withUnit } from '../legend';
import type { BatchMessage, HazardMessage, OverlayHeader, Welcome } from '../protocol';
import { decimal, say } from '../texts';
import type { MapView } from './map_view';
import { scaleBar } from './scale';

interface Caption {
  title: string;
  note: string;
  result: OverlayHeader | null;
  /** Hazard classes shown instead of the result. */
  classes: HazardMessage['classes'] | null;
}

/** Caption of a picture: case, number of boulders, and time. */
export function captionOf({ title, file, language }: Welcome, batch: BatchMessage | null, preliminary: boolean, classes: Caption['classes']): Caption {
  const notes = [
    batch && say('app.run.of_result', { n: batch.boulders }),
    preliminary && say('app.preliminary'),
    new Date().toLocaleDateString(language, { dateStyle: 'long' }),
  ];
  return { title: title || file, note: notes.filter(Boolean).join(' · '), result: batch?.overlay ?? null, classes };
}

const BAND = 84; // height of the caption
const MARGIN = 16;
const FONT = 'system-ui, sans-serif';

export function drawPicture(view: MapView, caption: Caption): HTMLCanvasElement {
  const [width = 1, height = 1] = view.map.getSize() ?? [];
  const ratio = Math.max(1, window.devicePixelRatio);
  const picture = document.createElement('canvas');
  picture.width = width * ratio;
  picture.height = (height + BAND) * ratio;
  const context = picture.getContext('2d');
  if (!context) return picture;
  context.scale(ratio, ratio);
  context.fillStyle = '#fff';
  context.fillRect(0, 0, width, height + BAND);
  drawLayers(context, view, ratio, width, height);
  context.translate(0, height);
  drawCaption(context, caption, width, view.map.getView().getResolution() ?? 1);
  return picture;
}

function drawLayers(context: CanvasRenderingContext2D, view: MapView, ratio: number, width: number, height: number): void {
  context.save();
  context.beginPath();
  context.rect(0, 0, width, height);
  context.clip();
  for (const canvas of view.target.querySelectorAll<HTMLCanvasElement>('.ol-layers canvas')) {
    if (!canvas.width || canvas.hidden) continue;
    const moved = new DOMMatrix(canvas.style.transform || `scale(${1 / ratio})`);
    context.save();
    context.globalAlpha = Number(canvas.parentElement?.style.opacity || canvas.style.opacity || 1);
    context.imageSmoothingEnabled = !canvas.classList.contains('cells');
    context.transform(moved.a, moved.b, moved.c, moved.d, moved.e, moved.f);
    context.drawImage(canvas, 0, 0);
    context.restore();
  }
  context.restore();
}

function drawCaption(context: CanvasRenderingContext2D, { title, note, result, classes }: Caption, width: number, resolution: number): void {
  context.fillStyle = '#111827';
  context.textBaseline = 'top';
  context.font = `600 15px ${FONT}`;
  context.fillText(title, MARGIN, 14, width * 0.42);
  context.font = `12px ${FONT}`;
  context.fillStyle = '#4b5563';
  context.fillText(note, MARGIN, 37, width * 0.42);
  if (classes) drawClasses(context, classes, width * 0.47);
  else if (result) drawRamp(context, result, width * 0.47, Math.min(280, width * 0.28));
  const bar = scaleBar(resolution, Math.min(140, width * 0.14));
  const left = width - MARGIN - bar.pixels - 34;
  context.fillStyle = '#111827';
  context.fillRect(left, 46, bar.pixels, 4);
  context.textAlign = 'center';
  context.fillText(`${decimal(bar.metres)} m`, left + bar.pixels / 2, 27);
  const x = width - MARGIN - 8;
  context.beginPath();
  context.moveTo(x, 26);
  context.lineTo(x + 7, 50);
  context.lineTo(x, 45);
  context.lineTo(x - 7, 50);
  context.fill();
  context.fillText(say('app.map.north_letter'), x, 11);
}

function drawClasses(context: CanvasRenderingContext2D, classes: HazardMessage['classes'], left: number): void {
  context.textAlign = 'left';
  context.fillStyle = '#111827';
  context.fillText(say('app.legend.hazard'), left, 14);
  classes.slice(1).forEach(([name, colour], k) => {
    const [x, y] = [left + 110 * (k % 2), 34 + 20 * (k >> 1)];
    context.fillStyle = colour;
    context.fillRect(x, y, 14, 11);
    context.fillStyle = '#111827';
    context.fillText(name, x + 20, y, 86);
  });
}

function drawRamp(context: CanvasRenderingContext2D, result: OverlayHeader, left: number, length: number): void {
  context.fillStyle = '#111827';
  context.textAlign = 'left';
  context.fillText(withUnit(nameOfMap(result), result.unit), left, 14, length);
  const colours = context.createLinearGradient(left, 0, left + length, 0);
  for (let k = 0; k <= 15; k++) colours.addColorStop(k / 15, css(viridis(k / 15)));
  context.fillStyle = colours;
  context.fillRect(left, 34, length, 12);
  context.fillStyle = '#111827';
  context.textAlign = 'center';
  for (const { text, place } of spread(result)) {
    const at = left + length * place;
    context.fillRect(at - 0.5, 46, 1, 4);
    context.fillText(text, at, 53);
  }
}

/** Start the download of a picture. */
export function download(picture: HTMLCanvasElement, name: string): void {
  picture.toBlob((blob) => {
    if (!blob) return;
    const link = document.createElement('a');
    link.href = URL.createObjectURL(blob);
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
  }, 'image/png');
}
