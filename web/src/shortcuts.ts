// SPDX-License-Identifier: BSD-3-Clause
// Keyboard shortcuts: letters for tools, Ctrl for undo, redo and save, arrows for the selected feature.
import { TOOLS, type Drawer, type Tool } from './draw';

interface Actions {
  undo(): void;
  redo(): void;
  save(): void;
  fit(): void;
  /** True while the map is shown and letters select tools. */
  onMap(): boolean;
  /** Distance [m] by which an arrow key moves the selected feature. */
  step(): number;
}

const ARROWS: Readonly<Record<string, readonly [number, number]>> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, 1],
  ArrowDown: [0, -1],
};

/** Handle keys until the signal is aborted. */
export function listenToKeys(drawer: Drawer, map: HTMLElement, tools: readonly Tool[], actions: Actions, signal: AbortSignal): void {
  const letters = new Map(tools.map((tool) => [TOOLS[tool].letter.toLowerCase(), tool]));
  document.addEventListener(
    'keydown',
    (event) => {
      if (event.defaultPrevented || document.querySelector('dialog[open]')) return;
      const typing =
        event.target instanceof HTMLElement &&
        event.target.closest('input:not([type=checkbox]):not([type=range]), textarea, select') !== null;
      const key = event.key.toLowerCase();
      if (event.ctrlKey || event.metaKey) {
        const undo = (): unknown => drawer.undoVertex() || actions.undo();
        const edits = typing ? {} : { y: actions.redo, z: event.shiftKey ? actions.redo : undo };
        const action = ({ s: actions.save, ...edits } as Record<string, (() => unknown) | undefined>)[key];
        if (!action) return;
        event.preventDefault();
        action();
        return;
      }
      if (typing || event.altKey || !actions.onMap()) return;
      const tool = letters.get(key);
      if (tool) drawer.use(tool);
      else if (key === 'escape') drawer.escape();
      else if (key === 'enter' && event.target === map) drawer.finishDrawing();
      else if (key === 'delete' || key === 'backspace') drawer.removeSelected();
      else if (key === 'f') actions.fit();
      else return;
      event.preventDefault();
    },
    { signal },
  );
  // Capture keys before the map, which would pan.
  map.addEventListener(
    'keydown',
    (event) => {
      const arrow = ARROWS[event.key];
      if (!arrow || event.ctrlKey || event.altKey || event.metaKey) return;
      const step = actions.step() * (event.shiftKey ? 10 : 1);
      if (!drawer.nudge(arrow[0] * step, arrow[1] * step)) return;
      event.preventDefault();
      event.stopPropagation();
    },
    { signal, capture: true },
  );
}
