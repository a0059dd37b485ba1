# SPDX-License-Identifier: BSD-3-Clause
"""Longitudes and latitudes (WGS 84) of a result's positions, for KML."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.coordinates.crs import (
    NO_DATUM,
    Bounds,
    Transformation,
    crs_name,
    degrees_way,
)

if TYPE_CHECKING:
    import xarray as xr

EASTINGS = ("x", "start_x", "stop_x", "line_vertex_x", "trajectory_x")


class Geographic(NamedTuple):
    """Transformation from plan coordinates to degrees, names of the CRS and of the vertical datum,
    and warnings."""

    way: Transformation
    crs: str
    heights: str  # name of the vertical datum
    remarks: list[str]

    def degrees(self, xyz: np.ndarray) -> np.ndarray:
        """Convert plan coordinates (n, 2 or 3) to longitude, latitude and unchanged height. Raises
        a RockfallError for places outside the domain of the projection."""
        if not len(xyz):
            return xyz
        places = np.column_stack([*self.way.transform(xyz[:, 0], xyz[:, 1]), *xyz.T[2:]])
        if not np.isfinite(places[:, :2]).all():
            raise RockfallError(f"{self.crs} does not define longitude and latitude at all places")
        return places


def geographic(data: xr.Dataset, wkt: str | None, what: str) -> Geographic:
    """Transformation to longitude and latitude [degree]; `what`, the product that needs it, is for
    messages. Raises a RockfallError without a CRS."""
    from rasterio.crs import CRS

    if wkt is None:
        raise RockfallError(
            f"{what} requires longitudes and latitudes, but the result has no CRS: give the DEM "
            "one (rockfall dem DEM -o DEM.tif --crs CODE) and run again"
        )
    crs = CRS.from_wkt(wkt)
    way = degrees_way(crs, _bounds(data))
    remarks = []
    if not way.is_best:
        remarks = [
            f"longitudes and latitudes from {crs_name(crs)}: PROJ lacks the most accurate "
            "transformation here: check places on a map"
        ]
    heights = data["crs"].attrs.get("vertical_datum", NO_DATUM)
    return Geographic(way, crs_name(crs), heights, remarks)


def _bounds(data: xr.Dataset) -> Bounds:
    """Extent of all positions in a result or hazard; a RockfallError if it has none."""
    limits = []
    for axis in "xy":
        names = [axis if name == "x" else f"{name[:-1]}{axis}" for name in EASTINGS]
        values = [data[name].values for name in names if name in data.variables]
        values = [value[np.isfinite(value)] for value in values if value.size]
        values = [value for value in values if value.size]
        if not values:
            raise RockfallError("the result has no places")
        limits.append((min(map(np.min, values)), max(map(np.max, values))))
    (west, east), (south, north) = limits
    return Bounds(float(west), float(south), float(east), float(north))
