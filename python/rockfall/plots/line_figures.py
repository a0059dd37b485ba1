# SPDX-License-Identifier: BSD-3-Clause
"""Figures of passing boulders: distributions at the lines, and run-out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from rockfall.analysis.observed.run_out import passing
from rockfall.analysis.precision.intervals import passing_percent
from rockfall.language import say, say_count, word
from rockfall.plots.cartography.marks import named
from rockfall.plots.style import (
    BARRIER,
    BLUE,
    GREY,
    INK,
    LINE,
    OBSERVED,
    WIDE,
    draw_bars,
    new_figure,
    plain,
    styled,
)
from rockfall.protection.barriers import barriers_of
from rockfall.quantities import QUANTITIES, number, round_step
from rockfall.result.crossings import boulders_at, line_names, places_at, values_at
from rockfall.result.trajectories import from_start, left_terrain, stop_distances

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DRAWN = (
    "speed", "passing_height", "energy_translational", "energy_rotational", "energy_total",
    "rotational_share",
)  # fmt: skip
DISTANCE = "axis.distance"  # message id of the axis label
ABREAST = 2  # number of panels side by side
HISTOGRAM, ROW = 1.9, 0.17  # height of a histogram, and of each row below it [inch]
MAX_BINS = 60
MAX_BINS_BELOW = 500  # maximum bins for a distribution that extends far below zero
BEYOND = 0.998  # quantile at the end of the axis: one in 500 values is beyond
OURS = {"marker": "o", "markersize": 4, "color": BLUE}


class Row(NamedTuple):
    """Mean and standard deviation of a quantity at a line, their source, and how they are drawn."""

    source: str
    mean: float
    std: float
    look: dict[str, Any]


@styled
def distribution_figure(
    result: xr.Dataset, quantity: str, observed: Any = None, which: Iterable[int] | None = None
) -> Figure:
    """Distribution of a quantity over the passing boulders, with a panel for each line (or for the
    line indices `which`). Mean and standard deviation are below, also from `observed` (see
    `rockfall.plots.figures`)."""
    which = list(range(result.sizes["line"]) if which is None else which)
    display, names = QUANTITIES[quantity], [line_names(result)[k] for k in which]
    ours = [display.factor * values_at(result, quantity, k) for k in which]
    theirs = [display.factor * _sample(observed, name, quantity) for name in names]
    rows = [_rows(*sample, quantity, observed) for sample in zip(names, ours, theirs, strict=True)]
    edges = _bins([*ours, *theirs])
    width = edges[1] - edges[0]
    abreast = min(ABREAST, len(names))
    deep = -(-len(names) // abreast)
    deepest = max(map(len, rows))
    tall = HISTOGRAM + ROW * deepest
    figure = new_figure(WIDE, 0.3 + (tall + 0.5) * deep)
    blocks = figure.add_gridspec(deep, abreast)
    panels = []  # shared axes take quadratic time
    for k, name in enumerate(names):
        axes = figure.add_subplot(blocks[k // abreast, k % abreast])
        panels.append(axes)
        _draw_bins(axes, ours[k], theirs[k], edges)
        axes.set_title(fill(f"{plain(name)}: {_passing(result, which[k])}", 54))
        axes.set_ylabel(say("axis.boulders_per", width=width, unit=display.unit))
        axes.set_xlabel(display.title)
        axes.set_xlim(min(0.0, edges[0]), edges[-1])
    high = max(axes.get_ylim()[1] for axes in panels)
    for axes, of_line in zip(panels, rows, strict=True):
        _draw_rows(axes, of_line, deepest, high)
    return figure


@styled
def passing_figure(result: xr.Dataset, observed: Any = None) -> Figure:
    """Fraction of boulders that travel at least a given distance, with its 95 % band, and the
    observed fraction (see `rockfall.plots.figures`)."""
    figure = new_figure(WIDE, 2.9)
    axes = figure.add_subplot()
    _draw_passing(axes, result)
    furthest = stop_distances(result).max()
    if observed is not None and observed.distances is not None:
        distance = np.sort(observed.distances)
        fraction = 100 * np.arange(distance.size, 0, -1) / distance.size
        label = say_count("axis.observed_boulders", distance.size)
        style: dict[str, Any] = {"color": INK, "lw": 1, "linestyle": (0, (4, 2)), "label": label}
        axes.step(np.append(0, distance), np.append(100, fraction), where="pre", **style)
        furthest = max(furthest, distance[-1])
    if observed is not None and observed.passing is not None:
        table = observed.passing
        axes.plot(
            table["distance"], 100 * table["fraction"],
            **OBSERVED | {"marker": "s", "linestyle": "", "label": say("axis.observed_fractions")},
        )  # fmt: skip
        furthest = max(furthest, table["distance"].max())
    axes.set_xlim(0, 1.03 * furthest or 1)
    axes.set(ylabel=say("axis.come_this_far"), xlabel=say(DISTANCE))
    mark_lines([axes], result, labels=axes)
    axes.legend(loc="upper right", frameon=True, framealpha=1, edgecolor="none")
    return figure


def _draw_passing(axes: Axes, result: xr.Dataset) -> None:
    """Draw the curve of `passing_figure`. The final distance of boulders that left the terrain is
    unknown, so two dotted curves bound the curve beyond the nearest exit."""
    gone, distance = left_terrain(result), stop_distances(result)
    shown, fraction, low, high = passing(result, distance)
    _, upper, _, high = passing(result, np.where(gone, np.inf, distance))
    reached = shown <= distance.min(where=gone, initial=np.inf)
    axes.fill_between(shown, 100 * low, 100 * high, color=BLUE, alpha=0.3, lw=0)
    label = say_count("axis.this_run_band", distance.size)
    axes.plot(shown[reached], 100 * fraction[reached], color=BLUE, lw=1, label=label)
    if gone.any():
        label = say_count("axis.left_terrain", int(gone.sum()))
        for bound, words in ((fraction, label), (upper, None)):
            style: dict[str, Any] = {"color": BLUE, "lw": 1, "linestyle": ":", "label": words}
            axes.plot(shown[~reached], 100 * bound[~reached], **style)
    axes.set_ylim(0, 105)


def mark_lines(panels: Iterable[Axes], result: xr.Dataset, labels: Axes) -> None:
    """Mark named lines in all panels, at the median distance of the boulders that cross them."""
    barriers, names = barriers_of(result), line_names(result)
    for k in sorted(named(result)):
        boulders = boulders_at(result, k)
        x, y = places_at(result, k)
        distance = from_start(result, x, y, boulders)
        if not distance.size:
            continue
        where = np.median(distance)
        for axes in panels:
            axes.axvline(where, **(BARRIER if k in barriers else LINE))
        high = 0.02 + 0.08 * (k % 4)  # staggered, because lines may be close together
        style: dict[str, Any] = {"transform": labels.get_xaxis_transform(), "clip_on": True}
        labels.text(where, high, f" {plain(names[k])}", **style)


def _finite(values: np.ndarray) -> np.ndarray:
    return values[np.isfinite(values)]


def _sample(observed: Any, line: str, quantity: str) -> np.ndarray:
    """Observed values of individual boulders; empty if there are none."""
    samples = {} if observed is None else observed.samples
    return np.asarray(samples.get((line, quantity), ()), float)


def _rows(
    line: str, ours: np.ndarray, theirs: np.ndarray, quantity: str, observed: Any
) -> list[Row]:
    """Means and deviations of a quantity at a line: simulated, published, and from the sample."""
    rows = []
    if ours.size:
        rows.append(Row(say("compare.this_run"), ours.mean(), _deviation(ours), OURS))
    if observed is not None:
        table = observed.summaries
        scale = QUANTITIES[quantity].factor
        here = (table["line"] == line) & (table["quantity"] == quantity) & table["mean"].notna()
        for row in table[here].itertuples():
            is_observed = row.method == "observed"
            name = word("observed") if is_observed else say("axis.printed", method=row.method)
            look = OBSERVED if row.method == "observed" else OBSERVED | {"color": GREY}
            rows.append(Row(name, scale * row.mean, scale * row.std, look))
    if theirs.size:
        label = say("axis.observed", n=theirs.size)
        rows.append(Row(label, theirs.mean(), _deviation(theirs), OBSERVED))
    return rows


def _deviation(values: np.ndarray) -> float:
    return values.std(ddof=1) if values.size > 1 else np.nan


def _bins(samples: list[np.ndarray]) -> np.ndarray:
    """Bin edges with a round width, up to a value that at most one in 500 exceeds in each sample;
    the number of bins depends on the largest sample."""
    high = max((float(np.quantile(v, BEYOND)) for v in samples if v.size), default=1.0)
    low = min([0.0, *(float(v.min()) for v in samples if v.size)])
    largest = max(v.size for v in samples)
    width = max(high, 1e-3) / np.clip(np.sqrt(largest), 8, MAX_BINS)
    width = round_step(max(width, high / MAX_BINS_BELOW - low / MAX_BINS_BELOW))
    first = np.floor(low / width)
    return width * np.arange(first, max(np.ceil(high / width), first + 1) + 1)


def _draw_bins(axes: Axes, ours: np.ndarray, theirs: np.ndarray, edges: np.ndarray) -> None:
    """Draw histograms in per cent of passing boulders: simulated filled, observed dashed."""
    if ours.size:
        draw_bars(axes, np.histogram(ours, edges)[0] / ours.size, edges)
    if theirs.size:
        fraction = 100 * np.histogram(theirs, edges)[0] / theirs.size
        axes.stairs(fraction, edges, color=INK, lw=1, linestyle=(0, (3, 1.5)))


def _draw_rows(axes: Axes, rows: list[Row], deepest: int, high: float) -> None:
    """Draw means, with one standard deviation on each side, in a strip below the histogram. A
    separate panel would take twice as long."""
    from matplotlib.ticker import MaxNLocator

    class FromZero(MaxNLocator):
        def tick_values(self, vmin: float, vmax: float) -> Sequence[float]:
            return super().tick_values(0, vmax)

    places = -high * (0.05 + ROW * (np.arange(max(deepest, 1)) + 0.5)) / HISTOGRAM
    for place, row in zip(places, rows, strict=False):
        spread = row.std if np.isfinite(row.std) else 0.0
        axes.errorbar(row.mean, place, xerr=spread, lw=1, **row.look)
    axes.set_ylim(places[-1] - high * ROW / HISTOGRAM, high)
    axes.yaxis.set_major_locator(FromZero(5, steps=[1, 2, 2.5, 5, 10]))
    axes.set_yticks(places[: len(rows)], [row.source for row in rows], minor=True)
    axes.tick_params(axis="y", which="minor", length=0)
    axes.axhline(0, color=GREY, lw=0.6)
    axes.spines["left"].set_bounds(0, high)


def _passing(result: xr.Dataset, line: int) -> str:
    """Number of boulders at a line or barrier, and their fraction with its 95 % interval."""
    n, *percents = passing_percent(result, line)
    fraction, low, high = map(number, percents)
    key = "axis.come" if line in barriers_of(result) else "axis.pass"
    return say(key, n=n, fraction=fraction, low=low, high=high)
