# SPDX-License-Identifier: BSD-3-Clause
"""Map extent of the boulders in a result."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from rockfall.io.rasters.arrays import corner_of
from rockfall.result.maps.passages import of_none, passed_map
from rockfall.result.trajectories import Terrain

Extent = tuple[float, float, float, float]  # west, east, south, north [m]

SLENDEREST = 1 / 3  # minimum ratio of shorter to longer side of a map
CELL = 5.0  # default cell size for margins [m]


def reached(result: xr.Dataset, terrain: Terrain | None = None, *places: Any) -> Extent:
    """Map extent of all places that boulders reached and of additional places (n, 2), with a
    margin and a minimum side ratio, within the terrain if given."""
    x, y = (
        [result[f"{end}_{axis}"].values for end in ("start", "stop") if f"{end}_{axis}" in result]
        for axis in "xy"
    )  # a hazard lacks these variables
    if "trajectory_x" in result:
        x, y = [*x, result["trajectory_x"].values], [*y, result["trajectory_y"].values]
    maps = [str(name) for name in result.data_vars if result[name].dims == ("y", "x")]
    everywhere = passed_map(result)  # defined wherever another map is
    for name in [everywhere] if everywhere else maps:
        passed = result[name].values > of_none(result, name)
        x = [*x, result["x"].values[passed.any(axis=0)]]
        y = [*y, result["y"].values[passed.any(axis=1)]]
    for place in places:
        if place is not None and len(place):
            x, y = [*x, place[:, 0]], [*y, place[:, 1]]
    if not sum(map(len, x)):  # without rows and maps: from the lines
        x, y = ([result[f"line_vertex_{axis}"].values] for axis in "xy")
    return around(np.concatenate(x), np.concatenate(y), cell_of(result), terrain)


def around(x: np.ndarray, y: np.ndarray, cell: float, terrain: Terrain | None = None) -> Extent:
    """Map extent of places x, y [m], with margin and minimum side ratio, within the terrain if
    given."""
    longest = max(np.ptp(x), np.ptp(y))
    margin = 0.06 * longest + 3 * cell
    shortest = SLENDEREST * (longest + 2 * margin) / 2
    west, east = _around(x, margin, shortest)
    south, north = _around(y, margin, shortest)
    if terrain is None:
        return west, east, south, north
    grid = terrain[1]
    west, east = max(west, grid.west), min(east, grid.east)
    return west, east, max(south, grid.south), min(north, grid.north)


def _around(c: np.ndarray, margin: float, shortest: float) -> tuple[float, float]:
    middle, half = (c.min() + c.max()) / 2, max(np.ptp(c) / 2 + margin, shortest)
    return float(middle - half), float(middle + half)


def cell_of(result: xr.Dataset) -> float:
    """Side of a terrain cell in the run [m]."""
    attrs = result["crs"].attrs if "crs" in result else {}
    return corner_of(attrs)[2] if "GeoTransform" in attrs else CELL
