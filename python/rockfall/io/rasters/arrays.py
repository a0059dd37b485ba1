# SPDX-License-Identifier: BSD-3-Clause
"""Elevations in memory: requirements, and conversion from NumPy arrays or xarray.DataArrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.coordinates.crs import check_metres
from rockfall.io.coordinates.crs_statements import check_statements
from rockfall.io.coordinates.length_units import is_metre, stated_in_attributes
from rockfall.io.rasters.grid import TOLERANCE, Grid, flaw_of, row_blocks
from rockfall.limits import MAX_ELEVATION

if TYPE_CHECKING:
    import xarray as xr
    from affine import Affine
    from rasterio.crs import CRS

_NAME = "dem"


def from_array(
    data: np.ndarray | xr.DataArray, transform: Affine | Grid | None = None
) -> tuple[np.ndarray, Grid]:
    """Elevations in the form of `read_dem`; the array is copied only if it must change.

    A NumPy array needs a `transform` (or a Grid). An xarray.DataArray must have the coordinates x
    and y of its cell centres, y in either direction, and a CRS as stored by rioxarray or CF.
    """
    if hasattr(data, "coords"):
        data = as_plan(cast("xr.DataArray", data))
        grid, flipped = grid_of(data)
        values, fill = data.values, data.attrs.get("_FillValue")
        stated = stated_in_attributes(data.attrs)
    elif transform is None:
        raise RockfallError(f"{_NAME}: a NumPy array needs a transform (affine.Affine)")
    else:
        values, fill, stated = np.ma.getdata(data), None, []
        grid, flipped = _numpy_grid(values, transform)
    check_metres(grid, _NAME, stated)
    dtype = elevation_dtype(values.dtype, _NAME)
    missing = np.ma.getmaskarray(data) if np.ma.isMaskedArray(data) else None
    if fill is not None and not np.isnan(fill):
        missing = values == np.asarray(fill).astype(values.dtype)
    z = np.ascontiguousarray(values[::-1] if flipped else values, dtype=dtype)
    if missing is not None and missing.any():
        z = z.copy() if np.shares_memory(z, values) else z
        z[missing[::-1] if flipped else missing] = np.nan
    check_elevations(_NAME, z)
    return z, grid


def elevation_dtype(stored: np.dtype | str, name: str) -> np.dtype:
    """float32 for types that it represents exactly (integers of up to 16 bits), else float64.
    Refuses types other than real numbers."""
    stored = np.dtype(stored)
    if stored.kind not in "iuf":
        raise RockfallError(f"{name}: elevations have type {stored}: must be real numbers")
    return np.dtype(np.float32 if np.can_cast(stored, np.float32) else np.float64)


def check_elevations(name: str, z: np.ndarray) -> None:
    """Refuse rasters smaller than 2 x 2 cells, implausible elevations, and rasters without
    elevations."""
    ny, nx = z.shape
    if min(nx, ny) < 2:
        raise RockfallError(f"{name}: {nx} x {ny} cells: must be at least 2 x 2")
    if not check_known(name, z):
        raise RockfallError(f"{name}: all cells are nodata")


def check_known(name: str | None, z: np.ndarray, row: int = 0) -> bool:
    """Return True if any cell has an elevation; refuse implausible elevations. `row` is the raster
    row of `z[0]`, for messages."""
    is_known = False
    for rows in row_blocks(z.shape):
        absurd = np.argwhere(np.abs(z[rows]) > MAX_ELEVATION)
        if absurd.size:
            at = tuple(absurd[0] + (rows.start, 0))
            rule = "finite" if np.isinf(z[at]) else "within 1e7 m of zero"
            raise RockfallError(
                f"{name}: row {row + at[0] + 1}, column {at[1] + 1}: elevation {z[at]:g}: "
                f"must be {rule} or nodata"
            )
        is_known = is_known or not np.isnan(z[rows]).all()
    return is_known


def grid_of(data: xr.DataArray) -> tuple[Grid, bool]:
    """Grid of a DataArray with dims (y, x), and True if its first row is the southernmost. Refuses
    other axes and cells that are not square.

    A GeoTransform stored with the CRS gives exact edges if it agrees with the coordinates.
    """
    x, y = _centres(data, "x"), _centres(data, "y")
    if min(x.size, y.size) < 2:
        raise RockfallError(f"{_NAME}: {x.size} x {y.size} cells: must be at least 2 x 2")
    cell, step = (x[-1] - x[0]) / (x.size - 1), (y[0] - y[-1]) / (y.size - 1)
    _check_steps("x", x, cell)
    _check_steps("y", y, -step)
    if cell < 0:
        raise RockfallError(f"{_NAME}: x must increase")
    if abs(cell - abs(step)) * max(x.size, y.size) > TOLERANCE * cell:
        raise RockfallError(f"{_NAME}: cells are not square ({cell:.10g} x {abs(step):.10g} m)")
    mapping = _grid_mapping(data)
    north = max(y[0], y[-1]) + abs(step) / 2
    grid = Grid(float(x[0] - cell / 2), float(north), float(cell), x.size, y.size, _crs(mapping))
    return _exact(grid, mapping), bool(step < 0)


def north_up(data: xr.DataArray, values: np.ndarray | None = None) -> tuple[np.ndarray, Grid]:
    """Values of a DataArray (or other values on its cells), north-up, and their grid."""
    grid, flipped = grid_of(data)
    values = data.values if values is None else values
    return values[::-1] if flipped else values, grid


def corner_of(attrs: Mapping[str, Any]) -> tuple[float, float, float]:
    """West edge, north edge and cell size [m] from the grid mapping of a result."""
    west, cell, _, north, _, _ = map(float, str(attrs["GeoTransform"]).split())
    return west, north, abs(cell)


def as_plan(data: xr.DataArray) -> xr.DataArray:
    """DataArray with dims (y, x); other dims of length one, such as a single band, are removed,
    others refused."""
    others = [name for name in data.dims if name not in ("y", "x")]
    if not {"y", "x"} <= set(data.dims) or any(data.sizes[name] > 1 for name in others):
        raise RockfallError(f"{_NAME}: dims are {', '.join(map(str, data.dims))}: must be y, x")
    return data.squeeze(others, drop=True).transpose("y", "x")


def _centres(data: xr.DataArray, axis: str) -> np.ndarray:
    if axis not in data.coords:
        raise RockfallError(f"{_NAME}: has no coordinate {axis} (cell centres [m])")
    _check_unit(f"coordinate {axis} is", data.coords[axis])
    return data.coords[axis].values.astype(np.float64)


def _check_unit(what: str, data: xr.DataArray) -> None:
    """Refuse units other than the metre."""
    unit = data.attrs.get("units")
    if unit is not None and not (isinstance(unit, str) and is_metre(unit)):
        raise RockfallError(f"{_NAME}: {what} in {unit}, but must be in metres")


def _check_steps(axis: str, centres: np.ndarray, step: float) -> None:
    """Refuse coordinates that are not finite and evenly spaced within a thousandth of a cell."""
    even = np.abs(np.diff(centres) - step) <= 1e-3 * abs(step)
    if step == 0 or not even.all():
        raise RockfallError(f"{_NAME}: coordinate {axis} is not evenly spaced")


def _grid_mapping(data: xr.DataArray) -> Mapping[str, Any]:
    """Attributes of the variable with the CRS; empty if there is none."""
    named = data.attrs.get("grid_mapping") or data.encoding.get("grid_mapping")
    for name in (named, "spatial_ref", "crs"):
        if name in data.coords:
            return data.coords[name].attrs
    return {"crs_wkt": data.attrs["crs"]} if "crs" in data.attrs else {}


def _crs(attrs: Mapping[str, Any]) -> CRS | None:
    from rasterio.crs import CRS
    from rasterio.errors import CRSError

    check_statements(_NAME, attrs)
    text = attrs.get("crs_wkt") or attrs.get("spatial_ref")
    if not text:
        return None
    try:
        return CRS.from_user_input(text)
    except CRSError as error:
        raise RockfallError(f"{_NAME}: CRS cannot be understood: {str(text)[:60]}") from error


def _exact(grid: Grid, attrs: Mapping[str, Any]) -> Grid:
    """Grid from the GeoTransform, if it agrees with the coordinates; else `grid` unchanged."""
    try:
        west, cell, _, north, _, step = map(float, str(attrs["GeoTransform"]).split())
    except (KeyError, ValueError):
        return grid
    north = north if step < 0 else north + grid.ny * step
    exact = replace(grid, west=west, north=north, cell=cell)
    return exact if cell > 0 and exact.matches(grid) else grid


def _numpy_grid(values: np.ndarray, transform: Affine | Grid) -> tuple[Grid, bool]:
    if values.ndim != 2:
        raise RockfallError(f"{_NAME}: array has {values.ndim} dimensions: must have two")
    if isinstance(transform, Grid):
        if values.shape != transform.shape:
            raise RockfallError(
                f"{_NAME}: array has shape {values.shape}, but its grid has {transform.shape}"
            )
        return transform, False
    t, (ny, nx) = transform, values.shape
    if flaw := flaw_of(t, max(nx, ny)):
        raise RockfallError(f"{_NAME}: {flaw}")
    north = t.f if t.e < 0 else t.f + ny * t.e
    return Grid(float(t.c), float(north), float(t.a), nx, ny), t.e > 0
