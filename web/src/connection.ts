// SPDX-License-Identifier: BSD-3-Clause
// Socket to the server, or the messages contained in a stand-alone page.
import { decode, isOf, variantOf, type Binary, type Request, type Text } from './protocol';

export interface Receiver {
  text(message: Text): void;
  binary(message: Binary): void;
  /** The connection is lost; no new attempt until `retry`. */
  lost(reason: 'refused' | 'closed'): void;
}

const STORED_KEY = 'rockfall-key';
const STORED_LANGUAGE = 'rockfall-language';
const TRIES = 3;
const REFUSED = 4401; // close code: wrong key

export class Connection {
  /** True if the page contains its messages: it has no server and is read-only. */
  readonly standalone = document.getElementById('messages') !== null;
  private socket: WebSocket | null = null;
  private tries = 0;
  private readonly frame = new Frame((message) => this.receiver.binary(message));

  constructor(private readonly receiver: Receiver) {}

  connect(): void {
    if (this.standalone) {
      this.play();
      return;
    }
    const socket = new WebSocket(`ws://${location.host}/live`);
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => {
      socket.send(JSON.stringify({ type: 'hello', key: takeKey(), language: chosenLanguage() } satisfies Request));
    };
    socket.onmessage = (event: MessageEvent<string | ArrayBuffer>) => {
      this.tries = 0;
      if (typeof event.data === 'string') this.receiver.text(JSON.parse(event.data) as Text);
      else this.frame.add(decode(event.data));
    };
    socket.onclose = (event) => {
      if (this.socket !== socket) return;
      this.socket = null;
      if (event.code === REFUSED) this.receiver.lost('refused');
      else if (++this.tries > TRIES) this.receiver.lost('closed');
      else setTimeout(() => this.connect(), 300 * 2 ** this.tries);
    };
    this.socket = socket;
  }

  /** Reconnect after `lost`. */
  retry(): void {
    this.tries = 0;
    this.connect();
  }

  send(message: Request): void {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  /** Change the language, and reload the page in it. */
  speak(language: string): void {
    localStorage.setItem(STORED_LANGUAGE, language);
    location.reload();
  }

  private play(): void {
    const text = document.getElementById('messages')?.textContent ?? '[]';
    for (const message of JSON.parse(text) as (Text | string)[]) {
      if (typeof message !== 'string') this.receiver.text(message);
      else this.receiver.binary(decode(Uint8Array.from(atob(message), (letter) => letter.charCodeAt(0)).buffer));
    }
  }
}

/** Forwards binary messages once per frame, and only the newest results. */
class Frame {
  private waiting: Binary[] = [];

  constructor(private readonly handle: (message: Binary) => void) {}

  add(message: Binary): void {
    if (this.waiting.length === 0) {
      if (document.hidden) setTimeout(() => this.flush(), 100);
      else requestAnimationFrame(() => this.flush());
    }
    this.waiting = this.waiting.filter((earlier) => !replaces(message, earlier));
    this.waiting.push(message);
  }

  private flush(): void {
    const messages = this.waiting;
    this.waiting = [];
    messages.forEach(this.handle);
  }
}

function replaces(message: Binary, earlier: Binary): boolean {
  if (isOf(message, 'lines') || (isOf(message, 'trajectories') && message.header.append)) return false;
  const kind = isOf(earlier, 'lines') ? 'batch' : earlier.header.type; // a new batch also replaces earlier lines
  return message.header.type === kind && variantOf(message) === variantOf(earlier);
}

/** Access key: from the address at first, later from the tab's storage. */
function takeKey(): string {
  const given = new URLSearchParams(location.hash.slice(1)).get('key');
  if (given) {
    sessionStorage.setItem(STORED_KEY, given);
    history.replaceState(null, '', location.pathname);
  }
  return sessionStorage.getItem(STORED_KEY) ?? '';
}

/** Language chosen earlier; '' leaves the choice to the server. */
function chosenLanguage(): string {
  return localStorage.getItem(STORED_LANGUAGE) ?? '';
}
