# SPDX-License-Identifier: BSD-3-Clause
"""Recorded trajectories in profile: elevation, height above the ground, speed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from rockfall.language import say
from rockfall.plots.extent import cell_of
from rockfall.plots.line_figures import DISTANCE, mark_lines
from rockfall.plots.map_figures import MAX_TRAJECTORIES
from rockfall.plots.style import INK, TRAJECTORY, WIDE, new_figure, styled
from rockfall.quantities import QUANTITIES
from rockfall.result.trajectories import Terrain, Trajectory, trajectories
from rockfall.terrain.height import height

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANEL, TALLEST = 6.3, 4.5  # width and maximum height of the profile [inch]


@styled
def profile_figure(result: xr.Dataset, terrain: Terrain | None = None) -> Figure:
    """Profile at true scale, heights above ground, and speeds of recorded trajectories against the
    plan distance from the release. Without terrain, ground and heights are omitted."""
    curves = trajectories(result, MAX_TRAJECTORIES)
    ground = _ground_below(result, curves, terrain)
    drop = max((np.ptp(curve.z) for curve in curves), default=0.0)
    high, furthest = true_scale(drop, max((curve.distance.max() for curve in curves), default=0.0))
    tall = [high, 1.3, 1.6]
    tall = tall if ground else [tall[0], tall[2]]
    figure = new_figure(WIDE, sum(tall) + 0.9)
    panels = figure.subplots(len(tall), 1, sharex=True, height_ratios=tall)
    _draw_profile(panels[0], curves, ground)
    if ground:
        _draw_heights(panels[1], curves, ground)
    draw_curves(panels[-1], [_speeds_in_motion(curve) for curve in curves])
    panels[-1].set(ylabel=QUANTITIES["speed"].title, ylim=(0, None), xlabel=say(DISTANCE))
    panels[-1].set_xlim(0, furthest)
    mark_lines(panels, result, labels=panels[0])
    figure.align_ylabels()
    return figure


def true_scale(drop: float, furthest: float, tallest: float = TALLEST) -> tuple[float, float]:
    """Height [inch], at most `tallest`, of a profile at true scale with the given fall and distance
    [m], and the distance [m] at the end of its axis."""
    drop, furthest = 1.1 * drop, 1.03 * furthest or 1.0
    high = float(np.clip(PANEL * drop / furthest, 1.2, tallest))
    return high, max(furthest, PANEL * drop / high)


def _ground_below(
    result: xr.Dataset, curves: Sequence[Trajectory], terrain: Terrain | None
) -> list[np.ndarray]:
    """Ground elevation [m] below trajectories; empty if unknown or too coarse."""
    if terrain is None or terrain[1].cell > 1.001 * cell_of(result):
        return []
    return [height(*terrain, curve.x, curve.y) for curve in curves]


def _speeds_in_motion(curve: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Distances [m] and speeds [m/s] without rest times between contacts."""
    moves = (curve.speed > 0) | (curve.time == 0)
    return curve.distance[moves], curve.speed[moves]


def _draw_profile(axes: Axes, curves: Sequence[Trajectory], ground: Sequence[np.ndarray]) -> None:
    """Draw trajectories and the ground below them at true scale."""
    below = [(curve.distance, z) for curve, z in zip(curves, ground, strict=bool(ground))]
    draw_curves(axes, below, color=INK, linewidth=0.8, alpha=1)
    draw_curves(axes, [(curve.distance, curve.z) for curve in curves])
    axes.set_ylabel(say("axis.elevation"))
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.set_aspect("equal", adjustable="datalim")


def _draw_heights(axes: Axes, curves: Sequence[Trajectory], ground: Sequence[np.ndarray]) -> None:
    """Draw the height of the boulder's point above ground, 0 at contacts."""
    above = [(curve.distance, curve.z - z) for curve, z in zip(curves, ground, strict=True)]
    draw_curves(axes, above)
    axes.set(ylabel=QUANTITIES["jump_height"].title, ylim=(0, None))


def draw_curves(axes: Axes, shown: list[tuple[np.ndarray, np.ndarray]], **options: object) -> None:
    """Draw curves (x, y), interrupted at NaN, by default in the style of trajectories."""
    from matplotlib.collections import LineCollection

    look: dict[str, Any] = {"rasterized": True, **TRAJECTORY, **options}
    axes.add_collection(LineCollection([np.column_stack(curve) for curve in shown], **look))
    axes.autoscale_view()
