# SPDX-License-Identifier: BSD-3-Clause
"""Figures along the way of recorded trajectories: profile, height above the ground, speed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.extent import cell_of
from rockfall.plots.line_figures import DISTANCE, mark_lines
from rockfall.plots.map_figures import MOST_WAYS
from rockfall.plots.style import FLIGHT, INK, WIDE, new_figure, styled
from rockfall.result.trajectories import Flight, flights, height

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rockfall.result.trajectories import Terrain


@styled
def way_figure(result: xr.Dataset, terrain: Terrain | None = None) -> Figure:
    """Profile at true scale, heights above the ground and speeds of the recorded trajectories,
    against the plan distance from the start; without terrain no ground, and no heights above it."""
    ways = flights(result, MOST_WAYS)
    ground = ground_below(result, ways, terrain)
    high, furthest = true_scale(ways, 6.3, 4.5)
    tall = [high, 1.3, 1.6]
    tall = tall if ground else [tall[0], tall[2]]
    figure = new_figure(WIDE, sum(tall) + 0.9)
    panels = figure.subplots(len(tall), 1, sharex=True, height_ratios=tall)
    draw_profile(panels[0], ways, ground)
    if ground:
        draw_heights(panels[1], ways, ground)
    _draw_curves(panels[-1], [(way.distance, way.speed) for way in ways])
    panels[-1].set(ylabel="speed [m/s]", ylim=(0, None), xlabel=DISTANCE)
    panels[-1].set_xlim(0, furthest)
    mark_lines(panels, result, labels=panels[0])
    figure.align_ylabels()
    return figure


def true_scale(ways: Sequence[Flight], wide: float, tallest: float) -> tuple[float, float]:
    """Height [inch] of a profile at true scale in a panel so wide, and the distance [m] at which
    its axis must end for all of it to be seen."""
    drop = 1.1 * max((np.ptp(way.z) for way in ways), default=0.0)
    furthest = 1.03 * max((way.distance.max() for way in ways), default=0.0) or 1.0
    high = float(np.clip(wide * drop / furthest, 1.2, tallest))
    return high, max(furthest, wide * drop / high)


def ground_below(
    result: xr.Dataset, ways: Sequence[Flight], terrain: Terrain | None
) -> list[np.ndarray]:
    """Elevation [m] of the ground below trajectories; none from a terrain that is unknown or too
    coarse for heights above it."""
    if terrain is None or terrain[1].cell > 1.001 * cell_of(result):
        return []
    return [height(terrain, way.x, way.y) for way in ways]


def draw_profile(axes: Axes, ways: Sequence[Flight], ground: Sequence[np.ndarray]) -> None:
    """Trajectories and the ground below them at true scale."""
    below = [(way.distance, z) for way, z in zip(ways, ground, strict=bool(ground))]
    _draw_curves(axes, below, color=INK, linewidth=0.8, alpha=1)
    _draw_curves(axes, [(way.distance, way.z) for way in ways])
    axes.set_ylabel("elevation [m]")
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.set_aspect("equal", adjustable="datalim")


def draw_heights(axes: Axes, ways: Sequence[Flight], ground: Sequence[np.ndarray]) -> None:
    """Heights of the boulder's point above the ground, 0 at a contact."""
    above = [(way.distance, way.z - z) for way, z in zip(ways, ground, strict=True)]
    _draw_curves(axes, above)
    axes.set(ylabel="jump height [m]", ylim=(0, None))


def _draw_curves(axes: Axes, curves: list[tuple[np.ndarray, np.ndarray]], **about: object) -> None:
    from matplotlib.collections import LineCollection

    look = {"rasterized": True, **FLIGHT, **about}
    axes.add_collection(LineCollection([np.column_stack(curve) for curve in curves], **look))
    axes.autoscale_view()
