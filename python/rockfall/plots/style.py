# SPDX-License-Identifier: BSD-3-Clause
"""Style of all figures: legible in print, in grey, and with colour vision deficiency."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.atomic import atomic_write
from rockfall.language import localised, spoken
from rockfall.simulation.progress import step

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis, Tick
    from matplotlib.backend_bases import RendererBase
    from matplotlib.figure import Figure

_Look = dict[str, Any]
_T = TypeVar("_T")

BLUE, VERMILION, GREEN = "#0072B2", "#D55E00", "#009E73"  # colours by Okabe and Ito (2008)
INK, GREY = "#222222", "#8A8A8A"
#: Styles of trajectories, evaluation lines, barriers and observations.
TRAJECTORY: _Look = {"color": BLUE, "linewidth": 0.5, "alpha": 0.6}
LINE: _Look = {"color": INK, "linewidth": 0.9, "linestyle": (0, (5, 2))}
BARRIER: _Look = {"color": INK, "linewidth": 1.8, "solid_capstyle": "butt"}
OBSERVED: _Look = {"color": INK, "marker": "D", "markersize": 3.5, "markerfacecolor": "white"}
NARROW, WIDE = 90 / 25.4, 180 / 25.4  # column and page width [inch]
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
    "svg.hashsalt": "rockfall",  # makes files reproducible
}
MOST_TICKS = 9  # maximum ticks on an axis; Matplotlib's locators give no more
FEW_TICKS = 6  # maximum intervals between them, unless a figure sets its own ticks
POINTS = 72  # points per inch
PDF = {"Creator": "rockfall", "CreationDate": None}  # metadata, fixed for reproducible files


def styled(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    """Wrap a function that creates a figure so that it uses the house style, and formats axis
    numbers for the language."""

    @wraps(draw)
    def wrapped(*arguments: object, **options: object) -> Figure:
        import matplotlib

        with matplotlib.rc_context(STYLE):
            figure = draw(*arguments, **options)
            _thin_ticks(figure)
        _localise_ticks(figure, spoken())
        return figure

    return wrapped


def _thin_ticks(figure: Figure) -> None:
    """Draw fewer ticks than Matplotlib does by default, because ticks take a third of a figure's
    time."""
    from matplotlib.ticker import AutoLocator

    class Thin(AutoLocator):
        def tick_values(self, vmin: float, vmax: float) -> Sequence[float]:
            assert self.axis is not None
            self.set_params(nbins=min(max(self.axis.get_tick_space(), 1), FEW_TICKS))
            return super().tick_values(vmin, vmax)

    for axis in [axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)]:
        if type(axis.get_major_locator()) is AutoLocator:
            axis.set_major_locator(Thin())


def _localise_ticks(figure: Figure, language: str) -> None:
    from matplotlib.ticker import ScalarFormatter

    class Localised(ScalarFormatter):
        def __call__(self, x: float, pos: int | None = None) -> str:
            return localised(super().__call__(x, pos), language)

    for axis in [axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)]:
        if language != "en" and type(axis.get_major_formatter()) is ScalarFormatter:
            axis.set_major_formatter(Localised(useOffset=False))


def new_figure(width: float, height: float) -> Figure:
    """Empty figure [inch] with space between panels, not registered with pyplot."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def draw_bars(axes: Axes, fraction: np.ndarray, edges: np.ndarray) -> None:
    """Draw a histogram in per cent."""
    axes.stairs(100 * fraction, edges, fill=True, color=BLUE, alpha=0.25)
    axes.stairs(100 * fraction, edges, color=BLUE, lw=1)


def save(figure: Figure, path: str | Path, dpi: int | None = None, **options: Any) -> None:
    """Write a figure atomically, with reproducible bytes. Raises Stopped if a stop was requested,
    and a RockfallError for an unknown extension. `options` are passed to Matplotlib's `savefig`."""
    import matplotlib

    step()
    dpi = dpi or (300 if Path(path).suffix == ".png" else 200)  # raster parts of vector files
    style = {
        ".png": {"Software": "rockfall"},
        ".pdf": PDF,
        ".svg": {"Creator": "rockfall", "Date": None},
    }
    with matplotlib.rc_context(STYLE), atomic_write(path) as part:
        _keep_ticks(figure)
        _lay_out(figure, Path(path).suffix, dpi)
        try:
            figure.savefig(part, dpi=dpi, metadata=style.get(part.suffix), **options)
        except ValueError as error:  # unknown file extension
            raise RockfallError(f"{path}: cannot be written: {error}") from error


def _keep_ticks(figure: Figure) -> None:
    """Cache ticks by view and available space, and the boxes of their labels by position, because
    Matplotlib computes them repeatedly."""
    for axis in [axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)]:
        # private attributes; figures only take longer without them
        for name, key in (
            ("get_tick_space", _size), ("_update_ticks", _room), ("_get_ticklabel_bboxes", _place)
        ):  # fmt: skip
            make = getattr(axis, name, None)
            if make is not None:
                setattr(axis, name, _kept(axis, make, key))


def _kept(
    axis: Axis, make: Callable[..., _T], key_of: Callable[..., Hashable]
) -> Callable[..., _T]:
    kept: dict[Hashable, _T] = {}

    def made(*arguments: Any) -> _T:
        key = key_of(axis, *arguments)
        if key not in kept:
            kept.clear()
            kept[key] = make(*arguments)
        return kept[key]

    return made


def _size(axis: Axis) -> tuple[float, ...]:
    """Values that determine the available space: size and resolution."""
    return *axis.axes.bbox.size, axis.figure.dpi


def _room(axis: Axis) -> tuple[float, ...]:
    """Values that determine the ticks: the view, and the available space."""
    return *axis.get_view_interval(), min(axis.get_tick_space(), MOST_TICKS)


def _place(axis: Axis, _: list[Tick], renderer: RendererBase) -> tuple[Any, ...]:
    """Values that determine the boxes of tick labels: position, view, resolution and fonts."""
    bounds, view = axis.axes.bbox.bounds, axis.get_view_interval()
    return *bounds, *view, axis.figure.dpi, type(renderer)


def _lay_out(figure: Figure, ending: str, dpi: int) -> None:
    """Fix the layout with the texts of the first format, so that it is computed only once."""
    from matplotlib.backend_bases import get_registered_canvas_class

    engine, canvas = figure.get_layout_engine(), get_registered_canvas_class(ending[1:])
    if engine is not None and canvas is not None:
        canvas(figure)
        figure.set_dpi(dpi if ending == ".png" else POINTS)
        engine.execute(figure)
        figure.set_layout_engine(None)  # fixes the layout


def save_pages(pages: Iterable[Figure], path: str | Path, dpi: int) -> None:
    """Write figures as pages of a PDF; see `save`."""
    import matplotlib
    from matplotlib.backends.backend_pdf import PdfPages

    step()
    with (
        matplotlib.rc_context(STYLE),
        atomic_write(path) as part,
        PdfPages(part, metadata=PDF) as file,
    ):
        for page in pages:
            file.savefig(page, dpi=dpi)


def plain(text: str) -> str:
    """User text with dollar signs escaped, so that Matplotlib does not take it for mathematics."""
    return text.replace("$", r"\$")


def capital(text: str) -> str:
    """Text with a capital first letter, otherwise unchanged."""
    return text[:1].upper() + text[1:]
