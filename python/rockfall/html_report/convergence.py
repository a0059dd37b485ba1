# SPDX-License-Identifier: BSD-3-Clause
"""Convergence of the numbers at a line with the number of boulders, and the number still needed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.analysis.line_statistics import line_numbers
from rockfall.analysis.precision.intervals import Sources, sources
from rockfall.html_report.intervals import STATISTICS, statistic
from rockfall.language import say
from rockfall.plots.style import BLUE, INK, VERMILION, WIDE, capital, new_figure, styled
from rockfall.quantities import QUANTITIES

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    History = dict[str, list[dict[str, float]]]  # quantity -> its numbers after each of the sizes

SHOWN = ("speed", "passing_height", "energy_total")
NUMBERS = [("fraction", "fraction"), *((q, name) for q in SHOWN for name in ("mean", "std", "q95"))]
FIRST = 30  # minimum number of boulders shown
STEPS = 24  # number of sizes
LOOKS = {  # colour and dashes
    "fraction": (INK, "-"),
    "mean": (BLUE, "-"),
    "std": (INK, (0, (1, 1.5))),
    "q95": (VERMILION, (0, (5, 2))),
}


def sizes(source: Sources) -> list[int]:
    """Numbers of boulders, evenly spaced in their logarithm, up to all; complete turns of the
    sources where there are enough."""
    of, boulders = source.count, source.number.size
    n = np.geomspace(min(FIRST, boulders), boulders, STEPS).round().astype(int)
    n = np.where(n > of, n // of * of, n)
    return sorted({*n.tolist(), boulders})


def mixed(source: Sources) -> np.ndarray:
    """Order of boulders in which each initial part is a sample of all: the sources take turns, in
    the same random order in each turn, and as often as they release boulders. The order within a
    source is unchanged."""
    by_source = np.argsort(source.number, kind="stable")
    boulders = np.bincount(source.number)
    first = np.cumsum(boulders) - boulders
    number = source.number[by_source]
    turn = np.arange(number.size) - first[number]
    late = np.random.default_rng(0).random(boulders.size)
    return by_source[np.argsort((turn + late[number]) / boulders[number], kind="stable")]


def known_of(number: np.ndarray, source: Sources) -> Sources:
    """Sources of the first boulders of `mixed`: strata only if all sources have the same number of
    boulders; before that, the selection of sources is random."""
    whole = number.size == source.number.size
    if source.sampled or whole or not np.ptp(np.bincount(number, minlength=source.count)):
        return Sources.of(number, source.sampled)
    return Sources.alone(number.size)


def history(result: xr.Dataset, line: int, n: list[int]) -> History:
    """Numbers at the line of this index after each of `n` boulders."""
    names = ["start_x", "start_y", *(n for n in result if result[n].dims == ("line", "boulder"))]
    one = result[names].isel(line=[line])  # copies of all lines would take memory
    source = sources(result)
    order = mixed(source)
    ordered, number = one.isel(boulder=order), source.number[order]
    found: History = {quantity: [] for quantity in SHOWN}
    for size in n:
        part, known = ordered.isel(boulder=slice(size)), known_of(number[:size], source)
        for quantity in SHOWN:
            found[quantity].append(line_numbers(part, 0, quantity, known))
    return found


@styled
def convergence_figure(result: xr.Dataset, line: int) -> Figure:
    """Fraction, speed, passing height and energy at a line against the number of boulders."""
    n = sizes(sources(result))
    found = history(result, line, n)
    figure = new_figure(WIDE, 4.6)
    axes = figure.subplots(2, 2, sharex=True)
    panels = dict(zip(("fraction", *SHOWN), axes.flat, strict=True))
    for quantity, panel in panels.items():
        panel.set_title(capital(QUANTITIES[quantity].title))
        panel.set_xscale("log")
        panel.xaxis.set_major_formatter("{x:,g}")
    ends: dict[Axes, float] = {}
    for quantity, name in NUMBERS:
        rows = found["speed" if quantity == "fraction" else quantity]
        panel = panels[quantity]
        ends[panel] = max(
            ends.get(panel, 0.0), _curve(panel, n, rows, name, QUANTITIES[quantity].factor)
        )
    for panel, end in ends.items():
        panel.set_ylim(0, end or None)
    for panel in axes[1]:
        panel.set_xlabel(say("label.boulders"))
    figure.legend(*axes[0, 1].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _curve(
    axes: Axes, n: list[int], rows: list[dict[str, float]], name: str, scale: float
) -> float:
    """Plot a number with its 95 % band; returns the upper limit for the axis: at least twice the
    highest number, since bands of few boulders are unbounded, and the end of the last band."""
    value, low, high = (
        np.array([scale * row.get(f"{name}{end}", np.nan) for row in rows])
        for end in ("", "_low", "_high")
    )
    colour, dashes = LOOKS[name]
    about: dict[str, Any] = {
        "label": statistic(name) if name in STATISTICS else None,
        "color": colour,
        "ls": dashes,
    }
    axes.fill_between(n, low, high, color=colour, alpha=0.18, lw=0)
    axes.plot(n, value, lw=1.1, marker=".", ms=3, **about)
    known = value[np.isfinite(value)]
    return max(2 * known.max(initial=0.0), 1.05 * np.nan_to_num(high[-1]))
