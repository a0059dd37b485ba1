# SPDX-License-Identifier: BSD-3-Clause
"""A terrain of surveyed points by inverse distance (Shepard 1968), as in the paper, section 3.4."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rockfall.io.grid import Grid, row_blocks


class Weights(NamedTuple):
    """Which points tell of a place, and how much: 1/distance**power."""

    power: float  # [-]
    neighbours: int  # nearest points, at most
    within: float  # and no farther than this [m]


def interpolated(points: np.ndarray, grid: Grid, weights: Weights) -> np.ndarray:
    """Elevations (ny, nx) [m] at the centres of cells, of points (n, 3) [m]; NaN where none is near
    enough. At a point they are its own, and among equal elevations the same."""
    from scipy.spatial import cKDTree

    tree, z = cKDTree(points[:, :2]), np.empty(grid.shape)
    number = min(weights.neighbours, len(points))
    for rows in row_blocks((grid.ny, grid.nx * number)):
        places = np.stack(np.meshgrid(grid.x, grid.y[rows]), axis=-1)
        apart, which = tree.query(
            places, range(1, number + 1), distance_upper_bound=_beyond(weights.within)
        )
        z[rows] = _mean(points[:, 2], apart, which, weights.power)
    return z


def left_out(points: np.ndarray, weights: Weights) -> np.ndarray:
    """How far the elevations that the other points give lie above those of points (n) [m]; NaN
    where no other is near enough."""
    from scipy.spatial import cKDTree

    number = min(weights.neighbours, len(points) - 1) + 1
    apart, which = cKDTree(points[:, :2]).query(
        points[:, :2], range(1, number + 1), distance_upper_bound=_beyond(weights.within)
    )
    own = which == np.arange(len(points))[:, None]
    own[~own.any(axis=1), -1] = True  # so many lie in one place that it is not among them
    others = len(points), number - 1
    apart, which = apart[~own].reshape(others), which[~own].reshape(others)
    return _mean(points[:, 2], apart, which, weights.power) - points[:, 2]


def _beyond(within: float) -> float:
    """What SciPy takes for a limit: it wants distances below it."""
    return float(np.nextafter(within, np.inf))


def _mean(z: np.ndarray, apart: np.ndarray, which: np.ndarray, power: float) -> np.ndarray:
    """Weighted by distances to the points, the nearest first; infinite ones count for nothing."""
    if not apart.shape[-1]:
        return np.full(apart.shape[:-1], np.nan)
    nearest = apart[..., :1]
    with np.errstate(invalid="ignore"):  # relative to the nearest, which weighs 1: no overflow
        weight = np.where(nearest > 0, (nearest / apart) ** power, apart == 0)
    weight[np.isinf(apart)] = 0.0
    of = np.append(z, 0.0)[which]
    first = of[..., 0]
    with np.errstate(invalid="ignore"):
        return first + (weight * (of - first[..., None])).sum(-1) / weight.sum(-1)
