# SPDX-License-Identifier: BSD-3-Clause
"""Start conditions at the sources of a scene, and the cells that boulders can reach."""

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case
from rockfall.io.rasters.grid import Box, Grid
from rockfall.scene.kernel_scene import KernelScene


class Survey:
    """Terrain data that a run needs in advance, collected from all rows."""

    def __init__(self, case: Case, grid: Grid, minima: np.ndarray | None = None) -> None:
        """`minima` are the block minima of all rows, if already known."""
        self._output, self._grid = case.output, grid
        self.head = np.full(1, -np.inf)  # energy head [m]
        nodes = grid.nx, grid.ny
        side = _core.block_of(nodes)
        blocks = [-(-n // side) for n in nodes] if "maps" in case.output else [1, 1]
        self._known = minima is not None
        #: Minimum elevation [m] of each block of cells.
        self.minima = np.full(blocks, np.inf, order="F") if minima is None else minima

    def take(self, kernel: KernelScene, first: int, stop: int) -> None:
        """Add rows `first` to `stop` - 1 of the raster; the kernel's scene must contain them and
        four more rows on either side. Refuse a source from which no boulder can start."""
        minima = np.empty((1, 1)) if self._known else self.minima  # placeholder
        kernel.check(*_core.scan_rows(kernel.handle, first + 1, stop, minima, self.head))

    def box(self, kernel: KernelScene) -> Box:
        """Box of all cells that boulders can reach; the whole grid without maps, or if they cover
        the terrain. No rebound adds energy, so no boulder rises
        above its energy head at release (theory, chapter 5)."""
        if "maps" not in self._output or self._output["map_extent"] == "terrain":
            return self._grid.box
        corners = _core.reachable_box(kernel.handle, self.minima, self.head[0])
        column, row, last_column, last_row = corners.tolist()
        return Box(row - 1, column - 1, last_row, last_column)
