# SPDX-License-Identifier: BSD-3-Clause
"""Rasters and sources of a scene as read from files."""

from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Self

import numpy as np

from rockfall.grounds import GroundRule
from rockfall.io.rasters.grid import Grid, row_blocks


@dataclass
class ExtremeCount:
    """Minimum of a stream of numbers, how often it occurs, and the next larger number."""

    value: float = np.inf
    count: int = 0
    next: float = np.inf

    def take(self, numbers: np.ndarray) -> None:
        """Add numbers, ignoring NaN."""
        value = np.fmin.reduce(numbers, axis=None, initial=np.inf)
        if not value <= self.next:
            return
        above = np.fmin.reduce(numbers, axis=None, initial=np.inf, where=numbers > value)
        count = int(np.count_nonzero(numbers == value))
        own = self.value, self.count, self.next
        low, high = sorted([own, (float(value), count, float(above))])
        self.value, self.count, self.next = low
        if low[0] == high[0]:
            self.count += high[1]
            self.next = min(low[2], high[2])
        elif high[1]:
            self.next = min(low[2], high[0])


@dataclass
class Rasters:
    """Terrain and ground of a scene or a window of it: arrays (ny, nx), northernmost row first."""

    grid: Grid  # grid of the whole terrain
    z: np.ndarray  # elevations [m], NaN if unknown; empty if the terrain is read in windows
    at: tuple[int, int] = (0, 0)  # row and column of the first cell in the grid
    #: (materials, 1 or 3): R_m, or Rg70, Rg20, Rg10 [m]
    sizes: np.ndarray = field(default_factory=lambda: np.zeros((1, 1)))
    zone: np.ndarray | None = None  # int8 or int16: 1-based row of `sizes`
    values: np.ndarray | None = None  # float32 (1 or 3, ny, nx): sizes of each cell [m]
    grounds: tuple[GroundRule, ...] = ()  # empty if all grounds use the impact sets
    material_ground: np.ndarray | None = None  # int8: 1-based ground of each row of `sizes`
    cell_ground: np.ndarray | None = None  # int8 (ny, nx): ground of each cell; both None: ground 1
    outside: int = 0  # number of cells with an elevation that are in no zone polygon

    def used_zones(self) -> np.ndarray:
        """0-based rows of `sizes` that some cell uses."""
        is_used = np.zeros(len(self.sizes) + 1, bool)
        assert self.zone is not None
        for rows in row_blocks(self.zone.shape):
            is_used[self.zone[rows]] = True
        return np.flatnonzero(is_used[1:])

    def free(self) -> None:
        """Free the memory of the cell arrays."""
        self.z, self.zone, self.values = np.empty((0, 0), self.z.dtype), None, None
        self.cell_ground = None


class SourceBoulders(NamedTuple):
    """Boulder properties defined by the sources."""

    volume: np.ndarray  # [m3]
    inertia: np.ndarray  # I/(m R**2) [-]
    density: np.ndarray | None = None  # [kg/m3]; None: as in the case
    shape: np.ndarray | None = None  # int8: number of the block shape, from 1; None: as in the case


class Features(NamedTuple):
    """Polygons or points of a source layer, with their release attributes."""

    names: list[str]
    number: np.ndarray  # int32: feature number of each source, from 1
    law: np.ndarray | None = None  # int32: number of the distribution, from 1; 0: as in the case
    value: np.ndarray | None = None  # (features, 9): `source_attributes.VALUES`, or NaN
    shape: np.ndarray | None = None  # int8: number of the block shape, from 1; 0: as in the case


@dataclass(frozen=True, eq=False)
class Sources:
    """Release points, with weights and boulder properties."""

    x: np.ndarray  # source positions [m]
    y: np.ndarray
    area: np.ndarray | None = None  # ratio of surface to plan area, for release by area
    frequency: np.ndarray | None = None  # weight of each source in boulders_total
    features: Features | None = None  # features of the source layer
    source_boulders: SourceBoulders | None = None  # set if sources define their boulders
    #: Raster values of source cells, negated, so that the minimum is the largest value.
    source_values: ExtremeCount = field(default_factory=ExtremeCount)

    def select(self, chosen: np.ndarray) -> Self:
        """Sources with these 0-based indices or this mask."""
        own: list[Any]
        x, y, area, frequency, *own = (
            None if column is None else column[chosen]
            for column in (self.x, self.y, self.area, self.frequency, *(self.source_boulders or ()))
        )
        changes: dict[str, Any] = {"x": x, "y": y, "area": area, "frequency": frequency}
        if self.features is not None:
            changes["features"] = self.features._replace(number=self.features.number[chosen])
        return replace(self, **changes, source_boulders=SourceBoulders(*own) if own else None)
