# SPDX-License-Identifier: BSD-3-Clause
"""Make the slope above the settlement: `dem.tif` (m), `zones.tif` (ids of zones.csv).

`python cases/settlement/make_terrain.py [FOLDER]` writes them next to this script, or to a folder.
The slope is synthetic: two rock faces, a gully between them, scree, pasture, and the flat fan
below.
"""

import sys
from pathlib import Path

import numpy as np

from rockfall.io.rasters.geotiff import write_geotiff
from rockfall.io.rasters.grid import Grid
from rockfall.terrain.synthetic import relief

CELL, NX, NY = 4.0, 110, 150  # [m]: 440 m across the slope, 600 m down it
GRID = Grid(0.0, CELL * NY, CELL, NX, NY)
SEED = 20250601  # seed of the relief
RELIEF = 0.25  # standard deviation of the relief [m]
BENDS = [0, 40, 80, 100, 300, 380, 440, 600]  # plan distances of bends from the northern edge [m]
ANGLES = [28, 36, 36, 36, 36, 24, 13, 4]  # slopes at the bends [degree]
TOP = 900.0  # elevation of the northern edge [m]
#: West and east end, upper and lower edge (plan distance from the north), and additional fall over
#: the rock [m].
FACES = (70.0, 190.0, 52.0, 76.0, 22.0), (260.0, 380.0, 56.0, 80.0, 18.0)
GULLY = 225.0, 4.0, 12.0  # axis, depth, half width [m]
ROCK, SCREE, PASTURE, FAN, STREAM = 1, 2, 3, 4, 5


def place() -> tuple[np.ndarray, np.ndarray]:
    """Plan distance from the northern edge (NY, 1) and easting (1, NX) of the cells [m]."""
    return (GRID.north - GRID.y)[:, None], GRID.x[None, :]


def face(s: np.ndarray, x: np.ndarray, edges: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Fraction of a face's height above each cell, and fraction of the cell within the face."""
    west, east, upper, lower, _ = edges
    across = 1 / (1 + np.exp(-(x - west) / 5)) / (1 + np.exp((x - east) / 5))
    return across, np.clip((s - upper) / (lower - upper), 0, 1)


def natural(s: np.ndarray) -> np.ndarray:
    """Elevation along the slope without faces, gully and relief [m]."""
    step = 0.01
    middle = np.arange(0, 600, step) + step / 2
    fall = np.cumsum(step * np.tan(np.radians(np.interp(middle, BENDS, ANGLES))))
    return TOP - np.interp(s, np.append(0, middle + step / 2), np.append(0, fall))


def elevation() -> np.ndarray:
    """Elevation (NY, NX), northern row first [m]."""
    s, x = place()
    z = natural(s) + relief(SEED, (NY, NX), RELIEF)
    for edges in FACES:  # rock rises above the slope, and falls to it at its foot
        across, above = face(s, x, edges)
        z = z + across * edges[-1] * (1 - above)
    axis, depth, half = GULLY
    along = np.interp(s, [0, 60, 320, 400], [depth / 4, depth, depth, 0])
    return (z - along * np.exp(-(((x - axis) / half) ** 2))).astype("f4")


def zones() -> np.ndarray:
    """Ids of zones.csv, (NY, NX), northern row first."""
    s, x = place()
    ids = np.full((NY, NX), SCREE)
    for begin, zone in (330, PASTURE), (420, FAN):
        ids[s[:, 0] > begin] = zone
    for edges in FACES:
        across, above = face(s, x, edges)
        ids[(across > 0.5) & (above > 0) & (above < 1)] = ROCK
    ids[np.abs(s - (580 + 4 * np.sin(x / 40))) < 4] = STREAM
    return ids.astype("u1")


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    folder.mkdir(parents=True, exist_ok=True)
    write_geotiff(folder / "dem.tif", elevation(), GRID)
    write_geotiff(folder / "zones.tif", zones(), GRID)
