# SPDX-License-Identifier: BSD-3-Clause
"""Figures of several panels: a run at a glance, and methods A and B at the lines."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.extent import passed_map, reached
from rockfall.plots.line_figures import DISTANCE, draw_passing, mark_lines
from rockfall.plots.map_figures import (
    draw_map,
    draw_marks,
    draw_relief,
    draw_stops,
    draw_ways,
)
from rockfall.plots.style import (
    BLUE,
    GREY,
    INK,
    STYLE,
    VERMILION,
    new_figure,
    plain,
    round_step,
    save,
    styled,
)
from rockfall.plots.trajectory_figures import draw_heights, draw_profile, ground_below, true_scale
from rockfall.quantities import count
from rockfall.result.trajectories import ends, flights, lines, stop_distances

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rockfall.io.grid import Grid

    Reference = Mapping[tuple[str, str, str], tuple[float, float]]

OURS = {"marker": "o", "markersize": 4.5, "linewidth": 1}
PAPER = {"marker": "o", "markersize": 4.5, "markerfacecolor": "white", "linewidth": 1}
METHODS = {"A": BLUE, "B": VERMILION}
OUTLINE = {"A": ((0, (4, 3)), 1.2), "B": ("-", 1.6)}  # both are seen where they coincide
QUANTITIES = [("speed", "speed", "m/s"), ("passing_height", "passing height", "m")]


def overview(result: xr.Dataset, dem: np.ndarray, grid: Grid, path: str | Path) -> None:
    """Write a picture of a run: the map; beside it profile, jump heights and how far boulders come.

    `dem` is (ny, nx) [m] on `grid`. Passages, lines and trajectories are drawn where `result` has
    them; without trajectories there is no profile. Distances are plan distances from the start of
    each boulder, in a straight line.
    """
    save(_overview(result, (dem, grid)), path, 200)


@styled
def _overview(result: xr.Dataset, terrain: tuple[np.ndarray, Grid]) -> Figure:
    extent = reached(result, terrain)
    ways = flights(result)
    ground = ground_below(result, ways, terrain)
    profile, furthest = true_scale(ways, 6.2, 5.0)
    furthest = max(furthest, 1.03 * stop_distances(result).max())
    tall = [profile, 1.5, 1.1] if ways else [3.0]
    high = sum(tall) + 1.6
    aspect = (extent[1] - extent[0]) / (extent[3] - extent[2])
    broad = float(np.clip((high - 1.5) * aspect, 1.9, 6.0))  # the map [inch]
    figure = new_figure(broad + 7.2, high)
    figure.get_layout_engine().set(w_pad=0.06, h_pad=0.05, wspace=0, hspace=0)
    left, right = figure.add_gridspec(1, 2, width_ratios=[broad + 0.7, 6.5])
    panels = right.subgridspec(len(tall), 1, height_ratios=tall).subplots(
        sharex=True, squeeze=False
    )[:, 0]
    plan = figure.add_subplot(left)
    draw_relief(plan, terrain, extent)
    if name := passed_map(result):
        draw_map(plan, result, name, extent)
    draw_ways(plan, result, "white")
    draw_stops(plan, result)
    draw_marks(plan, result, extent)
    plan.set_title("Reach, and where boulders stop")
    if ways:
        draw_profile(panels[0], ways, ground)
        draw_heights(panels[1], ways, ground)
        panels[0].set_title(
            f"Profile with {count(len(ways), 'trajectory', 'trajectories')}, true scale"
        )
        panels[1].set_title("Their height above the ground")
    draw_passing(panels[-1], result)
    panels[-1].set_title("Boulders that come at least this far")
    panels[-1].set(ylabel="boulders [%]", xlabel=DISTANCE)
    panels[-1].set_xlim(0, furthest)
    mark_lines(panels, result, labels=panels[0])
    panels[0].text(
        *(0.99, 0.97, _summary(result)),
        **{"ha": "right", "va": "top", "linespacing": 1.6, "transform": panels[0].transAxes},
    )
    return figure


def line_figure(
    result_a: xr.Dataset, result_b: xr.Dataset, reference: Reference, path: str | Path
) -> None:
    """Write the distributions of speed and passing height at each line, by methods A and B.

    `reference` holds printed values to set beside them: (line, method, quantity) -> (mean, standard
    deviation), with method A, B or observed, and quantity speed or passing_height.
    """
    import matplotlib.pyplot as plt

    results = {"A": result_a, "B": result_b}
    names = [str(name) for name in result_a["line"].values]
    with plt.rc_context(STYLE):
        figure = plt.figure(figsize=(4.4 * len(names), 6.4), layout="constrained")
        figure.get_layout_engine().set(wspace=0.05)
        for block, (quantity, label, unit) in zip(
            figure.add_gridspec(2, 1), QUANTITIES, strict=True
        ):
            axes = block.subgridspec(2, len(names), height_ratios=[2.2, 1], hspace=0).subplots(
                sharex=True, sharey="row", squeeze=False
            )
            limit, width = _bins(results.values(), quantity)
            for k, name in enumerate(names):
                values = {m: r[f"line_{quantity}"].values[k] for m, r in results.items()}
                printed = {m: reference.get((name, m, quantity)) for m in (*METHODS, "observed")}
                _shares(axes[0, k], values, limit, width)
                _means(axes[1, k], values, printed)
                axes[0, k].set_title(f"{label.capitalize()} at {plain(name)}")
                axes[1, k].set_xlabel(f"{label} [{unit}]")
            axes[0, 0].set_ylim(0, 1.3 * axes[0, 0].get_ylim()[1])  # room for the legend
            axes[0, 0].set_ylabel(f"boulders [% in {width:g} {unit}]")
        figure.legend(handles=_key(), loc="outside lower center", ncols=3)
        save(figure, path, 200)
        plt.close(figure)


def _summary(result: xr.Dataset) -> str:
    """Title, number of boulders, how they ended and the share that passes each line."""
    text = [result.attrs.get("title", ""), count(result.sizes["boulder"], "boulder")]
    text += [
        f"{of.sum():,} {end.replace('_', ' ')}" for end, of in ends(result).items() if of.any()
    ]
    for k, (name, _, _) in enumerate(lines(result)):
        text.append(f"{np.isfinite(result['line_x'].values[k]).mean():.1%} pass {name}")
    return plain("\n".join(text))


def _bins(results: Iterable[xr.Dataset], quantity: str) -> tuple[float, float]:
    """End of the axis, above all but one boulder in 500, and a round width of classes below it."""
    values = np.concatenate([r[f"line_{quantity}"].values.ravel() for r in results])
    values = values[np.isfinite(values)]
    most = float(np.quantile(values, 0.998)) if values.size else 1.0
    width = round_step(most / 70)
    return width * np.ceil(most / width), width


def _shares(axes: Axes, values: Mapping[str, np.ndarray], limit: float, width: float) -> None:
    """Shares of all released boulders: what the bars add up to is the share that passes."""
    edges = np.arange(0, limit + width / 2, width)
    for method, v in reversed(values.items()):
        released, v = v.size, v[np.isfinite(v)]
        about = {"weights": np.full(v.size, 100 / released), "color": METHODS[method]}
        about["linestyle"], about["lw"] = OUTLINE[method]
        label = f"method {method}, {v.size / released:.1%} pass"
        axes.hist(v, edges, histtype="stepfilled", alpha=0.2, **{**about, "lw": 0})
        axes.hist(v, edges, histtype="step", label=label, **about)
    axes.set_xlim(0, limit)
    axes.tick_params(axis="x", labelbottom=False)
    axes.legend(loc="upper right", handlelength=1.8, reverse=True)


def _means(
    axes: Axes,
    values: Mapping[str, np.ndarray],
    printed: Mapping[str, tuple[float, float] | None],
) -> None:
    """Means with standard deviations, ours filled and those of the paper open."""
    for row, (method, pair) in enumerate(printed.items()):
        colour = METHODS.get(method, INK)
        v = values.get(method)
        if v is not None and np.isfinite(v).any():
            axes.errorbar(np.nanmean(v), row - 0.16, xerr=np.nanstd(v), color=colour, **OURS)
        if pair:
            where = row + 0.16 * (method in values)
            axes.errorbar(pair[0], where, xerr=pair[1], color=colour, **PAPER)
    axes.set(ylim=(len(printed) - 0.4, -0.6))
    axes.set_yticks(range(len(printed)), [f"method {m}" if m in METHODS else m for m in printed])
    axes.tick_params(axis="y", length=0)


def _key() -> list:
    from matplotlib.lines import Line2D

    return [
        Line2D([], [], color=GREY, label="this run", **OURS),
        Line2D([], [], color=GREY, label="the paper", **PAPER),
        Line2D([], [], color=GREY, label="mean and one standard deviation to each side"),
    ]
