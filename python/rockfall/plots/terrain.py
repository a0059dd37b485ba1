# SPDX-License-Identifier: BSD-3-Clause
"""Terrain of a result: found, checked and read."""

from __future__ import annotations

import contextlib
import json
import warnings
from pathlib import Path

import numpy as np
import xarray as xr

from rockfall.case import FROM_ARRAY, case_of
from rockfall.errors import RockfallError
from rockfall.io.rasters.arrays import corner_of
from rockfall.io.rasters.grid import Box, Grid
from rockfall.io.rasters.raster_file import open_raster, raster_file
from rockfall.plots.extent import reached
from rockfall.result.trajectories import Terrain
from rockfall.scene.layers import file_checksum
from rockfall.terrain.dams import with_dam

MAX_CELLS = 16_000_000  # maximum cells at full resolution; larger terrain is thinned


def terrain_of(
    result: xr.Dataset, dem: str | Path | None = None, beside: Path | None = None
) -> Terrain | None:
    """Elevations (ny, nx) [m] within the extent of a result, with its dams, thinned to about
    `MAX_CELLS`, and their grid.

    The terrain is read from the file `dem`, else from the case's file (relative to the folder of
    the run), else from a file of this name in the result's folder `beside`. A `dem` that differs
    from the run's file raises a RockfallError. Without `dem`, a failure returns None and gives a
    warning with the reason.
    """
    try:
        path = _found(result, _places(result, beside) if dem is None else [Path(dem)])
        z, grid = _read(result, path)
        for dam in case_of(result).dam:
            # a crest that extends beyond the boulders raises an error
            with contextlib.suppress(RockfallError):
                z, _ = with_dam(z, grid, dam, str(path))
        return z, grid
    except RockfallError as error:
        if dem is not None:
            raise
        warnings.warn(f"{error}. Figures have no relief: give the DEM of the run", stacklevel=2)
        return None


def _places(result: xr.Dataset, beside: Path | None) -> list[Path]:
    """Candidate paths of the case's DEM: in the folder of the run, or next to the result. Refuses
    elevations given as an array."""
    case = case_of(result)
    if case.terrain["dem"] == FROM_ARRAY:
        raise RockfallError(f"{case.name}: elevations were given as an array, not as a file")
    name = case.terrain["dem"]
    places = [case.path(name)]
    if beside is not None:
        places += [beside / name, beside / Path(name).name]
    return list(dict.fromkeys(places))


def _found(result: xr.Dataset, places: list[Path]) -> Path:
    """First path that is the run's DEM; raises a RockfallError if there is none."""
    there = [path for path in places if Path(raster_file(str(path))).exists()]
    for path in there[:-1]:
        with contextlib.suppress(RockfallError):
            _check_same(result, path)
            return path
    if not there:
        raise RockfallError(
            f"{', '.join(map(str, places))}: cannot be read: No such file or directory"
        )
    _check_same(result, there[-1])
    return there[-1]


def _check_same(result: xr.Dataset, path: Path) -> None:
    """Raise a RockfallError for a DEM whose bytes differ from the run's; arrays cannot be
    checked."""
    checksum = file_checksum(path)
    expected = json.loads(result.attrs["input_checksums"])["dem"]
    from_array = case_of(result).terrain["dem"] == FROM_ARRAY
    if checksum != expected and not from_array:
        raise RockfallError(f"{path}: is not the DEM of the run (SHA-256 differs)")


def _read(result: xr.Dataset, path: Path) -> Terrain:
    """Read the part of a DEM that boulders reached, in blocks."""
    west, east, south, north = reached(result)
    with open_raster(path) as raster:
        raster.check_cells()
        grid = raster.grid
        _check_place(result, path, grid)
        columns = _inside(grid.x, west, east)
        rows = _inside(grid.y, south, north)
        step = int(np.sqrt(rows.size * columns.size / MAX_CELLS)) + 1
        rows, columns = rows[step // 2 :: step], columns[step // 2 :: step]
        z = np.full((rows.size, columns.size), np.nan, raster.dtype)
        for block_rows, block, valid in raster.blocks():
            in_block = (rows >= block_rows.start) & (rows < block_rows.stop)
            part = np.ix_(rows[in_block] - block_rows.start, columns)
            z[in_block] = np.where(valid[part], block[part], np.nan)
    cell = step * grid.cell
    corner = grid.x[columns[0]] - cell / 2, grid.y[rows[0]] + cell / 2
    return z, Grid(*corner, cell, columns.size, rows.size, grid.crs, str(path))


def _inside(centres: np.ndarray, low: float, high: float) -> np.ndarray:
    """Indices of the cells whose centres lie between two positions."""
    return np.flatnonzero((centres >= low) & (centres <= high))


def _check_place(result: xr.Dataset, path: Path, grid: Grid) -> None:
    """Raise a RockfallError for a DEM whose cells do not match the result's grid and map origin."""
    west, north, cell = corner_of(result["crs"].attrs)
    column, row = round((west - grid.west) / grid.cell), round((grid.north - north) / grid.cell)
    part = grid.part(Box(row, column, grid.ny, grid.nx))
    among = 0 <= column < grid.nx and 0 <= row < grid.ny
    if not (among and Grid(west, north, cell, part.nx, part.ny).matches(part)):
        raise RockfallError(
            f"{path}: corner {grid.west:.12g}, {grid.north:.12g}, cells of {grid.cell:.10g} m: "
            f"must match the run (corner {west:.12g}, {north:.12g}, cells of {cell:.10g} m)"
        )
