# SPDX-License-Identifier: BSD-3-Clause
"""Maps of a result along a section: statistics of all boulders by terrain cell.

In a map each boulder counts once per cell, with its maximum there. Mean and quantile come from the
cell at the section, the maximum from all cells that a station crosses.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from rockfall.analysis.line_statistics import with_limits
from rockfall.analysis.lines.stations import Stations
from rockfall.io.rasters.arrays import north_up
from rockfall.io.rasters.grid import Grid
from rockfall.result.maps.passages import passages_of, passed_map, thin_cells
from rockfall.result.samples import simulated

#: For each quantity: prefix of its map names, and name of its map of maxima.
MAPPED = {
    "speed": ("speed", "speed_max_map"),
    "energy_total": ("energy", "energy_max"),
    "jump_height": ("jump_height", "jump_height_max_map"),
    "passing_height": ("passing_height", "passing_height_max"),
}
SHOWN = ("energy_total", "passing_height", "speed")  # quantities in tables and figures
REACH = with_limits("reach_probability")
OF_CELL = ("mean", *with_limits("q95"))
COLUMNS = ["cell_n", *with_limits("cell_fraction")]
COLUMNS += [f"cell_{quantity}_{suffix}" for quantity in MAPPED for suffix in OF_CELL]
COLUMNS += [f"corridor_{quantity}_max" for quantity in MAPPED]


def map_numbers(result: xr.Dataset, stations: Stations) -> dict[str, np.ndarray]:
    """COLUMNS at each station (stations,); NaN outside the maps, if the result lacks the map, and
    where too few boulders passed."""
    columns = {name: np.full(stations.distance.size, np.nan) for name in COLUMNS}
    if (passed := passed_map(result)) is not None:
        count = _at(result, passed, stations, passages_of(result))
        columns["cell_n"] = np.round(count)
        columns["cell_fraction"] = count / simulated(result)
    for name, end in zip(REACH[1:], ("low", "high"), strict=True):
        if name in result:
            columns[f"cell_fraction_{end}"] = _at(result, name, stations)
    for quantity, (start, of_max) in MAPPED.items():
        for suffix in OF_CELL:
            if (name := f"{start}_{suffix}") in result:
                columns[f"cell_{quantity}_{suffix}"] = _at(
                    result, name, stations, known(result, name)
                )
        if of_max in result:
            columns[f"corridor_{quantity}_max"] = _max_across(result, of_max, stations)
    return columns


def has_maps(result: xr.Dataset) -> bool:
    """Return True if a result has a map that a section uses."""
    names = {f"{start}_{suffix}" for start, _ in MAPPED.values() for suffix in OF_CELL}
    names |= {of_max for _, of_max in MAPPED.values()}
    return any(str(name) in names for name in result.data_vars)


def known(result: xr.Dataset, name: str) -> np.ndarray:
    """Map values (y, x), NaN where too few boulders passed. Without a passage count, a quantile
    counts as known if both its limits exist."""
    values = result[name].values
    if (thin := thin_cells(result, name)) is not None:
        return np.where(thin, np.nan, values)
    if "thin_below" not in result[name].attrs or passed_map(result) is not None:
        return values
    limits = with_limits(name)[1:]
    if not all(limit in result for limit in limits):
        return np.full(values.shape, np.nan)
    complete = np.isfinite([result[limit].values for limit in limits]).all(axis=0)
    return np.where(complete, values, np.nan)


def _at(
    result: xr.Dataset, name: str, stations: Stations, values: np.ndarray | None = None
) -> np.ndarray:
    """Values of a map, or of another array on its cells, at the stations."""
    values, grid = north_up(result[name], values)
    return grid.at(values, stations.place.real, stations.place.imag)


def _max_across(result: xr.Dataset, name: str, stations: Stations) -> np.ndarray:
    """Maximum of a map over the cells that each station crosses."""
    values, grid = north_up(result[name])
    highest = np.full(stations.distance.size, np.nan)
    for k, (place, direction) in enumerate(zip(stations.place, stations.direction, strict=True)):
        half = 1j * direction * stations.within
        crossed = places_in_cells(grid, place - half, place + half)
        among = grid.at(values, crossed.real, crossed.imag)
        highest[k] = np.fmax.reduce(among, initial=np.nan)
    return highest


def places_in_cells(grid: Grid, start: complex, end: complex) -> np.ndarray:
    """A point in each cell that a straight line crosses, in order, as x + iy [m]."""
    parts = [0.0, 1.0]
    for low, high, edge in (
        (start.real, end.real, grid.west), (start.imag, end.imag, grid.north)
    ):  # fmt: skip
        first, last = sorted([(low - edge) / grid.cell, (high - edge) / grid.cell])
        edges = edge + grid.cell * np.arange(np.ceil(first), np.floor(last) + 1)
        if high != low:
            parts.extend((edges - low) / (high - low))
    parts = np.unique(np.clip(parts, 0.0, 1.0))
    return start + (parts[:-1] + parts[1:]) / 2 * (end - start)
