# SPDX-License-Identifier: BSD-3-Clause
"""Figures of all rebounds: fractions of the incident energy, incidence angles, R_t and R_n; and of
R_t and R_n of an impact set."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from rockfall.language import say
from rockfall.plots.style import BLUE, GREY, INK, VERMILION, WIDE, draw_bars, new_figure, styled
from rockfall.quantities import REBOUND, with_unit
from rockfall.result.grounds import classical_grounds, table_grounds
from rockfall.scene.rebounds.sets import Sets, restitution

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ENERGY = ("tangential_share", "normal_share", "rotational_share")
RESTITUTION = ("restitution_tangential", "restitution_normal")
# Values from Bourrier et al. (2009, section 5.2).
PAPER = {
    "restitution_tangential": [(0.7, "axis.paper_tangential")],
    "restitution_normal": [(0.4, "axis.paper_normal"), (1.0, "axis.paper_normal_small")],
}
ANGLES = np.arange(5.0, 90.1, 2.5)  # incidence angles [degree]
LAST_RT = 60.0  # [degree] at steeper incidence V_t_in is too small to divide by
KNOWN: dict[str, list[tuple[tuple[float, ...], tuple[float, ...]]]] = {
    "R_t": [((5, 30), (0.7, 0.7))],
    "R_n": [((90,), (0.4,)), ((10, 20), (1.0, 1.0))],
}


def beside_paper(result: xr.Dataset) -> bool:
    """Return True if all rebounds follow impact sets, so that the paper's values apply."""
    return not (classical_grounds(result) or table_grounds(result))


@styled
def histogram_figure(result: xr.Dataset, *names: str) -> Figure:
    """Histograms of the run in per cent of rebounds, with the paper's values if comparable."""
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
    """Fraction of the rebounds in each histogram bin, and the bin edges."""
    counts = result[f"{name}_histogram"].values
    bounds = result[f"{name}_bin_bounds"].values
    return counts / max(1, counts.sum()), np.append(bounds[:, 0], bounds[-1, 1])


@styled
def draw_restitution(sets: Sequence[Sets]) -> Figure:
    """R_t and R_n against incidence angle for each ratio, without spin (Fig. 5 of the paper): mean
    and middle 80 % of the admissible draws from each set, with the paper's values in grey."""
    figure = new_figure(WIDE, 3.6)
    panels = figure.subplots(2, 5, sharex=True, sharey="row")
    looks = ((VERMILION, "-"), (BLUE, (0, (5, 2))))
    for fitted, (colour, dashes) in zip(sets, looks, strict=False):
        for k in range(5):
            draws = [restitution(fitted.mean[k], fitted.covariance[k], angle) for angle in ANGLES]
            for row, axes in enumerate(panels[:, k]):
                shown = ANGLES[ANGLES <= (LAST_RT, 90.0)[row]]
                values = [draw[row] for draw in draws[: shown.size]]
                # Angles with an admissible draw.
                is_known = np.array([v.size > 0 for v in values])
                shown, values = shown[is_known], [v for v in values if v.size]
                if not values:
                    continue
                low, high = np.transpose([np.quantile(v, (0.1, 0.9)) for v in values])
                axes.fill_between(shown, low, high, color=colour, alpha=0.18, lw=0)
                mean = [v.mean() for v in values]
                axes.plot(shown, mean, color=colour, lw=1.2, ls=dashes, label=fitted.name)
    for row, name in enumerate(KNOWN):
        for axes in panels[row]:
            for x, y in KNOWN[name]:
                axes.plot(x, y, color=GREY, lw=4, alpha=0.5, marker="s", ms=4, zorder=0)
        panels[row, 0].set_ylabel(name)
    for k in range(5):
        panels[0, k].set_title(f"R_b/R_m = {k + 1}")
        panels[1, k].set_xlim(0, 91)
    panels[0, 0].set_ylim(0, 1.1)
    panels[1, 0].set_ylim(0, 2.5)
    panels[1, 4].legend(loc="upper right")
    figure.supxlabel(say("axis.incidence_angle"), fontsize=8)
    return figure
