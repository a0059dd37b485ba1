# SPDX-License-Identifier: BSD-3-Clause
"""Make the slope of the forest experiment as a plane: `dem.tif`.

`python cases/vaujany-forest/make_terrain.py [FOLDER]` writes it next to this script, or to a
folder. It falls southwards at 38 degrees, and extends above the release and below the line at the
end of the slope.
"""

import sys
from pathlib import Path

import numpy as np

from rockfall.io.rasters.geotiff import write_geotiff
from rockfall.io.rasters.grid import Grid

CELL, NX, NY = 2.0, 100, 110  # [m]: 200 m across the slope, 220 m down it, in plan
GRID = Grid(0.0, CELL * NY, CELL, NX, NY)
GRADIENT = np.tan(np.radians(38.0))
BOTTOM = 900.0  # elevation of the southern edge [m]


def elevation() -> np.ndarray:
    """Elevation (NY, NX), northern row first [m]."""
    return (BOTTOM + GRADIENT * GRID.y[:, None] + np.zeros((1, NX))).astype("f8")


def write(folder: Path) -> None:
    """Write the raster of the slope."""
    folder.mkdir(parents=True, exist_ok=True)
    write_geotiff(folder / "dem.tif", elevation(), GRID)


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
