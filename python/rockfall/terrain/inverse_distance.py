# SPDX-License-Identifier: BSD-3-Clause
"""Terrain from surveyed points by inverse-distance weighting (Shepard 1968; paper, section 3.4)."""

from typing import NamedTuple

import numpy as np

from rockfall.io.rasters.grid import Grid, row_blocks


class Weights(NamedTuple):
    """Weighting of surveyed points by 1/distance**power."""

    power: float  # [-]
    neighbours: int  # maximum number of nearest points used
    within: float  # maximum distance [m]


def interpolated(points: np.ndarray, grid: Grid, weights: Weights) -> np.ndarray:
    """Interpolate elevations (ny, nx) [m] at cell centres from points (n, 3) [m]; NaN where no
    point is near. Elevations at the points, and constant elevations, are reproduced exactly."""
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


def left_out(points: np.ndarray, weights: Weights, every: int = 1) -> np.ndarray:
    """Leave-one-out errors (n,) [m] at one in `every` points: elevation interpolated from the other
    points minus measured elevation; NaN if no other point is near."""
    from scipy.spatial import cKDTree

    tree, asked = cKDTree(points[:, :2]), np.arange(0, len(points), every)
    number = min(weights.neighbours, len(points) - 1) + 1
    errors = np.empty(len(asked))
    for rows in row_blocks((len(asked), number)):
        apart, which = tree.query(
            points[asked[rows], :2], range(1, number + 1),
            distance_upper_bound=_beyond(weights.within),
        )  # fmt: skip
        own = which == asked[rows][:, None]
        own[~own.any(axis=1), -1] = True  # more coincident points than neighbours
        others = len(apart), number - 1
        apart, which = apart[~own].reshape(others), which[~own].reshape(others)
        errors[rows] = _mean(points[:, 2], apart, which, weights.power) - points[asked[rows], 2]
    return errors


def _beyond(within: float) -> float:
    """Limit for SciPy, which requires distances strictly below it."""
    return float(np.nextafter(within, np.inf))


def _mean(z: np.ndarray, apart: np.ndarray, which: np.ndarray, power: float) -> np.ndarray:
    """Inverse-distance weighted mean of points sorted by distance, ignoring infinite distances."""
    if not apart.shape[-1]:
        return np.full(apart.shape[:-1], np.nan)
    nearest = apart[..., :1]
    with np.errstate(invalid="ignore"):  # relative to the nearest point, which avoids overflow
        weight = np.where(nearest > 0, (nearest / apart) ** power, apart == 0)
    weight[np.isinf(apart)] = 0.0
    heights = z[np.minimum(which, len(z) - 1)]  # missing neighbours have weight 0
    first = heights[..., 0]
    with np.errstate(invalid="ignore"):
        return first + (weight * (heights - first[..., None])).sum(-1) / weight.sum(-1)
