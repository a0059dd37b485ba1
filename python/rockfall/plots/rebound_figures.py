# SPDX-License-Identifier: BSD-3-Clause
"""Figures over all rebounds: fractions of the incident energy, incidence angles, R_t and R_n."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rockfall.language import say
from rockfall.plots.style import INK, WIDE, draw_bars, new_figure, styled
from rockfall.quantities import REBOUND, with_unit
from rockfall.result.grounds import classical_grounds, table_grounds

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

ENERGY = ("tangential_share", "normal_share", "rotational_share")
RESTITUTION = ("restitution_tangential", "restitution_normal")
# Values of Bourrier et al. (2009, section 5.2).
PAPER = {
    "restitution_tangential": [(0.7, "axis.paper_tangential")],
    "restitution_normal": [(0.4, "axis.paper_normal"), (1.0, "axis.paper_normal_small")],
}


def beside_paper(result: xr.Dataset) -> bool:
    """Return True if the rebounds are comparable with values of the paper, which are by impact
    sets."""
    return not (classical_grounds(result) or table_grounds(result))


@styled
def histogram_figure(result: xr.Dataset, *names: str) -> Figure:
    """Histograms of the run side by side, each in per cent of its rebounds, with the values of the
    paper where these may be compared."""
    figure = new_figure(WIDE, 2.3)
    panels = figure.subplots(1, len(names), squeeze=False)[0]
    for axes, name in zip(panels, names, strict=True):
        frequency, edges = histogram(result, name)
        display = REBOUND[name]
        draw_bars(axes, frequency, display.factor * edges)
        axes.set(xlim=display.factor * edges[[0, -1]], ylim=(0, None), xlabel=display.title)
        printed = PAPER.get(name, ()) if beside_paper(result) else ()
        if printed:
            axes.set_ylim(0, 1.3 * axes.get_ylim()[1])  # space for text
        for k, (value, words) in enumerate(printed):
            axes.axvline(value, color=INK, lw=1, linestyle=(0, (1, 1)))
            axes.annotate(
                say(words), (value, 0.97 - 0.09 * k), (3, 0), va="top", fontsize=7,
                xycoords=axes.get_xaxis_transform(), textcoords="offset points",
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
            )  # fmt: skip
    panels[0].set_ylabel(with_unit(say("label.rebounds"), "%"))
    return figure


def histogram(result: xr.Dataset, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Fraction of the rebounds in each bin of a histogram, and the edges of the bins."""
    counts = result[f"{name}_histogram"].values
    bounds = result[f"{name}_bin_bounds"].values
    return counts / max(1, counts.sum()), np.append(bounds[:, 0], bounds[-1, 1])
