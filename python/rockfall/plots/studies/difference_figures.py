# SPDX-License-Identifier: BSD-3-Clause
"""Maps of differences between a variant and the first variant."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from rockfall.io.rasters.arrays import north_up
from rockfall.language import word
from rockfall.plots.cartography.rasters import draw_image
from rockfall.plots.cartography.sheet import finish, new_sheet
from rockfall.plots.extent import around
from rockfall.plots.style import styled
from rockfall.result.trajectories import Terrain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LESS, MORE, UNDECIDED = "#0072B2", "#D55E00", "#BBBBBB"  # colours by Okabe and Ito (2008)


@styled
def difference_figure(
    maps: Mapping[str, xr.DataArray], variant: str, terrain: Terrain | None = None
) -> Figure:
    """Map of cells that fewer or more boulders pass in a variant, from `difference_maps`;
    undecided cells are grey."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    passing, verdict = maps[f"{variant}_passing"], maps[f"{variant}_verdict"]
    values = verdict.values.astype(float)
    values[(values == 0) & (passing.values == 0)] = np.nan
    shown, grid = north_up(verdict, values)
    is_known = np.isfinite(values)
    x, y = verdict["x"].values[is_known.any(axis=0)], verdict["y"].values[is_known.any(axis=1)]
    colours = {"less": LESS, "undecided": UNDECIDED, "more": MORE}
    key: list[Any] = [Patch(color=colour, label=word(name)) for name, colour in colours.items()]
    if not is_known.any():
        x, y = verdict["x"].values, verdict["y"].values
    sheet = new_sheet(around(x, y, grid.cell, terrain), terrain, key)
    style: dict[str, Any] = {"clim": (-1.5, 1.5), "opacity": 0.7}
    draw_image(sheet.axes, shown, grid, cmap=ListedColormap(list(colours.values())), **style)
    finish(sheet, verdict.attrs if "crs" not in verdict.coords else verdict["crs"].attrs)
    return sheet.figure
