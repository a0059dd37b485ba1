# SPDX-License-Identifier: BSD-3-Clause
"""Results of a run in progress or in parts: the kernel's arrays, and the run they belong to."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case, in_kernel
from rockfall.errors import RockfallError
from rockfall.grounds import GroundRule
from rockfall.io.input_warnings import InputWarning
from rockfall.io.rasters.grid import Box, Grid
from rockfall.result.dataset import georeference
from rockfall.result.run_arrays import Array, window
from rockfall.scene.forest.trees import Stand
from rockfall.scene.parts import Features
from rockfall.scene.scene import Scene
from rockfall.simulation.map_plan import tells_sources
from rockfall.simulation.run_state import Run
from rockfall.simulation.spilled_crossings import GROUPS as CROSSINGS
from rockfall.simulation.spilled_crossings import SpilledCrossings
from rockfall.terrain.dams import DamShape
from rockfall.terrain.line_beyond import LinesBeyond
from rockfall.version import __version__

ANY = range(1, 2)  # placeholder if boulder numbers do not matter


@dataclass
class Origin:
    """The whole run to which a part belongs; used instead of its scene when parts are merged."""

    case: Case
    boulders: int  # total number in the run
    grid: Grid  # terrain grid without a CRS
    window: Box  # cells that maps cover
    checksums: dict[str, str]
    decoded: dict[str, str]
    version: str
    grounds: Sequence[GroundRule] = ()  # ground names and models
    features: Features | None = None  # source layer features, by name
    shapes: Sequence[str] = ()  # block shapes, if there are several
    warnings: list[InputWarning] | None = None
    dams: Sequence[DamShape] = ()
    stands: Sequence[Stand] = ()
    beyond: LinesBeyond = field(default_factory=dict)

    def difference(self, other: Origin, own: range = ANY, theirs: range = ANY) -> str:
        """First item in which another run differs; "" if none. Threads and the notation of the case
        do not count. The boulders `theirs` may be only the first of `own`."""
        texts, numbers, corners = zip(self._identity(own), other._identity(theirs), strict=True)
        cases = in_kernel(self.case), in_kernel(other.case)
        what = _core.run_difference(*cases, *texts, np.array(numbers).T, np.array(corners).T)
        return what.decode().strip()

    def _identity(self, numbers: range) -> tuple[bytes, list[int], tuple[float, ...]]:
        """Texts, integers and reals in the kernel's identity_t, for these boulders (from 1)."""
        sums = (json.dumps(by_name, sort_keys=True) for by_name in (self.checksums, self.decoded))
        texts = "\1".join((self.version, *sums)).encode(errors="replace")
        grid, ends = self.grid, (numbers.start, numbers.stop - 1)
        integers = [self.boulders, *ends, grid.nx, grid.ny, *window(self.window)]
        return texts, integers, (grid.west, grid.north, grid.cell)


@dataclass
class Tally:
    """A kernel run of a scene or of parts, and the data that the kernel does not store."""

    scene: Scene | Origin
    run: Run
    box: Box  # terrain cells of the maps
    boulders: int  # number of boulders to simulate
    before: int = 0  # number of boulders in the run before this tally
    done: int = 0
    trajectories: dict[int, np.ndarray] = field(
        default_factory=dict
    )  # (vertices, fields) by boulder
    date: str = ""  # date of the last part, if the run is merged from parts; "": now
    wall: float = 0.0
    cpu: float = 0.0
    threads: int = 0
    crs: dict[str, Any] = field(default_factory=dict)  # attributes of the CRS if the grid has none
    marks: np.ndarray | None = None  # bool: completed boulders; None: the first `done` of them
    spilled: SpilledCrossings | None = None  # crossings in a file instead of the run
    goes_on: bool = False  # True if the run continues after a result, which is then a copy

    def array(self, file_name: str) -> np.ndarray:
        """View of an array of the run, by its name in files."""
        return self.run.array(file_name)

    def differs_in(self, arrays: Mapping[str, np.ndarray], *names: str) -> str:
        """First of the arrays `names` that differs from the run's array; "" if none does."""
        own = {array.file_name: array.values for array in self.run.arrays()}
        differ = (
            name for name in names if name in own and not np.array_equal(own[name], arrays[name])
        )
        return next(differ, "")

    def arrays(self, *groups: str) -> list[Array]:
        """Arrays in some groups of variables, with rows of completed boulders only."""
        return self._chosen(self.run.arrays(*groups))

    def crossings(self) -> list[Array]:
        """Arrays of crossings, sorted by line, then by boulder."""
        if self.spilled is not None:
            return self.spilled.columns(self.run)
        self.run.sort_crossings()
        return self.arrays(*CROSSINGS)

    def crossed(self) -> int:
        """Number of line crossings so far."""
        if not self.scene.case.lines:
            return 0
        before = int(self.spilled.ends[-1]) if self.spilled is not None else 0
        return before + self.array("crossing_line").size

    def part_arrays(self) -> list[Array]:
        """Arrays of the packed part, as from `arrays`."""
        arrays = self._chosen(self.run.part_arrays())
        if self.spilled is None:
            return arrays
        others = [array for array in arrays if array.group not in CROSSINGS]
        return others + self.spilled.columns(self.run)

    def _chosen(self, arrays: Iterable[Array]) -> list[Array]:
        rows, chosen = self.chosen, []
        for array in arrays:
            values = array.values
            if "boulder" in array.dims:
                values = values[..., rows]
            elif self.goes_on and array.group != "work":
                values = values.copy()
            chosen.append(array._replace(values=values))
        return chosen

    @property
    def number(self) -> np.ndarray | None:
        """Boulder number of each row; None if all boulders have rows."""
        return next((array.values for array in self.run.arrays("kept")), None)

    @property
    def row_bytes(self) -> int:
        """Size [bytes] of all boulder rows, the minimum size of a result file."""
        rows = (array for array in self.run.arrays() if "boulder" in array.dims)
        return sum(array.values.nbytes for array in rows if array.group != "work")

    @property
    def rows(self) -> int:
        """Number of rows of completed boulders."""
        return self.numbers().size

    @property
    def chosen(self) -> slice | np.ndarray:
        """Rows of completed boulders: a slice of the first rows, or the indices of marked rows."""
        number = self.number
        if self.marks is not None:
            of_rows = self.marks if number is None else self.marks[number - self.before - 1]
            return np.flatnonzero(of_rows)
        if number is None:
            return slice(self.done)
        return slice(int(np.searchsorted(number, self.before + self.done, side="right")))

    def numbers(self) -> np.ndarray:
        """Numbers of the boulders in the chosen rows."""
        if (number := self.number) is not None:
            return number[self.chosen]
        if self.marks is not None:
            return self.before + 1 + np.asarray(self.chosen)
        return np.arange(self.before + 1, self.before + self.done + 1, dtype="i8")

    def go_on(self, scene: Scene) -> None:
        """Continue with a scene that has more boulders."""
        self.run, self.scene, self.boulders = self.run.continued(scene), scene, scene.boulders

    def sort_rows(self) -> None:
        """Sort rows by boulder number."""
        if self.number is None:
            return
        order = np.argsort(self.number)
        for array in self.run.arrays():
            if "boulder" in array.dims:
                array.values[...] = array.values[..., order]

    def columns(self) -> dict[str, np.ndarray]:
        """Kernel columns for the chosen rows, and sums over boulders, by name."""
        return {array.name: array.values for array in self.arrays("boulder", "count")}

    def settle(self, sign: int = 1) -> None:
        """Reduce the cell counts of split sources to completed boulders, as a part stores them.
        Sign -1 restores the counts of all boulders, to continue the run."""
        if tells_sources(self.scene.case):
            assert isinstance(self.scene, Scene)
            _core.settle_sources(self.run.handle, self.scene.kernel.handle, self.done, sign)
            self.run.changed()

    def restore_sources(self) -> bool:
        """Restore the source counts of an unpacked part, to continue its run; False if the cells
        of split sources do not match."""
        if not tells_sources(self.scene.case):
            return True
        assert isinstance(self.scene, Scene)
        good = _core.restore_sources(self.run.handle, self.scene.kernel.handle)
        self.run.changed()
        return bool(good)

    @property
    def window(self) -> Box:
        """Terrain cells that the maps cover; all cells if there are no maps."""
        return self.box if self.scene.case.output.get("maps") else self.scene.grid.box

    @property
    def grid(self) -> Grid:
        """Grid of the maps; without maps, of the whole terrain."""
        return self.scene.grid.part(self.window)

    def georeference(self) -> dict[str, Any]:
        """Attributes that georeference the maps."""
        return georeference(self.grid) | self.crs


def shard_range(scene: Scene, shard: tuple[int, int]) -> range:
    """Boulders (0-based) of shard I of N; sizes differ by at most one. Raises a RockfallError
    unless I is 1 to N, and for more shards than boulders."""
    which, parts = shard
    if not 1 <= which <= parts:
        raise RockfallError(f"shard = {which}/{parts}: must be I/N with I from 1 to N")
    if parts > max(1, scene.boulders):
        raise RockfallError(f"shard = {which}/{parts}: the run has only {scene.boulders} boulders")
    return range(
        _core.boulders_in_parts(scene.boulders, which - 1, parts),
        _core.boulders_in_parts(scene.boulders, which, parts),
    )


def origin_of(tally: Tally) -> Origin:
    """Run to which a tally belongs."""
    scene = tally.scene
    return Origin(
        scene.case, scene.boulders, replace(scene.grid, crs=None), tally.window,
        scene.checksums, scene.decoded, __version__, scene.grounds, scene.features, scene.shapes,
        scene.warnings, scene.dams, scene.stands, scene.beyond,
    )  # fmt: skip
