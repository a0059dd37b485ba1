// SPDX-License-Identifier: BSD-3-Clause
// Dialog for choosing the ground of a document that starts from a DEM.
import { button, element, uniqueId } from './dom';
import type { GroundChoice } from './protocol';
import { say } from './texts';

export class GroundDialog {
  readonly dialog = element('dialog', { class: 'grounds' });

  constructor(grounds: readonly GroundChoice[], choose: (ground: GroundChoice) => void) {
    const title = element('h2', { id: uniqueId('dialog') }, say('app.ground.title'));
    const choices = grounds.map((ground) => {
      const about = [element('b', {}, ground.name), element('small', {}, say(`app.ground.${ground.name}`))];
      const take = (): void => {
        this.dialog.close();
        choose(ground);
      };
      return element('li', {}, button(about, take, { class: 'recent', attributes: { 'data-ground': ground.name } }));
    });
    this.dialog.setAttribute('aria-labelledby', title.id);
    this.dialog.append(title, element('p', { class: 'hint' }, say('app.ground.hint')), element('ul', {}, ...choices));
  }

  open(): void {
    if (!this.dialog.open) this.dialog.showModal();
  }
}
