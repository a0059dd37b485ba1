# SPDX-License-Identifier: BSD-3-Clause
"""Layers of a result or hazard as GeoDataFrames, identical to exported files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from rockfall.case import case_of
from rockfall.errors import need
from rockfall.files.export import crs_wkt, export_layers
from rockfall.files.hazard_files import hazard_layers, is_hazard, read_hazard
from rockfall.result.boulders import ground_strength
from rockfall.result.dataset import read_result
from rockfall.result.variables import ENDS

if TYPE_CHECKING:
    from geopandas import GeoDataFrame


def layers(result: xr.Dataset | str | Path) -> dict[str, GeoDataFrame]:
    """Layers of a result or a hazard (a Dataset, or its netCDF file) as GeoDataFrames, by name.

    Layers and columns are as in rockfall.gpkg or hazard.gpkg. In addition, `stops` has the
    `ground_strength` of each boulder (`rockfall.ground_strength`), and a hazard has `lines` with
    the number of boulders per year that cross them. Raises a RockfallError without geopandas.

    >>> import rockfall
    >>> stops = rockfall.layers(rockfall.run(rockfall.read_case("case.nml")))["stops"]
    >>> {"volume_m3", "ground_strength"} <= {*stops.columns}
    True
    """
    need("GeoDataFrames need", "", "geopandas")
    if isinstance(result, str | Path):
        result = read_hazard(result) if is_hazard(result) else read_result(result)
    if "hazard_class" in result:
        made = {**dict(hazard_layers(result)), **_hazard_lines(result)}
    else:
        made = export_layers(result)
    frames = {name: _frame(features, crs_wkt(result)) for name, (_, features) in made.items()}
    if "stops" in frames:
        frames["stops"]["ground_strength"] = ground_strength(result).values
    return frames


def _hazard_lines(hazard: xr.Dataset) -> dict[str, tuple[str, list[Any]]]:
    """Evaluation lines and barriers of a hazard, if any, with their frequencies [1/year]."""
    import shapely

    if "line_frequency" not in hazard:
        return {}
    by_name = {line["name"]: line for line in case_of(hazard).lines}
    names = hazard["line"].values.astype(str).tolist()
    places = [np.column_stack([by_name[name][axis] for axis in "xy"]) for name in names]
    columns = {"line": np.array(names, object)}
    columns |= {f"frequency{end}": hazard[f"line_frequency{end}"].values for end in ENDS}
    return {"lines": ("LineString", [(np.array([*map(shapely.linestrings, places)]), columns)])}


def _frame(features: Any, crs: str | None) -> GeoDataFrame:
    """GeoDataFrame of a layer, from parts whose geometry may be WKB."""
    import shapely
    from geopandas import GeoDataFrame

    parts = list(features)
    shapes = np.concatenate([part for part, _ in parts])
    if len(shapes) and isinstance(shapes[0], bytes):
        shapes = shapely.from_wkb(shapes)
    names = parts[0][1]
    columns = {name: np.concatenate([fields[name] for _, fields in parts]) for name in names}
    return GeoDataFrame(columns, geometry=shapes, crs=crs)
