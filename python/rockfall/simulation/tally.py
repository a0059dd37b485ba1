# SPDX-License-Identifier: BSD-3-Clause
"""What a run has found so far: rows of its boulders, and what was added up over them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.grounds import GroundRule
from rockfall.io.grid import Box, Grid
from rockfall.result.dataset import georeference
from rockfall.result.samples import Samples, empty_like, rows_kept
from rockfall.result.variables import fields
from rockfall.scene.scene import Features, InputWarning, Scene
from rockfall.simulation.maps import Maps
from rockfall.terrain.dams import DamShape
from rockfall.version import __version__


@dataclass
class Origin:
    """The run that a part is of; stands in for its scene, too."""

    case: Case
    boulders: int  # of the whole run
    grid: Grid  # of the terrain, without a CRS
    window: Box  # the cells of it that maps cover
    checksums: dict[str, str]
    decoded: dict[str, str]
    version: str
    grounds: Sequence[GroundRule] = ()  # their names and models
    features: Features | None = None  # their names
    warnings: list[InputWarning] | None = None
    dams: Sequence[DamShape] = ()

    def difference(self, other: Origin) -> str:
        """The first thing in which another run differs, "" if it is the same; threads may differ,
        and how the case is written."""
        for what in ("version", "boulders", "checksums", "decoded", "grid", "window"):
            one, its = getattr(self, what), getattr(other, what)
            if isinstance(one, dict):
                differ = (key for key in sorted({*one, *its}) if one.get(key) != its.get(key))
                if key := next(differ, ""):
                    return key
            elif one != its:
                return what
        texts = (run.case.replace(case={"threads": 0}).text() for run in (self, other))
        return "" if len({*texts}) == 1 else "case"


@dataclass
class Tally:
    """What the kernel adds to from chunk to chunk, and the rows of the boulders done."""

    scene: Scene | Origin
    maps: Maps
    histogram: np.ndarray  # (6, bins)
    boulder: np.ndarray  # (rows, fields): all boulders, or those that the case keeps
    count: np.ndarray
    crossing: np.ndarray  # (rows, lines, fields)
    by_ground: np.ndarray  # rebounds on each ground of the scene; a single zero where it has none
    energy: np.ndarray  # (rows, fields), or one row that nobody asked for
    trees_hit: np.ndarray  # (rows,), or one where there are no trees
    feature: np.ndarray  # (rows,) of a run of which there are parts alone; or one
    outcome: np.ndarray  # (rows, barriers), or one where there are no barriers
    boulders: int  # that are to be done
    number: np.ndarray | None = None  # of the boulder of each row; None: all of them
    samples: Samples | None = None  # where not all rows are kept
    before: int = 0  # boulders of the run before those of this tally
    done: int = 0
    counted: dict[str, Any] = field(default_factory=dict)  # in boulders whose `count` was not kept
    trajectories: dict[int, np.ndarray] = field(
        default_factory=dict
    )  # (vertices, fields) by boulder
    date: str = ""  # of the last part of a run that there is in parts alone; "": now
    wall: float = 0.0
    cpu: float = 0.0
    threads: int = 0
    crs: dict[str, Any] = field(default_factory=dict)  # said of the grid, where it has no CRS

    @property
    def rows(self) -> int:
        """Rows of the boulders done."""
        if self.number is None:
            return self.done
        return int(np.searchsorted(self.number, self.before + self.done, side="right"))

    def numbers(self) -> np.ndarray:
        """The boulders of these rows."""
        if self.number is None:
            return np.arange(self.before + 1, self.before + self.done + 1)
        return self.number[: self.rows]

    def go_on(self, scene: Scene) -> None:
        """Make room for the boulders of a scene that are more of the same."""
        rows, self.scene, self.boulders = self.rows, scene, scene.boulders
        self.number = kept_numbers(scene, range(scene.boulders))
        size = scene.boulders if self.number is None else self.number.size
        asked = [name for name, is_asked in (
            ("boulder", True), ("count", True), ("crossing", True),
            ("energy", scene.case.output["energy_balance"]),
            ("trees_hit", scene.case.has_forest), ("outcome", bool(scene.case.barrier)),
        ) if is_asked]  # fmt: skip
        for name in asked:
            before = getattr(self, name)
            more = np.zeros((size, *before.shape[1:]), before.dtype)
            more[:rows] = before[:rows]
            setattr(self, name, more)
        if self.samples is not None:
            self.samples.make_room(scene.boulders)

    def samples_bytes(self) -> int:
        """Bytes that samples take."""
        if self.samples is None:
            return 0
        return sum(array.nbytes for array in vars(self.samples).values())

    def sort_rows(self) -> None:
        """Put rows that came in any order into that of their boulders."""
        if self.number is None:
            return
        order = np.argsort(self.number)
        for name in ("boulder", "count", "crossing", "energy", "feature", "trees_hit", "outcome"):
            rows = getattr(self, name)
            if len(rows) == order.size:
                setattr(self, name, rows[order])
        self.number = self.number[order]

    def columns(self) -> dict[str, np.ndarray]:
        """The kernel's numbers in each of these rows, by name."""
        names, rows = fields(1) + fields(2), (*self.boulder.T, *self.count.T)
        return {name: row[: self.rows] for name, row in zip(names, rows, strict=True)}

    def feature_of(self, source: np.ndarray) -> np.ndarray:
        """The feature of the source of each row."""
        if isinstance(self.scene, Origin):
            return self.feature[: self.rows]
        assert self.scene.features is not None
        return self.scene.features.of[source - 1]

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


def empty_tally(
    scene: Scene | Origin,
    maps: Maps,
    numbers: range,
    threads: int,
    kept: np.ndarray | None = None,
    samples: Samples | None = None,
) -> Tally:
    """Room for boulders of these numbers, counted from 0; rows of those kept (from 1) alone, and
    samples of all."""
    bins, barriers = _core.histogram_bins()[0], len(scene.case.barrier)
    rows = len(numbers) if kept is None else kept.size
    return Tally(
        scene,
        maps,
        histogram=np.zeros((len(bins), max(bins)), "i8"),
        boulder=np.empty((rows, len(fields(1)))),
        count=np.zeros((rows, len(fields(2))), "i4"),
        by_ground=np.zeros(max(1, len(scene.grounds)), "i8"),
        energy=np.zeros((rows if scene.case.output["energy_balance"] else 1, len(fields(5)))),
        feature=np.zeros(rows if isinstance(scene, Origin) and scene.features else 1, "i4"),
        trees_hit=np.zeros(rows if scene.case.has_forest else 1, "i4"),
        outcome=np.zeros((rows, barriers) if barriers else (1, 1), "i1"),
        crossing=np.empty((rows, len(scene.case.lines), len(fields(3)))),
        boulders=len(numbers),
        number=kept,
        samples=samples,
        before=numbers.start,
        threads=threads,
    )


def kept_numbers(scene: Scene, numbers: range) -> np.ndarray | None:
    """Of the boulders of these numbers, counted from 0, those whose rows are kept, from 1: from
    each source as many as its part of all, the first of it; None: all of them."""
    kept = rows_kept(scene.case, scene.boulders)
    if not kept:
        return None if kept is None else np.zeros(0, "i8")
    found, n = _core.recorded(scene.kernel.handle, numbers.start + 1, numbers.stop, kept)
    return found[:n].astype("i8")


def empty_samples(scene: Scene) -> Samples | None:
    """Of the boulders of a scene; None where all rows are kept."""
    if rows_kept(scene.case, scene.boulders) is None:
        return None
    (parts, groups), _, _ = _core.sample_layout(scene.kernel.handle, 1)
    _, part_last, group_part = _core.sample_layout(scene.kernel.handle, max(parts, groups))
    return empty_like(scene.case, scene.boulders, part_last[:parts], group_part[:groups])


def shard_range(scene: Scene, shard: tuple[int, int]) -> range:
    """The boulders of the I-th of N shards, counted from 0; they differ by one at most."""
    which, of = shard
    if not 1 <= which <= of:
        raise RockfallError(f"shard = {which}/{of}: must be I/N with I from 1 to N")
    if of > max(1, scene.boulders):
        raise RockfallError(f"shard = {which}/{of}: there are {scene.boulders} boulders only")
    return range(_core.share(scene.boulders, which - 1, of), _core.share(scene.boulders, which, of))


def origin_of(tally: Tally) -> Origin:
    """The run of a tally."""
    scene = tally.scene
    return Origin(
        scene.case, scene.boulders, replace(scene.grid, crs=None), tally.window,
        scene.checksums, scene.decoded, __version__, scene.grounds, scene.features,
        scene.warnings, scene.dams,
    )  # fmt: skip
