# SPDX-License-Identifier: BSD-3-Clause
"""Figure of a measured convergence."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from rockfall.plots.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    VERMILION,
    capital,
    new_figure,
    plain,
    save,
    styled,
)
from rockfall.quantities import QUANTITIES
from rockfall.studies.convergence import AS_GIVEN, KEYS, NUMBERS, SIZE, Convergence

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = {"fraction": INK, "mean": BLUE, "std": GREEN, "q95": VERMILION, "max": GREY}
MARKERS = {"boulders": "D", "speed": "o", "passing_height": "s", "energy_total": "^"}
SHOWN = {name: QUANTITIES["fraction" if name == "boulders" else name] for name in MARKERS}


def figure(convergence: Convergence, paths: Sequence[Path]) -> None:
    """Draw the statistics of each line against the number of boulders, and the errors below. Write
    the figure to each of `paths`, in the format of its extension."""
    page = _page(convergence)
    for path in paths:
        save(page, path, dpi=200)


@styled
def _page(convergence: Convergence) -> Figure:
    lines = list(dict.fromkeys(convergence.study["line"]))
    page = new_figure(9.6, 4.7 * len(lines) + 0.5)
    page.set_layout_engine("constrained", w_pad=0.06, h_pad=0.06)
    blocks = page.add_gridspec(len(lines), 1)
    for k, line in enumerate(lines):
        rows = blocks[k].subgridspec(2, 1, height_ratios=[1, 1.25])
        panels = rows[0].subgridspec(1, 4).subplots(squeeze=False)[0]
        for axes, quantity in zip(panels, SHOWN, strict=True):
            _study(axes, _at(convergence.study, line, quantity), quantity, plain(line))
        left, right = rows[1].subgridspec(1, 2).subplots(sharey=True, squeeze=False)[0]
        _errors(left, _at(convergence.error, line), _at(convergence.cost, line), plain(line))
        _terrains(right, _at(convergence.numerical, line), plain(line))
        if left.get_yscale() == "log":
            left.set_ylim(bottom=0.01)  # smaller errors do not matter
    page.legend(handles=_key(), loc="outside lower center", ncols=5)
    return page


def _at(table: pd.DataFrame, line: str, quantity: str | None = None) -> pd.DataFrame:
    rows = table["line"] == line
    return table[rows if quantity is None else rows & (table["quantity"] == quantity)]


def _study(axes: Axes, table: pd.DataFrame, quantity: str, line: str) -> None:
    """Draw statistics of a quantity against the number of boulders, with 95 % bands."""
    scale = SHOWN[quantity].factor
    for statistic, rows in table.groupby("statistic", sort=False):
        n, colour = rows["boulders"], COLOURS[statistic]
        axes.fill_between(
            n, scale * rows["low"], scale * rows["high"], color=colour, alpha=0.2, lw=0
        )
        axes.plot(n, scale * rows["value"], color=colour, marker=MARKERS[quantity], ms=3, lw=1)
    n = table["boulders"]  # all sizes, including those without a crossing
    axes.set(xlabel="boulders from each source", xlim=(0.8 * n.min(), 1.25 * n.max()))
    _logarithmic(axes, "x", (1,))
    if quantity != "boulders" and (table["value"] > 0).any():
        _logarithmic(axes, "y")  # equal distances are equal percentages
    axes.set_title(f"{capital(SHOWN[quantity].title)} at {line}")


def _errors(axes: Axes, table: pd.DataFrame, cost: pd.DataFrame, line: str) -> None:
    """Draw the Monte Carlo error against CPU time on logarithmic scales."""
    for (quantity, statistic), group in table.groupby(KEYS[1:], sort=False):
        colour, marker = COLOURS[statistic], MARKERS[quantity]
        look: dict[str, Any] = {"color": colour, "marker": marker, "ms": 3.5, "lw": 0.8}
        axes.plot(group["cpu_seconds"], 100 * group["error"], **look)
    axes.set(xlabel="CPU time [s]", ylabel="error [%]")
    if not len(table):
        axes.set_title(f"Monte Carlo error at {line}: too few boulders cross it")
        return
    _logarithmic(axes, "x")
    _logarithmic(axes, "y", (1,))
    slope = cost["slope"]
    axes.set_title(f"Monte Carlo error at {line}: slopes {slope.min():.2f} to {slope.max():.2f}")


def _terrains(axes: Axes, table: pd.DataFrame, line: str) -> None:
    """Draw the changes for terrain variants, and the Monte Carlo error."""
    variants = list(dict.fromkeys(table["variant"]))
    labels = []
    for k, variant in enumerate(variants):
        changes = table[table["variant"] == variant]
        given = variant == AS_GIVEN
        height = 100 * (changes["statistical_error"] if given else changes["change"].abs())
        for place, (key, y, error) in enumerate(
            zip(changes[KEYS[1:]].values, height, 100 * changes["change_error"], strict=True)
        ):
            colour = COLOURS[key[1]]
            face = "white" if given else colour
            look: dict[str, Any] = {"marker": MARKERS[key[0]], "ms": 4, "mfc": face}
            at = k + 0.07 * (place - (len(NUMBERS) - 1) / 2)
            axes.errorbar(at, y, None if given else error, color=colour, lw=0.8, **look)
        what = f"Monte Carlo,\n{SIZE:,} boulders" if given else variant
        labels.append(f"{what}\n{changes['cpu_seconds'].iloc[0]:.2g} s")
    axes.set_xticks(range(len(variants)), labels)
    axes.set_title(f"Numerical error at {line}, CPU time of {SIZE:,} boulders")


def _logarithmic(axes: Axes, name: str, digits: tuple[int, ...] = (1, 2, 5)) -> None:
    """Make an axis, x or y, logarithmic with few plain numbers."""
    from matplotlib.ticker import LogLocator, NullLocator

    axes.set(**{f"{name}scale": "log"})
    axis = getattr(axes, f"{name}axis")
    axis.set_major_locator(LogLocator(subs=digits))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter("{x:,g}")


def _key() -> list:
    from matplotlib.lines import Line2D

    colours = [Line2D([], [], color=colour, label=name) for name, colour in COLOURS.items()]
    marks = [
        Line2D([], [], color=INK, lw=0, marker=marker, ms=4, label=SHOWN[quantity].label)
        for quantity, marker in MARKERS.items()
    ]
    return [*colours, *marks]
