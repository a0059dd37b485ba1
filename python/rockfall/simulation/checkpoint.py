# SPDX-License-Identifier: BSD-3-Clause
"""What a long run has done so far, on disk, so that a run that was killed goes on from there.

A folder holds the rows of the boulders done, an archive for each time it was written, an archive of
the tallies, and `state.json`, which names those archives, with sizes and checksums. It is replaced
last, in one step, when all that it names is on disk: at any instant it describes a whole state. An
archive has its boulders in its name, and is written only when there are more: so no name that the
state has is ever taken again.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import struct
import threading
import time
import zlib
from collections.abc import Callable, Container, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import IO, Any
from zipfile import BadZipFile

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.files import check_regular
from rockfall.simulation.lock import LOCK, locked
from rockfall.simulation.merge import CLOCKS, add_tallies, tallies
from rockfall.simulation.simulate import Tally
from rockfall.simulation.source_maps import FED, fed_cells, restore_stamps
from rockfall.version import __version__

STATE = "state.json"
STATE_OF_BATCH = "state.txt"  # of the checkpoints of rockfall-batch
PARTS = {  # of the state, and their types
    "identity": dict, "done": int, "archives": list, "wall_seconds": float, "cpu_seconds": float
}  # fmt: skip
#: What reading raises of a file that is damaged.
DAMAGED = (
    OSError, ValueError, TypeError, KeyError, EOFError, RuntimeError, OverflowError, BadZipFile,
    struct.error, zlib.error, MemoryError,
)  # fmt: skip
ROWS = ("boulder", "count", "crossing")  # arrays of a tally with a row for each boulder
OWN = re.compile(r"((rows|maps)-\d+-\d+\.npz|state\.json)(\.part)?")  # names in the folder


@contextmanager
def checkpoint_folder(output: Path, say: Callable[[str], None]) -> Iterator[Path]:
    """The folder of a run's checkpoints beside its output, for this run alone; one of somebody
    else's is refused."""
    folder = output.with_name(f"{output.name}.checkpoint")
    names = os.listdir(folder) if folder.is_dir() else []
    if names and not any(OWN.fullmatch(name) or name in (LOCK, STATE_OF_BATCH) for name in names):
        raise RockfallError(f"{folder}: is there, and no checkpoint; choose another output")
    with locked(folder, say):
        yield folder


@dataclass(frozen=True)
class Archive:
    """A file of arrays as it was written."""

    kind: str  # rows, or maps
    first: int  # boulder of the run
    last: int
    bytes: int = 0
    sha256: str = ""

    @property
    def name(self) -> str:
        return f"{self.kind}-{self.first}-{self.last}.npz"


class Checkpoint:
    """The checkpoint of a run in `folder`, written every so many seconds.

    A checkpoint that cannot be written (a full disk) does not end the run: `say` is told once, and
    the last good one stays.
    """

    def __init__(
        self, folder: str | Path, every: float, say: Callable[[str], None] = lambda _: None
    ) -> None:
        self.folder, self.every, self.say = Path(folder), every, say
        self.rows: list[Archive] = []
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
        *rows, maps = (Archive(**one) for one in state["archives"])
        if maps.first != tally.before + 1:
            raise RockfallError(f"{self.folder}: cannot be read: its boulders begin elsewhere")
        for archive in rows:
            with self._opened(archive) as arrays:
                these = slice(archive.first - tally.before - 1, archive.last - tally.before)
                for name in ROWS:  # one after the other
                    getattr(tally, name)[these] = arrays[name]
        with self._opened(maps) as file:
            arrays = dict(file)
            tally.histogram += arrays.pop("histogram")
            add_tallies(tally.maps, arrays)
            if arrays.keys() >= set(FED):
                restore_stamps(tally.maps, arrays)
        tally.done = self.saved = state["done"]
        tally.wall, tally.cpu = state["wall_seconds"], state["cpu_seconds"]
        self.rows = rows

    @contextmanager
    def _opened(self, archive: Archive) -> Iterator[Any]:
        """The arrays of an archive that is what the state says."""
        path = self.folder / archive.name
        try:
            check_regular(path)
            with open(path, "rb") as file:
                if os.fstat(file.fileno()).st_size != archive.bytes:
                    raise ValueError(f"{archive.name} has another size than {STATE} says")
                if _checksum(file) != archive.sha256:
                    raise ValueError(f"{archive.name} has another checksum than {STATE} says")
                file.seek(0)
                with np.load(file) as arrays:
                    yield arrays
        except DAMAGED as error:
            raise RockfallError(f"{self.folder}: cannot be read: {error}") from error

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
        except (OSError, ValueError, TypeError, RecursionError) as error:
            raise RockfallError(f"{self.folder}: cannot be read: {error}") from error

    def look(self, tally: Tally) -> None:
        """Write a checkpoint, if it is time to."""
        if time.monotonic() - self.last >= self.every:
            self.save(tally)

    def save(self, tally: Tally) -> None:
        """Begin to write what was done since the last checkpoint, while the run goes on: rows of
        boulders do not change any more, and tallies are copied. Not without new boulders; never,
        where that is how often."""
        self.finish()
        if np.isinf(self.every) or tally.done == self.saved:
            return
        state = {
            "identity": _identity(tally), "done": tally.done, "wall_seconds": tally.wall,
            "cpu_seconds": tally.cpu,
        }  # fmt: skip
        last = tally.before + tally.done
        rows = {name: getattr(tally, name)[self.saved : tally.done] for name in ROWS}
        maps = {"histogram": tally.histogram.copy(), **tallies(tally.maps), **fed_cells(tally)}
        new = {
            Archive("rows", tally.before + self.saved + 1, last): rows,
            Archive("maps", tally.before + 1, last): maps,
        }
        self.writer = threading.Thread(target=self._save, args=(state, new))
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

    def _save(self, state: dict[str, Any], new: dict[Archive, dict[str, np.ndarray]]) -> None:
        """In a thread of its own: the archives, and last the state that names them."""
        try:
            self.folder.mkdir(exist_ok=True)
            if not self.rows:
                _sync(self.folder.parent)
            archives = [*self.rows, *(self._write_archive(*one) for one in new.items())]
            text = json.dumps(state | {"archives": [asdict(one) for one in archives]})
            self._write(STATE, lambda file: file.write(text.encode()))
            self.rows, self.saved = archives[:-1], state["done"]
            self._remove_files(keep={STATE, *(one.name for one in archives)})
        except BaseException as error:  # the run's own thread must know
            self.error = error

    def _write_archive(self, archive: Archive, arrays: dict[str, np.ndarray]) -> Archive:
        size, checksum = self._write(archive.name, lambda file: np.savez(file, **arrays))
        return replace(archive, bytes=size, sha256=checksum)

    def _write(self, name: str, put: Callable[[IO[bytes]], Any]) -> tuple[int, str]:
        """A file that is on disk, whole, before it bears its name; its size and checksum."""
        part = self.folder / f"{name}.part"
        with open(part, "w+b") as file:
            put(file)
            file.flush()
            os.fsync(file.fileno())
            size, checksum = os.fstat(file.fileno()).st_size, _checksum(file)
        os.replace(part, self.folder / name)
        _sync(self.folder)
        return size, checksum

    def _remove_files(self, keep: Container[str] = ()) -> None:
        """Remove our own files but some; the state first, for without it the rest is nothing."""
        own = sorted(filter(OWN.fullmatch, os.listdir(self.folder)), key=STATE.__ne__)
        for name in own:
            if name not in keep:
                (self.folder / name).unlink()

    def remove(self) -> None:
        """The run is done and written."""
        self.finish()
        with suppress(OSError):  # there is none, or somebody keeps files of his own there
            self._remove_files()
            self.folder.rmdir()


def _checksum(file: IO[bytes]) -> str:
    file.seek(0)
    return hashlib.file_digest(file, "sha256").hexdigest()


def _sync(folder: Path) -> None:
    """Bring the names in a folder to disk."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _is_state(state: Any) -> bool:
    """Whether JSON has all parts of a state, each of its type, and archives of its boulders."""
    if not isinstance(state, dict) or not state.keys() >= PARTS.keys():
        return False
    if not all(isinstance(state[name], kind) for name, kind in PARTS.items()):
        return False
    if not all(0 <= state[clock] < np.inf for clock in CLOCKS):
        return False
    *rows, maps = (Archive(**one) for one in state["archives"])
    end = maps.first - 1
    for one in rows:
        if (one.kind, one.first) != ("rows", end + 1) or not one.first <= one.last:
            return False
        end = one.last
    return (maps.kind, maps.last) == ("maps", end) and state["done"] == end - maps.first + 1


def _identity(tally: Tally) -> dict[str, Any]:
    """What a run that goes on must have in common with the one that was killed."""
    scene = tally.scene
    return {
        "version": __version__,
        "case": scene.case.replace(case={"threads": 0}).text(),
        "boulders": [tally.before, tally.boulders, scene.boulders],
        **{f"input {name}": checksum for name, checksum in sorted(scene.checksums.items())},
        **{f"decoded {name}": checksum for name, checksum in sorted(scene.decoded.items())},
    }
