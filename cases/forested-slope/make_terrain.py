# SPDX-License-Identifier: BSD-3-Clause
"""Make a wooded slope above a road: `dem.tif` (m), `stems.tif` (stems per hectare) and `zones.tif`
(ids of zones.csv).

`python cases/forested-slope/make_terrain.py [FOLDER]` writes them next to this script, or to a
folder. From the north: 16 m of cliff at 60 degrees, a slope that flattens from 38 to 31 degrees, a
road (a level bench 8 m wide), a meadow. The forest begins below the scree at the foot of the cliff
and ends above the road; a lane without trees runs down its middle. The slope is synthetic.
"""

import sys
from pathlib import Path

import numpy as np

from rockfall.io.rasters.geotiff import write_geotiff
from rockfall.io.rasters.grid import Grid
from rockfall.terrain.synthetic import relief

CELL, NX, NY = 2.0, 120, 150  # [m]: 240 m across the slope, 300 m down it
GRID = Grid(0.0, CELL * NY, CELL, NX, NY)
CLIFF, FOOT, ROAD, END = 16.0, 224.0, 232.0, 300.0  # plan distances from the northern edge [m]
BOTTOM = 600.0  # elevation of the southern edge [m]
SEED = 20250716  # seed of the relief
RELIEF = 0.2  # standard deviation of the relief [m]
FOREST = 60.0, 200.0  # edges of the forest, plan distances from the northern edge [m]
LANE = 110.0, 130.0  # eastings of a lane without trees [m]
STEMS = 300.0  # per hectare


def south() -> np.ndarray:
    """Plan distance of the rows from the northern edge, (NY, 1) [m]."""
    return (GRID.north - GRID.y)[:, None]


def natural(steeper: float) -> np.ndarray:
    """Elevation of the rows without relief, (NY, 1) [m]."""
    step = np.linspace(0.0, END, 3001)
    slope = 38.0 - 7.0 * (step - CLIFF) / (FOOT - CLIFF) + steeper
    angle = np.select([step < CLIFF, step < FOOT, step < ROAD], [60.0, slope, 0.0], 10.0)
    fall = np.concatenate([[0.0], np.cumsum(np.tan(np.radians(angle[:-1])) * np.diff(step))])
    return BOTTOM + fall[-1] - np.interp(south(), step, fall)


def rough(seed: int) -> np.ndarray:
    """Relief (NY, NX) [m]; zero on cliff, road and meadow."""
    on_slope = (south() > CLIFF) & (south() < FOOT - 4.0)
    return np.where(on_slope, relief(seed, (NY, NX), RELIEF), 0.0)


def elevation(seed: int = SEED, steeper: float = 0.0) -> np.ndarray:
    """Elevation (NY, NX), northern row first [m]; `relief` and `steeper` [degrees] give other
    slopes."""
    return (natural(steeper) + rough(seed)).astype("f4")


def stems() -> np.ndarray:
    """Stems per hectare, (NY, NX), northern row first."""
    down, x = south(), GRID.x[None, :]
    wooded = (down > FOREST[0]) & (down < FOREST[1]) & ~((x > LANE[0]) & (x < LANE[1]))
    return np.where(wooded, STEMS, 0.0).astype("f4")


def zones() -> np.ndarray:
    """Ids of zones.csv, (NY, NX), northern row first: scree, forest floor, road and meadow."""
    ids = np.select([south() < FOREST[0], south() < FOOT, south() < ROAD], [1, 2, 3], 4)
    return np.broadcast_to(ids, (NY, NX)).astype("u1")


def write(folder: Path, *slope: float) -> None:
    """Write the three rasters of the slope, or of another slope (`elevation`)."""
    folder.mkdir(parents=True, exist_ok=True)
    write_geotiff(folder / "dem.tif", elevation(*slope), GRID)
    write_geotiff(folder / "stems.tif", stems(), GRID)
    write_geotiff(folder / "zones.tif", zones(), GRID)


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
