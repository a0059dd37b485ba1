# SPDX-License-Identifier: BSD-3-Clause
"""Source cells of a result, dissolved into an area for each feature: a map shows release areas
instead of thousands of squares.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.case import case_of, facts
from rockfall.errors import RockfallError
from rockfall.io.rasters.arrays import corner_of

if TYPE_CHECKING:
    import xarray as xr


class SourceTable(NamedTuple):
    """Sources of a result."""

    places: np.ndarray  # positions (n, 2) [m]
    feature: np.ndarray  # number of each source's feature in the source layer, from 1
    boulders: np.ndarray  # number of boulders of each source
    furthest: np.ndarray | None  # maximum plan distance of their boulders [m]; None if unknown
    names: tuple[str, ...]  # names of features; "" for a result without a layer


def are_cells(data: xr.Dataset) -> bool:
    """Return True if the sources of a result are terrain cells; False for points, and if the case
    or the cells are unknown."""
    try:
        has_points = facts(case_of(data), "release").has_points
    except (RockfallError, KeyError):
        return False
    has_grid = "crs" in data.variables and "GeoTransform" in data["crs"].attrs
    return has_grid and not has_points


def source_areas(
    data: xr.Dataset, sources: SourceTable
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Areas of source cells as a multipolygon for each feature, with attributes: `sources` and
    `boulders` are counts, `area_m2` is the plan area.

    Edges between cells of a feature are dissolved; holes remain."""
    import shapely

    numbers, part = np.unique(sources.feature, return_inverse=True)
    shapes = _dissolved(data, sources.places, part)
    fields = {
        "name": np.array([sources.names[k - 1] for k in numbers], dtype=object),
        "sources": np.bincount(part).astype(np.int64),
        "boulders": np.bincount(part, sources.boulders).astype(np.int64),
        "area_m2": shapely.area(shapes),
    }
    if sources.furthest is not None:
        fields["plan_distance_max_m"] = np.zeros(numbers.size)
        np.maximum.at(fields["plan_distance_max_m"], part, sources.furthest)
    return shapes, fields


def _dissolved(data: xr.Dataset, places: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Multipolygon of the cells in each part, numbered from 0."""
    import shapely
    from affine import Affine
    from rasterio.features import shapes

    west, north, cell = corner_of(data["crs"].attrs)
    column = np.floor((places[:, 0] - west) / cell).astype(np.int64)
    row = np.floor((north - places[:, 1]) / cell).astype(np.int64)
    left, top = column.min(), row.min()
    numbers = np.zeros((np.ptp(row) + 1, np.ptp(column) + 1), np.int32)
    numbers[row - top, column - left] = part + 1
    place = Affine(cell, 0.0, west + cell * left, 0.0, -cell, north - cell * top)
    patches = list(shapes(numbers, numbers > 0, connectivity=4, transform=place))
    polygons = [shapely.geometry.shape(shape) for shape, _ in patches]
    owner = np.array([int(number) - 1 for _, number in patches])
    order = np.argsort(owner, kind="stable")
    return shapely.multipolygons(np.array(polygons, dtype=object)[order], indices=owner[order])
