// SPDX-License-Identifier: BSD-3-Clause
// Map tools as buttons, with their shortcut letters.
import { button, element } from './dom';
import { TOOLS, type Tool } from './draw';
import { icon } from './icons';
import { say } from './texts';

export class Toolbar {
  readonly root = element('nav', { class: 'tools', label: say('app.tools') });
  private readonly buttons = new Map<Tool, HTMLButtonElement>();

  constructor(tools: readonly Tool[], use: (tool: Tool) => void) {
    for (const tool of tools) {
      const { letter } = TOOLS[tool];
      const text = say(`app.tool.${tool}`);
      const made = button([icon(tool), element('kbd', {}, letter)], () => use(tool), {
        title: `${text} (${letter})`,
        label: text,
        attributes: { 'aria-keyshortcuts': letter, 'aria-pressed': 'false', 'data-tool': tool },
      });
      this.buttons.set(tool, made);
      this.root.append(made);
    }
  }

  show(tool: Tool, may: (tool: Tool) => boolean): void {
    for (const [name, made] of this.buttons) {
      made.setAttribute('aria-pressed', String(name === tool));
      made.disabled = !may(name);
    }
  }
}
