# SPDX-License-Identifier: BSD-3-Clause
"""Frequency against energy at places of hazards: a panel for each place, with all variants."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from rockfall.analysis.hazard.levels import exceedance
from rockfall.language import say
from rockfall.plots.style import BLUE, GREEN, GREY, INK, VERMILION, WIDE, new_figure, plain, styled
from rockfall.quantities import QUANTITIES
from rockfall.tables.hazard import places_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = (INK, BLUE, VERMILION, GREEN, GREY)
PANELS = 4
RAREST = 1e-4  # lowest frequency shown [1/year]


@styled
def curves_figure(hazards: Mapping[str, xr.Dataset]) -> Figure:
    """Annual frequency of boulders above each energy at the first places, with 95 % bands."""
    first = next(iter(hazards.values()))
    places = [
        place for place in places_of(first)
        if not np.isnan(first[f"{place.kind}_energy_by_period"].values[place.k]).any()
    ]  # fmt: skip
    names = [place.name for place in places]
    shown = [place for place in places if names.count(place.name) == 1][:PANELS]
    rows = max(1, -(-len(shown) // 2))
    figure = new_figure(WIDE, 0.5 + 1.9 * rows)
    panels = figure.subplots(
        rows, min(2, max(1, len(shown))), sharex=True, sharey=True, squeeze=False
    )
    for axes in panels.flat[len(shown) :]:
        axes.set_visible(False)
    for axes, place in zip(panels.flat, shown, strict=False):
        for k, (name, hazard) in enumerate(hazards.items()):
            curve = exceedance(hazard, str(first[place.kind].values[place.k]))
            energy = np.maximum(curve["energy"].to_numpy(), curve["energy"].to_numpy()[1]) / 1000
            colour = COLOURS[k % len(COLOURS)]
            axes.plot(energy, curve["frequency"], color=colour, lw=1.2, label=name)
            axes.fill_between(energy, curve["low"], curve["high"], color=colour, alpha=0.15, lw=0)
        axes.set_title(plain(place.name))
        axes.set(xscale="log", yscale="log")
        axes.set_ylim(RAREST, None)
    for axes in panels[-1]:
        axes.set_xlabel(QUANTITIES["energy_total"].short)
    for axes in panels[:, 0]:
        axes.set_ylabel(say("hazard.boulders_a_year"))
    if len(hazards) > 1:
        panels.flat[0].legend()
    return figure
