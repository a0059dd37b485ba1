# SPDX-License-Identifier: BSD-3-Clause
"""Road segments as a table and as a layer."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.hazard.classes import CLASSES
from rockfall.analysis.hazard.variables import CLASS_ENDS
from rockfall.analysis.objects.segment_hits import QUANTITIES
from rockfall.quantities import SHOWN
from rockfall.result.maps.flat_maps import shown
from rockfall.result.variables import ENDS

#: Quantities in figures and tables, and their columns in the table of segments.
SHOWN_COLUMNS = {"energy_total": "energy_q95_kJ", "upper_edge": "upper_edge_q95"}


def has_segments(hazard: xr.Dataset) -> bool:
    """Return True if a hazard has road segments."""
    return "segment" in hazard.dims


def segment_table(hazard: xr.Dataset) -> pd.DataFrame:
    """Table with a row for each segment: position [m], frequencies and return periods with limits,
    class, and energies [kJ], heights and diameters [m] of the boulders that touch the segment."""
    words = np.array(CLASSES, dtype=object)
    columns: dict[str, np.ndarray] = {
        name: hazard[f"segment_{name}"].values.astype(object) for name in ("road", "name")
    }
    start, end = (hazard[f"segment_{name}"].values for name in ("start", "end"))
    columns |= {"chainage_from": start, "chainage_to": end, "length": end - start}
    columns["width"] = hazard["segment_width"].values
    inside = hazard["segment_within"].values > 0
    columns["within_terrain"] = np.where(inside, "yes", "no").astype(object)
    columns |= {f"frequency{end}": hazard[f"segment_frequency{end}"].values for end in ENDS}
    for threshold in hazard["threshold"].values.tolist():
        for end in ENDS:
            values = hazard[f"segment_exceedance_frequency{end}"].sel(threshold=threshold).values
            columns[f"frequency_above_{shown('threshold', threshold)}{end}"] = values
    with np.errstate(divide="ignore"):
        for end, opposite in (("", ""), ("_low", "_high"), ("_high", "_low")):
            yearly = columns[f"frequency{opposite}"]
            columns[f"return_period{end}"] = np.where(yearly > 0, 1 / yearly, np.nan)
    for end in CLASS_ENDS:
        columns[f"hazard{end}"] = words[hazard[f"segment_hazard_class{end}"].values]
    for name in QUANTITIES:
        columns |= dict(_numbers(hazard, name))
    columns["boulders"] = hazard["segment_boulders"].values
    return pd.DataFrame(columns)


def _numbers(hazard: xr.Dataset, name: str) -> list[tuple[str, np.ndarray]]:
    """Columns with the mean and 95 % quantile of a quantity, in its display unit."""
    mean = hazard[f"segment_{name}_mean"]
    unit, factor = SHOWN.get(mean.attrs["units"], (mean.attrs["units"], 1.0))
    unit = "" if unit == "m" else f"_{unit}"
    columns = [(f"{name}_mean{unit}", factor * mean.values)]
    for end in ENDS:
        values = hazard[f"segment_{name}_q95{end}"].values
        columns.append((f"{name}_q95{unit}{end}", factor * values))
    return columns


def segment_layer(hazard: xr.Dataset) -> tuple:
    """Axes of the segments with the columns of their table, for `write_geopackage`."""
    import shapely

    shapes = shapely.from_wkt(hazard["segment_geometry"].values.astype(str))
    columns = {str(name): column.to_numpy() for name, column in segment_table(hazard).items()}
    return "LineString", [(shapes, columns)]
