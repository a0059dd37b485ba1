# SPDX-License-Identifier: BSD-3-Clause
"""Windows of a terrain that does not fit in memory, loaded one at a time around successive sources.

Columns, rows and coordinates are those of the complete raster, so results do not depend on windows.
A boulder that leaves its window is not tallied: it is simulated again in a larger one.
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

RIM = 4  # cells of a window that boulders may not enter, where the raster continues


class Windows:
    """Terrain of a scene in windows of a given number of cells, larger where a source needs it."""

    scene: Scene
    window: Scene
    sources: range  # sources of the window

    def __init__(self, scene: Scene, cells: int) -> None:
        self.cells = cells
        # Margin of a window around its sources (north, west, south, east), enlarged as needed.
        self.margins = np.full(4, max(RIM, math.isqrt(cells) // 8))
        self.reading = 0.0  # CPU seconds spent reading windows
        self._turn_to(scene)
        self.ground = Ground()
        self.survey = self._survey()

    @property
    def bytes(self) -> int:
        """Memory of a window."""
        return self.cells * cell_bytes(self.scene.case, self.scene.z.dtype)

    def around(self, scene: Scene, first: int, boulders: int) -> tuple[Scene, int]:
        """Scene with a window of its rasters for boulders from number `first` on, and the number of
        boulders it serves. Attributes other than rasters may differ from those of the previous
        scene."""
        if scene is not self.scene:
            self._turn_to(scene)
        source = scene.source_of(first)
        if source not in self.sources:
            self.sources, box = self._fitting(source)
            self.window = self.scene  # free its memory before the next is read
            begin = time.process_time()
            self.window = read_window(self.scene, box)
            self.reading += time.process_time() - begin
        stop = self.scene.numbers_of(self.sources.stop - 1).stop
        return self.window, min(boulders, stop - first)

    def widen(self, x: np.ndarray, y: np.ndarray) -> None:
        """Enlarge windows on the sides where boulders left this one [m]."""
        grid, box = self.scene.grid, self._box()
        row, column = (grid.north - y) / grid.cell, (x - grid.west) / grid.cell
        left = np.array([
            box.row > 0 and (row < box.row + RIM).any(),
            box.column > 0 and (column < box.column + RIM).any(),
            box.stop_row < grid.ny and (row > box.stop_row - RIM).any(),
            box.stop_column < grid.nx and (column > box.stop_column - RIM).any(),
        ])  # fmt: skip
        if not left.any():
            raise RockfallError("internal error: a boulder left the reachable area", code=1)
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
        """The longest run of sources from this one that fits in a window (at least one), and its
        box."""
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
        """Read all rows once: checks, checksums, sources, and the reachable area."""
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
    """All rows in order, in bands: scenes with rasters of about the given number of cells, which
    hold those rows and their neighbours."""
    ny, nx = scene.grid.shape
    rows = max(1, cells // nx - 2 * RIM)
    for first in range(0, ny, rows):
        stop = min(first + rows, ny)
        window = Box(max(0, first - RIM), 0, min(ny, stop + RIM), nx)
        yield read_window(scene, window), Box(first, 0, stop, nx)


def groups(numbers: np.ndarray) -> Iterator[tuple[int, int]]:
    """Runs of consecutive numbers in an ascending array, as (first, count)."""
    for group in np.split(numbers, np.flatnonzero(np.diff(numbers) != 1) + 1):
        yield int(group[0]), group.size
