# SPDX-License-Identifier: BSD-3-Clause
"""Make the stand-in for the experimental slope: `dem.tif` (m) and `zones.tif` (ids of zones.csv).

The slope is defined in `rockfall_lab.scorecard.vaujany_slope`, whose parameters the calibration of
impact sets varies. It is the same on every run, but its last bits may differ with another NumPy or
libm. The two files are therefore stored next to this script.
"""

from pathlib import Path

import numpy as np
import rasterio

from rockfall_lab.scorecard.vaujany_slope import CELL, NORTH, WEST, Talus, zones

HERE = Path(__file__).parent


def write(name: str, raster: np.ndarray) -> None:
    """Write a GeoTIFF next to this script, without a CRS, because the site is synthetic."""
    transform = rasterio.Affine(CELL, 0, WEST, 0, -CELL, NORTH)
    height, width = raster.shape
    about = {"height": height, "width": width, "count": 1, "dtype": raster.dtype}
    with rasterio.open(
        HERE / name, "w", driver="GTiff", compress="deflate", transform=transform, **about
    ) as file:
        file.write(raster, 1)


if __name__ == "__main__":
    write("dem.tif", Talus().elevation())
    write("zones.tif", zones())
