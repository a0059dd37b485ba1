# SPDX-License-Identifier: BSD-3-Clause
"""Observed positions, stopping places and impacts of boulders, compared with maps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.observed.observations import CONTACT, Observed
from rockfall.io.rasters.arrays import north_up
from rockfall.result.samples import simulated
from rockfall.result.variables import BLOCK_SHAPE

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

REACH = ("passages", "reach_probability")  # maps that give the reach; one is enough
VALUES = {  # observed quantity -> maps of its values in cells, the maximum last
    "speed": ("speed_mean", "speed_q50", "speed_q95", "speed_max_map"),
    "height": ("jump_height_mean", "jump_height_q50", "jump_height_q95", "jump_height_max_map"),
}


def at_places(result: xr.Dataset, name: str, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Map values in the cells that contain points x, y [m]; NaN outside the map."""
    values, grid = north_up(result[name])
    return grid.at(values, x, y)


def reach_at(result: xr.Dataset, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Reach probability in the cells that contain points x, y [m]; NaN outside the map."""
    name = next(name for name in REACH if name in result)
    reach = at_places(result, name, x, y)
    return reach / simulated(result) if name == "passages" else reach


def stops_table(result: xr.Dataset, seen: Observed) -> pd.DataFrame:
    """Table of stopping places: x, y, reach_probability, and other columns of the file."""
    import pandas as pd

    if seen.stops is None or not {*REACH} & set(result):
        return pd.DataFrame(columns=["x", "y", REACH[1]])
    x, y = seen.stops.T
    table = pd.DataFrame({"x": x, "y": y, REACH[1]: reach_at(result, x, y)})
    if any(seen.sources):
        table["source"] = list(seen.sources)
    if seen.volumes is not None:
        table["volume"] = seen.volumes
    if seen.shapes is not None:
        table["block_shape"] = np.array(["", *BLOCK_SHAPE])[seen.shapes]
    return _with_kept(table, seen, "stops")


def contacts_table(result: xr.Dataset, seen: Observed) -> pd.DataFrame:
    """Table of impacts: x, y, reach_probability; speed [m/s] and height [m] where known, with the
    corresponding map values of the result; and other columns of the file."""
    import pandas as pd

    if seen.contacts is None or not {*REACH} & set(result):
        return pd.DataFrame(columns=["x", "y", REACH[1]])
    x, y = (seen.contacts[axis].to_numpy(float) for axis in "xy")
    columns = {"x": x, "y": y, REACH[1]: reach_at(result, x, y)}
    for name, maps in VALUES.items():
        if seen.contacts[name].notna().any():
            columns[name] = seen.contacts[name].to_numpy(float)
            columns |= {name: at_places(result, name, x, y) for name in maps if name in result}
    for name in CONTACT[4:]:
        if seen.contacts[name].notna().any():
            columns[name] = seen.contacts[name].to_numpy(float)
    return _with_kept(pd.DataFrame(columns), seen, "contacts")


def _with_kept(table: pd.DataFrame, seen: Observed, kind: str) -> pd.DataFrame:
    """Add the other columns of a file to a table; a name already in use becomes given_NAME."""
    if kind not in seen.kept:
        return table
    ours = {*table.columns, "table", *VALUES}
    kept = seen.kept[kind].rename(columns=lambda name: f"given_{name}" if name in ours else name)
    return table.assign(**{str(name): column for name, column in kept.items()})
