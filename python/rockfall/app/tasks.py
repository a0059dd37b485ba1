# SPDX-License-Identifier: BSD-3-Clause
"""Products of a saved case: its result alone, or with a report or layers. The case runs from the
start, without live tallies. A run for the result alone uses the checkpoints of `rockfall run`, so
that either program can resume it."""

import time
import warnings
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from threading import Event, Thread
from typing import Any

from rockfall.app.edited.document import Site
from rockfall.app.edited.places import without_files
from rockfall.app.messages import Message, fault_message, text_message
from rockfall.case import Case, read_case
from rockfall.case.files import input_files
from rockfall.errors import RockfallError
from rockfall.files.export import export
from rockfall.interrupts import Stopped, check_stop, stopped_by
from rockfall.io.output_files import check_result_path, overwriting
from rockfall.language import say, speaking
from rockfall.result.dataset import write_result
from rockfall.result.samples import simulated
from rockfall.scene.read import read_scene
from rockfall.session.session import open_session
from rockfall.simulation.memory import machine_memory
from rockfall.simulation.parts.checkpoint import Checkpoint, checkpoint_of
from rockfall.simulation.parts.lock import locked
from rockfall.simulation.parts.part_file import boulders_in
from rockfall.simulation.simulate import Interrupted, simulate
from rockfall.simulation.tally import Tally

REPORT, EXPORT, SIMULATE = "report", "export", "simulate"
TELL_SECONDS = 0.25  # interval between progress messages
SAVE_SECONDS = 60.0  # between checkpoints
MAX_UNFINISHED = 5  # maximum number of runs offered


def outputs(task: str, name: str) -> list[str]:
    """Names of the files and folders that a task writes in addition to the case, result first."""
    result = Path(f"{name}.nc")
    others = {
        REPORT: f"{name}.html", EXPORT: f"{name}_layers", SIMULATE: str(checkpoint_of(result)),
    }  # fmt: skip
    return [str(result), others[task]]


def unfinished(folder: Path) -> dict[str, int]:
    """Names of the stopped runs in a folder, latest first, and their numbers of boulders."""
    suffix = str(checkpoint_of(Path(".nc")))
    files = [file for file in folder.glob(f"*{suffix}") if file.is_file()]
    files.sort(key=lambda file: file.stat().st_mtime, reverse=True)
    names = {file.name.removesuffix(suffix): file for file in files}
    runs = [(name, file) for name, file in names.items() if (folder / f"{name}.nml").is_file()]
    boulders = {name: boulders_in(file) for name, file in runs[:MAX_UNFINISHED]}
    return {name: number for name, number in boulders.items() if number}


class Task:
    """A thread that runs a saved case and writes a product, unless cancelled."""

    def __init__(
        self, kind: str, site: Site, name: str, overwrite: bool, language: str,
        send: Callable[[str, Message], None], then: Callable[[], None], resume: bool = False,
    ) -> None:  # fmt: skip
        self._kind, self._site, self.name, self._overwrite = kind, site, name, overwrite
        self._language, self._send, self._then, self._resume = language, send, then, resume
        self._cancel = Event()
        self._thread = Thread(target=self._work, name=kind, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def cancel(self) -> None:
        """Stop as soon as possible; only a checkpoint may remain."""
        self._cancel.set()

    def wait(self) -> None:
        self._thread.join()

    def _work(self) -> None:
        with speaking(self._language), overwriting(self._overwrite), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the page already shows the warnings of the case
            try:
                with stopped_by(self._cancel.is_set):
                    end = self._about("done", files=self._make())
            except RockfallError as error:
                end = self._refusal(without_files(str(error), self._site))
            except Stopped:
                end = self._refusal(say("app.server_cancelled"))
            except Interrupted as stop:
                n = simulated(stop.contents)
                end = self._refusal(say("app.server_stopped" if n else "app.server_cancelled", n=n))
            except Exception as error:  # reported to the page; the server keeps running
                end = "fault", fault_message(error)
            self._then()
            self._send(*end)

    def _make(self) -> list[str]:
        folder, name = self._site.folder, self.name
        result, product = outputs(self._kind, name)
        path, case = folder / result, read_case(folder / f"{name}.nml").replace(variant=[])
        if self._kind == SIMULATE:
            self._simulate(case, path)
            return [result]
        write_result(self._run(case), path)
        check_stop()
        self._phase(say("app.server_drawing" if self._kind == REPORT else "app.server_writing"))
        if self._kind == REPORT:
            report = import_module("rockfall.products").report  # slow import
            report(path, folder / product, language=self._language)
            return [result, product]
        return [result, *(f"{product}/{file.name}" for file in export(path, folder / product))]

    def _simulate(self, case: Case, path: Path) -> None:
        """Write the result of a case, using checkpoints."""
        checkpoint = _Watched(path, _Clock(self._phase, say("app.server_simulating")))
        with overwriting(self._overwrite or self._resume), locked(path, checkpoint.say):
            check_result_path(path, input_files(case))
            if not self._resume:
                checkpoint.remove()
            scene = read_scene(case, memory=machine_memory())
            result = simulate(scene, checkpoint=checkpoint, keep=False)
            with checkpoint.named():
                write_result(result, path)
            checkpoint.remove()

    def _run(self, case: Case) -> Any:
        clock = _Clock(self._phase, say("app.server_simulating"))
        with open_session(case) as session:
            for batch in session.run(cancel=self._cancel, batch_seconds=TELL_SECONDS):
                clock.tell(batch.boulders, batch.total)
                if batch.complete:
                    return batch.dataset()
        raise Stopped

    def _phase(self, text: str, done: int = 0, total: int = 0, left: float | None = None) -> None:
        """Report progress; total 0 means unknown."""
        self._send(*self._about("progress", phase=text, done=done, total=total, seconds_left=left))

    def _refusal(self, text: str) -> tuple[str, str]:
        return self._about("refused", text=text, exists=False)

    def _about(self, kind: str, **content: Any) -> tuple[str, str]:
        """Kind and content of the task message."""
        return kind, text_message(kind, task=self._kind, **content)


class _Clock:
    """Progress of a run; estimates the time left from the rate since the first report."""

    def __init__(self, tell: Callable[[str, int, int, float | None], None], what: str) -> None:
        self._tell, self.what = tell, what
        self._begun, self._before = time.perf_counter(), 0

    def start(self, done: int) -> None:
        """Begin a run in which `done` boulders may already be finished."""
        self._begun, self._before = time.perf_counter(), done

    def tell(self, done: int, total: int) -> None:
        """Send the progress of the run to the page."""
        spent = time.perf_counter() - self._begun
        left = spent / (done - self._before) * (total - done) if done > self._before else None
        self._tell(self.what, done, total, left)


class _Watched(Checkpoint):
    """Checkpoint that reports the progress of its run."""

    def __init__(self, output: Path, clock: _Clock) -> None:
        super().__init__(output, SAVE_SECONDS, self._note)
        self._clock = clock

    def restore(self, tally: Tally) -> None:
        super().restore(tally)
        self._clock.start(tally.done)

    def look(self, tally: Tally) -> None:
        self._clock.tell(tally.done, tally.boulders)
        super().look(tally)

    def _note(self, text: str) -> None:
        """Report that checkpoints can no longer be written."""
        self._clock.what = f"{self._clock.what} ({text})"
