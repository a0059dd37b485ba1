# SPDX-License-Identifier: BSD-3-Clause
"""The opened file and the pages that display it: the first page can edit, other pages only view."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from threading import RLock
from typing import Any, TypeAlias

from rockfall.app.edited.document import Document
from rockfall.app.edited.forms import Form
from rockfall.app.edited.opening import ground_choices, is_result, open_site
from rockfall.app.edited.places import without_files
from rockfall.app.edited.saving import Exists, check_free, check_name, save
from rockfall.app.exhibit import Exhibit
from rockfall.app.live import Live
from rockfall.app.messages import Message, Refused, fault_message, read_message, text_message
from rockfall.app.outbox import Client
from rockfall.app.pictures import View, map_choices
from rockfall.app.recent import note_recent, recent_files
from rockfall.app.surroundings import Given, Offers
from rockfall.app.tasks import EXPORT, REPORT, SIMULATE, Task, outputs, unfinished
from rockfall.app.view_request import view_of
from rockfall.app.web_map import web_map
from rockfall.errors import RockfallError
from rockfall.language import LANGUAGES, say, speaking, texts_of
from rockfall.result.dataset import read_result
from rockfall.version import __version__

MAX_REVISION = 2**53  # largest integer that JSON keeps exact in a browser
KEPT = (
    "terrain",
    "objects",
    "basemap",
    "background",
    "state",
    "batch",
    "lines",
    "trajectories",
    "section",
    "net",
    "hazard",
    "origins",
)  # messages sent to a page on entry
ADDED = {"more": "trajectories", "lines": "lines"}  # kinds that extend a message of another kind
STALE = {
    "state": ("batch", "lines", "trajectories", "section", "net", "hazard", "origins"),
    "batch": ("lines",),
    "hazard": ("origins",),
}  # message kinds that make earlier kinds obsolete

NOTHING = Given()

Shown: TypeAlias = "Live | Exhibit"


class Room:
    """An opened file, its live run, and its pages. Methods may be called from any thread."""

    def __init__(self, path: Path | None, language: str = "", given: Given = NOTHING) -> None:
        if language and language not in LANGUAGES:
            raise RockfallError(f"--language {language}: must be one of {', '.join(LANGUAGES)}")
        self._language, self._lock = language, RLock()
        self._clients: list[Client] = []
        self._writer: Client | None = None
        self._last: dict[str, list[Message]] = {}  # messages of kinds in KEPT
        self._shown: Shown | None = None
        self._task: Task | None = None
        self._given, self._offers = given, Offers({}, {})
        self._wms: dict[str, str] | None = None
        if path is not None:
            self._open(path)

    @property
    def is_empty(self) -> bool:
        """Return True if no page is open."""
        return not self._clients

    @property
    def is_busy(self) -> bool:
        """Return True while a task is in progress."""
        return self._task is not None

    def close(self) -> None:
        """Stop the live run and all other work."""
        if (task := self._task) is not None:
            task.cancel()
            task.wait()
        if self._shown is not None:
            self._shown.close()

    def enter(self, client: Client, hello: dict[str, Any]) -> None:
        """Welcome a page, and send it the current messages."""
        with self._lock:
            wish = hello.get("language")
            client.language = self._language or (wish if wish in LANGUAGES else LANGUAGES[0])
            if self._writer is None:
                self._writer = client
            if self._shown is not None and self._writer is client:
                self._shown.speak(client.language)
            self._clients.append(client)  # earlier messages follow the welcome
            self._welcome(client)

    def leave(self, client: Client) -> None:
        """Remove a page; if it was the editor, the next page becomes the editor."""
        with self._lock:
            if client in self._clients:
                self._clients.remove(client)
            if self._writer is client:
                self._writer = None
                if self._clients:
                    self._set_writer(self._clients[0])

    def take(self, client: Client, text: str) -> None:
        """Perform a request of a page, or report why it failed."""
        with speaking(client.language):
            task = ""
            try:
                message = read_message(text)
                task = message["type"][:40]
                self._take(client, message)
            except (Refused, RockfallError) as error:
                fields = error.entry() if isinstance(error, Refused) else self._entry(error)
                fields |= {"task": task, "exists": isinstance(error, Exists)}  # type: ignore[dict-item]
                client.send("refused", text_message("refused", **fields))
            except Exception as error:  # reported to the page; the connection stays open
                client.send("fault", fault_message(error))

    def _entry(self, error: RockfallError) -> dict[str, str]:
        text = str(error)
        return {"text": without_files(text, self._shown.site) if self._shown else text}

    def _take(self, client: Client, message: dict[str, Any]) -> None:
        kind = message["type"]
        if kind == "take_over":
            with self._lock:
                self._set_writer(client)
            return
        if kind not in _ACTIONS:
            raise Refused(say("app.server_unknown", name=kind[:40]))
        if client is not self._writer:
            raise Refused(say("app.server_reader"))
        _ACTIONS[kind](self, client, message)

    def _set_writer(self, client: Client) -> None:
        """Make a page the editor; it gets the document of the previous editor."""
        before, self._writer = self._writer, client
        if before is not None and before is not client:
            before.send("role", text_message("role", writer=False))
        if self._shown is not None:
            self._shown.speak(client.language)
            client.send("document", document_message(self._shown))
        client.send("role", text_message("role", writer=True))

    def _open(self, path: Path) -> None:
        """Open a file, which replaces the previous one; refuses a missing file."""
        if not path.is_file():
            raise RockfallError(f"{path}: no such file")
        language = self._writer.language if self._writer else self._language or LANGUAGES[0]
        shown: Shown
        if is_result(path):
            shown = Exhibit(read_result(path), path, self._send)
        else:
            shown = Live(*open_site(path), self._send, language)
        offers, given = Offers.of(path.absolute().parent, self._given), self._given
        first = next(iter(offers.objects), "") if given.objects else ""
        basemap = "" if given.basemap is None else given.basemap.name
        shown.offer = offers.objects.get(first)
        shown.view = shown.view._replace(objects=first, basemap=basemap)
        wms = web_map(given.wms, shown.site.grid)
        around = [*offers.messages(shown.view, View(), shown.site.grid)]
        note_recent(path)
        before = self._shown
        if before is not None:
            before.close()
        with self._lock:
            self._last.clear()
            self._shown, self._offers, self._wms = shown, offers, wms
            for client in self._clients:
                self._welcome(client)
        for kind, content in around:
            self._send(kind, content)
        shown.start()

    def _send(self, kind: str, message: Message) -> None:
        """Send to all pages, and keep the message for pages that connect later."""
        with self._lock:
            if kind in ADDED:
                self._last.setdefault(ADDED[kind], []).append(message)
            elif kind in KEPT:
                self._last[kind] = [message]
            for stale in STALE.get(kind, ()):
                self._last.pop(stale, None)
            for client in self._clients:
                client.send(kind, message)

    def _welcome(self, client: Client) -> None:
        """Send a page everything it needs to start."""
        client.recent = recent_files()
        recent = [{"name": path.name, "folder": str(path.parent)} for path in client.recent]
        fields = {
            "offers": self._offers.labels, "wms": self._wms, "writer": client is self._writer,
            "version": __version__, "recent": recent,
            "language": client.language, "languages": LANGUAGES,
            "texts": texts_of(client.language, "app"),
        }  # fmt: skip
        fields |= about_shown(self._shown, client.language)
        client.send("welcome", text_message("welcome", **fields))
        if isinstance(self._shown, Live) and not self.is_busy:
            self._offer_unfinished(self._shown, client.send)
        for kind in KEPT:
            for message in self._last.get(kind, []):
                client.send("kept", message)

    def _edit(self, client: Client, message: dict[str, Any]) -> None:
        revision = message.get("revision")
        layers, settings = message.get("layers", {}), message.get("settings", {})
        variant, whole = message.get("variant", ""), message.get("whole", False)
        if type(revision) is not int or not 0 < revision <= MAX_REVISION:
            raise Refused(say("app.server_wrong_type", name="revision"))
        if not isinstance(layers, dict) or not isinstance(settings, dict):
            raise Refused(say("app.server_wrong_type", name="edit"))
        if not isinstance(whole, bool):
            raise Refused(say("app.server_wrong_type", name="whole"))
        with self._lock:  # results must follow the welcome
            live = self._live()
            live.edit(revision, layers, settings, variant, whole)
            if readers := [reader for reader in self._clients if reader is not client]:
                content = document_message(live)
                for reader in readers:
                    reader.send("document", content)
        if self._task is None:
            live.run(True)  # a change runs at once, even after a pause

    def _view(self, _: Client, message: dict[str, Any]) -> None:
        if self._shown is None:
            raise Refused(say("app.server_nothing_open"))
        shown, offers = self._shown, self._offers
        view = view_of(message, shown.maps, offers)
        for kind, content in offers.messages(view, shown.view, shown.site.grid):
            self._send(kind, content)
        shown.offer = offers.objects.get(view.objects)
        shown.look(view)

    def _compare(self, _: Client, message: dict[str, Any]) -> None:
        live, variant = self._live(), message.get("variant")
        if not isinstance(variant, str) or variant not in live.site.variants.documents:
            raise Refused(say("app.server_wrong_type", name="variant"))
        live.compare(variant)

    def _run(self, running: bool) -> None:
        self._live().run(running)

    def _save(self, message: dict[str, Any], others: Callable[[str], list[str]]) -> str:
        """Save the document and return its name. Unless the page allows overwriting, refuse
        existing files, including those that `others` lists."""
        live, overwrite = self._live(), message.get("overwrite", False)
        name = check_name(message.get("name"))
        if not isinstance(overwrite, bool):
            raise Refused(say("app.server_wrong_type", name="overwrite"))
        document, revision = live.latest()
        with self._lock:
            if self._task is not None and self._task.name == name:
                raise Refused(say("app.server_busy"))  # a task is running the case with this name
            check_free(live.site.folder, others(name), overwrite)
            saved = save(live.site, document, name, overwrite)
        note_recent(saved.files[0])
        fields = {"files": [file.name for file in saved.files], "remark": saved.remark}
        self._send("saved", text_message("saved", **fields, document_revision=revision))
        return name

    def _start_task(self, _: Client, message: dict[str, Any]) -> None:
        kind, live = message["type"], self._live()
        with self._lock:
            if self.is_busy:
                raise Refused(say("app.server_busy"))
            name = self._save(message, lambda name: outputs(kind, name))
            self._begin_task(live, kind, name, message.get("overwrite", False))

    def _resume(self, _: Client, message: dict[str, Any]) -> None:
        live, name = self._live(), check_name(message.get("name"))
        with self._lock:
            if self.is_busy:
                raise Refused(say("app.server_busy"))
            if name not in unfinished(live.site.folder):
                raise Refused(say("app.server_unknown", name=name))
            self._begin_task(live, SIMULATE, name, True, resume=True)

    def _begin_task(self, live: Live, kind: str, name: str, overwrite: bool, **how: bool) -> None:
        was_running, self._task = live.running, Task(
            kind, live.site, name, overwrite, live.language, self._send,
            lambda: self._end_task(live, kind, was_running), **how,
        )  # fmt: skip
        live.run(False)
        self._task.start()

    def _offer_unfinished(self, live: Live, send: Callable[[str, Message], None]) -> None:
        """Send the stopped runs in the folder that the page can resume."""
        runs = [{"name": name, "boulders": n} for name, n in unfinished(live.site.folder).items()]
        send("unfinished", text_message("unfinished", runs=runs))

    def _end_task(self, live: Live, kind: str, was_running: bool) -> None:
        with self._lock:
            self._task = None
            if kind == SIMULATE:
                self._offer_unfinished(live, self._send)
        live.run(was_running)

    def _cancel(self) -> None:
        if (task := self._task) is not None:
            task.cancel()

    def _open_recent(self, client: Client, message: dict[str, Any]) -> None:
        index, files = message.get("index"), client.recent
        if type(index) is not int or not 0 <= index < len(files):
            raise Refused(say("app.server_wrong_type", name="index"))
        if self.is_busy:
            raise Refused(say("app.server_busy"))
        self._open(files[index])

    def _live(self) -> Live:
        if self._shown is None:
            raise Refused(say("app.server_nothing_open"))
        if not isinstance(self._shown, Live):
            raise Refused(say("app.server_result"))
        return self._shown


def about_shown(shown: Shown | None, language: str) -> dict[str, Any]:
    """Part of the welcome message that describes the opened file."""
    if shown is None:
        return {
            "mode": "start", "title": "", "file": "", "folder": "", "revision": 0, "maps": [],
            "scenarios": 0,
            "document": Document().content(), "forms": {"settings": {}, "layers": {}},
            "base": None, "variants": [], "grounds": [],
            "view": View("", 0)._asdict(),
        }  # fmt: skip
    site, document = shown.site, shown.document
    base = site.variants.base
    return {
        "mode": site.mode, "title": document.settings.get("case", {}).get("title", ""),
        "file": site.file.name, "folder": str(site.folder), "revision": shown.revision,
        "maps": map_choices(shown.maps, language), "document": document.content(),
        "scenarios": shown.scenarios,
        "forms": {"settings": _forms(site.settings_forms), "layers": _forms(site.layer_forms)},
        "view": shown.view._asdict(),
        "base": base.content() if base else None, "grounds": ground_choices(),
        "variants": [variant.content() for variant in site.variants.documents.values()],
    }  # fmt: skip


def _forms(forms: dict[str, Form]) -> dict[str, list[dict[str, Any]]]:
    return {name: [field.about() for field in form.values()] for name, form in forms.items()}


def document_message(shown: Shown) -> str:
    """Message `document`: the edited document and its revision."""
    content = shown.document.content()
    return text_message("document", document=content, revision=shown.revision)


_ACTIONS: dict[str, Callable[[Room, Client, dict[str, Any]], object]] = {
    "edit": Room._edit,
    "view": Room._view,
    "compare": Room._compare,
    "run": lambda room, *_: room._run(True),
    "stop": lambda room, *_: room._run(False),
    "save": lambda room, _, message: room._save(message, lambda _: []),
    REPORT: Room._start_task,
    EXPORT: Room._start_task,
    SIMULATE: Room._start_task,
    "resume": Room._resume,
    "cancel": lambda room, *_: room._cancel(),
    "open_recent": Room._open_recent,
}
