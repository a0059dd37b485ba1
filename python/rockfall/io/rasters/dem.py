# SPDX-License-Identifier: BSD-3-Clause
"""Elevations of a raster file.

Rasters in memory are north-up and C-ordered, `array[row, column]`, northernmost row first. Files
are read in blocks of rows, so that a large raster needs no memory beyond its final array.
"""

import math
from pathlib import Path

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.coordinates.crs import check_metres
from rockfall.io.coordinates.raster_units import stated_units
from rockfall.io.rasters.arrays import check_elevations
from rockfall.io.rasters.grid import Box, Grid
from rockfall.io.rasters.raster_file import GdalCells, RasterFile, open_raster
from rockfall.language import remark

SAME_UNIT = 1e-3  # tolerance for rounded unit factors


def read_dem(path: str | Path, remarks: list[str] | None = None) -> tuple[np.ndarray, Grid]:
    """Read the elevations [m] of a raster, NaN where missing, and its grid; a `packing_note` may
    be added to `remarks`.

    float32 stays float32; integers of 8 and 16 bits become float32, which is exact; other types,
    packed values and ESRI ASCII grids become float64. `path` may be `file.nc:variable`.
    """
    with open_raster(path) as raster:
        _check_dem(raster)
        z = _elevations(raster, raster.grid.box)
        add_packing_note(raster, remarks)
    check_elevations(str(path), z)
    return z, raster.grid


def dem_header(path: str | Path) -> tuple[Grid, np.dtype]:
    """Grid of a DEM, and the type of its elevations in memory."""
    with open_raster(path) as raster:
        _check_dem(raster)
        return raster.grid, raster.dtype


def packing_note(path: str | Path) -> list[str]:
    """Remarks on the scale and offset of a raster, which a companion file may set unnoticed."""
    remarks: list[str] = []
    with open_raster(path) as raster:
        add_packing_note(raster, remarks)
    return remarks


def read_elevations(path: str | Path, box: Box) -> np.ndarray:
    """Read the elevations [m] of the cells in a box, NaN where missing."""
    with open_raster(path) as raster:
        return _elevations(raster, box)


def _elevations(raster: RasterFile, box: Box) -> np.ndarray:
    z = np.empty(box.shape, raster.dtype)
    for rows, block, valid in raster.blocks(box):
        z[rows] = block
        z[rows][~valid] = np.nan
    return z


def _check_dem(raster: RasterFile) -> None:
    """Refuse a raster that cannot be a terrain model."""
    stated = stated_units(raster)
    for unit, where in stated:
        scale = raster.cells.packing[0]
        if not unit.is_metre and math.isclose(scale, unit.factor, rel_tol=SAME_UNIT):
            raise RockfallError(
                f"{raster.path}: elevations are declared in {unit.name} ({where}), but scale "
                f"factor {scale:g} already converts them to metres: correct the unit or the scale"
            )
    check_metres(raster.grid, raster.path, stated, raster.in_metres)
    raster.check_cells()


def add_packing_note(raster: RasterFile, remarks: list[str] | None) -> None:
    """Add a remark on the scale and offset of a raster to `remarks`, if it has any and `remarks` is
    not None."""
    if remarks is None or not isinstance(raster.cells, GdalCells):
        return
    scale, offset = raster.cells.packing
    if (scale, offset) == (1.0, 0.0):
        return
    beside = Path(f"{raster.path}.aux.xml")
    said_by = f" ({beside.name})" if beside.exists() else ""
    numbers = {"scale": float(scale), "offset": float(offset)}
    remarks.append(remark(f"{raster.path}{said_by}", "input.packing", **numbers))
