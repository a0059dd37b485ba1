# SPDX-License-Identifier: BSD-3-Clause
"""What a long run has done so far, on disk, so that a run that was killed goes on from there.

A folder holds the rows of the boulders done, a file for each time it was written, the tallies, and
`state.json`, which names those files. It is replaced last, in one step, when all that it names is
on disk: at any instant it describes a whole state.
"""

from __future__ import annotations

import json
import os
import shutil
import struct
import threading
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from rockfall.errors import RockfallError
from rockfall.files import check_regular
from rockfall.parts import CLOCKS, add_tallies, tallies
from rockfall.simulate import Tally
from rockfall.sourcemaps import FED, fed_cells, restore_stamps

STATE = "state.json"
STATE_OF_BATCH = "state.txt"  # of the checkpoints of rockfall-batch
PARTS = {  # of the state, and their types
    "identity": dict, "done": int, "rows": list, "maps": str, "wall_seconds": float,
    "cpu_seconds": float,
}  # fmt: skip
#: What reading raises of a file that is damaged; each array has a checksum in its archive.
DAMAGED = (
    OSError, ValueError, TypeError, KeyError, EOFError, RuntimeError, OverflowError, BadZipFile,
    struct.error, zlib.error, MemoryError,
)  # fmt: skip
ROWS = ("boulder", "count", "crossing")  # arrays of a tally with a row for each boulder


class Checkpoint:
    """The checkpoint of a run in `folder`, written every so many seconds.

    A checkpoint that cannot be written (a full disk) does not end the run: `say` is told once, and
    the last good one stays.
    """

    def __init__(
        self, folder: str | Path, every: float, say: Callable[[str], None] = lambda _: None
    ) -> None:
        self.folder, self.every, self.say = Path(folder), every, say
        self.rows: list[str] = []  # files
        self.saved = 0  # boulders in them
        self.writer: threading.Thread | None = None
        self.error: BaseException | None = None  # of the writer
        self.last = time.monotonic()

    def restore(self, tally: Tally) -> None:
        """Bring a tally to the state of the folder; nothing is done where there is none.

        A checkpoint of another case, input, version or range of boulders is refused.
        """
        state = self._state()
        if state is None:
            return
        for what, value in _identity(tally).items():
            if state["identity"].get(what) != value:
                raise RockfallError(
                    f"{self.folder}: is of another run, its {what} differs; remove it, or run "
                    "without --resume elsewhere"
                )
        try:
            for name in state["rows"]:
                self._take_rows(tally, name)
            with self._arrays(state["maps"]) as file:
                arrays = dict(file)
        except DAMAGED as error:
            raise RockfallError(f"{self.folder}: cannot be read: {error}") from error
        if self.saved != state["done"]:
            raise RockfallError(f"{self.folder}: cannot be read: rows of {self.saved} boulders")
        tally.histogram += arrays.pop("histogram")
        add_tallies(tally.maps, arrays)
        if arrays.keys() >= set(FED):
            restore_stamps(tally.maps, arrays)
        tally.done = self.saved
        tally.wall, tally.cpu = state["wall_seconds"], state["cpu_seconds"]
        self.rows = state["rows"]

    def _take_rows(self, tally: Tally, name: str) -> None:
        with self._arrays(name) as file:
            for rows in ROWS:  # one after the other
                values = file[rows]
                getattr(tally, rows)[self.saved : self.saved + len(values)] = values
        self.saved += len(values)

    def _arrays(self, name: str) -> Any:
        check_regular(self.folder / name)
        return np.load(self.folder / name)

    def found(self) -> int:
        """Boulders in the folder, 0 without a checkpoint."""
        state = self._state()
        return state["done"] if state else 0

    def _state(self) -> dict[str, Any] | None:
        if (self.folder / STATE_OF_BATCH).exists():
            raise RockfallError(
                f"{self.folder}: is of rockfall-batch; go on with that, or remove it"
            )
        try:
            check_regular(self.folder / STATE)
            state = json.loads((self.folder / STATE).read_text())
            if not _is_state(state):
                raise ValueError(f"{STATE} is not of a checkpoint")
            return state
        except FileNotFoundError:
            return None
        except (OSError, ValueError, RecursionError) as error:
            raise RockfallError(f"{self.folder}: cannot be read: {error}") from error

    def look(self, tally: Tally) -> None:
        """Write a checkpoint, if it is time to."""
        if time.monotonic() - self.last >= self.every:
            self.save(tally)

    def save(self, tally: Tally) -> None:
        """Begin to write what was done since the last checkpoint, while the run goes on: rows of
        boulders do not change any more, and tallies are copied. Never, where that is how often."""
        self.finish()
        if np.isinf(self.every):
            return
        k, rows, arrays = len(self.rows), [*self.rows], None
        if tally.done > self.saved:
            rows.append(f"rows-{k}.npz")
            arrays = {name: getattr(tally, name)[self.saved : tally.done] for name in ROWS}
        maps = {"histogram": tally.histogram.copy(), **tallies(tally.maps), **fed_cells(tally)}
        state = {
            "identity": _identity(tally), "done": tally.done, "rows": rows, "maps": f"maps-{k}.npz",
            "wall_seconds": tally.wall, "cpu_seconds": tally.cpu,
        }  # fmt: skip
        self.writer = threading.Thread(target=self._save, args=(arrays, maps, state))
        self.writer.start()
        self.last = time.monotonic()

    def finish(self) -> None:
        """Wait for what is being written."""
        if self.writer is None:
            return
        self.writer.join()
        self.writer = None
        error, self.error = self.error, None
        if isinstance(error, OSError):
            self.say(f"{self.folder}: no checkpoint: {error.strerror or error}")
            self.every = np.inf
        elif error is not None:
            raise error

    def _save(
        self, rows: dict[str, np.ndarray] | None, maps: dict[str, np.ndarray], state: dict[str, Any]
    ) -> None:
        """In a thread of its own: the files, and last the state that names them."""
        try:
            self.folder.mkdir(exist_ok=True)
            if rows is not None:
                self._write(state["rows"][-1], rows)
            self._write(state["maps"], maps)
            self._write(STATE, json.dumps(state).encode())
            self.rows, self.saved = state["rows"], state["done"]
            for old in self.folder.glob("maps-*.npz"):
                if old.name != state["maps"]:
                    old.unlink()
        except BaseException as error:  # the run's own thread must know
            self.error = error

    def _write(self, name: str, content: bytes | dict[str, np.ndarray]) -> None:
        """A file that is on disk, whole, before it bears its name."""
        part = self.folder / f"{name}.part"
        with open(part, "wb") as file:
            if isinstance(content, bytes):
                file.write(content)
            else:
                np.savez(file, **content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, self.folder / name)
        folder = os.open(self.folder, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)

    def remove(self) -> None:
        """The run is done and written."""
        self.finish()
        shutil.rmtree(self.folder, ignore_errors=True)


def _is_state(state: Any) -> bool:
    """Whether JSON has all parts of a state, each of its type; names are of files in the folder."""
    if not isinstance(state, dict) or not state.keys() >= PARTS.keys():
        return False
    if not all(isinstance(state[name], kind) for name, kind in PARTS.items()):
        return False
    if not all(0 <= state[clock] < np.inf for clock in CLOCKS):
        return False
    return all(isinstance(one, str) and Path(one).name == one for one in state["rows"])


def _identity(tally: Tally) -> dict[str, Any]:
    """What a run that goes on must have in common with the one that was killed."""
    from rockfall import __version__

    scene = tally.scene
    return {
        "version": __version__,
        "case": scene.case.replace(case={"threads": 0}).text(),
        "boulders": [tally.before, tally.boulders, scene.boulders],
        **{f"input {name}": checksum for name, checksum in sorted(scene.checksums.items())},
        **{f"decoded {name}": checksum for name, checksum in sorted(scene.decoded.items())},
    }
