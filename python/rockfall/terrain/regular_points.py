# SPDX-License-Identifier: BSD-3-Clause
"""Detection of points on a regular grid, with or without gaps, as in national surveys."""

from typing import NamedTuple

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.rasters.grid import Grid, row_blocks
from rockfall.terrain.height import height

ROUNDING = 0.02  # maximum distance of rounded coordinates from their node, in spacings
DENSE = 0.8  # minimum fraction of points with at least two of four neighbours
#: Maximum nodes of a grid.
MAX_CELLS = 400_000_000
SPARSE = 100  # maximum nodes per point in a grid with gaps


class Nodes(NamedTuple):
    """Elevations (ny, nx) [m] at nodes, NaN without a point; `grid` has a cell around each node.
    `shared` counts the nodes with points of different elevations, whose mean is used."""

    z: np.ndarray
    grid: Grid
    shared: int

    @property
    def gaps(self) -> int:
        """Number of nodes without a point."""
        return int(np.isnan(self.z).sum())


class _Axis(NamedTuple):
    """Nodes along an axis: first node, spacing [m], and node index of each point."""

    first: float
    step: float
    at: np.ndarray

    @property
    def size(self) -> int:
        return int(self.at.max()) + 1


def spacings(points: np.ndarray) -> tuple[float, float] | None:
    """Node spacings in x and y [m]; None if points (n, 3) are not on the nodes of a grid."""
    axes = _axes(points)
    return None if axes is None else (axes[0].step, axes[1].step)


def regular_nodes(points: np.ndarray) -> Nodes | None:
    """Nodes of a regular grid with square cells; None if points (n, 3) [m] are not on the nodes of
    such a grid, or too few of its nodes have neighbours."""
    axes = _axes(points)
    if axes is None:
        return None
    x, y = axes
    nx, ny = x.size, y.size
    if abs(x.step - y.step) * max(nx, ny) > 5 * ROUNDING * x.step:
        return None
    cell = x.step if nx >= ny else y.step
    node = (ny - 1 - y.at) * nx + x.at
    count = np.bincount(node, minlength=nx * ny)
    if _dense(count.reshape(ny, nx) > 0) < DENSE:
        return None
    z = np.full(nx * ny, np.nan)
    z[node] = points[:, 2]
    shared = 0
    if (count > 1).any():
        differ = np.bincount(node, weights=points[:, 2] != z[node], minlength=nx * ny) > 0
        shared = int(differ.sum())
        mean = np.bincount(node, weights=points[:, 2], minlength=nx * ny)[differ] / count[differ]
        z[differ] = mean
    west, north = x.first - cell / 2, y.first + (ny - 1) * cell + cell / 2
    return Nodes(z.reshape(ny, nx), Grid(west, north, cell, nx, ny), shared)


def resampled(nodes: Nodes, cell: float) -> tuple[np.ndarray, Grid]:
    """Elevations and grid, resampled bilinearly to cells with edges at multiples of `cell` [m].
    Refuses too few or too many cells."""
    own = nodes.grid
    west = np.ceil((own.x[0] - cell / 2) / cell - ROUNDING) * cell
    north = np.floor((own.y[0] + cell / 2) / cell + ROUNDING) * cell
    nx = int((own.x[-1] - west - cell / 2) / cell + ROUNDING) + 1
    ny = int((north - cell / 2 - own.y[-1]) / cell + ROUNDING) + 1
    if min(nx, ny) < 2 or nx * ny > MAX_CELLS:
        raise RockfallError(f"--cell {cell:g}: {nx:,} x {ny:,} cells: must be 2 to {MAX_CELLS:,}")
    grid = Grid(float(west), float(north), cell, nx, ny)
    z = np.empty(grid.shape)
    for rows in row_blocks(grid.shape):
        x, y = np.meshgrid(grid.x, grid.y[rows])
        z[rows] = height(nodes.z, own, x.clip(own.x[0], own.x[-1]), y.clip(own.y[-1], own.y[0]))
    return z, grid


def _axes(points: np.ndarray) -> tuple[_Axis, _Axis] | None:
    x = _axis(points[:, 0])
    y = None if x is None else _axis(points[:, 1])
    if x is None or y is None or x.size * y.size > min(MAX_CELLS, SPARSE * len(points)):
        return None
    return x, y


def _axis(values: np.ndarray) -> _Axis | None:
    """Nodes along an axis; None if coordinates are not evenly spaced, or most are unique."""
    places = np.unique(values)
    if not 2 <= len(places) <= len(values) / 2:
        return None
    steps = np.diff(places)
    wide = np.quantile(steps, 0.95, method="lower")  # excludes gaps and double roundings of a node
    steps = steps[steps > ROUNDING * wide]
    usual = np.median(steps)
    step = float(steps[abs(steps - usual) < usual / 2].mean())
    nodes = np.rint((places - places[0]) / step)
    if nodes[-1] < 1:
        return None
    step = float(f"{(places[-1] - places[0]) / nodes[-1]:.9g}")
    offset = places - places[0] - nodes * step
    first = float(np.round(places[0] + np.median(offset), 6))
    if abs(places - first - nodes * step).max() > ROUNDING * step:
        return None
    return _Axis(first, step, np.rint((values - first) / step).astype(np.int64))


def _dense(has_point: np.ndarray) -> float:
    """Fraction of the nodes with a point for which at least two of the four neighbours also have a
    point."""
    around = np.zeros(has_point.shape, np.int8)
    around[1:] += has_point[:-1]
    around[:-1] += has_point[1:]
    around[:, 1:] += has_point[:, :-1]
    around[:, :-1] += has_point[:, 1:]
    return float((around[has_point] >= 2).mean())
