# SPDX-License-Identifier: BSD-3-Clause
"""Start conditions at the sources of a scene, and the cells that boulders can reach."""

from __future__ import annotations

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.io.grid import Box
from rockfall.scene.scene import Scene


class Survey:
    """Terrain data needed before a run, gathered from all its rows."""

    def __init__(self, scene: Scene) -> None:
        output = scene.case.output
        self.scene, self.head = scene, np.full(1, -np.inf)  # energy head [m]
        nodes = scene.grid.nx, scene.grid.ny
        side = _core.block_of(nodes)
        blocks = [-(-n // side) for n in nodes] if "maps" in output else [1, 1]
        self.minima = np.full(blocks, np.inf, order="F")  # minima of blocks of cells [m]

    def take(self, scene: Scene, first: int, stop: int) -> None:
        """Add rows `first` to `stop` - 1 of the raster; the scene holds them and four more on
        either side.

        A source from which no boulder can start is refused.
        """
        kernel = scene.kernel
        kernel.check(*_core.scan_rows(kernel.handle, first + 1, stop, self.minima, self.head))

    def box(self) -> Box:
        """Box of all cells that boulders can reach: no rebound adds energy, so no boulder rises
        above its energy head at release (theory, chapter 5)."""
        scene, grid = self.scene, self.scene.grid
        output = scene.case.output
        if "maps" not in output or output["map_extent"] == "terrain":
            return grid.box
        found = _core.reachable_box(scene.kernel.handle, self.minima, self.head[0])
        column, row, last_column, last_row = found.tolist()
        return Box(row - 1, column - 1, last_row, last_column)


def survey(scene: Scene) -> Survey:
    """Survey the terrain of a scene."""
    if scene.windows:
        return scene.windows.survey
    found = Survey(scene)
    found.take(scene, 0, scene.grid.ny)
    return found
