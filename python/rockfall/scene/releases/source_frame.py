# SPDX-License-Identifier: BSD-3-Clause
"""Sources of a scene as a GeoDataFrame that a run accepts as its sources."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rockfall.errors import need
from rockfall.grounds.impact_tables import BLOCK_SHAPES
from rockfall.scene.releases.source_attributes import LAWS, VALUES
from rockfall.scene.scene import Scene

if TYPE_CHECKING:
    from geopandas import GeoDataFrame


def source_frame(scene: Scene) -> GeoDataFrame:
    """Source points with the release attributes that the layer gives, named as in
    docs/releases.md: name, volume and its parameters, density, drop height, velocity, block shape
    and frequency."""
    need("GeoDataFrames need", "", "geopandas")
    import shapely
    from geopandas import GeoDataFrame

    columns: dict[str, np.ndarray] = {}
    if (features := scene.features) is not None:
        own = features.number - 1
        columns["name"] = np.array(features.names, object)[own]
        if features.law is not None and features.value is not None:
            columns["volume"] = np.array([None, *LAWS], object)[features.law[own]]
            columns |= dict(zip(VALUES, features.value[own].T, strict=True))
        if features.shape is not None:
            columns["block_shape"] = np.array([None, *BLOCK_SHAPES], object)[features.shape[own]]
    if scene.frequency is not None:
        columns["frequency"] = scene.frequency
    given = {name: column for name, column in columns.items() if (column == column).any()}
    given = {name: column for name, column in given.items() if any(v is not None for v in column)}
    crs = None if scene.grid.crs is None else scene.grid.crs.to_wkt()
    return GeoDataFrame(given, geometry=shapely.points(scene.x, scene.y), crs=crs)
