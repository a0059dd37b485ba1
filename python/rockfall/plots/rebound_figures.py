# SPDX-License-Identifier: BSD-3-Clause
"""Figures over all rebounds: shares of the incident energy, incidence angles, R_t and R_n."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rockfall.plots.style import BLUE, INK, NARROW, WIDE, new_figure, styled

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

LABELS = {
    "tangential_share": "tangential share of energy",
    "normal_share": "normal share of energy",
    "rotational_share": "rotational share of energy",
    "incidence_angle": "incidence angle from the surface [degrees]",
    "restitution_tangential": "R_t = V_t,out / V_t,in",
    "restitution_normal": "R_n = -V_n,out / V_n,in",
}
ENERGY = ("tangential_share", "normal_share", "rotational_share")
RESTITUTION = ("restitution_tangential", "restitution_normal")
# What Bourrier et al. (2009, section 5.2) print of their rebounds.
PAPER = {
    "restitution_tangential": [(0.7, "0.7 at small angles")],
    "restitution_normal": [(0.4, "0.4 at vertical impact"), (1.0, "above 1 at small angles")],
}


@styled
def histogram_figure(result: xr.Dataset, *names: str) -> Figure:
    """Histograms of the run side by side, each in per cent of its rebounds, with what the paper
    prints in grey."""
    figure = new_figure(NARROW if len(names) == 1 else WIDE, 2.3)
    panels = figure.subplots(1, len(names), squeeze=False)[0]
    for axes, name in zip(panels, names, strict=True):
        share, edges = histogram(result, name)
        axes.stairs(100 * share, edges, fill=True, color=BLUE, alpha=0.25)
        axes.stairs(100 * share, edges, color=BLUE, lw=1)
        axes.set(xlim=(edges[0], edges[-1]), ylim=(0, None), xlabel=LABELS[name])
        printed = PAPER.get(name, ())
        if printed:
            axes.set_ylim(0, 1.3 * axes.get_ylim()[1])  # room for words
        for k, (value, words) in enumerate(printed):
            axes.axvline(value, color=INK, lw=1, linestyle=(0, (1, 1)))
            axes.annotate(
                f"paper: {words}", (value, 0.97 - 0.09 * k), (3, 0), va="top", fontsize=7,
                xycoords=axes.get_xaxis_transform(), textcoords="offset points",
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
            )  # fmt: skip
    panels[0].set_ylabel("rebounds [%]")
    return figure


def histogram(result: xr.Dataset, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Share of the rebounds in each class of a histogram, and the edges of the classes."""
    counts = result[f"{name}_histogram"].values
    bounds = result[f"{name}_bin_bounds"].values
    return counts / max(1, counts.sum()), np.append(bounds[:, 0], bounds[-1, 1])
