# SPDX-License-Identifier: BSD-3-Clause
"""Posteriors of a back-analysis, in a separate module because other figures need none of its
imports."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from rockfall.plots.style import BLUE, GREY, INK, capital, new_figure, plain, styled
from rockfall.studies.back.posterior import draws_table, parameters, posterior_table
from rockfall.studies.back.study import Back

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANEL, BINS = 1.5, 16  # panel size [inch], and bins of its densities


@styled
def posterior_figure(analysis: Back) -> Figure:
    """Matrix of panels, with a row and a column for each parameter. The diagonal has the densities
    of prior (grey) and posterior (blue), with lines at 5, 50 and 95 % of the posterior; panels
    below have draws of both. Impact sets, which have no order, are omitted."""
    shown, table = list(parameters(analysis)), posterior_table(analysis)
    first = analysis.members.iloc[: analysis.inputs.design[..., 0].size]
    prior, draws = ([table[parameter.column] * (parameter.scale or 1.0) for parameter in shown]
                    for table in (first, draws_table(analysis)))  # fmt: skip
    figure = new_figure(PANEL * max(len(shown), 2), PANEL * max(len(shown), 1.3))
    panels = figure.add_gridspec(max(len(shown), 1), max(len(shown), 1))
    for i, parameter in enumerate(shown):
        for j in range(i):
            axes = figure.add_subplot(panels[i, j])
            for sample, colour in ((prior, GREY), (draws, BLUE)):
                axes.plot(sample[j], sample[i], ".", ms=1.5, alpha=0.6, color=colour)
        axes = figure.add_subplot(panels[i, i])
        _densities(axes, prior[i], draws[i])
        for end in table.loc[i, ["q05", "median", "q95"]]:
            axes.axvline(end, color=INK, lw=0.7, linestyle=(0, (2, 2)))
        unit = f" [{parameter.units}]" if parameter.units != "1" else ""
        axes.set_title(plain(capital(parameter.label) + unit), fontsize=6.5)
    for axes in figure.axes:
        axes.tick_params(labelsize=5)
    return figure


def _densities(axes: Axes, prior: pd.Series, draws: pd.Series) -> None:
    low, high = min(prior.min(), draws.min()), max(prior.max(), draws.max())
    edges = np.linspace(low, high, BINS + 1)
    for table, colour in ((prior, GREY), (draws, BLUE)):
        axes.stairs(np.histogram(table, edges, density=True)[0], edges, fill=True, color=colour,
                    alpha=0.5)  # fmt: skip
    axes.set_yticks([])
