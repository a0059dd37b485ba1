# SPDX-License-Identifier: BSD-3-Clause
"""Elevations between cell centres, computed as in the kernel (theory, chapter 2)."""

import numpy as np

from rockfall.io.rasters.grid import Grid


def inside(grid: Grid, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Mask of points between the outer cell centres."""
    among = (x >= grid.x[0]) & (x <= grid.x[-1])
    return among & (y >= grid.y[-1]) & (y <= grid.y[0])


def height(z: np.ndarray, grid: Grid, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Bilinear elevation [m] at points between cell centres; `z` is (ny, nx), north row first."""
    j, i, v, u = _patches(grid, x, y)
    north = (1 - u) * z[j, i] + u * z[j, i + 1]
    south = (1 - u) * z[j + 1, i] + u * z[j + 1, i + 1]
    return (1 - v) * north + v * south


def steepness(z: np.ndarray, grid: Grid, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """1/cos of the slope of the bilinear surface at points between the cell centres."""
    j, i, v, u = _patches(grid, x, y)
    east = (1 - v) * (z[j, i + 1] - z[j, i]) + v * (z[j + 1, i + 1] - z[j + 1, i])
    south = (1 - u) * (z[j + 1, i] - z[j, i]) + u * (z[j + 1, i + 1] - z[j, i + 1])
    return np.sqrt(1 + (east**2 + south**2) / grid.cell**2)


def _patches(grid: Grid, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, ...]:
    """Row and column of the patch of each point, and the position within it (south, east), from 0
    to 1."""
    u = (x - grid.west) / grid.cell - 0.5
    v = (grid.north - y) / grid.cell - 0.5
    i = np.clip(u.astype(int), 0, grid.nx - 2)
    j = np.clip(v.astype(int), 0, grid.ny - 2)
    return j, i, v - j, u - i
