# SPDX-License-Identifier: BSD-3-Clause
"""Terrain that does not fit in memory: windows of it, one at a time, round the sources in turn.

Columns, rows and coordinates stay those of the whole raster, so no bit depends on a window. A
boulder that leaves its window is in no tally: it is flown again in a larger one.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.arrays import check_known
from rockfall.io.grid import Box
from rockfall.scene.digest import Digest
from rockfall.scene.ground import Ground
from rockfall.scene.reach import Survey
from rockfall.scene.scene import Scene
from rockfall.scene.surface import cell_bytes, read_window

RIM = 4  # cells of a window that boulders keep off, where the raster goes on


class Windows:
    """The terrain of a scene in windows of so many cells, unless a source needs a larger one."""

    scene: Scene
    window: Scene
    sources: range  # whose window it is

    def __init__(self, scene: Scene, cells: int) -> None:
        self.cells = cells
        # How far a window goes beyond its sources, and learns to go: north, west, south, east.
        self.margins = np.full(4, max(RIM, math.isqrt(cells) // 8))
        self.reading = 0.0  # CPU seconds that windows took to be read
        self._turn_to(scene)
        self.ground = Ground()
        self.survey = self._survey()

    @property
    def bytes(self) -> int:
        """Memory of a window."""
        return self.cells * cell_bytes(self.scene.case, self.scene.z.dtype)

    def around(self, scene: Scene, first: int, boulders: int) -> tuple[Scene, int]:
        """The scene with a window of its rasters for boulders from number `first` on, and for how
        many of them it is. It may differ from the scene before in all but its rasters."""
        if scene is not self.scene:
            self._turn_to(scene)
        source = scene.source_of(first)
        if source not in self.sources:
            self.sources, box = self._fitting(source)
            self.window = self.scene  # its memory is free before the next takes it
            begin = time.process_time()
            self.window = read_window(self.scene, box)
            self.reading += time.process_time() - begin
        stop = self.scene.numbers_of(self.sources.stop - 1).stop
        return self.window, min(boulders, stop - first)

    def widen(self, x: np.ndarray, y: np.ndarray) -> None:
        """Let windows go further on the sides where boulders left this one [m]."""
        grid, box = self.scene.grid, self._box()
        row, column = (grid.north - y) / grid.cell, (x - grid.west) / grid.cell
        left = np.array([
            box.row > 0 and (row < box.row + RIM).any(),
            box.column > 0 and (column < box.column + RIM).any(),
            box.stop_row < grid.ny and (row > box.stop_row - RIM).any(),
            box.stop_column < grid.nx and (column > box.stop_column - RIM).any(),
        ])  # fmt: skip
        if not left.any():
            raise RockfallError("a boulder went where none can go", code=1)
        self.margins = np.where(left, 2 * self.margins, self.margins)
        self.sources = range(0)

    def _turn_to(self, scene: Scene) -> None:
        self.scene = self.window = scene
        self.column = ((scene.x - scene.grid.west) / scene.grid.cell).astype(int)
        self.row = ((scene.grid.north - scene.y) / scene.grid.cell).astype(int)
        self.sources = range(0)

    def _box(self) -> Box:
        row, column = self.window.at
        return Box(row, column, row + self.window.z.shape[0], column + self.window.z.shape[1])

    def _fitting(self, source: int) -> tuple[range, Box]:
        """As many sources from this one on as a window holds, one at least, and that."""
        row, column = self.row[source:], self.column[source:]
        north, west, south, east = self.margins
        ny, nx = self.scene.grid.shape
        boxes = np.stack([
            np.maximum(np.minimum.accumulate(row) - north, 0),
            np.maximum(np.minimum.accumulate(column) - west, 0),
            np.minimum(np.maximum.accumulate(row) + south + 1, ny),
            np.minimum(np.maximum.accumulate(column) + east + 1, nx),
        ], axis=1)  # fmt: skip
        cells = (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])
        n = max(1, int(np.searchsorted(cells, self.cells, side="right")))
        return range(source, source + n), Box(*boxes[n - 1].tolist())

    def _survey(self) -> Survey:
        """All rows once: checks, sums, sources, and where boulders can come."""
        found, known, digest = Survey(self.scene), False, Digest(self.scene)
        path = self.scene.grid.path
        for band, box in bands(self.scene, self.cells):
            known = check_known(path, band.z, band.at[0]) or known
            found.take(band, box.row, box.stop_row)
            self.ground.take(band, box)
            digest.take(band, box.row, box.stop_row)
        if not known:
            raise RockfallError(f"{path}: all cells are nodata")
        self.decoded = digest.sums()
        return found


def bands(scene: Scene, cells: int) -> Iterator[tuple[Scene, Box]]:
    """All rows in order, some at a time: the scene with rasters of about so many cells, which hold
    those rows and what lies about them."""
    ny, nx = scene.grid.shape
    rows = max(1, cells // nx - 2 * RIM)
    for first in range(0, ny, rows):
        stop = min(first + rows, ny)
        window = Box(max(0, first - RIM), 0, min(ny, stop + RIM), nx)
        yield read_window(scene, window), Box(first, 0, stop, nx)


def groups(numbers: np.ndarray) -> Iterator[tuple[int, int]]:
    """Ascending numbers as (first, how many) that follow each other."""
    for group in np.split(numbers, np.flatnonzero(np.diff(numbers) != 1) + 1):
        yield int(group[0]), group.size
