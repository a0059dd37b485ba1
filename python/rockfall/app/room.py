# SPDX-License-Identifier: BSD-3-Clause
"""The opened file and the pages that look at it: the first of them writes, the others read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from threading import RLock
from typing import Any

from rockfall.app.document import Document, Site
from rockfall.app.features import MAX_FEATURES, MAX_VERTICES
from rockfall.app.live import MAX_TRAJECTORIES, Live, View
from rockfall.app.messages import MAX_BYTES, Message, Refused, read_message, text_message
from rockfall.app.opening import open_site
from rockfall.app.pictures import BY_SOURCE, map_choices
from rockfall.language import LANGUAGES, say, speaking, texts_of
from rockfall.result.variables import MAP
from rockfall.version import __version__

FIRST_MAP = "passages"
MAX_REVISION = 2**53
_KEPT = ("terrain", "background", "state", "batch", "trajectories")  # sent to a page that enters


class Client:
    """A page: where messages to it go."""

    def __init__(self, send: Callable[[str, Message], None]) -> None:
        self.send, self.language = send, "en"


class Room:
    """An opened file, its live run, and the pages. Methods may be called from any thread."""

    def __init__(self, path: Path | None, language: str = "") -> None:
        self._language, self._lock = language, RLock()
        self._clients: list[Client] = []
        self._writer: Client | None = None
        self._last: dict[str, list[Message]] = {}
        self._live: Live | None = None
        self._site: Site | None = None
        if path is not None:
            self._open(path)

    @property
    def is_empty(self) -> bool:
        """Return True if no page is there."""
        return not self._clients

    def close(self) -> None:
        """End the live run."""
        if self._live is not None:
            self._live.close()

    def enter(self, client: Client, hello: dict[str, Any]) -> None:
        """Welcome a page, and send it what the others have."""
        with self._lock:
            wish = hello.get("language")
            client.language = self._language or (wish if wish in LANGUAGES else LANGUAGES[0])
            self._clients.append(client)
            if self._writer is None:
                self._writer = client
            client.send("welcome", self._welcome(client))
            for kind in _KEPT:
                for message in self._last.get(kind, []):
                    client.send("kept", message)
            if self._live is not None and self._writer is client:
                self._live.language = client.language

    def leave(self, client: Client) -> None:
        """Forget a page; the next one may write."""
        with self._lock:
            self._clients.remove(client)
            if self._writer is client:
                self._writer = None
                if self._clients:
                    self._set_writer(self._clients[0])

    def take(self, client: Client, text: str) -> None:
        """Do what a page asks for."""
        with self._lock, speaking(client.language):
            try:
                message = read_message(text)
                kind = message["type"]
                if kind == "take_over":
                    self._set_writer(client)
                elif kind not in _ACTIONS:
                    raise Refused(say("app.server_unknown", name=kind[:40]))
                elif client is not self._writer:
                    raise Refused(say("app.server_reader"))
                else:
                    _ACTIONS[kind](self, message)
            except Refused as error:
                task = message["type"][:40] if "message" in locals() else ""
                refusal = {**error.entry(), "task": task, "exists": False}
                client.send("refused", text_message("refused", **refusal))

    def _set_writer(self, client: Client) -> None:
        before, self._writer = self._writer, client
        for one in {before, client} - {None}:
            assert one is not None
            one.send("role", text_message("role", writer=one is client))

    def _open(self, path: Path) -> None:
        site, document = open_site(path)
        maps = document.settings.get("output", {}).get("maps", [])
        shown = next((one for one in maps if one in _live_maps(site)), FIRST_MAP)
        view = View(shown, 100)
        self._last.clear()
        self._site = site
        self._live = Live(site, document, view, self._send, self._language or LANGUAGES[0])
        self._live.start()

    def _send(self, kind: str, message: Message) -> None:
        """Send to all pages, and keep for those that come later."""
        with self._lock:
            if kind == "more":
                self._last.setdefault("trajectories", []).append(message)
            elif kind in _KEPT:
                self._last[kind] = [message]
            if kind == "state":
                self._last.pop("batch", None)
                self._last.pop("trajectories", None)
            for client in self._clients:
                client.send(kind, message)

    def _welcome(self, client: Client) -> str:
        site, live = self._site, self._live
        about: dict[str, Any] = {
            "mode": "start", "title": "", "file": "", "folder": "", "revision": 0, "maps": [],
            "document": Document().content(), "forms": {"settings": {}, "layers": {}},
            "view": {"map": "", "trajectories": 0},
        }  # fmt: skip
        if site is not None and live is not None:
            forms = {
                "settings": {g: _form(one) for g, one in site.settings_forms.items()},
                "layers": {g: _form(one) for g, one in site.layer_forms.items()},
            }
            about = {
                "mode": site.mode, "title": live.document.settings.get("case", {}).get("title", ""),
                "file": site.file.name, "folder": str(site.folder), "forms": forms,
                "revision": live.revision, "document": live.document.content(),
                "maps": map_choices(_live_maps(site)),
                "view": {"map": live.view.map, "trajectories": live.view.trajectories},
            }  # fmt: skip
        return text_message(
            "welcome", writer=client is self._writer, version=__version__,
            language=client.language, languages=LANGUAGES, texts=texts_of(client.language, "app"),
            recent=[], limits={
                "features": MAX_FEATURES, "vertices": MAX_VERTICES, "bytes": MAX_BYTES,
                "trajectories": MAX_TRAJECTORIES,
            },
            **about,
        )  # fmt: skip

    def _edit(self, message: dict[str, Any]) -> None:
        revision = message.get("revision")
        layers, settings = message.get("layers", {}), message.get("settings", {})
        if not isinstance(revision, int) or not 0 < revision <= MAX_REVISION:
            raise Refused(say("app.server_wrong_type", name="revision"))
        if not isinstance(layers, dict) or not isinstance(settings, dict):
            raise Refused(say("app.server_wrong_type", name="edit"))
        self._running().edit(revision, layers, settings)

    def _view(self, message: dict[str, Any]) -> None:
        shown, number = message.get("map", ""), message.get("trajectories", 0)
        live = self._running()
        assert self._site is not None
        if shown != "" and shown not in _live_maps(self._site):
            raise Refused(say("app.server_wrong_type", name="map"))
        if type(number) is not int or not 0 <= number <= MAX_TRAJECTORIES:
            raise Refused(say("app.server_wrong_type", name="trajectories"))
        live.look(View(shown, number))

    def _running(self) -> Live:
        if self._live is None:
            raise Refused(say("app.server_nothing_open"))
        return self._live


def _form(form: dict[str, Any]) -> list[dict[str, Any]]:
    return [field.about() for field in form.values()]


def _live_maps(site: Site) -> list[str]:
    """Maps that a live run can show: runs in the order of the sources would be no samples."""
    forest = "forest" in site.opened
    return [
        name for name in MAP if name not in BY_SOURCE and (forest or not name.startswith("tree_"))
    ]


_ACTIONS: dict[str, Callable[[Room, dict[str, Any]], None]] = {
    "edit": Room._edit,
    "view": Room._view,
    "run": lambda room, _: room._running().run(True),
    "stop": lambda room, _: room._running().run(False),
}
