# SPDX-License-Identifier: BSD-3-Clause
"""Points of a layer as table rows with attributes as cells, and polygons merged to an area."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.rasters.grid import Grid
from rockfall.io.tables import Row
from rockfall.io.vectors.layers import EXTENSIONS, plain, read_features, read_points

PLACE = ("x", "y")  # columns of the coordinates [m]
POLYGONS = {3, 6}  # type numbers, also of multipolygons


def is_point_layer(path: str | Path) -> bool:
    """Return True for the name of a vector layer.

    >>> is_point_layer("blocks.gpkg"), is_point_layer("blocks.csv")
    (True, False)
    """
    return Path(path).suffix.lower() in EXTENSIONS


def read_point_rows(
    path: str | Path, grid: Grid, remarks: list[str]
) -> tuple[str, list[str], Iterator[Row]]:
    """Columns and rows of a point layer in the form of `rockfall.io.tables.read_table`: x and y
    [m] in the CRS of the grid, and the attributes with names in lower case.

    Reprojections are noted in `remarks`. Raises a RockfallError for an invalid layer.
    """
    points = read_points(path, grid, remarks)
    columns = {name.lower(): values for name, values in points.values.items()}
    for axis in PLACE:
        if axis in columns:
            raise RockfallError(f"{path}: attribute {axis}: the points have coordinates already")
    names = [*PLACE, *columns]

    def rows() -> Iterator[Row]:
        for k, feature in enumerate(points.feature.tolist()):
            place = {"x": repr(float(points.x[k])), "y": repr(float(points.y[k]))}
            cells = {name: _text(values[k]) for name, values in columns.items()}
            yield Row(f"{path}: feature {feature}", place | cells)

    return str(path), names, rows()


def read_area(path: str | Path, grid: Grid, remarks: list[str]) -> Any:
    """Union of a layer's polygons in the CRS of the grid; None for layers of points or lines."""
    import shapely

    shapes = read_features(path, grid, remarks)[0]
    if not set(shapely.get_type_id(shapes)) <= POLYGONS:
        return None
    return shapely.union_all(shapes)


def _text(value: Any) -> str:
    """Attribute as cell text; "" if empty (integer columns with gaps are read as reals)."""
    if (value := plain(value)) is None:
        return ""
    if isinstance(value, float) and value.is_integer() and np.abs(value) < 2.0**53:
        return str(int(value))
    return str(value).strip()
