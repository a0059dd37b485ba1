# SPDX-License-Identifier: BSD-3-Clause
"""The sheet of a map: its room on paper, frame with coordinates, scale bar, north arrow, key.

Everything has its place in inches, so that the scale is known before anything is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.plots.cartography.labels import Labels, along
from rockfall.plots.cartography.relief import (
    BROWN,
    Contours,
    contours_of,
    draw_contours,
    draw_relief,
)
from rockfall.plots.style import INK, NARROW, WIDE
from rockfall.quantities import round_step

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rockfall.plots.cartography.basemap import Basemap
    from rockfall.plots.extent import Extent
    from rockfall.result.trajectories import Terrain

TALLEST = 7.2  # of a map [inch]
LEFT, RIGHT, TOP = 0.28, 0.1, 0.08  # margins of a map [inch]
TICKS, STRIP, ROW = 0.24, 0.3, 0.19  # heights below it: coordinates, scale bar, a row of the key
APART = 1.0  # between two coordinates [inch]
SMALL = 7  # size of texts about the map
PALE = 0.35  # of white over a picture of the user's


@dataclass
class Sheet:
    """A map that is drawn: `scale` in metres per inch, `bottom` and `wide` of its frame [inch],
    `free` the height of the room between the scale bar and the key [inch]."""

    figure: Figure
    axes: Axes
    extent: Extent
    scale: float
    left: float
    wide: float
    bottom: float
    key_rows: int
    labels: Labels
    contours: Contours | None

    @property
    def bar(self) -> float:
        """Where the bar of colours stands [inch]."""
        return self.bottom - TICKS - STRIP - 0.1

    @property
    def dots(self) -> float:
        """Metres of a typographic point."""
        return self.scale / 72

    def box(self, left: float, bottom: float, wide: float, high: float) -> Any:
        """A place in inches as matplotlib has it."""
        w, h = self.figure.get_size_inches()
        return left / w, bottom / h, wide / w, high / h


def new_sheet(
    extent: Extent,
    terrain: Terrain | None,
    key: Sequence[Any] = (),
    below: float = 0.0,
    basemap: Basemap | None = None,
) -> Sheet:
    """A sheet as wide as a column, or as a page for a broad map, with a key of these handles and so
    much room above it [inch]; what the map lies on is drawn."""
    from matplotlib.figure import Figure

    west, east, south, north = extent
    aspect = (north - south) / (east - west)
    width = NARROW if aspect > 0.8 else WIDE
    wide = width - LEFT - RIGHT
    high = min(aspect * wide, TALLEST)
    wide = high / aspect
    columns = 2 if width == NARROW else 4
    rows = -(-len(key) // columns)
    bottom = TICKS + STRIP + below + ROW * rows
    figure = Figure(figsize=(width, bottom + high + TOP))
    left = LEFT + (width - LEFT - RIGHT - wide) / 2
    w, h = figure.get_size_inches()
    axes = figure.add_axes((left / w, bottom / h, wide / w, high / h))
    axes.set(xlim=(west, east), ylim=(south, north))
    contours = contours_of(terrain, extent) if terrain is not None else None
    sheet = Sheet(
        figure, axes, extent, (east - west) / wide, left, wide, bottom, rows, Labels(axes), contours
    )
    if basemap is not None:
        _draw_basemap(axes, basemap)
    elif terrain is not None:
        draw_relief(axes, terrain, extent)
    if key:
        about: dict[str, Any] = {"fontsize": SMALL, "handletextpad": 0.5, "borderaxespad": 0.2}
        figure.legend(handles=key, loc="lower center", ncols=columns, labelspacing=0.35, **about)
    return sheet


def finish(sheet: Sheet) -> None:
    """Contours with their numbers where they are free, the frame, and what tells the scale."""
    if sheet.contours is not None:
        draw_contours(sheet.axes, sheet.contours)
        _name_contours(sheet, sheet.contours)
    _draw_frame(sheet)
    _draw_strip(sheet)


def _draw_basemap(axes: Axes, basemap: Basemap) -> None:
    pale = basemap.colours + PALE * (255.0 - basemap.colours)
    extent = basemap.extent
    axes.imshow(pale.astype("u1"), extent=extent, interpolation="bilinear", aspect="auto")


def _name_contours(sheet: Sheet, contours: Contours) -> None:
    for level, curves in contours.curves.items():
        if contours.is_index(level):
            for curve in sorted(curves, key=len, reverse=True)[:2]:
                length = np.hypot(*np.diff(curve, axis=0).T).sum() / sheet.scale  # [inch]
                if length > 0.6:
                    sheet.labels.put(f"{level:g}", along(curve), color=BROWN, fontsize=SMALL)


def _draw_frame(sheet: Sheet) -> None:
    """Coordinates along the frame, far enough apart."""
    axes, (west, east, south, north) = sheet.axes, sheet.extent
    step = round_step(sheet.scale * APART)
    ticks: dict[str, Any] = {"labelsize": SMALL, "length": 2.5, "pad": 2}
    axes.tick_params(**ticks)
    axes.set_xticks(_inner(west, east, step), [f"{one:.10g}" for one in _inner(west, east, step)])
    axes.set_yticks(
        _inner(south, north, step), [f"{one:.10g}" for one in _inner(south, north, step)],
        rotation=90, va="center",
    )  # fmt: skip
    axes.set(xlim=(west, east), ylim=(south, north), aspect="equal")
    axes.spines[:].set_visible(True)
    axes.spines[:].set_color(INK)


def _inner(low: float, high: float, step: float) -> list[float]:
    """Round numbers between two ends, not too near them for their texts."""
    margin = 0.3 * step
    first = int(np.ceil((low + margin) / step))
    return [step * k for k in range(first, int(np.floor((high - margin) / step)) + 1)]


def _draw_strip(sheet: Sheet) -> None:
    """Scale bar, interval of the contours, arrow to the north of the grid."""
    from matplotlib.patches import Polygon, Rectangle

    figure, inches = sheet.figure, sheet.figure.dpi_scale_trans
    base = sheet.bottom - TICKS - STRIP + 0.06
    half = round_step(0.4 * sheet.scale)
    for k, colour in enumerate((INK, "white")):
        about: dict[str, Any] = {"facecolor": colour, "edgecolor": INK, "linewidth": 0.6}
        corner = sheet.left + k * half / sheet.scale, base
        figure.add_artist(Rectangle(corner, half / sheet.scale, 0.05, transform=inches, **about))
    texts: dict[str, Any] = {"fontsize": SMALL, "transform": inches, "va": "bottom"}
    for k, end in enumerate(("0", f"{half:g}", f"{2 * half:g} m")):
        at = sheet.left + k * half / sheet.scale
        figure.text(at, base + 0.08, end, ha="center" if k else "left", **texts)
    right = sheet.left + sheet.wide
    tip = [(right - 0.1, base + 0.2), (right - 0.16, base), (right - 0.1, base + 0.05)]
    tip += [(right - 0.04, base)]
    figure.add_artist(Polygon(tip, facecolor=INK, edgecolor=INK, linewidth=0.5, transform=inches))
    figure.text(right - 0.24, base + 0.02, "N", ha="center", **texts | {"fontsize": 9})
    if sheet.contours is not None and sheet.contours.curves:
        note = f"contours every {sheet.contours.interval:g} m"
        figure.text(right - 0.4, base + 0.02, note, ha="right", color=BROWN, **texts)
