# SPDX-License-Identifier: BSD-3-Clause
"""Planes for tests of laboratory tables."""

from typing import Any

import numpy as np

from rockfall.io.rasters.grid import Grid


def plane(slope: float, rows: int, columns: int, cell: float) -> dict[str, Any]:
    """Terrain of a run: a plane with this slope [degree] to the south, 500 m in its lowest row."""
    y = np.mgrid[rows - 1 : -1 : -1, 0:columns][0] * cell
    place = Grid(0.0, rows * cell, cell, columns, rows)
    return {"dem": 500 + np.tan(np.radians(slope)) * y, "transform": place}
