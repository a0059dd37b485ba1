# SPDX-License-Identifier: BSD-3-Clause
"""Maps as GeoTIFF."""

from pathlib import Path
from typing import Any

import numpy as np

from rockfall.errors import OUR_FAULT, RockfallError
from rockfall.io.atomic import atomic_write
from rockfall.io.rasters.grid import Grid, row_blocks

_TILE = 256  # cells


def write_geotiff(
    path: str | Path, array: np.ndarray, grid: Grid, nodata: float | None = None, **tags: Any
) -> None:
    """Write a map as a cloud-optimised GeoTIFF with its CRS and `tags`, atomically.

    The tags `units` and `long_name` also become the unit and the description of the band.
    """
    from rasterio.io import MemoryFile
    from rasterio.shutil import copy
    from rasterio.windows import Window

    if array.shape != grid.shape:
        raise RockfallError(
            f"{path}: array {array.shape} is not of the grid {grid.shape}", code=OUR_FAULT
        )
    if array.dtype == bool:
        array = array.view(np.uint8)
    profile = {
        "driver": "GTiff", "width": grid.nx, "height": grid.ny, "count": 1, "crs": grid.crs,
        "dtype": array.dtype.name, "transform": grid.transform, "nodata": nodata,
        "bigtiff": "IF_SAFER",
    }  # fmt: skip
    packed = {
        "driver": "COG", "blocksize": _TILE, "compress": "deflate", "bigtiff": "IF_SAFER",
        "resampling": "nearest",  # method for overviews
        "predictor": "yes" if array.dtype.kind == "f" or array.dtype.itemsize < 8 else "no",
    }  # fmt: skip
    # Python writes the bytes, because GDAL does not report a full disk on closing.
    with MemoryFile() as plain, MemoryFile() as memory, atomic_write(path) as part:
        with plain.open(**profile) as file:
            for rows in row_blocks(grid.shape, _TILE):
                window = Window(0, rows.start, grid.nx, rows.stop - rows.start)
                file.write(array[rows], 1, window=window)
            file.update_tags(**tags)
            file.units = [str(tags.get("units", ""))]
            file.set_band_description(1, str(tags.get("long_name", "")))
        with plain.open() as file:
            copy(file, memory.name, **packed)
        part.write_bytes(memory.getbuffer())
