# SPDX-License-Identifier: BSD-3-Clause
"""Windows of a terrain that does not fit in memory, loaded in turn around successive sources.

Columns, rows and coordinates refer to the whole raster, so results do not depend on windows. A
boulder that leaves its window is not counted but simulated again in a larger window.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from rockfall.errors import OUR_FAULT, RockfallError
from rockfall.io.rasters.grid import Box, Grid
from rockfall.scene.ground import Ground
from rockfall.scene.layers import Inputs
from rockfall.scene.parts import Rasters, Sources
from rockfall.scene.releases.reach import Survey
from rockfall.scene.surface import read_window

RIM = 4  # [cells] margin of a window that boulders may not enter if the raster continues


class Windows:
    """Window of a large terrain that is in memory: at most `cells`, unless a single source needs
    more. The survey covers the whole terrain."""

    def __init__(self, cells: int, cell_bytes: int, survey: Survey, ground: Ground) -> None:
        self.cells, self.bytes = cells, cells * cell_bytes  # size and memory of a window
        self.survey, self.ground = survey, ground
        # Margins of a window around its sources (north, west, south, east); they grow as needed.
        self.margins = np.full(4, max(RIM, math.isqrt(cells) // 8))
        self.reading = 0.0  # CPU time for reading windows [s]
        self.owner: Any = None  # scene whose window is in memory
        self.window: Any = None  # that scene with the window's rasters
        self.sources = range(0)  # indices of the window's sources
        self.box = Box(0, 0, 0, 0)

    def fit(self, grid: Grid, sources: Sources, first: int) -> Box:
        """Move the window to source `first` and as many later sources as fit; return its box."""
        column = ((sources.x[first:] - grid.west) / grid.cell).astype(int)
        row = ((grid.north - sources.y[first:]) / grid.cell).astype(int)
        north, west, south, east = self.margins
        boxes = np.stack([
            np.maximum(np.minimum.accumulate(row) - north, 0),
            np.maximum(np.minimum.accumulate(column) - west, 0),
            np.minimum(np.maximum.accumulate(row) + south + 1, grid.ny),
            np.minimum(np.maximum.accumulate(column) + east + 1, grid.nx),
        ], axis=1)  # fmt: skip
        cells = (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])
        n = max(1, int(np.searchsorted(cells, self.cells, side="right")))
        self.sources, self.box = range(first, first + n), Box(*boxes[n - 1].tolist())
        return self.box

    def widen(self, grid: Grid, x: np.ndarray, y: np.ndarray) -> None:
        """Enlarge the margins on the sides where boulders left the window, at x, y [m]."""
        box = self.box
        row, column = (grid.north - y) / grid.cell, (x - grid.west) / grid.cell
        left = np.array([
            box.row > 0 and (row < box.row + RIM).any(),
            box.column > 0 and (column < box.column + RIM).any(),
            box.stop_row < grid.ny and (row > box.stop_row - RIM).any(),
            box.stop_column < grid.nx and (column > box.stop_column - RIM).any(),
        ])  # fmt: skip
        if not left.any():
            raise RockfallError("internal error: a boulder left the reachable area", code=OUR_FAULT)
        self.margins = np.where(left, 2 * self.margins, self.margins)
        self.sources = range(0)


def bands(inputs: Inputs, cells: int) -> Iterator[tuple[Rasters, Box]]:
    """Yield all rows in bands of about `cells` cells: rasters with adjacent rows, and the band's
    box."""
    ny, nx = inputs.grid.shape
    rows = max(1, cells // nx - 2 * RIM)
    for first in range(0, ny, rows):
        stop = min(first + rows, ny)
        window = Box(max(0, first - RIM), 0, min(ny, stop + RIM), nx)
        yield read_window(inputs, window), Box(first, 0, stop, nx)


def groups(numbers: np.ndarray) -> Iterator[tuple[int, int]]:
    """Yield the ranges of consecutive numbers in an ascending array, as pairs (first, count)."""
    for group in np.split(numbers, np.flatnonzero(np.diff(numbers) != 1) + 1):
        yield int(group[0]), group.size
