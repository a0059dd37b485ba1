# SPDX-License-Identifier: BSD-3-Clause
"""Hazard zones on a full page, large enough to distinguish houses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from rockfall.plots.cartography.sheet import INCH, Room, finish, inner_size, new_sheet, round_scale
from rockfall.plots.extent import Extent
from rockfall.plots.hazard.hazard_figures import draw_zones, extent_of, zone_key
from rockfall.plots.style import styled
from rockfall.result.trajectories import Terrain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FINEST, COARSEST = 1000.0, 5000.0  # limits of the scale denominator


@styled
def close_map(hazard: xr.Dataset, terrain: Terrain | None, room: Room) -> Figure:
    """Map of the zones, lines, barriers and objects of a hazard at 1:1,000 to 1:5,000. If the full
    map needs a smaller scale, only the area around objects and lines is shown."""
    key = zone_key(hazard)
    wide, high = inner_size(room, key)
    extent = extent_of(hazard, terrain)
    west, east, south, north = extent
    scale = round_scale(max((east - west) / wide, (north - south) / high) / INCH)
    metres = INCH * min(max(scale, FINEST), COARSEST)
    middle = np.array([west + east, south + north]) / 2
    if scale > COARSEST:
        middle = _middle(hazard, middle)
    sides = np.array([wide, high]) * metres * (1 - 1e-9)  # prevents rounding to the next scale
    sheet = new_sheet(_around(middle, sides, terrain), terrain, key, room=room)
    draw_zones(sheet, hazard)
    finish(sheet, hazard["crs"].attrs)
    return sheet.figure


def _middle(hazard: xr.Dataset, middle: np.ndarray) -> np.ndarray:
    """Centre of the objects, or of the cells with the highest class."""
    import shapely

    if "object" in hazard.dims:
        shapes = shapely.from_wkt(hazard["object_geometry"].values.astype(str))
        west, south, east, north = shapely.total_bounds(shapes)
        return np.array([west + east, south + north]) / 2
    classes = hazard["hazard_class"].values
    rows, columns = np.nonzero(classes == classes.max())
    places = (hazard["x"].values[columns], hazard["y"].values[rows])
    return np.array([place.mean() for place in places]) if classes.any() else middle


def _around(middle: np.ndarray, sides: np.ndarray, terrain: Terrain | None) -> Extent:
    """Extent of this size around a point, shifted and clipped to the terrain."""
    low, high = middle - sides / 2, middle + sides / 2
    if terrain is not None:
        grid = terrain[1]
        first, last = np.array([grid.west, grid.south]), np.array([grid.east, grid.north])
        shift = np.maximum(first - low, 0) - np.maximum(high - last, 0)
        low, high = np.maximum(low + shift, first), np.minimum(high + shift, last)
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])
