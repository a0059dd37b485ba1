# SPDX-License-Identifier: BSD-3-Clause
"""Raster geometry: north-up, with square cells, in metres."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from affine import Affine
    from rasterio.crs import CRS

#: Missing value of integer rasters; not allowed as a zone id.
NO_ID = int(np.iinfo(np.int32).min)

#: Edges closer than this fraction of a cell count as equal.
TOLERANCE = 1e-6

_BLOCK = 1_000_000  # cells


class Transform(NamedTuple):
    """Transformation from (column, row) to (x, y), with the names of `affine.Affine`, which is
    slow to import."""

    a: float
    b: float
    c: float
    d: float
    e: float
    f: float


@dataclass(frozen=True)
class Grid:
    """Raster geometry; row 0 is the northernmost, as in files.

    `west` and `north` are the outer edges [m], `cell` is the cell side [m], and `path` is the
    source file (for messages only).
    """

    west: float
    north: float
    cell: float
    nx: int
    ny: int
    crs: CRS | None = None
    path: str | None = field(default=None, compare=False)

    @property
    def shape(self) -> tuple[int, int]:
        """Shape (ny, nx) of arrays on the grid."""
        return self.ny, self.nx

    @property
    def east(self) -> float:
        """Outer eastern edge [m]."""
        return self.west + self.nx * self.cell

    @property
    def south(self) -> float:
        """Outer southern edge [m]."""
        return self.north - self.ny * self.cell

    @property
    def x(self) -> np.ndarray:
        """Cell centres from west to east [m], shape (nx,)."""
        return self.west + (np.arange(self.nx) + 0.5) * self.cell

    @property
    def y(self) -> np.ndarray:
        """Cell centres from north to south [m], shape (ny,)."""
        return self.north - (np.arange(self.ny) + 0.5) * self.cell

    @property
    def box(self) -> Box:
        """Box of all cells."""
        return Box(0, 0, self.ny, self.nx)

    def part(self, box: Box) -> Grid:
        """Grid of the cells in a box."""
        west, north = self.west + box.column * self.cell, self.north - box.row * self.cell
        return replace(self, west=west, north=north, nx=box.shape[1], ny=box.shape[0])

    def moved(self, east: float, north: float) -> Grid:
        """Grid shifted by these distances [m]."""
        return replace(self, west=self.west + east, north=self.north + north)

    @property
    def transform(self) -> Affine:
        """Affine transformation from (column, row) to (x, y), in rasterio's form."""
        from affine import Affine

        return Affine(self.cell, 0.0, self.west, 0.0, -self.cell, self.north)

    def cells(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of the cells at points [m]; points outside the grid get the nearest
        cell."""
        row = np.floor((self.north - y) / self.cell).astype(int).clip(0, self.ny - 1)
        return row, np.floor((x - self.west) / self.cell).astype(int).clip(0, self.nx - 1)

    def at(self, values: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Values of the cells at points [m], from an array (ny, nx); NaN outside the grid."""
        row, column = (self.north - y) / self.cell, (x - self.west) / self.cell
        inside = (row >= 0) & (row < self.ny) & (column >= 0) & (column < self.nx)
        there = np.full(x.shape, np.nan)
        there[inside] = values[row[inside].astype(int), column[inside].astype(int)]
        return there

    def matches(self, other: Grid) -> bool:
        """Return True if both grids have the same cells within `TOLERANCE`; ignores the CRS."""
        near = TOLERANCE * self.cell
        return self.shape == other.shape and all(
            abs(getattr(self, edge) - getattr(other, edge)) <= near
            for edge in ("west", "east", "south", "north")
        )

    def overlaps(self, other: Grid) -> bool:
        """Return True if the two grids overlap; ignores the CRS."""
        return max(self.west, other.west) < min(self.east, other.east) and max(
            self.south, other.south
        ) < min(self.north, other.north)


@dataclass(frozen=True)
class Box:
    """Rectangle of raster cells; `stop_row` and `stop_column` are exclusive."""

    row: int
    column: int
    stop_row: int
    stop_column: int

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""
        return self.stop_row - self.row, self.stop_column - self.column

    @property
    def rows(self) -> slice:
        return slice(self.row, self.stop_row)

    @property
    def columns(self) -> slice:
        return slice(self.column, self.stop_column)

    def corners(self) -> dict[str, tuple[int, int]]:
        """First and last (column, row), counted from 1, as the kernel expects for maps."""
        return {
            "map_at": (self.column + 1, self.row + 1),
            "map_last": (self.stop_column, self.stop_row),
        }


def flaw_of(transform: Affine | Transform, far: int) -> str:
    """Reason why cells cannot form a grid; "" if they can. `far` is the larger number of cells per
    side."""
    t = transform
    if not 0 < abs(t.a) < np.inf:
        return f"cells have the size {t.a:g}: must be > 0"
    if max(abs(t.b), abs(t.d)) * far > TOLERANCE * abs(t.a):
        return "is rotated"
    if t.a < 0:
        return "is mirrored: columns run from east to west"
    if abs(t.a - abs(t.e)) * far > TOLERANCE * t.a:
        return f"cells are not square ({t.a:.10g} x {abs(t.e):.10g} m)"
    return ""


def row_blocks(shape: tuple[int, int], multiple: int = 1) -> Iterator[slice]:
    """Slices of about a million cells in whole rows; each row count except the last is a multiple
    of `multiple`."""
    ny, nx = shape
    step = max(1, _BLOCK // (max(1, nx) * multiple)) * multiple
    return (slice(first, min(first + step, ny)) for first in range(0, ny, step))
