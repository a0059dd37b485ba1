# SPDX-License-Identifier: BSD-3-Clause
"""A run at a glance: map, profile, jump heights, and how far boulders come."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rockfall.plots.extent import passed_map, reached
from rockfall.plots.line_figures import DISTANCE, draw_passing, mark_lines
from rockfall.plots.map_figures import (
    draw_map,
    draw_marks,
    draw_relief,
    draw_stops,
    draw_trajectories,
)
from rockfall.plots.profile_figures import draw_heights, draw_profile, ground_below, true_scale
from rockfall.plots.style import new_figure, plain, save, styled
from rockfall.quantities import count, percent
from rockfall.result.trajectories import ends, lines, stop_distances, trajectories

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from rockfall.io.grid import Grid


def overview(result: xr.Dataset, dem: np.ndarray, grid: Grid, path: str | Path) -> None:
    """Write a figure of a run: the map; beside it profile, jump heights and how far boulders come.

    `dem` is (ny, nx) [m] on `grid`. Passages, lines and trajectories are drawn where `result` has
    them; without trajectories there is no profile. Distances are plan distances from the
    release of each boulder, in a straight line.
    """
    save(_overview(result, (dem, grid)), path, 200)


@styled
def _overview(result: xr.Dataset, terrain: tuple[np.ndarray, Grid]) -> Figure:
    extent = reached(result, terrain)
    shown = trajectories(result)
    ground = ground_below(result, shown, terrain)
    profile, furthest = true_scale(shown, 6.2, 5.0)
    furthest = max(furthest, 1.03 * stop_distances(result).max())
    tall = [profile, 1.5, 1.1] if shown else [3.0]
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
    draw_trajectories(plan, result, "white")
    draw_stops(plan, result)
    draw_marks(plan, result, extent)
    plan.set_title("Pass frequency and stopping points")
    if shown:
        draw_profile(panels[0], shown, ground)
        draw_heights(panels[1], shown, ground)
        panels[0].set_title(
            f"Profile with {count(len(shown), 'trajectory', 'trajectories')}, true scale"
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


def _summary(result: xr.Dataset) -> str:
    """Title, number of boulders, how they ended and the fraction that passes each line."""
    text = [result.attrs.get("title", ""), count(result.sizes["boulder"], "boulder")]
    text += [
        f"{of.sum():,} {end.replace('_', ' ')}" for end, of in ends(result).items() if of.any()
    ]
    for k, (name, _, _) in enumerate(lines(result)):
        text.append(f"{percent(np.isfinite(result['line_x'].values[k]).mean())} pass {name}")
    return plain("\n".join(text))
