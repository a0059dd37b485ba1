# SPDX-License-Identifier: BSD-3-Clause
"""Figure of a case with every rebound model, side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.language import word
from rockfall.plots.style import BLUE, GREY, INK, WIDE, new_figure, plain, styled
from rockfall.quantities import AT_LINES, QUANTITIES
from rockfall.studies.models import RUN_OUT, Models

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANELS = {"boulders": ("fraction", "fraction"), **{name: ("mean", name) for name in AT_LINES}}


@styled
def models_figure(models: Models) -> Figure:
    """Row of panels for each line, and a panel for the run-out, with a row for each model. Filled
    marks are means or fractions, open marks 95 % quantiles, bars their 95 % intervals."""
    lines = [line for line in dict.fromkeys(models.table["line"]) if line]
    deep = 0.55 + 0.17 * len(models.names)
    figure = new_figure(1.35 * WIDE, (deep + 0.35) * (len(lines) + 1))
    blocks = figure.add_gridspec(len(lines) + 1, 1)
    for k, line in enumerate(lines):
        row = blocks[k].subgridspec(1, len(PANELS)).subplots(sharey=True, squeeze=False)[0]
        for axes, (quantity, (statistic, label)) in zip(row, PANELS.items(), strict=True):
            _draw(axes, models, line, quantity, statistic, label)
        row[0].set_title(plain(line))
    axes = figure.add_subplot(blocks[-1].subgridspec(1, 2)[0])
    _draw(axes, models, "", RUN_OUT, "mean", RUN_OUT)
    return figure


def _draw(axes: Axes, models: Models, line: str, quantity: str, statistic: str, label: str) -> None:
    """Draw a quantity for all models, with a thin line at the value of the first."""
    shown = QUANTITIES[label]
    here = models.table[(models.table["line"] == line) & (models.table["quantity"] == quantity)]
    places = np.arange(len(models.names))
    for number, colour, face in ((statistic, BLUE, BLUE), ("q95", GREY, "white")):
        rows = here[here["statistic"] == number].set_index("model").reindex(models.names)
        if rows["value"].notna().any():
            value, low, high = (shown.factor * rows[name] for name in ("value", "low", "high"))
            ends = np.nan_to_num(np.stack([value - low, high - value])).clip(min=0)
            about_: dict[str, Any] = {"linestyle": "", "marker": "o", "ms": 3.5, "lw": 1}
            axes.errorbar(value, places, xerr=ends, color=colour, mfc=face, **about_)
            if number == statistic:
                axes.axvline(value.iloc[0], color=INK, lw=0.5, linestyle=(0, (2, 2)))
    axes.set_yticks(places, [plain(word(name)) for name in models.names])
    axes.set_ylim(len(places) - 0.5, -0.5)
    axes.set_xlim(left=0)
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel(shown.title)
