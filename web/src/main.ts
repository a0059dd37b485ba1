// SPDX-License-Identifier: BSD-3-Clause
// Entry of the page: opens the connection, and forwards messages to the window of the case.
import 'ol/ol.css';
import './style.css';
import { CaseWindow } from './case_window';
import { Connection } from './connection';
import { button, element } from './dom';
import type { Binary, Text, Welcome } from './protocol';
import { startPage } from './start';
import { say, setTexts } from './texts';

const root = document.getElementById('app') as HTMLElement;
let current: CaseWindow | null = null;

const connection = new Connection({ text: receive, binary, lost });

Object.defineProperty(window, 'rockfall', { get: () => current?.handles ?? { preliminary: true, revision: 0 } });

function receive(message: Text): void {
  if (message.type === 'welcome') welcome(message);
  else if (message.type === 'fault' && !current)
    root.replaceChildren(element('p', { class: 'alert red' }, message.text));
  else current?.receive(message);
}

function binary(message: Binary): void {
  current?.receiveBinary(message);
}

function welcome(message: Welcome): void {
  setTexts(message.texts, message.language);
  document.documentElement.lang = message.language;
  document.title = message.title ? `${message.title} – rockfall` : 'rockfall';
  const variants = current?.variantsFor(message) ?? null; // reuse the variants of a lost connection
  current?.dispose();
  current = null;
  if (message.mode === 'start')
    root.replaceChildren(startPage(message, (index) => connection.send({ type: 'open_recent', index })));
  else current = new CaseWindow(root, message, connection, variants);
}

/** Show above the content that the connection is lost. */
function lost(reason: 'refused' | 'closed'): void {
  // Before the first message the page has no texts; the notice is then in English.
  const known = say('app.lost') !== 'app.lost';
  const text = known
    ? say(reason === 'refused' ? 'app.refused' : 'app.lost')
    : 'No connection to rockfall. Start `rockfall app` again, and open the address that it prints.';
  const notice = element(
    'div',
    { class: 'lost', attributes: { role: 'alertdialog', 'aria-label': text } },
    element('p', {}, text),
    button(
      known ? say('app.retry') : 'Try again',
      () => {
        notice.remove();
        connection.retry();
      },
      { class: 'primary' },
    ),
  );
  document.querySelectorAll('.lost').forEach((old) => old.remove());
  document.body.append(notice);
}

connection.connect();
