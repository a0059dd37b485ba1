# SPDX-License-Identifier: BSD-3-Clause
"""Origins of the boulders at a place of a hazard, as GeoTIFF, GeoPackage and tables."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.hazard.origins import origin_areas, origins_at
from rockfall.files.export import Layers, crs_wkt, write_geopackage, write_map
from rockfall.files.qgis_style import write_classes
from rockfall.io.rasters.arrays import grid_of
from rockfall.io.tables import write_csv
from rockfall.result.maps.classes import classes_of

#: Maps: name of the file and of the column, unit, and True if source cells without arrivals are 0.
MAPS = (
    ("frequency", "year-1", True), ("share", "%", True),
    ("energy_mean_kJ", "kJ", False), ("energy_q95_kJ", "kJ", False),
)  # fmt: skip
FIGURE = "origins.png"
FILES = (
    *(f"{name}.{ending}" for name, *_ in MAPS for ending in ("tif", "qml")),
    *("cells.csv", "areas.csv", "origins.gpkg", FIGURE),
)


def origin_tables(hazard: xr.Dataset, kind: str, k: int, side: float) -> dict[str, pd.DataFrame]:
    """Tables of the cells and areas of `origins_at` and `origin_areas`, with energies in kJ."""
    tables = {"cells": origins_at(hazard, kind, k), "areas": origin_areas(hazard, kind, k, side)}
    for table in tables.values():
        energies = [name for name in table if name.startswith("energy")]
        table[energies] *= 1e-3
        table.rename(columns={name: f"{name}_kJ" for name in energies}, inplace=True)
    return tables


def put_origins(
    hazard: xr.Dataset, tables: dict[str, pd.DataFrame], folder: Path
) -> Iterator[Path]:
    """Write `origin_tables` to a folder: a GeoTIFF for each of `MAPS`, origins.gpkg, and CSV
    files."""
    import shapely

    for name, unit, is_zero in MAPS:
        path, plan = folder / f"{name}.tif", hazard.set_coords("crs")["hazard_class"]
        grid, cells = grid_of(plan)[0], tables["cells"]
        values = np.full(grid.shape, np.nan, "f4")
        if is_zero:
            values[grid.cells(hazard["source_x"].values, hazard["source_y"].values)] = 0.0
        factor = 100.0 if unit == "%" else 1.0
        at = grid.cells(cells["x"].to_numpy(), cells["y"].to_numpy())
        values[at] = factor * cells[name].to_numpy()
        attrs = {"units": unit, "long_name": name}
        yield write_map(path, xr.DataArray(values, plan.coords, plan.dims, attrs=attrs))
        yield write_classes(path, classes_of(unit))
    layers: Layers = {}
    for name, table in tables.items():
        columns = {str(column): values.to_numpy() for column, values in table.items()}
        layers[name] = "Point", [(shapely.points(columns["x"], columns["y"]), columns)]
        write_csv(table, folder / f"{name}.csv")
        yield folder / f"{name}.csv"
    yield write_geopackage(folder / "origins.gpkg", layers, crs_wkt(hazard))
