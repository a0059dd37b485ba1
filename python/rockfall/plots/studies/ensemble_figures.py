# SPDX-License-Identifier: BSD-3-Clause
"""Effects of uncertain inputs on statistics at lines, compared with the Monte Carlo error."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from rockfall.kernel_rules import Z
from rockfall.language import word
from rockfall.plots.style import BLUE, GREY, WIDE, new_figure, plain, styled
from rockfall.quantities import AT_LINES, QUANTITIES
from rockfall.result.crossings import line_index, line_names

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NUMBERS = {"fraction": ["fraction"]} | {name: [f"{name}.mean", f"{name}.q95"] for name in AT_LINES}


@styled
def ranges_figure(data: xr.Dataset) -> Figure:
    """A row of panels for each line: 90 % of the draws in grey, the unchanged case and its interval
    in blue."""
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
