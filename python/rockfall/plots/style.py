# SPDX-License-Identifier: BSD-3-Clause
"""The look of all figures: read in print, in greys, and by people who see colours differently."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.files import atomic_write
from rockfall.io.output_files import SIGNATURE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    _Look = dict[str, Any]

BLUE, VERMILION, GREEN = "#0072B2", "#D55E00", "#009E73"  # Okabe and Ito (2008)
INK, GREY = "#222222", "#8A8A8A"
#: One of many trajectories, an evaluation line, a barrier, and what was observed.
TRAJECTORY: _Look = {"color": BLUE, "linewidth": 0.5, "alpha": 0.6}
LINE: _Look = {"color": INK, "linewidth": 0.9, "linestyle": (0, (5, 2))}
BARRIER: _Look = {"color": INK, "linewidth": 1.8, "solid_capstyle": "butt"}
OBSERVED: _Look = {"color": INK, "marker": "D", "markersize": 3.5, "markerfacecolor": "white"}
NARROW, WIDE = 90 / 25.4, 180 / 25.4  # a column and a page [inch]
FORMATS = ("png", "pdf", "svg")
STYLE: dict[Any, Any] = {
    "font.size": 8,
    "axes.titlesize": 8.5,
    "axes.titlelocation": "left",
    "axes.edgecolor": GREY,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.frameon": False,
    "svg.hashsalt": "rockfall",  # the same figure, the same bytes
}


def styled(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    """A function that makes a figure, in the house style."""

    @wraps(draw)
    def wrapped(*arguments: object, **options: object) -> Figure:
        import matplotlib

        with matplotlib.rc_context(STYLE):
            return draw(*arguments, **options)

    return wrapped


def new_figure(width: float, height: float) -> Figure:
    """An empty figure [inch] that keeps its panels apart, and of which nobody else knows."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def draw_bars(axes: Axes, fraction: np.ndarray, edges: np.ndarray) -> None:
    """A histogram in per cent."""
    axes.stairs(100 * fraction, edges, fill=True, color=BLUE, alpha=0.25)
    axes.stairs(100 * fraction, edges, color=BLUE, lw=1)


def save(figure: Figure, path: str | Path, dpi: int | None = None) -> None:
    """Write a figure, whole or not at all; its bytes do not tell when."""
    import matplotlib

    dpi = dpi or (300 if Path(path).suffix == ".png" else 200)  # vectors with dense parts as dots
    about = {
        ".png": {"Software": SIGNATURE},
        ".pdf": {"Creator": SIGNATURE, "CreationDate": None},
        ".svg": {"Creator": SIGNATURE, "Date": None},
    }
    with matplotlib.rc_context(STYLE), atomic_write(path) as part:
        try:
            figure.savefig(part, dpi=dpi, metadata=about.get(part.suffix))
        except ValueError as error:  # an ending that is no picture's
            raise RockfallError(f"{path}: cannot be written: {error}") from error


def plain(text: str) -> str:
    """A user's text as it is: no dollar in it starts mathematics."""
    return text.replace("$", r"\$")


def capital(text: str) -> str:
    """With a capital first letter, the others as they are."""
    return text[:1].upper() + text[1:]
