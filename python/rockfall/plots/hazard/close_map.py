# SPDX-License-Identifier: BSD-3-Clause
"""Hazard zones, large enough to distinguish houses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from rockfall.plots.cartography.sheet import INCH, Room, finish, inner_size, new_sheet, round_scale
from rockfall.plots.extent import Extent
from rockfall.plots.hazard.hazard_figures import (
    draw_zones,
    extent_of,
    places_extent,
    zone_key,
)
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
    west, east, south, north = extent_of(hazard, terrain)
    middle = np.array([west + east, south + north]) / 2
    scale = max(_scale((west, east, south, north), hazard, room), FINEST)
    if scale > COARSEST:
        scale, middle = COARSEST, _middle(hazard, middle)
    # prevents rounding to the next scale
    sides = np.array(inner_size(room, key)) * scale * INCH * (1 - 1e-9)
    sheet = new_sheet(_around(middle, sides, terrain), terrain, key, room=room)
    draw_zones(sheet, hazard)
    finish(sheet, hazard["crs"].attrs)
    return sheet.figure


def is_whole(hazard: xr.Dataset, terrain: Terrain | None, room: Room) -> bool:
    """Return True if the close map in `room` shows all places that boulders reach."""
    return _scale(extent_of(hazard, terrain), hazard, room) <= COARSEST


def shows_places(hazard: xr.Dataset, terrain: Terrain | None, room: Room) -> bool:
    """Return True if the close map in `room` shows all objects, and lines where boulders arrive."""
    places = _scale(places_extent(hazard), hazard, room)
    return places <= COARSEST or is_whole(hazard, terrain, room)


def _scale(extent: Extent, hazard: xr.Dataset, room: Room) -> float:
    """Denominator of the round scale at which an extent fits into the room; NaN for no extent."""
    wide, high = inner_size(room, zone_key(hazard))
    west, east, south, north = extent
    rough = max((east - west) / wide, (north - south) / high) / INCH
    return round_scale(max(rough, 1.0)) if np.isfinite(rough) else np.nan


def _middle(hazard: xr.Dataset, middle: np.ndarray) -> np.ndarray:
    """Centre (x, y) [m] of objects and lines, else of the highest class, else `middle`."""
    west, east, south, north = places_extent(hazard)
    if np.isfinite(west):
        return np.array([west + east, south + north]) / 2
    classes = hazard["hazard_class"].values
    rows, columns = np.nonzero(classes == classes.max())
    places = (hazard["x"].values[columns], hazard["y"].values[rows])
    return np.array([place.mean() for place in places]) if classes.any() else middle


def _around(middle: np.ndarray, sides: np.ndarray, terrain: Terrain | None) -> Extent:
    """Extent with sides [m] around a point, shifted and clipped to the terrain."""
    low, high = middle - sides / 2, middle + sides / 2
    if terrain is not None:
        grid = terrain[1]
        first, last = np.array([grid.west, grid.south]), np.array([grid.east, grid.north])
        shift = np.maximum(first - low, 0) - np.maximum(high - last, 0)
        low, high = np.maximum(low + shift, first), np.minimum(high + shift, last)
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])
