# SPDX-License-Identifier: BSD-3-Clause
"""Elevations between cell centres, as in the kernel (theory, chapter 2)."""

from __future__ import annotations

import numpy as np

from rockfall.io.grid import Grid


def height(z: np.ndarray, grid: Grid, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Bilinear elevation [m] at points within the cell centres; `z` is (ny, nx), from the north."""
    u = (x - grid.west) / grid.cell - 0.5
    v = (grid.north - y) / grid.cell - 0.5
    i = np.clip(u.astype(int), 0, grid.nx - 2)
    j = np.clip(v.astype(int), 0, grid.ny - 2)
    u, v = u - i, v - j
    north = (1 - u) * z[j, i] + u * z[j, i + 1]
    south = (1 - u) * z[j + 1, i] + u * z[j + 1, i + 1]
    return (1 - v) * north + v * south
