# SPDX-License-Identifier: BSD-3-Clause
"""Live runs of a document: one thread owns the session, and the latest edit wins."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from threading import Condition, Event, Thread
from typing import Any

import xarray as xr

from rockfall.analysis.lines.section import PATHS
from rockfall.app.edited.document import Document, Runnable, Site, runnable, with_output
from rockfall.app.edited.features import Frame
from rockfall.app.edited.places import entry_of, without_files
from rockfall.app.messages import Refused, fault_message, text_message
from rockfall.app.pictures import BY_SOURCE, Ground, View, background_message
from rockfall.app.progress import Progress, Send
from rockfall.app.sections import MAPS
from rockfall.app.study_messages import hazard_message, hazard_of, origins_message, point_of
from rockfall.app.surroundings import Offer, stands_of
from rockfall.case import REPEATABLE, Case, key_table
from rockfall.case.variants import BASE
from rockfall.case.zones import case_zones
from rockfall.errors import RockfallError
from rockfall.interrupts import Stopped, stopped_by
from rockfall.io.rasters.dem import read_dem
from rockfall.language import say, speaking, translated
from rockfall.result.variables import EXCEEDED, MAP
from rockfall.scene.rules.plausible import input_warnings
from rockfall.session.session import Session, open_session, scene_of
from rockfall.simulation.simulate import Interrupted

STEP = 0.05  # kernel time between checks for new requests [s]
FIRST_MAP = "passages"


@dataclass
class _Pending:
    """Requests since the last check."""

    document: Document | None = None
    revision: int = 0
    error: Refused | None = None  # error of the latest edit
    view: View | None = None


class Live:
    """A document that runs after each edit. Methods may be called from any thread."""

    def __init__(self, site: Site, document: Document, send: Send, language: str = "en") -> None:
        self.site, self.document, self.revision = site, document, 0
        self.language, self.running = language, True
        maps = document.settings.get("output", {}).get("maps", [])
        self.view = View(next((name for name in maps if name in self.maps), FIRST_MAP))
        self.error: Refused | None = None  # error of the latest edit
        self.offer: Offer | None = None  # selected objects at risk, if any
        self._send, self._wake, self._cancel = send, Condition(), Event()
        self._closing = Event()
        self._pending = _Pending(document=document)
        self._closed = False
        self._session: Session | None = None
        self._frames: dict[str, Frame] = {}
        self._layers: dict[str, Any] = {}
        self._ground: Ground | None = None
        self._seen: tuple[Any, ...] = (None,) * 4  # non-feature parts sent to the page
        self._progress: Progress | None = None
        self._aside: Progress | None = None  # run of a variant for comparison
        self._made: tuple[Case, dict[str, Any]] | None = None  # case and layers of the document
        self._hazard: xr.Dataset | None = None  # hazard of the current result, if any
        self._is_hazard_due, self._told_origin = False, ""
        self._compared: list[Document] = []  # variants waiting for their run
        self._thread = Thread(target=self._work, name="live", daemon=True)

    @property
    def maps(self) -> list[str]:
        """Maps that the page can show: not maps by source, because a partial run would follow the
        order of the sources and would not be representative."""
        documents = self.site.variants.documents.values()
        states = (self.site.opened, *(document.settings for document in documents))
        forest = any("forest" in settings for settings in states)
        return [
            name for name in MAP
            if name not in (*BY_SOURCE, *EXCEEDED) and (forest or not name.startswith("tree_"))
        ]  # fmt: skip

    @property
    def scenarios(self) -> int:
        """Number of scenarios that can be run for a hazard."""
        return len(self.site.kept.get("scenario", []))

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """Cancel the run, and wait for the thread."""
        with self._wake:
            self._closed = True
            self._cancel.set()
            self._closing.set()
            self._wake.notify()
        self._thread.join()

    def edit(
        self, revision: int, layers: Mapping[str, Any], settings: Mapping[str, Any], variant: str,
        whole: bool = False,
    ) -> None:  # fmt: skip
        """Replace layers and groups of the document, and run it. After a refused edit, the
        document and the page differ: no run starts until an edit has the `whole` document."""
        with self._wake:
            try:
                if self.error is not None and not whole:
                    raise self.error
                before = Document() if whole else self.document
                self.document = self.site.edited(before, layers, settings, variant)
                self.error = None
            except Refused as error:
                self.error = error
            self._pending.error = self.error
            self.revision = revision
            self._pending.document, self._pending.revision = self.document, revision
            self._cancel.set()
            self._wake.notify()

    def latest(self) -> tuple[Document, int]:
        """Document and its revision; raises Refused if the latest edit was refused."""
        with self._wake:
            if self.error is not None:
                raise self.error
            return self.document, self.revision

    def look(self, view: View) -> None:
        """Set the selected map, lines or section; another map or a first section needs a run."""
        with self._wake:
            if view.map != self.view.map or (view.section and not self.view.section):
                self._pending.document = self._pending.document or self.document
                self._pending.revision = self.revision
                self._cancel.set()
            of_hazard = view.hazard, view.objects
            if of_hazard != (self.view.hazard, self.view.objects):
                self._is_hazard_due = view.hazard and self._made is not None
                self._hazard = None
            self.view = self._pending.view = view
            self._wake.notify()

    def speak(self, language: str) -> None:
        """Set the language and resend all texts."""
        with self._wake:
            if language != self.language:
                self.language = language
                self._pending.document = self._pending.document or self.document
                self._pending.revision, self._pending.error = self.revision, self.error
                self._cancel.set()
                self._wake.notify()

    def compare(self, variant: str) -> None:
        """Run a variant of the opened case, to compare it with the document."""
        with self._wake:
            self._compared.append(self.site.variants.documents[variant])
            self._wake.notify()

    def run(self, running: bool) -> None:
        """Continue or pause the run."""
        with self._wake:
            self.running = running
            self._wake.notify()

    def _work(self) -> None:
        if self._works(self._show_terrain):
            while not self._closed:
                if not self._works(self._step):
                    self._progress = self._aside = None
        if self._session is not None:
            self._session.close()

    def _works(self, work: Callable[[], None]) -> bool:
        """Run `work`; report an error to the page and return False, so that editing continues."""
        try:
            work()
            return True
        except RockfallError as error:  # a file has changed since it was opened
            self._send("fault", text_message("fault", text=without_files(str(error), self.site)))
        except Exception as error:
            self._send("fault", fault_message(error))
        return False

    def _show_terrain(self) -> None:
        dem = self.site.folder / self.site.opened["terrain"]["dem"]
        z, grid = read_dem(dem)
        self._ground = Ground(z, grid)
        self._send("terrain", self._ground.message())

    def _step(self) -> None:
        """Do pending work, else advance the run."""
        with self._wake:
            while not self._closed and not self._has_work():
                self._wake.wait()
            if self._closed:
                return
            pending, self._pending = self._pending, _Pending()
            if pending.document is not None:
                self._cancel.clear()
        if pending.document is not None:
            with speaking(self.language):
                self._take(pending.document, pending.revision, pending.error)
        elif pending.view is not None and self._progress is not None:
            self._progress.look(pending.view)
            if self.view.origin != self._told_origin:
                self._tell_origins()
        elif self._progress is not None and self._progress.has_work(self.running):
            self._progress.over = not self._progress.step(self.running)
        elif self._is_hazard_due and self.running:
            self._run_hazard()
        if self._aside is not None:
            self._aside = self._aside if self._aside.step(True) else None
        elif self._compared:
            with speaking(self.language):
                self._begin_aside(self._compared.pop(0))

    def _has_work(self) -> bool:
        pending, progress = self._pending, self._progress
        goes_on = progress is not None and progress.has_work(self.running)
        goes_on = goes_on or (self._is_hazard_due and self.running)
        wanted = pending.document, pending.view, self._aside
        return goes_on or bool(self._compared) or any(work is not None for work in wanted)

    def _take(self, document: Document, revision: int, error: Refused | None) -> None:
        """Accept a document and report its errors; start its run if there are none."""
        self._progress = self._made = self._hazard = None
        self._is_hazard_due = False
        errors: list[dict[str, str]] = []
        warnings: list[str] = []
        if error is not None:
            errors = [error.entry()]
        else:
            try:
                made = runnable(self.site, document)
                self._change(made)
                assert self._session is not None
                warnings = [
                    f"{without_files(where, self.site)}: {translated(text)}"
                    for where, text in input_warnings(scene_of(self._session))
                ]
                if self.site.variants.base and not document.variant:
                    warnings.append(say("app.server_base", name=BASE))
                warnings += [
                    say("app.server_variant", name=name, group=f"&{group}")
                    for name, group in self.site.variants.others.items()
                ]
            except Refused as refused:
                errors = [refused.entry()]
            except RockfallError as refusal:
                errors = [entry_of(str(refusal), self.site, document)]
        fields: dict[str, Any] = {"revision": revision, "errors": errors, "warnings": warnings}
        fields |= {"refused": error is not None, "running": self.running}
        self._send("state", text_message("state", **fields))
        if not errors:
            assert self._session is not None and self._ground is not None
            self._show_background(made)
            self._progress = self._begin(self._cancel, {"revision": revision}, self._send)
            frames = {name: self._frames[name] for name in made.layers}
            self._made, self._is_hazard_due = (made.case, frames), self.view.hazard

    def _run_hazard(self) -> None:
        """Run the scenarios and send their hazard; a change of the document stops the run."""
        assert self._made is not None
        self._is_hazard_due = False
        fields = {"revision": self.revision}
        self._send("hazard", text_message("hazard_begun", **fields))
        try:
            with speaking(self.language), stopped_by(self._cancel.is_set):
                self._hazard = hazard_of(*self._made, self.offer, self.site.grid)
        except (Stopped, Interrupted):
            self._is_hazard_due = self.view.hazard
        except RockfallError as error:
            text = without_files(str(error), self.site)
            self._send("hazard", text_message("hazard_refused", text=text, **fields))
        else:
            self._send("hazard", hazard_message(self._hazard, self.language, **fields))
            self._tell_origins()

    def _tell_origins(self) -> None:
        """Send the sources of the selected place, unless the document or the place changes
        meanwhile."""
        if self._hazard is None or self._made is None:
            return
        place, revision = self.view.origin, self.revision
        if point_of(self._hazard, place):
            self._send("hazard", text_message("hazard_begun", revision=revision))
        try:
            with stopped_by(lambda: self._cancel.is_set() or self._pending.view is not None):
                told = self._hazard, place, self.language, self._made[1]
                self._send("origins", origins_message(*told, revision=revision))
        except (Stopped, Interrupted):
            self._told_origin = ""
        else:
            self._told_origin = place

    def _begin_aside(self, variant: Document) -> None:
        """Start the run of a variant for comparison."""
        try:
            made = runnable(self.site, variant)
            self._change(made)
        except (Refused, RockfallError) as refusal:
            text = without_files(str(refusal), self.site)
            self._send("refused", text_message("refused", task="compare", text=text, exists=False))
            return
        fields = {"revision": 0, "variant": variant.variant}
        self._send("variant background", self._background(made, variant=variant.variant)[1])
        self._aside = self._begin(
            self._closing, fields, lambda kind, message: self._send(f"variant {kind}", message)
        )

    def _begin(self, cancel: Event, fields: dict[str, Any], send: Send) -> Progress:
        """Start a run of the session."""
        assert self._session is not None and self._ground is not None
        batches = self._session.run(cancel=cancel, batch_seconds=STEP)
        aside = send is not self._send
        view = self.view._replace(section=()) if aside else self.view
        rasters = scene_of(self._session).rasters
        terrain = rasters.z, rasters.grid
        return Progress(batches, fields, view, self._ground, terrain, send, self.language, aside)

    def _show_background(self, made: Runnable) -> None:
        """Send the non-feature parts of the case if they have changed."""
        seen, message = self._background(made)
        if not all(new is other for new, other in zip(seen, self._seen, strict=True)):
            self._seen = seen
            self._send("background", message)

    def _background(self, made: Runnable, **fields: Any) -> tuple[tuple[Any, ...], bytes]:
        """Zones, sources, trees and stands that are not features, to detect changes; and the
        message with them."""
        assert self._session is not None and self._ground is not None
        scene, drawn = scene_of(self._session), made.layers
        zones = None if "zones" in drawn else scene.rasters.zone
        sources = None if "sources" in drawn else scene.x
        rows = {} if zones is None else case_zones(made.case)
        stands = stands_of(made.case, self.site.grid) if scene.stands else []
        fields |= {"stands": stands}
        message = background_message(scene, rows, sources is not None, self._ground, **fields)
        return (zones, sources, scene.trees, scene.stands or None), message

    def _change(self, made: Runnable) -> None:
        """Open or change the session; unchanged layers are passed as the same objects."""
        shown, section = self.view.map, self.view.section
        maps = [*([shown] if shown else []), *(MAPS if section else [])]
        case = with_output(made.case, maps, PATHS if section else 0)
        frames: dict[str, Any] = {}
        for name, layer in made.layers.items():
            if self._layers.get(name) != layer:
                self._layers[name] = layer
                self._frames[name] = layer.frame(self.site.grid.crs)
            frames[name] = self._frames[name]
        if self._session is None:
            self._session = open_session(case, **frames)
            return
        groups = _changes(self._session.case, case)
        none = dict.fromkeys(self._frames.keys() - frames.keys())
        self._session.change(**groups, **frames, **none)


def _changes(before: Case, after: Case) -> dict[str, Any]:
    """Changes that turn the case `before` into `after`."""
    changes: dict[str, Any] = {name: getattr(after, name) for name in REPEATABLE}
    for group in {key.group for key in key_table()} - {*REPEATABLE}:
        changes[group] = dict.fromkeys(getattr(before, group)) | getattr(after, group)
    return changes
