# SPDX-License-Identifier: BSD-3-Clause
"""Map of the sources by their contribution to a place: the cells that contribute half of all
boulders, the next 30 %, the rest, and cells without a contribution."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.analysis.hazard.origins import SOURCES
from rockfall.io.rasters.arrays import grid_of
from rockfall.language import Number, say
from rockfall.plots.cartography.rasters import draw_image
from rockfall.plots.cartography.sheet import Room, finish, new_sheet
from rockfall.plots.hazard.hazard_figures import draw_places, extent_of
from rockfall.plots.style import GREY, styled
from rockfall.tables.dossier import Place, places_of

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from rockfall.result.trajectories import Terrain

PARTS = 0.5, 0.8  # cumulative shares between classes
COLOURS = ("#7f0000", "#d7301f", "#fdbb84", "#f7f7f7")


def origin_place(hazard: xr.Dataset) -> Place | None:
    """First place that boulders reach and whose sources are known; None if there is none."""
    for place in places_of(hazard):
        name = f"{place.kind}_source_frequency"
        if place.kind in SOURCES and name in hazard and hazard[name].values[place.k].any():
            return place
    return None


def parts_of_total(rates: np.ndarray) -> np.ndarray:
    """Class of each cell by its frequency: 0 for cells that together contribute half of the sum, 1
    up to 80 %, 2 for the rest, and 3 without a contribution; equal frequencies may be in two
    classes."""
    order = np.argsort(-rates, kind="stable")
    before = np.concatenate([[0.0], np.cumsum(rates[order])[:-1]]) / rates.sum()
    classes = np.empty(rates.size, int)
    classes[order] = np.searchsorted(PARTS, before, side="right")
    return np.where(rates > 0, classes, len(COLOURS) - 1)


@styled
def origin_map(hazard: xr.Dataset, terrain: Terrain | None, place: Place, room: Room) -> Figure:
    """Map of the sources of the boulders that reach a place."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    words = [
        say("dossier.origin_first", part=Number("50")),
        say("dossier.origin_next", part=Number("30")),
        say("dossier.origin_rest", part=Number("20")),
        say("dossier.origin_none"),
    ]
    key = [
        Patch(facecolor=colour, edgecolor=GREY, label=label)
        for colour, label in zip(COLOURS, words, strict=True)
    ]
    sheet = new_sheet(extent_of(hazard, terrain), terrain, key, room=room)
    grid, _ = grid_of(hazard["hazard_class"])
    rates = hazard[f"{place.kind}_source_frequency"].values[place.k]
    rows, columns = grid.cells(hazard["source_x"].values, hazard["source_y"].values)
    classes = np.full(grid.shape, np.nan)
    classes[rows, columns] = parts_of_total(rates)
    style: dict[str, Any] = {"vmin": -0.5, "vmax": len(COLOURS) - 0.5}
    draw_image(sheet.axes, classes, grid, cmap=ListedColormap(list(COLOURS)), **style)
    draw_places(sheet, hazard)
    finish(sheet, hazard["crs"].attrs)
    return sheet.figure
