# SPDX-License-Identifier: BSD-3-Clause
"""Figures of rock layers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rockfall.plots.style import BLUE, INK, new_figure, save, styled
from rockfall_lab.case import names

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rockfall_lab.spheres.experiment import Layers

ROCK = "#D9D4CB"


def layer_figure(layers: Layers, path: str | Path) -> None:
    """Write an image of the first layer: a view from above, and a section through its middle."""
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
    cut = square > 0  # spheres cut by the plane through the middle, in discs
    _discs(section, x[cut][:, [0, 2]], np.sqrt(square[cut]), ROCK)
    section.axhline(facts[0], color=BLUE, lw=0.8)
    section.set(xlim=(0, width), ylim=(0, 1.05 * facts[1]), xlabel="x [m]", ylabel="z [m]")
    section.set_title(f"section; mean height of the surface {facts[0]:.2f} m")
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
