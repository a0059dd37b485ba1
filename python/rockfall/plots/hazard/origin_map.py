# SPDX-License-Identifier: BSD-3-Clause
"""Map of the sources by their contribution to a place: cells that contribute half of all boulders,
the next 30 %, and the rest, with the energies of their boulders at the place; and cells without a
contribution."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.hazard.origins import SOURCES, origins_at
from rockfall.io.rasters.arrays import grid_of
from rockfall.language import Number, Text, say
from rockfall.plots.cartography.rasters import draw_image
from rockfall.plots.cartography.sheet import Room, finish, new_sheet
from rockfall.plots.hazard.hazard_figures import draw_places, extent_of
from rockfall.plots.style import GREY, styled
from rockfall.quantities import number
from rockfall.tables.hazard import Place, places_of

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

    from rockfall.result.trajectories import Terrain

PARTS = 0.5, 0.8  # cumulative fractions at class limits
COLOURS = ("#7f0000", "#d7301f", "#fdbb84", "#f7f7f7")


def origin_place(hazard: xr.Dataset) -> Place | None:
    """First place reached by boulders from known sources; None if there is none."""
    for place in places_of(hazard):
        name = f"{place.kind}_source_frequency"
        if place.kind in SOURCES and name in hazard and (hazard[name].values[place.k] > 0).any():
            return place
    return None


def parts_and_words(table: pd.DataFrame) -> tuple[np.ndarray, list[Text]]:
    """Class of each row of `origins`, and a text for each class: its fraction of all boulders,
    their mean energy, and an energy that 95 % of the boulders from each cell do not exceed."""
    rates = table["frequency"].to_numpy()
    parts = parts_of_total(rates) if rates.size else np.zeros(0, int)
    names = ("first", "50"), ("next", "30"), ("rest", "20")
    words = [say(f"dossier.origin_{name}", part=Number(part)) for name, part in names]
    for k in np.unique(parts):
        own = table[parts == k]
        mean = np.average(own["energy_mean"], weights=own["frequency"])
        energies = {"mean": number(1e-3 * mean), "q95": number(1e-3 * own["energy_q95"].max())}
        words[k] = say("dossier.origin_energy", text=words[k], **energies)
    return parts, words


def parts_of_total(rates: np.ndarray) -> np.ndarray:
    """Class (cells,) from the cells' frequencies above 0: 0 for the cells that together contribute
    half of the total, 1 up to 80 %, 2 for the rest; equal frequencies may get different classes."""
    order = np.argsort(-rates, kind="stable")
    before = np.concatenate([[0.0], np.cumsum(rates[order])[:-1]]) / rates.sum()
    classes = np.empty(rates.size, int)
    classes[order] = np.searchsorted(PARTS, before, side="right")
    return classes


@styled
def origin_map(hazard: xr.Dataset, terrain: Terrain | None, place: Place, room: Room) -> Figure:
    """Map of the sources from which boulders reach a place."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    table = origins_at(hazard, place.kind, place.k)
    parts, words = parts_and_words(table)
    words = [*words, say("dossier.origin_none")]
    key = [
        Patch(facecolor=colour, edgecolor=GREY, label=label)
        for colour, label in zip(COLOURS, words, strict=True)
    ]
    sheet = new_sheet(extent_of(hazard, terrain), terrain, key, room=room)
    grid, _ = grid_of(hazard["hazard_class"])
    classes = np.full(grid.shape, np.nan)
    classes[grid.cells(hazard["source_x"].values, hazard["source_y"].values)] = len(PARTS) + 1
    classes[grid.cells(table["x"].to_numpy(), table["y"].to_numpy())] = parts
    limits = -0.5, len(COLOURS) - 0.5
    draw_image(sheet.axes, classes, grid, cmap=ListedColormap(list(COLOURS)), clim=limits)
    draw_places(sheet, hazard)
    finish(sheet, hazard["crs"].attrs)
    return sheet.figure
