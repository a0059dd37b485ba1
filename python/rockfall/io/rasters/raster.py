# SPDX-License-Identifier: BSD-3-Clause
"""Raster files and arrays: elevations and aligned rasters as input, maps as output.

In memory rasters are north-up and C-ordered, `array[row, column]`, row 0 the northernmost. Files
are read in blocks of rows, so a large raster needs no memory beyond its final array.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from shlex import quote
from typing import Any

import numpy as np

from rockfall.errors import OUR_FAULT, RockfallError
from rockfall.io.coordinates.crs import check_metres, crs_name, same_crs
from rockfall.io.coordinates.raster_units import stated_units
from rockfall.io.files import atomic_write
from rockfall.io.rasters.arrays import check_elevations
from rockfall.io.rasters.grid import NO_ID, Box, Grid, row_blocks
from rockfall.io.rasters.raster_file import GdalCells, RasterFile, open_raster
from rockfall.language import remark

_TILE = 256  # cells
SAME_UNIT = 1e-3  # relative: rounded factors of a unit


def read_dem(path: str | Path, remarks: list[str] | None = None) -> tuple[np.ndarray, Grid]:
    """Elevations [m], NaN where missing, and their grid; `remarks` gets a `packing_note`.

    float32 stays float32; integers of 8 and 16 bits become float32, which represents them exactly;
    all other types, and every ESRI ASCII grid, become float64. `path` may be `file.nc:variable`.
    """
    with open_raster(path) as raster:
        _check_dem(raster)
        z = _elevations(raster, raster.grid.box)
        _remark(raster, remarks)
    check_elevations(str(path), z)
    return z, raster.grid


def dem_header(path: str | Path) -> tuple[Grid, np.dtype]:
    """Grid of a DEM, and the type of its elevations in memory."""
    with open_raster(path) as raster:
        _check_dem(raster)
        return raster.grid, raster.dtype


def packing_note(path: str | Path) -> list[str]:
    """A remark if stored numbers are not the values because of a companion file, which a look at
    the raster alone would not reveal. Packing in netCDF files is explicit."""
    remarks: list[str] = []
    with open_raster(path) as raster:
        _remark(raster, remarks)
    return remarks


def read_elevations(path: str | Path, box: Box) -> np.ndarray:
    """Elevations of some cells [m], NaN where missing."""
    with open_raster(path) as raster:
        return _elevations(raster, box)


def _elevations(raster: RasterFile, box: Box) -> np.ndarray:
    z = np.empty(box.shape, raster.dtype)
    for rows, block, valid in raster.blocks(box):
        z[rows] = block
        z[rows][~valid] = np.nan
    return z


def _check_dem(raster: RasterFile) -> None:
    """Refuse a raster that cannot be a terrain."""
    stated = stated_units(raster)
    for unit, where in stated:
        scale = raster.cells.packing[0]
        if not unit.is_metre and math.isclose(scale, unit.factor, rel_tol=SAME_UNIT):
            raise RockfallError(
                f"{raster.path}: elevations are in {unit.name} ({where}), and its scale of "
                f"{scale:g} makes metres of them already: correct one"
            )
    check_metres(raster.grid, raster.path, stated, raster.in_metres)
    raster.check_cells()


def _remark(raster: RasterFile, remarks: list[str] | None) -> None:
    """Add the remark of `packing_note` to some, unless these are not wanted."""
    if remarks is None or not isinstance(raster.cells, GdalCells):
        return
    scale, offset = raster.cells.packing
    if (scale, offset) == (1.0, 0.0):
        return
    beside = Path(f"{raster.path}.aux.xml")
    said_by = f" ({beside.name})" if beside.exists() else ""
    numbers = {"scale": float(scale), "offset": float(offset)}
    remarks.append(remark(f"{raster.path}{said_by}", "input.packing", **numbers))


def aligned_blocks(
    path: str | Path,
    grid: Grid,
    what: str,
    dtype: Any,
    box: Box | None = None,
    smooth: bool = True,
    remarks: list[str] | None = None,
) -> Iterator[tuple[slice, np.ndarray]]:
    """Read a raster of `what` (a plural, for messages), aligned with the cells of `grid`, in blocks
    of rows: (rows, values valid until the next block). With a box, its rows count from 0. `smooth`:
    values may be interpolated between cells, unless they are integers. `remarks` gets a
    `packing_note`.

    Cells without data are NaN, or `NO_ID` when `dtype` is an integer (of 32 bits or more).
    """
    dtype = np.dtype(dtype)
    store = np.empty((0, 0), dtype)
    with open_raster(path) as raster:
        _remark(raster, remarks)
        _check_aligned(
            raster, grid, what, "bilinear" if smooth and dtype.kind == "f" else "nearest"
        )
        if dtype.kind == "f":
            _check_unit(raster, what)
        for rows, block, valid in raster.blocks(box):
            if dtype.kind != "f":
                inside = (block > NO_ID) & (block <= np.iinfo(dtype).max)
                if block.dtype.kind == "f":
                    inside &= np.rint(block) == block
                if (wrong := np.argwhere(valid & ~inside)).size:
                    row, column = wrong[0]
                    _refuse_mark(raster, what, float(block[row, column]), np.iinfo(dtype).max)
                    raise RockfallError(
                        f"{raster.path}: row {rows.start + row + 1}, column {column + 1}: "
                        f"{block[row, column]:g}: {what} must be integers"
                    )
            if store.shape < block.shape:  # one for all blocks: the heap keeps what comes and goes
                store = np.empty(block.shape, dtype)
            values = store[: len(block)]
            values.fill(np.nan if dtype.kind == "f" else NO_ID)
            np.copyto(values, block, where=valid, casting="unsafe")
            yield rows, values


def write_geotiff(
    path: str | Path, array: np.ndarray, grid: Grid, nodata: float | None = None, **tags: Any
) -> None:
    """Write a map as a cloud-optimised GeoTIFF, with its CRS and `tags`, atomically.

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
        "resampling": "nearest",  # of overviews
        "predictor": "yes" if array.dtype.kind == "f" or array.dtype.itemsize < 8 else "no",
    }  # fmt: skip
    # GDAL does not report a full disk when it closes a file, so Python writes the bytes.
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


def _refuse_mark(raster: RasterFile, what: str, value: float, largest: int) -> None:
    """Refuse a number out of the range of integers, which is nodata that a file does not declare;
    suggest the command that does."""
    if abs(value) <= largest:
        return
    cure = "declare it as nodata"
    if Path(raster.path).suffix.lower() in (".tif", ".tiff"):
        cure += f": rio edit-info --nodata {value!r} {quote(str(raster.path))}"
    raise RockfallError(f"{raster.path}: {what} cannot be {value:g}: {cure}")


def _check_unit(raster: RasterFile, what: str) -> None:
    """Refuse lengths in units other than the metre."""
    for unit, where in stated_units(raster):
        if not unit.is_metre:
            raise RockfallError(
                f"{raster.path}: {what} are in {unit.name} ({where}), metres are needed"
            )


def _check_aligned(raster: RasterFile, grid: Grid, what: str, resampling: str) -> None:
    """Refuse a raster that is not aligned with `grid`; suggest the command that aligns it."""
    own, dem, apart = raster.grid, grid.path or "the terrain", False
    if not same_crs(own.crs, grid.crs):
        problem = f"{what} are in {crs_name(own.crs)}, {dem} is in {crs_name(grid.crs)}"
    elif not (flaw := raster.flaw()) and own.matches(grid):
        return
    else:
        apart = not flaw and not own.overlaps(grid)
        verb = "lie apart from" if apart else "are not on"
        problem = f"{what} ({flaw or _extent(own)}) {verb} the cells of {dem} ({_extent(grid)})"
    if grid.path and not apart:
        options = f"--like {quote(grid.path)} --resampling {resampling}"
        problem += f"; resample with: {raster.warp(f'on_{Path(grid.path).stem}', options)}"
    raise RockfallError(f"{raster.path}: {problem}")


def _extent(grid: Grid) -> str:
    """Short description of the position of a grid."""
    return (
        f"{grid.nx} x {grid.ny} cells of {grid.cell:.10g}, "
        f"corner {grid.west:.12g}, {grid.north:.12g}"
    )
