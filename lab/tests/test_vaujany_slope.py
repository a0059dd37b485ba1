# SPDX-License-Identifier: BSD-3-Clause
"""Stand-in for the experimental slope."""

from pathlib import Path

import numpy as np
import rasterio

from rockfall_lab.scorecard import vaujany_slope
from rockfall_lab.scorecard.vaujany_slope import Talus

VAUJANY = Path(__file__).parents[2] / "cases/vaujany"


def test_vaujany_rasters_are_those_of_the_script():
    elevation, zones = Talus().elevation(), vaujany_slope.zones()
    with rasterio.open(VAUJANY / "dem.tif") as dem, rasterio.open(VAUJANY / "zones.tif") as ids:
        assert np.abs(dem.read(1) - elevation).max() < 1e-4
        assert (ids.read(1) == zones).all()
        assert dem.transform == ids.transform == rasterio.Affine(2.5, 0, 0, 0, -2.5, 600)
        assert dem.crs is None
