# SPDX-License-Identifier: BSD-3-Clause
"""Statistics of the terrain and ground of a scene: elevations, slopes, rock sizes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from rockfall.io.rasters.grid import Box, row_blocks
from rockfall.scene.kernel_scene import area_ratios
from rockfall.scene.parts import ExtremeCount, Rasters

SAMPLES = 100_000  # approximate number of evenly spaced cells at which slopes are sampled
QUANTILES = (0.1, 0.5, 0.9)
MIDDLE = (20.0, 45.0)  # [degree] slopes between plains, where boulders stop, and cliffs
MIN_MIDDLE = 0.05  # minimum fraction of cells; edges of cliffs and terraces alone are fewer
NORMAL_MEDIAN = 0.6745  # median absolute value of the standard normal distribution
LOWEST_LAND = -450.0  # [m] the shore of the Dead Sea is at -430 m
SPIKE = (10.0, 5.0)  # [m], [cells]: no rock is this much higher or lower than all eight neighbours


@dataclass
class Ground:
    """Statistics accumulated over all terrain rows, band by band."""

    low: ExtremeCount = field(default_factory=ExtremeCount)  # elevations [m]
    high: ExtremeCount = field(default_factory=ExtremeCount)  # negated elevations [m]
    n_known: int = 0  # number of cells with an elevation
    deep: int = 0  # number of cells below LOWEST_LAND
    spikes: int = 0  # number of cells above or below all neighbours
    spike: tuple[float, float, float] = (0.0, 0.0, 0.0)  # largest spike: x, y and height [m]
    integers: bool = True  # True if all elevations are integers
    steps: int = 0  # bends reversed by the next cell; counted if all are integers
    spans: int = 0  # number of places checked for steps
    slopes: list[np.ndarray] = field(default_factory=list)  # slope tangents at SAMPLES cells
    bends: list[np.ndarray] = field(default_factory=list)  # changes of the tangents there (2, n)
    materials: list[np.ndarray] = field(default_factory=list)  # rows of `sizes` there; -1: unknown
    numbers: list[np.ndarray] = field(default_factory=list)  # ground numbers there, from 1
    rocks: list[np.ndarray] = field(default_factory=list)  # rock sizes there (n, 1 or 3) [m]
    source_z: list[np.ndarray] = field(default_factory=list)  # elevations of the sources [m]
    source_slopes: list[np.ndarray] = field(default_factory=list)  # slope tangents at the sources
    sizes: np.ndarray = field(default_factory=lambda: np.empty(0))  # rock sizes of materials [m]
    used: set[int] = field(default_factory=set)  # rows of `sizes` used in some cell
    falling: int = 0  # number of cells whose Rg70, Rg20, Rg10 decrease, if sizes are rasters
    rising: int = 0  # number of cells whose sizes vary otherwise
    smallest: float = np.inf  # extreme sizes, if sizes are rasters [m]
    largest: float = 0.0

    def take(self, band: Rasters, box: Box) -> None:
        """Add the rows of a box, from rasters that include the neighbouring rows."""
        inner = slice(box.row - band.at[0], box.stop_row - band.at[0])
        z = band.z[inner]
        for rows in row_blocks(z.shape):
            self._take_elevations(z[rows])
        self._take_spikes(band, inner)
        self._take_samples(band, *_samples(band, box))
        self._take_sizes(band, inner)

    def with_sources(self, band: Rasters, box: Box, x: np.ndarray, y: np.ndarray) -> Ground:
        """Copy with the sources in a box added, selected from all sources at x, y [m]."""
        row = ((band.grid.north - y) / band.grid.cell).astype(int).clip(0, band.grid.ny - 1)
        in_box = (row >= box.row) & (row < box.stop_row)
        if not in_box.any():
            return self
        x, y = x[in_box], y[in_box]
        column = ((x - band.grid.west) / band.grid.cell).astype(int).clip(0, band.grid.nx - 1)
        z = band.z[row[in_box] - band.at[0], column - band.at[1]]
        return replace(
            self,
            source_z=[*self.source_z, z],
            source_slopes=[*self.source_slopes, _slopes(band, x, y)],
        )

    def _take_samples(self, band: Rasters, row: np.ndarray, column: np.ndarray) -> None:
        """Sample slopes and ground at these cells."""
        self.slopes.append(_slopes(band, band.grid.x[column], band.grid.y[row]))
        at = row - band.at[0], column - band.at[1]
        self.bends.append(_bends(band, *at))
        if band.values is not None:
            self.rocks.append(band.values[:, *at].T)
        else:
            zero = np.zeros(row.size, int)
            self.materials.append(zero if band.zone is None else band.zone[at].astype(int) - 1)
        self.numbers.append(_ground_numbers(band, at))

    def _take_elevations(self, z: np.ndarray) -> None:
        self.low.take(z)
        self.high.take(-z)
        is_known = ~np.isnan(z)
        self.n_known += int(np.count_nonzero(is_known))
        self.deep += int(np.count_nonzero(z < LOWEST_LAND))
        self.integers = self.integers and bool((np.rint(z) == z)[is_known].all())
        if not self.integers:
            return
        for along in z, z.T:
            bend = along[:, 2:] - 2 * along[:, 1:-1] + along[:, :-2]
            back = bend[:, 1:] * bend[:, :-1]
            self.steps += int(np.count_nonzero(back < 0))
            self.spans += int(np.count_nonzero(~np.isnan(back)))

    def _take_spikes(self, band: Rasters, rows: slice) -> None:
        """Count cells far above or below all known neighbours, and keep the largest spike."""
        z, grid = band.z, band.grid
        limit = max(SPIKE[0], SPIKE[1] * grid.cell)
        for block in row_blocks((rows.stop - rows.start, z.shape[1])):
            first = rows.start + block.start
            step = np.diff(z[first : rows.start + block.stop], axis=1)
            alone = (np.abs(step[:, :-1]) > limit) & (step[:, :-1] * step[:, 1:] < 0)
            for row, column in np.argwhere(alone & (np.abs(step[:, 1:]) > limit)):
                i, j = first + row, column + 1
                around = z[max(0, i - 1) : i + 2, j - 1 : j + 2].astype(float).ravel()
                apart = z[i, j] - around
                apart = apart[~np.isnan(apart) & (apart != 0)]
                above = apart.size and (apart.min() > limit or apart.max() < -limit)
                if above and apart.size == np.count_nonzero(~np.isnan(around)) - 1:
                    self.spikes += 1
                    by = float(apart[np.argmin(abs(apart))])
                    if abs(by) > abs(self.spike[2]):
                        x, y = grid.x[j + band.at[1]], grid.y[i + band.at[0]]
                        self.spike = float(x), float(y), by

    def _take_sizes(self, band: Rasters, rows: slice) -> None:
        self.sizes = band.sizes
        if band.values is not None:
            for layer in band.values:
                self.smallest = float(np.fmin.reduce(layer[rows], None, initial=self.smallest))
                finite = np.isfinite(layer[rows])
                self.largest = float(np.max(layer[rows], initial=self.largest, where=finite))
            falling, rising = falls_and_rises(band.values[:, rows])
            self.falling, self.rising = self.falling + falling, self.rising + rising
        elif band.zone is None:
            self.used = {0}
        else:
            self.used |= set((np.unique(band.zone[rows]) - 1).tolist()) - {-1}

    def quantiles(self) -> np.ndarray:
        """Quantiles of the terrain slope [degree]; NaN if no cell has all its neighbours."""
        return _degrees(self.slopes, QUANTILES)

    def roughness(self) -> float:
        """Robust standard deviation of the change of slope angle between adjacent cells, on slopes
        in MIDDLE [degree]; NaN if there are too few."""
        slopes = np.degrees(np.arctan(np.concatenate([np.empty(0), *self.slopes])))
        is_middle = (slopes > MIDDLE[0]) & (slopes < MIDDLE[1])
        if not is_middle.size or is_middle.mean() < MIN_MIDDLE:
            return np.nan
        turns = np.abs(np.concatenate(self.bends, axis=1)[:, is_middle])
        return float(np.degrees(np.arctan(np.median(turns) / NORMAL_MEDIAN)))

    def source_quantiles(self) -> np.ndarray:
        """Quantiles of the slope at the sources [degree]."""
        return _degrees(self.source_slopes, QUANTILES)


def ground_of(rasters: Rasters) -> Ground:
    """Statistics of a whole terrain in memory, without sources."""
    ground = Ground()
    ground.take(rasters, rasters.grid.box)
    return ground


def falls_and_rises(sizes: np.ndarray) -> tuple[int, int]:
    """Numbers of places where Rg70, Rg20, Rg10 (in this order) decrease, and where they vary
    otherwise; equal or missing sizes count as neither."""
    falls = (sizes[1:] <= sizes[:-1]).all(axis=0) & (sizes[-1] < sizes[0])
    differ = (sizes[1:] != sizes[:-1]).any(axis=0) & ~np.isnan(sizes).any(axis=0)
    return int(np.count_nonzero(falls)), int(np.count_nonzero(differ & ~falls))


def _degrees(tangents: list[np.ndarray], shares: tuple[float, ...]) -> np.ndarray:
    all_ = np.concatenate(tangents) if tangents else np.empty(0)
    if not all_.size:
        return np.full(len(shares), np.nan)
    return np.degrees(np.arctan(np.quantile(all_, shares)))


def _slopes(band: Rasters, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Slope tangents of the cells at given points."""
    if not x.size:
        return np.empty(0)
    return np.sqrt(np.maximum(area_ratios(band, x, y) ** 2 - 1, 0.0))


def _bends(band: Rasters, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Changes (2, n) of the slope tangent at cells of a band, along rows and columns."""
    z = band.z
    twice = 2 * z[row, column].astype(float)
    along = z[row, column - 1] - twice + z[row, column + 1]
    across = z[row - 1, column] - twice + z[row + 1, column]
    return np.array([along, across]) / band.grid.cell


def _ground_numbers(band: Rasters, at: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Ground numbers of the scene at these cells."""
    if band.cell_ground is not None:
        return band.cell_ground[at]
    if band.material_ground is None or band.zone is None:
        return np.ones(at[0].size, int)
    return np.append(0, band.material_ground)[band.zone[at]]


def _samples(band: Rasters, box: Box) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the sample cells in a box, evenly spaced over the whole terrain. Cells
    without an elevation, or next to such a cell, are omitted."""
    grid = band.grid
    step = max(1, int(np.sqrt(grid.nx * grid.ny / SAMPLES)))
    rows = np.arange(max(1, -(-box.row // step) * step), min(box.stop_row, grid.ny - 1), step)
    columns = np.arange(1, grid.nx - 1, step)
    near = [-1, 0, 1]
    around = (
        band.z[np.ix_(rows - band.at[0] + i, columns - band.at[1] + j)] for i in near for j in near
    )
    row, column = np.nonzero(~np.isnan(sum(around)))
    return rows[row], columns[column]
