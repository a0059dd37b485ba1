# SPDX-License-Identifier: BSD-3-Clause
"""Figure of the statistics at a line against the number of boulders."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from rockfall.analysis.line_statistics import row_name
from rockfall.analysis.precision.history import NUMBERS, history, sizes
from rockfall.analysis.precision.intervals import sources
from rockfall.language import localised, say, spoken
from rockfall.plots.style import BLUE, INK, VERMILION, WIDE, capital, new_figure, styled
from rockfall.quantities import AT_LINES, QUANTITIES, statistic
from rockfall.result.variables import ENDS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LOOKS = {  # colour and dash styles
    "fraction": (INK, "-"),
    "mean": (BLUE, "-"),
    "std": (INK, (0, (1, 1.5))),
    "q95": (VERMILION, (0, (5, 2))),
}


@styled
def history_figure(result: xr.Dataset, line: int) -> Figure:
    """Fraction, speed, passing height and energy at a line against the number of boulders."""
    n = sizes(sources(result))
    numbers = history(result, line, n)
    figure = new_figure(WIDE, 4.6)
    axes = figure.subplots(2, 2, sharex=True)
    language = spoken()
    panels = dict(zip(("fraction", *AT_LINES), axes.flat, strict=True))
    for quantity, panel in panels.items():
        panel.set_title(capital(QUANTITIES[quantity].title))
        panel.set_xscale("log")
        panel.xaxis.set_major_formatter(lambda n, _: localised(f"{n:,g}", language))
    ends: dict[Axes, float] = {}
    for quantity, name in NUMBERS:
        rows = numbers[row_name(quantity)]
        panel = panels[quantity]
        ends[panel] = max(
            ends.get(panel, 0.0), _curve(panel, n, rows, name, QUANTITIES[quantity].factor)
        )
    for panel, end in ends.items():
        panel.set_ylim(0, end or None)
    for panel in axes.flat:
        _mark_minor(panel)
    for panel in axes[1]:
        panel.set_xlabel(say("label.boulders"))
    figure.legend(*axes[0, 1].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _mark_minor(axes: Axes) -> None:
    """Draw the minor ticks of a logarithmic axis as one curve, because each tick takes 1 ms."""
    import matplotlib
    from matplotlib.markers import TICKDOWN
    from matplotlib.ticker import LogLocator, NullLocator

    low, high = axes.get_xlim()
    if high <= 10 * low:
        return
    places = np.array(LogLocator(subs=range(2, 10)).tick_values(low, high))
    places = places[(places >= low) & (places <= high)]
    axes.xaxis.set_minor_locator(NullLocator())
    look = matplotlib.rcParams
    style: dict[str, Any] = {
        "marker": TICKDOWN, "ms": look["xtick.minor.size"], "mew": look["xtick.minor.width"],
        "color": look["xtick.color"],
    }  # fmt: skip
    axes.plot(
        places, np.zeros(places.size), ls="", transform=axes.get_xaxis_transform(),
        clip_on=False, scalex=False, scaley=False, **style,
    )  # fmt: skip


def _curve(
    axes: Axes, n: list[int], rows: list[dict[str, float]], name: str, scale: float
) -> float:
    """Plot a statistic with its 95 % band. Return the upper axis limit: twice the highest value or,
    if larger, just above the last band. Earlier bands may exceed it, because those of few boulders
    are wide or unbounded."""
    value, low, high = (
        np.array([scale * row.get(f"{name}{end}", np.nan) for row in rows]) for end in ENDS
    )
    colour, dashes = LOOKS[name]
    label = None if name == "fraction" else statistic(name)
    style: dict[str, Any] = {"label": label, "color": colour, "ls": dashes}
    axes.fill_between(n, low, high, color=colour, alpha=0.18, lw=0)
    axes.plot(n, value, lw=1.1, marker=".", ms=3, **style)
    finite = value[np.isfinite(value)]
    return max(2 * finite.max(initial=0.0), 1.05 * np.nan_to_num(high[-1]))
