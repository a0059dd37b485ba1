# SPDX-License-Identifier: BSD-3-Clause
"""Reading of a case's rasters, which must have the cells of its terrain."""

from collections.abc import Iterator
from pathlib import Path
from shlex import quote
from typing import Any

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.coordinates.crs import crs_name, same_crs
from rockfall.io.coordinates.raster_units import stated_units
from rockfall.io.rasters.dem import add_packing_note
from rockfall.io.rasters.grid import NO_ID, Box, Grid
from rockfall.io.rasters.raster_file import RasterFile, open_raster


def aligned_blocks(
    path: str | Path,
    grid: Grid,
    what: str,
    dtype: Any,
    box: Box | None = None,
    smooth: bool = True,
    remarks: list[str] | None = None,
) -> Iterator[tuple[slice, np.ndarray]]:
    """Read a raster aligned with `grid` in blocks of rows: (rows, values valid until the next
    block). `what` (a plural) is used in messages. Rows of a box count from 0. If `smooth`, advice
    may suggest interpolation, unless values are integers. A `packing_note` may be added to
    `remarks`.

    Raises a RockfallError for cells unlike `grid` or invalid values. Cells without data are NaN, or
    `NO_ID` when `dtype` is an integer (of 32 bits or more).
    """
    dtype = np.dtype(dtype)
    store = np.empty((0, 0), dtype)
    with open_raster(path) as raster:
        add_packing_note(raster, remarks)
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
            if store.shape < block.shape:  # all blocks share a buffer, which saves memory
                store = np.empty(block.shape, dtype)
            values = store[: len(block)]
            values.fill(np.nan if dtype.kind == "f" else NO_ID)
            np.copyto(values, block, where=valid, casting="unsafe")
            yield rows, values


def _refuse_mark(raster: RasterFile, what: str, value: float, largest: int) -> None:
    """Refuse a magnitude above `largest` as undeclared nodata, with a command that declares it."""
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
                f"{raster.path}: {what} are in {unit.name} ({where}), but must be in metres"
            )


def _check_aligned(raster: RasterFile, grid: Grid, what: str, resampling: str) -> None:
    """Refuse a raster that is not aligned with `grid`, and suggest the command that aligns it."""
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
        problem += f": resample with: {raster.warp(f'on_{Path(grid.path).stem}', options)}"
    raise RockfallError(f"{raster.path}: {problem}")


def _extent(grid: Grid) -> str:
    """Short description of the position of a grid."""
    return (
        f"{grid.nx} x {grid.ny} cells of {grid.cell:.10g}, "
        f"corner {grid.west:.12g}, {grid.north:.12g}"
    )
