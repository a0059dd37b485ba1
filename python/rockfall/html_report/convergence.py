# SPDX-License-Identifier: BSD-3-Clause
"""How the numbers at a line converge with the number of boulders, and how many more they need."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.analysis.line_statistics import line_numbers, sources
from rockfall.html_report.intervals import STATISTICS
from rockfall.plots.style import BLUE, INK, VERMILION, WIDE, capital, new_figure, styled
from rockfall.quantities import QUANTITIES

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    History = dict[str, list[dict[str, float]]]  # quantity -> its numbers after each of the sizes

SHOWN = ("speed", "passing_height", "energy_total")
NUMBERS = [("fraction", "fraction"), *((q, name) for q in SHOWN for name in ("mean", "std", "q95"))]
TARGETS = (0.05, 0.02, 0.01)  # half widths of an interval, relative to the number
FIRST = 30  # boulders from which numbers are shown
STEPS = 24  # sizes at which they are taken
LOOKS = {  # colour and dashes
    "fraction": (INK, "-"),
    "mean": (BLUE, "-"),
    "std": (INK, (0, (1, 1.5))),
    "q95": (VERMILION, (0, (5, 2))),
}


def sizes(boulders: int) -> list[int]:
    """Numbers of boulders, evenly apart in their logarithm, up to all."""
    first = min(FIRST, boulders)
    return sorted(set(np.geomspace(first, boulders, STEPS).round().astype(int).tolist()))


def by_turns(source: np.ndarray) -> np.ndarray:
    """The order of boulders that takes one of each source in turn; of one source: as they are."""
    by_source = np.argsort(source, kind="stable")
    first = np.searchsorted(source[by_source], source[by_source])
    turn = np.empty(source.size, int)
    turn[by_source] = np.arange(source.size) - first
    return np.lexsort((source, turn))


def history(result: xr.Dataset, line: int) -> History:
    """Numbers at the line of this index after each of `sizes` boulders."""
    names = ["start_x", "start_y", *(n for n in result if result[n].dims == ("line", "boulder"))]
    one = result[names].isel(line=[line])  # copies of all lines would take memory
    source = sources(result)
    order = by_turns(source)
    ordered, source = one.isel(boulder=order), source[order]
    found: History = {quantity: [] for quantity in SHOWN}
    for n in sizes(order.size):
        part = ordered.isel(boulder=slice(n))
        for quantity in SHOWN:
            found[quantity].append(line_numbers(part, 0, quantity, source[:n]))
    return found


def needed(boulders: int, half: float, target: float) -> int:
    """Boulders with which an interval of this half width has that of `target`, both relative
    to the number: it falls as 1/sqrt(n). Rounded up to two digits."""
    exact = boulders * (half / target) ** 2
    step = 10 ** max(0, math.floor(math.log10(max(exact, 1.0))) - 1)
    return math.ceil(exact / step - 1e-9) * step


@styled
def convergence_figure(result: xr.Dataset, line: int) -> Figure:
    """Fraction, speed, passing height and energy at a line against the number of boulders."""
    found, n = history(result, line), sizes(result.sizes["boulder"])
    figure = new_figure(WIDE, 4.6)
    axes = figure.subplots(2, 2, sharex=True)
    panels = dict(zip(("fraction", *SHOWN), axes.flat, strict=True))
    for quantity, panel in panels.items():
        panel.set_title(capital(QUANTITIES[quantity].title))
        panel.set_xscale("log")
        panel.xaxis.set_major_formatter("{x:,g}")
    for quantity, name in NUMBERS:
        rows = found["speed" if quantity == "fraction" else quantity]
        _curve(panels[quantity], n, rows, name, QUANTITIES[quantity].factor)
    for panel in axes.flat:
        panel.set_ylim(0, None)
    for panel in axes[1]:
        panel.set_xlabel("boulders")
    figure.legend(*axes[0, 1].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _curve(axes: Axes, n: list[int], rows: list[dict[str, float]], name: str, scale: float) -> None:
    """A number with its 95 % band."""
    value, low, high = (
        np.array([scale * row.get(f"{name}{end}", np.nan) for row in rows])
        for end in ("", "_low", "_high")
    )
    colour, dashes = LOOKS[name]
    about: dict[str, Any] = {"label": STATISTICS.get(name), "color": colour, "ls": dashes}
    axes.fill_between(n, low, high, color=colour, alpha=0.18, lw=0)
    axes.plot(n, value, lw=1.1, marker=".", ms=3, **about)
