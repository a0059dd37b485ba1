# SPDX-License-Identifier: BSD-3-Clause
"""Figures of the laboratory: layers, impacts, and the fitted sets."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rockfall.lab.case import names
from rockfall.lab.sets import restitution
from rockfall.language import say
from rockfall.plots.style import BLUE, GREY, INK, VERMILION, WIDE, new_figure, save, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rockfall.lab.experiment import Layers
    from rockfall.lab.sets import Sets

ROCK = "#D9D4CB"
ANGLES = np.arange(5.0, 90.1, 2.5)  # incidence [degrees]
LAST_RT = 60.0  # [degrees]; beyond, V_t_in is too small to divide by
KNOWN: dict[str, list[tuple[tuple[float, ...], tuple[float, ...]]]] = {
    "R_t": [((5, 30), (0.7, 0.7))],
    "R_n": [((90,), (0.4,)), ((10, 20), (1.0, 1.0))],
}


def layer_figure(layers: Layers, path: str | Path) -> None:
    """Write an image of the first layer: from above, and a section through its middle."""
    save(_layer(*layers.one(0)), path, 200)


@styled
def _layer(x: np.ndarray, radius: np.ndarray, facts: np.ndarray) -> Figure:
    width = facts[names("layer").index("width")]
    figure = new_figure(7.2, 3.6)
    above, section = figure.subplots(1, 2)
    order = np.argsort(x[:, 2])
    _discs(above, x[order, :2], radius[order], ROCK)
    above.set(xlim=(0, width), ylim=(0, width), xlabel="x [m]", ylabel="y [m]")
    above.set_title(f"{len(radius)} rocks from above")
    square = radius**2 - (x[:, 1] - width / 2) ** 2
    cut = square > 0  # spheres that the plane through the middle cuts, in discs
    _discs(section, x[cut][:, [0, 2]], np.sqrt(square[cut]), ROCK)
    section.axhline(facts[0], color=BLUE, lw=0.8)
    section.set(xlim=(0, width), ylim=(0, 1.05 * facts[1]), xlabel="x [m]", ylabel="z [m]")
    section.set_title(f"section; mean height of the surface {facts[0]:.2f} m")
    return figure


@styled
def draw_restitution(sets: Sequence[Sets]) -> Figure:
    """R_t and R_n against the incidence angle for each ratio, without spin (the paper's Fig. 5):
    mean and the middle 80 % of the admissible draws of each set; values of the paper in grey."""
    figure = new_figure(WIDE, 3.6)
    panels = figure.subplots(2, 5, sharex=True, sharey="row")
    looks = ((VERMILION, "-"), (BLUE, (0, (5, 2))))
    for fitted, (colour, dashes) in zip(sets, looks, strict=False):
        for k in range(5):
            draws = [restitution(fitted.mean[k], fitted.covariance[k], angle) for angle in ANGLES]
            for row, axes in enumerate(panels[:, k]):
                shown = ANGLES[ANGLES <= (LAST_RT, 90.0)[row]]
                values = [draw[row] for draw in draws[: shown.size]]
                is_known = np.array([v.size > 0 for v in values])  # some draw is admissible
                shown, values = shown[is_known], [v for v in values if v.size]
                if not values:
                    continue
                low, high = np.transpose([np.quantile(v, (0.1, 0.9)) for v in values])
                axes.fill_between(shown, low, high, color=colour, alpha=0.18, lw=0)
                mean = [v.mean() for v in values]
                axes.plot(shown, mean, color=colour, lw=1.2, ls=dashes, label=fitted.name)
    for row, name in enumerate(KNOWN):
        for axes in panels[row]:
            for x, y in KNOWN[name]:
                axes.plot(x, y, color=GREY, lw=4, alpha=0.5, marker="s", ms=4, zorder=0)
        panels[row, 0].set_ylabel(name)
    for k in range(5):
        panels[0, k].set_title(f"R_b/R_m = {k + 1}")
        panels[1, k].set_xlim(0, 91)
    panels[0, 0].set_ylim(0, 1.1)
    panels[1, 0].set_ylim(0, 2.5)
    panels[1, 4].legend(loc="upper right")
    figure.supxlabel(say("axis.incidence_angle"), fontsize=8)
    return figure


def _discs(axes: Axes, x: np.ndarray, radius: np.ndarray, colour: str) -> None:
    from matplotlib.collections import EllipseCollection

    axes.add_collection(
        EllipseCollection(
            2 * radius, 2 * radius, np.zeros_like(radius), units="x", offsets=x,
            offset_transform=axes.transData, facecolor=colour, edgecolor=INK, linewidth=0.4,
        )
    )  # fmt: skip
    axes.set_aspect("equal")
