# SPDX-License-Identifier: BSD-3-Clause
"""Products of a saved case: it is run afresh, so that nothing comes from a live tally, and its
result is written, with a report or layers."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from threading import Event, Thread
from typing import Any

from rockfall.app.document import Site
from rockfall.app.messages import Message, fault_message, text_message
from rockfall.app.places import without_files
from rockfall.case import read_case
from rockfall.errors import RockfallError
from rockfall.interrupts import Stopped, check_stop, stopped_by
from rockfall.io.output_files import overwriting
from rockfall.language import say, speaking
from rockfall.result.dataset import write_result
from rockfall.result.export import export
from rockfall.session.session import open_session

REPORT, EXPORT = "report", "export"
TELL_SECONDS = 0.25  # between messages on the progress


def outputs(task: str, name: str) -> list[str]:
    """Names of the files and folders that a task writes besides the case."""
    return [f"{name}.nc", f"{name}.html" if task == REPORT else f"{name}_layers"]


class Task:
    """A thread that runs a saved case and makes a product of it, until cancelled."""

    def __init__(
        self, kind: str, site: Site, name: str, overwrite: bool, language: str,
        send: Callable[[str, Message], None], then: Callable[[], None],
    ) -> None:  # fmt: skip
        self._kind, self._site, self.name, self._overwrite = kind, site, name, overwrite
        self._language, self._send, self._then = language, send, then
        self._cancel = Event()
        self._thread = Thread(target=self._work, name=kind, daemon=True)

    def start(self) -> None:
        """Begin to work."""
        self._thread.start()

    def cancel(self) -> None:
        """Stop as soon as possible, without files."""
        self._cancel.set()

    def wait(self) -> None:
        """Wait for the thread to end."""
        self._thread.join()

    def _work(self) -> None:
        with speaking(self._language), overwriting(self._overwrite), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # those of the case are shown already
            try:
                with stopped_by(self._cancel.is_set):
                    end = self._about("done", files=self._make())
            except RockfallError as error:
                end = self._refusal(without_files(str(error), self._site))
            except Stopped:
                end = self._refusal(say("app.server_cancelled"))
            except Exception as error:  # the page is to know of it, and the server to live
                end = "fault", fault_message(error)
            self._then()
            self._send(*end)

    def _make(self) -> list[str]:
        folder, name = self._site.folder, self.name
        result, product = outputs(self._kind, name)
        path = folder / result
        write_result(self._run(folder / f"{name}.nml"), path)
        self._phase(say("app.server_drawing" if self._kind == REPORT else "app.server_writing"))
        if self._kind == REPORT:
            report = import_module("rockfall.products").report  # as long as all else to import
            report(path, folder / product, language=self._language)
            return [result, product]
        return [result, *(f"{product}/{one.name}" for one in export(path, folder / product))]

    def _run(self, path: Path) -> Any:
        """Result of the case in a file."""
        begun, what = time.perf_counter(), say("app.server_simulating")
        case = read_case(path).replace(variant=[])
        with open_session(case) as session:
            for batch in session.run(cancel=self._cancel, batch_seconds=TELL_SECONDS):
                spent, total = time.perf_counter() - begun, batch.total
                left = spent / batch.boulders * (total - batch.boulders)
                self._phase(what, batch.boulders, total, left)
                if batch.complete:
                    return batch.dataset()
        raise Stopped

    def _phase(self, text: str, done: int = 0, total: int = 0, left: float | None = None) -> None:
        """Tell how far the work is; total 0: not known. End it if it is cancelled."""
        check_stop()
        self._send(*self._about("progress", phase=text, done=done, total=total, seconds_left=left))

    def _refusal(self, text: str) -> tuple[str, str]:
        return self._about("refused", text=text, exists=False)

    def _about(self, kind: str, **content: Any) -> tuple[str, str]:
        """Kind and message on the task."""
        return kind, text_message(kind, task=self._kind, **content)
