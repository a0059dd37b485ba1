# SPDX-License-Identifier: BSD-3-Clause
"""Simulation of a case's boulders by the kernel, in chunks, and creation of the result."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.errors import OUR_FAULT, RockfallError, check_kernel
from rockfall.interrupts import interrupts
from rockfall.result.samples import simulated
from rockfall.result.variables import fields
from rockfall.scene.releases.reach import Survey
from rockfall.scene.rules.plausible import input_warnings
from rockfall.scene.scene import Scene
from rockfall.scene.windows import groups
from rockfall.simulation.parts.part_file import make_part
from rockfall.simulation.progress import progress_bar
from rockfall.simulation.run_state import Run
from rockfall.simulation.spilled_crossings import SpilledCrossings
from rockfall.simulation.tally import Tally, shard_range
from rockfall.simulation.tally_dataset import make_result
from rockfall.system import before_fork

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.result.contents import Contents
    from rockfall.simulation.parts.checkpoint import Checkpoint

# A forked child would wait forever for the idle threads of its parent.
before_fork(_core.end_team)

CHUNK_SECONDS = 0.25  # duration of a kernel call between checks for Ctrl-C
MAX_SECONDS = 1.0  # after this time, a call starts no more boulders
FIRST_CHUNK = int(_core.constant("first_chunk"))  # small, because boulders may be slow
CHUNK_CROSSINGS = int(_core.constant("chunk_crossings"))  # approximate maximum, all in memory
STATUS = fields("count").index("status")  # row in the kernel's integer values
STOP = [fields("boulder").index(name) for name in ("stop_x", "stop_y")]  # rows of real values
LEFT_WINDOW = int(_core.constant("left_window"))  # status of boulders to repeat in a larger window


class Interrupted(KeyboardInterrupt):
    """Raised on Ctrl-C; `result` has the completed boulders.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> try:
    ...     result = rockfall.run(case)
    ... except rockfall.Interrupted as stop:
    ...     result = stop.result  # a valid result of fewer boulders
    """

    def __init__(self, contents: Contents) -> None:
        super().__init__(f"interrupted after {simulated(contents)} boulders")
        self.contents = contents

    @cached_property
    def result(self) -> Any:
        return self.contents.dataset()


class StudyInterrupted(Interrupted):
    """Raised on Ctrl-C in a study of many runs; `result` is the study from the completed runs."""

    def __init__(self, study: Any, runs: int) -> None:
        KeyboardInterrupt.__init__(self, f"interrupted after {runs} runs")
        self.result, self.runs = study, runs


def run_scene(scene: Scene, **how: Any) -> xr.Dataset:
    """Run a scene that has been read; see `simulate` for the arguments."""
    import xarray  # noqa: F401  before the run: later there may be no memory for it

    return simulate(scene, **how).dataset()


def simulate(
    scene: Scene,
    *,
    progress: bool | str = False,
    threads: int | None = None,
    chunk: int | None = None,
    shard: tuple[int, int] = (1, 1),
    checkpoint: Checkpoint | None = None,
    keep: bool = True,
    spill: Path | None = None,
) -> Contents:
    """Run a scene and return its results; see `run`. A text as `progress` is shown with it.

    The run resumes from `checkpoint` and updates it at intervals. If the folder `spill` is given,
    line crossings are stored there in an unnamed file, which limits memory. Unless `keep`, the
    rasters of the scene are freed before the result is created.
    """
    import netCDF4  # noqa: F401  writes the result; after the run there may be no memory for it

    if threads is None:
        threads = scene.case.case["threads"]
    check_team(threads)
    input_warnings(scene)  # checked before its rasters are freed
    with interrupts() as interrupted:  # Ctrl+C waits for the current chunk
        tally = start(scene, threads, shard)
        if spill is not None and scene.case.lines and scene.windows is None:
            tally.spilled = SpilledCrossings(spill, len(scene.case.lines))
        if checkpoint:
            checkpoint.check_space(tally)
            checkpoint.restore(tally)
        what = f"boulders, {progress}" if isinstance(progress, str) else "boulders"
        with progress_bar(tally.boulders, bool(progress), what) as advance:
            advance(tally.done)

            def step(boulders: int) -> None:
                advance(boulders)
                if tally.spilled is not None:
                    tally.spilled.take(tally.run)
                if checkpoint:
                    checkpoint.look(tally)

            run_chunks(tally, chunk, interrupted, step)
            if checkpoint and (checkpoint.keep or interrupted()):
                checkpoint.save(tally)
            trace(tally)
        if not keep:
            scene.forget_rasters()
        if tally.boulders < scene.boulders:
            result = make_part(tally)
            tally.run.forget_tallies()
        else:
            tally.settle()
            result = make_result(tally)
    if interrupted():
        raise Interrupted(result)
    return result


def check_team(threads: int) -> None:
    """Refuse a number of threads that is invalid, or whose memory is not available."""
    check_kernel(*_core.team_fits(threads))


def start(scene: Scene, threads: int, shard: tuple[int, int] = (1, 1)) -> Tally:
    """Create the empty tally of a run, or of a shard of it."""
    numbers, survey = shard_range(scene, shard), scene.survey()
    check_overflow(scene, survey)
    box = survey.box(scene.kernel)
    run = Run.of_scene(scene, numbers, box, threads)
    return Tally(scene, run, box, len(numbers), numbers.start, threads=threads)


def check_overflow(scene: Scene, survey: Survey) -> None:
    """Refuse a run in which counters of a map cell could overflow."""
    if "maps" in scene.case.output:
        kernel = scene.kernel
        kernel.check(*_core.check_maps(kernel.handle, survey.head[0] - survey.minima.min()))


def run_chunks(
    tally: Tally, chunk: int | None, interrupted: Callable[[], bool], advance: Callable[[int], None]
) -> None:
    """Simulate the remaining boulders of a tally, until all are completed or an interrupt
    occurs."""
    size, total = chunk or FIRST_CHUNK, tally.boulders
    while tally.done < total and not interrupted():
        size = min(size, total - tally.done)
        wall, cpu = time.perf_counter(), time.process_time()
        size = _run_range(tally, tally.before + tally.done + 1, size)
        tally.done += (done := size)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        tally.wall, tally.cpu = tally.wall + wall, tally.cpu + cpu
        advance(size)
        if chunk is None:
            size = max(1, int(size * min(4.0, CHUNK_SECONDS / max(wall, 1e-9))))
            most = CHUNK_CROSSINGS * done / max(1, int(tally.array("crossed")[0]))
            size = min(size, max(1, int(most)))


def _run_range(tally: Tally, first: int, size: int) -> int:
    """Simulate and store up to `size` boulders from number `first`; fewer if their sources are in
    different terrain windows, or if time is up. Return the number. A boulder outside all windows is
    an internal error."""
    scene = tally.scene
    assert isinstance(scene, Scene)
    windows, grid = scene.windows, scene.grid
    scene, size = scene.around(first, size)
    scene.kernel.keep_within(tally.box)
    size, left, stop = tally.run.advance(scene, first, size, seconds=MAX_SECONDS)
    del scene  # frees the window before reading the next
    if left.size:
        if windows is None:
            raise RockfallError(
                f"internal error: boulder {left[0]} left the reachable area", code=OUR_FAULT
            )
        windows.widen(grid, *stop)
        for start_, n in groups(left):
            done = 0
            while done < n:
                done += _run_range(tally, start_ + done, n - done)
    return size


def trace(tally: Tally) -> None:
    """Repeat selected boulders individually and keep their trajectories."""
    wall, cpu = time.perf_counter(), time.process_time()
    scene = tally.scene
    assert isinstance(scene, Scene)
    wanted = min(scene.case.output["trajectories"], scene.boulders)
    if not wanted:
        return
    ends = tally.before + 1, tally.before + tally.done
    for number in recorded_numbers(scene, wanted, *ends):
        tally.trajectories[number] = trajectory(scene, number)
    tally.wall += time.perf_counter() - wall
    tally.cpu += time.process_time() - cpu


def recorded_numbers(scene: Scene, wanted: int, first: int, last: int) -> list[int]:
    """Numbers of the boulders from `first` to `last` whose trajectories are recorded, if the run
    records `wanted` evenly spread trajectories."""
    numbers, n = _core.recorded_numbers(scene.kernel.handle, first, last, wanted)
    return numbers[:n].tolist()


def trajectory(scene: Scene, number: int) -> np.ndarray:
    """Vertices (release, contacts, end) of a boulder, with columns `fields("vertex")`."""
    while True:
        vertex, left = _run_alone(scene.around(number, 1)[0], number)
        if left is None:
            return vertex
        assert scene.windows is not None
        scene.windows.widen(scene.grid, *left)


def _run_alone(
    scene: Scene, number: int
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray] | None]:
    """Vertices of a boulder, and its exit position if it left the window; tallies do not change."""
    vertex, recorded = np.empty((0, len(fields("vertex")))), 256
    while recorded > len(vertex):
        vertex = np.empty((recorded, len(fields("vertex"))))
        recorded, boulder, count = _core.trajectory(scene.kernel.handle, number, vertex.T)
    left = tuple(boulder[STOP]) if count[STATUS] == LEFT_WINDOW else None
    return vertex[:recorded], left
