# SPDX-License-Identifier: BSD-3-Clause
"""Drive the kernel over the boulders of a case, in chunks, and make a result of what it returns."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.interrupts import interrupts
from rockfall.io.grid import Box, Grid
from rockfall.result.dataset import georeference, make_result
from rockfall.result.variables import fields
from rockfall.scene.plausible import warn_of
from rockfall.scene.reach import Survey, survey
from rockfall.scene.read import read_scene
from rockfall.scene.scene import Scene
from rockfall.scene.windows import groups
from rockfall.simulation.memory import machine_memory
from rockfall.simulation.part_file import make_part
from rockfall.simulation.source_maps import follow_sources, settle

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.simulation.checkpoint import Checkpoint
    from rockfall.simulation.part_file import Origin

# A child of a fork would wait for ever for the threads that a run leaves waiting in its parent.
os.register_at_fork(before=_core.end_team)

CHUNK_SECONDS = 0.25  # between calls of the kernel: progress, Ctrl-C
FIRST_CHUNK = 64  # boulders
BINS = 50  # rows of the kernel's histograms
MOST_THREADS = int(_core.constant("max_threads"))
MOST_ROWS = 2**31 - 2  # of class_counts, and one more can be counted
STATUS = 0  # row of the kernel's integers
LEFT_WINDOW = int(_core.constant("left_window"))  # status: to be flown again in a larger window
ALL = Box(0, 0, 2**31 - 1, 2**31 - 1)  # any cells
HALVINGS = 5  # of these rows, before they are too few to begin with


class Interrupted(KeyboardInterrupt):
    """Ctrl-C came: `result` holds the boulders that were done, whole."""

    def __init__(self, result: xr.Dataset) -> None:
        super().__init__(f"interrupted after {result.sizes['boulder']} boulders")
        self.result = result


@dataclass
class Maps:
    """The kernel's tallies by cell, in stacks (layers, ny, nx), where `plan` says; what the case
    does not ask for has a single element."""

    names: str  # of the maps, as the kernel wants them
    plan: np.ndarray  # of the kernel's map_plan
    counts: np.ndarray
    sums: np.ndarray
    maxima: np.ndarray
    class_counts: np.ndarray  # (cells, classes): rows are given away as cells are reached
    column: np.ndarray  # (ny, nx): row of class_counts, from 1
    columns: np.ndarray  # (1,): rows given away; one more than there are when they did not do
    box: Box  # the cells of the terrain that they are of
    #: (1 or 2, ny, nx): the source that was last counted there boulder by boulder; `head` has the
    #: second layer to itself
    stamp: np.ndarray = field(default_factory=lambda: np.zeros((1, 1, 1), "i4"))
    head: int = 0

    def arguments(self) -> dict[str, np.ndarray]:
        """As the kernel wants them."""
        return {
            "map_counts": self.counts.T, "map_sums": self.sums.T,
            "map_reals": self.maxima.T, "class_counts": self.class_counts.T,
            "column": self.column.T, "columns": self.columns,
        }  # fmt: skip

    def marks(self) -> dict[str, Any]:
        """What a run of the kernel wants besides: where they lie, and to tell sources apart."""
        return {"stamp": self.stamp.T, "head": self.head, **self.box.corners()}


def no_maps(names: Sequence[str] = (), box: Box = ALL) -> Maps:
    """Empty tallies for the maps of these names, on these cells."""
    shape = box.shape if names else (1, 1)
    text = " ".join(names)
    plan = _core.map_plan(text)
    counts, sums, maxima, classes = plan[:4].max(), plan[4:7].max(), plan[7:10].max(), plan[13]

    def stack(layers: int, dtype: str) -> np.ndarray:
        return np.zeros((layers, *shape) if layers else (1, 1, 1), dtype)

    return Maps(
        text, plan, stack(counts, "i4"), stack(sums, "i8"), stack(maxima, "f4"),
        class_counts=_class_counts(shape[0] * shape[1], classes),
        column=np.zeros(shape if classes else (1, 1), "i4"),
        columns=np.zeros(1, "i4"),
        box=box,
    )  # fmt: skip


def _class_counts(cells: int, classes: int) -> np.ndarray:
    """Rows for all cells, or for half as many as the system grants (the run needs memory for other
    things too): it takes the memory of a row when a boulder first passes the cell, and few may be
    passed."""
    if not classes:
        return np.empty((1, 1), "i4")
    rows = min(cells, MOST_ROWS)
    for k in range(HALVINGS + 1):
        try:
            np.empty((rows >> k, classes), "i4")  # is it granted?
        except MemoryError:
            continue
        return np.empty((rows >> k + (k > 0), classes), "i4")
    raise MemoryError


@dataclass
class Tally:
    """What the kernel adds to from chunk to chunk, and the rows of the boulders done."""

    scene: Scene | Origin
    maps: Maps
    histogram: np.ndarray  # (6, bins)
    boulder: np.ndarray  # (boulders, fields)
    count: np.ndarray
    crossing: np.ndarray  # (boulders, lines, fields)
    before: int = 0  # boulders of the run before those of this tally
    done: int = 0
    counted: dict[str, int] = field(default_factory=dict)  # in boulders whose `count` was not kept
    trajectories: list[np.ndarray] = field(default_factory=list)  # (vertices, fields) each
    wall: float = 0.0
    cpu: float = 0.0
    threads: int = 0
    crs: dict[str, Any] = field(default_factory=dict)  # said of the grid, where it has no CRS

    @property
    def boulders(self) -> int:
        """Boulders that are to be done."""
        return len(self.boulder)

    def columns(self) -> dict[str, np.ndarray]:
        """The kernel's numbers of each of the boulders done, by name."""
        names, rows = fields(1) + fields(2), (*self.boulder.T, *self.count.T)
        return {name: row[: self.done] for name, row in zip(names, rows, strict=True)}

    @property
    def window(self) -> Box:
        """The cells of the terrain that maps cover; without any, all of them."""
        return self.maps.box if self.maps.names else self.scene.grid.box

    @property
    def grid(self) -> Grid:
        """That of the maps; without any, of all the terrain."""
        return self.scene.grid.part(self.window)

    def georeference(self) -> dict[str, Any]:
        """What says where the maps lie."""
        return georeference(self.grid) | self.crs


def run(
    case: Case,
    *,
    progress: bool = False,
    threads: int | None = None,
    chunk: int | None = None,
    shard: tuple[int, int] = (1, 1),
    memory: float | None = None,
    **arrays: Any,
) -> xr.Dataset:
    """Run a case: an xarray.Dataset of boulders, lines, maps and histograms.

    `arrays` (dem, zones, ...) are as in `rockfall.scene.read.read_scene`. The result does not
    depend on `threads` (default: the case's) or `chunk`, boulders in one call of the kernel
    (default: what takes a quarter of a second). `shard` (I, N) runs the I-th of N ranges of
    boulders, and gives a part for `rockfall.merge`, without maps. Ctrl-C raises `Interrupted`, which holds the boulders done. Rasters that need more
    than half of `memory` [bytes] (default: that of the machine) are read in windows. What is likely
    a mistake in the case is a UserWarning.
    """
    scene = read_scene(case, memory=memory or machine_memory(), **arrays)
    warn_of(scene)
    how = {"progress": progress, "threads": threads, "chunk": chunk, "shard": shard}
    return run_scene(scene, keep=False, **how)


def run_scene(
    scene: Scene,
    *,
    progress: bool = False,
    threads: int | None = None,
    chunk: int | None = None,
    shard: tuple[int, int] = (1, 1),
    checkpoint: Checkpoint | None = None,
    keep: bool = True,
) -> xr.Dataset:
    """Run a scene that has been read; see `run`.

    It goes on from `checkpoint`, and writes it now and then. A scene that need not be kept loses
    its rasters before the result is made, to save memory.
    """
    import netCDF4  # noqa: F401  what makes the result, before the run: there may be no memory for it
    import xarray  # noqa: F401

    from rockfall.simulation.progress import progress_bar

    threads = scene.case.case["threads"] if threads is None else threads
    if not 0 <= threads <= MOST_THREADS:
        raise RockfallError(f"threads = {threads}: must be 0 (all cores) to {MOST_THREADS}")
    check_team(threads)
    with interrupts() as interrupted:  # no chunk is lost half-way
        tally = start(scene, threads, shard)
        if checkpoint:
            checkpoint.restore(tally)
        with progress_bar(tally.boulders, shown=progress) as advance:
            advance(tally.done)

            def step(boulders: int) -> None:
                advance(boulders)
                if checkpoint:
                    checkpoint.look(tally)

            run_chunks(tally, chunk, interrupted, step)
            if checkpoint and interrupted():
                checkpoint.save(tally)
            trace(tally)
        if not keep:
            scene.forget_rasters()
        if tally.boulders < scene.boulders:
            result = make_part(tally)
        else:
            settle(tally)
            result = make_result(tally)
    if interrupted():
        raise Interrupted(result)
    return result


def check_team(threads: int) -> None:
    """Refuse as many threads where the process has no room for them."""
    code, message = _core.team_fits(threads)
    if code:
        raise RockfallError(message.decode().strip(), code)


def shard_range(scene: Scene, shard: tuple[int, int]) -> range:
    """The boulders of the I-th of N shards, counted from 0; they differ by one at most."""
    which, of = shard
    if not 1 <= which <= of:
        raise RockfallError(f"shard = {which}/{of}: must be I/N with I from 1 to N")
    if of > max(1, scene.boulders):
        raise RockfallError(f"shard = {which}/{of}: there are {scene.boulders} boulders only")
    return range(scene.boulders * (which - 1) // of, scene.boulders * which // of)


def start(scene: Scene, threads: int, shard: tuple[int, int] = (1, 1)) -> Tally:
    """Empty tallies of what the case asks for."""
    numbers, found = shard_range(scene, shard), survey(scene)
    check_tallies(scene, found)
    box = found.box()
    try:
        return _start(scene, threads, numbers, box)
    except (MemoryError, ValueError) as error:  # NumPy has the latter for sizes past all bounds
        raise RockfallError(
            f"{scene.case.name}: {scene.boulders} boulders and the asked maps do not fit in memory"
        ) from error


def check_tallies(scene: Scene, found: Survey) -> None:
    """Refuse a run whose boulders could add up to more in a cell of a map than its numbers hold."""
    if "maps" in scene.case.output:
        kernel = scene.kernel
        kernel.check(*_core.check_maps(kernel.handle, found.head[0] - found.minima.min()))


def _start(scene: Scene, threads: int, numbers: range, box: Box) -> Tally:
    tally = empty_tally(scene, no_maps(scene.case.output.get("maps", []), box), numbers, threads)
    follow_sources(tally.maps, scene, numbers.start)
    return tally


def empty_tally(scene: Scene | Origin, maps: Maps, numbers: range, threads: int) -> Tally:
    """Room for boulders of these numbers, counted from 0."""
    return Tally(
        scene,
        maps,
        histogram=np.zeros((len(_core.histogram_bins()[0]), BINS), "i8"),
        boulder=np.empty((len(numbers), len(fields(1)))),
        count=np.zeros((len(numbers), len(fields(2))), "i4"),
        crossing=np.empty((len(numbers), len(scene.case.line), len(fields(3)))),
        before=numbers.start,
        threads=threads,
    )


def run_chunks(
    tally: Tally, chunk: int | None, interrupted: Callable[[], bool], advance: Callable[[int], None]
) -> None:
    """Follow the boulders of a tally that are left, up to the last or until interrupted."""
    size, total = chunk or FIRST_CHUNK, tally.boulders
    while tally.done < total and not interrupted():
        size = min(size, total - tally.done)
        wall, cpu = time.perf_counter(), time.process_time()
        size = _fly(tally, tally.before + tally.done + 1, size)
        tally.done += size
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        tally.wall, tally.cpu = tally.wall + wall, tally.cpu + cpu
        advance(size)
        if chunk is None:
            size = max(1, int(size * min(4.0, CHUNK_SECONDS / max(wall, 1e-9))))


def _fly(tally: Tally, first: int, size: int) -> int:
    """Boulders from number `first` on, into their places: `size` of them, or those whose sources
    lie in one window of the terrain; returns how many."""
    windows, scene = tally.scene.windows, tally.scene
    if windows:
        scene, size = windows.around(scene, first, size)
    left = _call(tally, scene, first, size)
    del scene  # no window stays while another is read
    if left.size:
        if windows is None:
            raise RockfallError(f"boulder {left[0]} went where none can go", code=1)
        stop = tally.boulder[left - tally.before - 1]
        windows.widen(stop[:, fields(1).index("stop_x")], stop[:, fields(1).index("stop_y")])
        for start_, n in groups(left):
            done = 0
            while done < n:
                done += _fly(tally, start_ + done, n - done)
    return size


def _call(tally: Tally, scene: Scene, first: int, size: int) -> np.ndarray:
    """Boulders `first` to `first + size - 1`, into their places. Returns the numbers of those that
    left the window, which are in no tally."""
    lines = len(tally.scene.case.line)
    boulder, count, crossing, code, message = _core.run(
        scene.kernel.handle, first, tally.threads, **tally.maps.arguments(), **tally.maps.marks(),
        histogram=tally.histogram.T, nl=max(1, lines), n=size,
    )  # fmt: skip
    scene.kernel.check(code, message)
    if tally.maps.columns[0] > len(tally.maps.class_counts):
        raise RockfallError(
            f"{tally.scene.case.name}: &output maps: boulders reach more than "
            f"{len(tally.maps.class_counts)} cells; the counts of quantile maps in more do not fit "
            "in memory"
        )
    done = slice(first - 1 - tally.before, first - 1 - tally.before + size)
    tally.boulder[done], tally.count[done] = boulder.T, count.T
    tally.crossing[done] = crossing.T[:, :lines]
    return first + np.flatnonzero(count[STATUS] == LEFT_WINDOW)


def trace(tally: Tally) -> None:
    """Fly the first boulders once more, each alone, and keep their way."""
    wall, cpu = time.perf_counter(), time.process_time()
    last = min(tally.scene.case.output["trajectories"], tally.before + tally.done)
    for number in range(tally.before + 1, last + 1):
        tally.trajectories.append(trajectory(tally.scene, number))
    tally.wall += time.perf_counter() - wall
    tally.cpu += time.process_time() - cpu


def trajectory(scene: Scene, number: int) -> np.ndarray:
    """The vertices (release, contacts, end) of one boulder, each with the columns `fields(4)`."""
    while True:
        window = scene.windows.around(scene, number, 1)[0] if scene.windows else scene
        vertex, left = _fly_alone(window, number)
        if left is None:
            return vertex
        scene.windows.widen(*left)


def _fly_alone(
    scene: Scene, number: int
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray] | None]:
    """The vertices of a boulder, and where it left the window if it did; no tally changes."""
    vertex, recorded = np.empty((0, len(fields(4)))), 256
    while recorded > len(vertex):
        vertex = np.empty((recorded, len(fields(4))))
        recorded, boulder, count = _core.trajectory(scene.kernel.handle, number, vertex.T)
    place = boulder[[fields(1).index(name) for name in ("stop_x", "stop_y")]]
    left = tuple(place) if count[STATUS] == LEFT_WINDOW else None
    return vertex[:recorded], left
