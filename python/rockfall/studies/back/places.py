# SPDX-License-Identifier: BSD-3-Clause
"""Check that boulders can reach the observed places."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.vectors.layers import extent
from rockfall.scene.scene import Scene


def check_on_terrain(scene: Scene, where: Sequence[str], x: np.ndarray, y: np.ndarray) -> None:
    """Raise a RockfallError for a place x, y [m] outside the terrain, or else without an elevation;
    `where` gives the file and row of each place."""
    if not len(x):
        return
    grid = scene.grid
    inside = (grid.west <= x) & (x <= grid.east) & (grid.south <= y) & (y <= grid.north)
    for k in np.flatnonzero(~inside)[:1].tolist():
        raise RockfallError(
            f"{where[k]}: x = {x[k]:.12g}, y = {y[k]:.12g}: lies outside the terrain, "
            f"{extent(grid.west, grid.south, grid.east, grid.north)}"
        )
    for k in np.flatnonzero(~scene.known_at(x, y))[:1].tolist():
        raise RockfallError(
            f"{where[k]}: x = {x[k]:.12g}, y = {y[k]:.12g}: the terrain has no elevation there"
        )
