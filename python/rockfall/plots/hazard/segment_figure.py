# SPDX-License-Identifier: BSD-3-Clause
"""Hazard along roads: frequency, energy and height of each segment against chainage."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.hazard.classes import CLASSES
from rockfall.files.hazard_files import HAZARD_COLOURS
from rockfall.files.segment_files import SHOWN_COLUMNS, segment_table
from rockfall.language import Number, say, word
from rockfall.plots.style import BLUE, GREEN, INK, VERMILION, WIDE, new_figure, plain, styled
from rockfall.quantities import QUANTITIES
from rockfall.result.maps.flat_maps import shown
from rockfall.result.variables import ENDS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ABOVE = (BLUE, GREEN, VERMILION)  # colours: all boulders, then boulders above each threshold
FALLS = 3.0  # number of decades on the frequency axis
ROOM = 5.0  # factor above the highest frequency that leaves space for the legend


def roads_of_segments(hazard: xr.Dataset) -> list[str]:
    """Names of the segmented roads of a hazard, in order."""
    return list(dict.fromkeys(hazard["segment_road"].values.tolist()))


@styled
def segment_figure(hazard: xr.Dataset, road: str) -> Figure:
    """Figure of the segments of a road: hazard class, annual frequencies with 95 % bands, and 95 %
    quantiles of energy and upper-edge height of boulders that touch them. Hatched bands have no
    upper limit, because there are too few boulders."""
    rows = segment_table(hazard)
    rows = rows[rows["road"] == road].sort_values("chainage_from")
    thresholds = hazard["threshold"].values.tolist()
    figure = new_figure(WIDE, 5.8)
    panels = figure.subplots(4, 1, sharex=True, height_ratios=[0.25, 3, 2, 2])
    _draw_classes(panels[0], rows)
    panels[0].set_title(plain(road), pad=14)
    _draw_frequencies(panels[1], rows, thresholds)
    for axes, (quantity, name) in zip(panels[2:], SHOWN_COLUMNS.items(), strict=True):
        _draw_steps(axes, rows, name, BLUE)
        axes.set_ylim(0.0)
        axes.set(ylabel=f"{QUANTITIES[quantity].short}, q95")
    ends = rows["chainage_from"].iloc[0], rows["chainage_to"].max()
    panels[-1].set(xlim=ends, xlabel=say("axis.chainage"))
    figure.align_ylabels()
    return figure


def _draw_classes(axes: Axes, rows: pd.DataFrame) -> None:
    """Draw the class of each segment as a band, hatched where uncertain."""
    from matplotlib.patches import Patch

    colours = dict(zip(CLASSES, HAZARD_COLOURS, strict=True))
    for _, row in rows.iterrows():
        style: dict[str, Any] = {"facecolor": colours[row["hazard"]], "edgecolor": INK, "lw": 0.3}
        if row["hazard_lower"] != row["hazard_upper"]:
            style["hatch"] = "/////"
        axes.axvspan(row["chainage_from"], row["chainage_to"], **style)
    key = [
        Patch(facecolor=colours[name], edgecolor=INK, lw=0.3, label=word(name))
        for name in reversed(CLASSES)
        if name in {*rows["hazard"]}
    ]
    axes.legend(handles=key, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(key))
    axes.set(yticks=[])
    axes.spines[:].set_visible(False)
    axes.tick_params(bottom=False)


def _draw_frequencies(axes: Axes, rows: pd.DataFrame, thresholds: list[float]) -> None:
    """Draw frequencies of all boulders and of boulders above each threshold, on a log axis."""
    names = ["frequency"]
    names += [f"frequency_above_{shown('threshold', threshold)}" for threshold in thresholds]
    energies = (Number(shown("threshold", threshold, " ")) for threshold in thresholds)
    labels = [
        say("axis.all_boulders"),
        *(say("hazard.above", energy=energy) for energy in energies),
    ]
    for k, (name, label) in enumerate(zip(names, labels, strict=True)):
        _draw_steps(axes, rows, name, ABOVE[k % len(ABOVE)], label)
    axes.set_yscale("log")
    top = np.nanmax(rows["frequency_high"].to_numpy(), initial=1e-6)
    axes.set_ylim(10.0 ** (np.floor(np.log10(top)) - FALLS + 1), ROOM * top)
    axes.set(ylabel=say("hazard.boulders_a_year"))
    axes.legend(loc="upper right", ncols=len(names))


def _draw_steps(
    axes: Axes, rows: pd.DataFrame, name: str, colour: str, label: str | None = None
) -> None:
    """Draw a quantity by segment as steps with a band, hatched without an upper limit."""
    top = rows[[name, f"{name}_high"]].max().max()
    for k, (_, row) in enumerate(rows.iterrows()):
        ends = [row["chainage_from"], row["chainage_to"]]
        value, low, high = (row[f"{name}{end}"] for end in ENDS)
        axes.plot(ends, [value] * 2, color=colour, lw=1.2, label=label if not k else None)
        if np.isfinite(high):
            lower = low if np.isfinite(low) else 0.0
            axes.fill_between(ends, lower, high, color=colour, alpha=0.2, lw=0)
        elif np.isfinite(value):
            style: dict[str, Any] = {"facecolor": "none", "edgecolor": colour, "alpha": 0.4}
            axes.fill_between(ends, value, 1.1 * top, hatch="////", lw=0, **style)
