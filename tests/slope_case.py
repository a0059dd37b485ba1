# SPDX-License-Identifier: BSD-3-Clause
"""Small slope with the files of a user: rasters, a table, impact sets, and a case with a line."""

from pathlib import Path

import numpy as np

import scenes
from made import make_raster

NY, NX = 30, 24
TABLE = "zone,mean_radius\n1,0.3\n2,0.2\n"
CASE = """&case title = 'Slope', boulders = 20, seed = 7 /
&terrain dem = 'dem.tif' /
&surface zones = 'zones.tif', table = 'zones.csv' /
&impact sets = 'sets.nml' /
&boulder volume = 'fixed', volume_mean = 0.8, density = 2800.0 /
&release x = 600060.0, y = 4999980.0, drop_height = 2.0 /
&line name = 'L', x = 600000.0, 600120.0, y = 4999930.0, 4999930.0 /
&output maps = 'passages', 'energy_mean', trajectories = 3 /
"""


def slope():
    south = np.arange(NY)[:, None] * 5.0
    return (1100 - 0.7 * np.minimum(south, 100) + 0 * np.arange(NX)).astype("f4")


def zones():
    return (np.where(np.arange(NX) < 12, 1, 2) + np.zeros((NY, 1))).astype("i4")


def write_slope(folder="."):
    make_raster(f"{folder}/dem.tif", slope(), nodata=-9999)
    make_raster(f"{folder}/zones.tif", zones(), nodata=-9999)
    for name, text in (("zones.csv", TABLE), ("sets.nml", scenes.CALM_SETS), ("case.nml", CASE)):
        Path(folder, name).write_text(text)
