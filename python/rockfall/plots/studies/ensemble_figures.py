# SPDX-License-Identifier: BSD-3-Clause
"""Effects of uncertain inputs on statistics at lines, compared with the Monte Carlo error; and
posteriors of a back-analysis."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.kernel_rules import Z
from rockfall.language import word
from rockfall.plots.style import BLUE, GREY, INK, WIDE, capital, new_figure, plain, styled
from rockfall.quantities import QUANTITIES
from rockfall.result.crossings import line_index, line_names
from rockfall.studies.back.posterior import draws_table, parameters, posterior_table
from rockfall.studies.back.study import Back

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NUMBERS = {"fraction": ["fraction"]} | {
    name: [f"{name}.mean", f"{name}.q95"] for name in ("speed", "passing_height", "energy_total")
}


PANEL, BINS = 1.5, 16  # panel size of a posterior [inch], and bins of its densities


@styled
def ranges_figure(data: xr.Dataset) -> Figure:
    """Panels for a line: 90 % of the draws in grey, the unchanged case and its interval in blue."""
    lines = line_names(data)
    figure = new_figure(1.35 * WIDE, 1.1 * len(lines) + 0.4)
    grid = figure.subplots(len(lines), len(NUMBERS), squeeze=False)
    for row, line in zip(grid, lines, strict=True):
        for axes, (quantity, names) in zip(row, NUMBERS.items(), strict=True):
            _draw(axes, data.isel(line=line_index(data, line)), quantity, names)
        row[0].set_title(plain(str(line)))
    return figure


def _draw(axes: Axes, at: xr.Dataset, quantity: str, names: list[str]) -> None:
    shown = QUANTITIES[quantity]
    for k, name in enumerate(names):
        of_result = at.sel(result=name)
        low, high, value, error = (
            shown.factor * of_result[key].item()
            for key in ("q05", "q95", "case_value", "monte_carlo_std")
        )
        axes.barh(k, high - low, left=low, height=0.5, color=GREY, alpha=0.5, lw=0)
        half = np.nan_to_num(Z * error)
        axes.errorbar(value, k, xerr=half, color=BLUE, marker="o", ms=3.5, lw=1.2)
    labels = [name.partition(".")[2] or "passing" for name in names]
    axes.set_yticks(range(len(names)), [*map(word, labels)])
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlim(left=0)
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel(shown.title)


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
