# SPDX-License-Identifier: BSD-3-Clause
"""Map sheet: size on paper, frame with coordinates, scale bar, north arrow, legend.

All positions are in inches, so that the scale is known before anything is drawn.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rockfall.language import localised, say
from rockfall.plots.cartography.basemap import Basemap
from rockfall.plots.cartography.labels import Labels, along
from rockfall.plots.cartography.relief import (
    BROWN,
    Contours,
    contours_of,
    draw_contours,
    draw_relief,
)
from rockfall.plots.extent import Extent
from rockfall.plots.style import INK, WIDE
from rockfall.quantities import round_step
from rockfall.result.trajectories import Terrain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LEFT, RIGHT, TOP = 0.28, 0.1, 0.08  # map margins [inch]
TICKS, STRIP, ROW = 0.24, 0.44, 0.19  # heights below the map [inch]: coordinates, scale, legend row
NARROWEST_BAR = 3.0  # minimum width of the colour bar [inch]
KEY_COLUMN = 1.75  # minimum width of a legend column [inch]
KEY_PATCH = 0.5  # width of a legend entry without its text [inch]
INCH = 0.0254  # metres per inch
SCALES = (1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # leading digits of scales
APART = 1.0  # minimum distance between coordinates [inch]
SMALL = 7  # font size around the map
PALE = 0.35  # opacity of the white layer over the user's image
WKT_NAME = re.compile(r'\w+\["([^"]+)"')
#: EPSG code at the end of a WKT.
EPSG = re.compile(r'(?:AUTHORITY\["EPSG","|ID\["EPSG",)([0-9]+)"?\]\]$')


class Room(NamedTuple):
    """Maximum size of a map on paper, including all its parts [inch]."""

    wide: float = WIDE
    high: float = 8.6


PAGE = Room()


@dataclass
class Sheet:
    """A drawn map: `scale` in metres per inch; `left`, `bottom` and `wide` (width) of its frame
    [inch]."""

    figure: Figure
    axes: Axes
    extent: Extent
    scale: float
    left: float
    wide: float
    bottom: float
    labels: Labels
    contours: Contours | None
    paper: str = "A4"  # paper size at which the scale is valid

    @property
    def bar(self) -> tuple[float, float, float]:
        """Left, bottom and width of the colour bar [inch], which is wide enough for its labels."""
        inner = self.figure.get_figwidth() - LEFT - RIGHT
        wide = max(self.wide, min(NARROWEST_BAR, inner))
        left = min(self.left + (self.wide - wide) / 2, LEFT + inner - wide)
        return max(left, LEFT), self.bottom - TICKS - STRIP - 0.1, wide

    @property
    def dots(self) -> float:
        """Metres per typographic point."""
        return self.scale / 72

    def box(self, left: float, bottom: float, wide: float, high: float) -> Any:
        """Position in fractions of the figure, from inches."""
        w, h = self.figure.get_size_inches()
        return left / w, bottom / h, wide / w, high / h


def new_sheet(
    extent: Extent,
    terrain: Terrain | None,
    key: Sequence[Any] = (),
    below: float = 0.0,
    basemap: Basemap | None = None,
    room: Room = PAGE,
) -> Sheet:
    """New sheet that fits `room`: a map at a round scale with its background, the legend `key`, and
    free space `below` the map [inch]."""
    from matplotlib.figure import Figure

    west, east, south, north = extent
    width, columns = room.wide, _columns(room, key)
    bottom = TICKS + STRIP + below + ROW * -(-len(key) // columns)
    inner, tallest = inner_size(room, key, below)
    scale = INCH * round_scale(max((east - west) / inner, (north - south) / tallest) / INCH)
    wide, high = (east - west) / scale, (north - south) / scale
    figure = Figure(figsize=(width, bottom + high + TOP))
    left = LEFT + (inner - wide) / 2
    w, h = figure.get_size_inches()
    axes = figure.add_axes((left / w, bottom / h, wide / w, high / h))
    axes.set(xlim=(west, east), ylim=(south, north))
    contours = contours_of(terrain, extent) if terrain is not None else None
    sheet = Sheet(figure, axes, extent, scale, left, wide, bottom, Labels(axes), contours)
    if basemap is not None:
        _draw_basemap(axes, basemap)
    elif terrain is not None:
        draw_relief(axes, terrain, extent)
    if key:
        style: dict[str, Any] = {"fontsize": SMALL, "handletextpad": 0.5, "borderaxespad": 0.2}
        figure.legend(handles=key, loc="lower center", ncols=columns, labelspacing=0.35, **style)
    return sheet


def inner_size(room: Room, key: Sequence[Any] = (), below: float = 0.0) -> tuple[float, float]:
    """Maximum width and height of the map frame [inch] in `room`, with the legend `key` and free
    space `below` the map."""
    bottom = TICKS + STRIP + below + ROW * -(-len(key) // _columns(room, key))
    return room.wide - LEFT - RIGHT, room.high - bottom - TOP


def _columns(room: Room, key: Sequence[Any]) -> int:
    """Number of legend columns that leave space for the longest text."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(size=SMALL)
    widths = (text_to_path.get_text_width_height_descent(entry.get_label(), font, False)[0]
              for entry in key)  # fmt: skip
    column = max(widths, default=0.0) / 72 + KEY_PATCH
    return max(1, int(room.wide / max(column, KEY_COLUMN)))


def round_scale(rough: float) -> float:
    """Round scale denominator (5000 for 1:5,000) above `rough`."""
    power = 10.0 ** np.floor(np.log10(rough))
    return float(power * next(scale for scale in SCALES if scale * power >= 0.9999 * rough))


def scale_text(denominator: float, paper: str = "A4") -> str:
    """Text of the scale, which is valid at the drawn size of the map."""
    return say("map.scale", denominator=denominator, paper=paper)


def named_crs(crs: Mapping[str, Any]) -> str:
    """Name of the coordinate system of a grid mapping; "" if it has none."""
    keys = ("projected_crs_name", "geographic_crs_name")
    match = WKT_NAME.search(str(crs.get("crs_wkt", "")))  # CF lacks parameters for some systems
    names = (str(crs[key]) for key in keys if crs.get(key))
    return next(names, match[1] if match else "")


def crs_text(crs: Mapping[str, Any]) -> str:
    """Text of the coordinate system of a grid mapping, with its EPSG code."""
    code = EPSG.search(str(crs.get("crs_wkt", "")).rstrip())
    parts = [named_crs(crs), f"EPSG:{code[1]}" if code else ""]
    return ", ".join(filter(None, parts)) or say("sheet.no_crs")


def finish(sheet: Sheet, crs: Mapping[str, Any]) -> None:
    """Draw contour labels at free places, the frame, the scale, and the coordinate system given by
    the grid mapping's attributes."""
    if sheet.contours is not None:
        draw_contours(sheet.axes, sheet.contours)
        _name_contours(sheet, sheet.contours)
    _draw_frame(sheet)
    _draw_strip(sheet, crs_text(crs))


def _draw_basemap(axes: Axes, basemap: Basemap) -> None:
    pale = basemap.colours + PALE * (255.0 - basemap.colours)
    extent = basemap.extent
    axes.imshow(pale.astype("u1"), extent=extent, interpolation="bilinear", aspect="auto")


def _name_contours(sheet: Sheet, contours: Contours) -> None:
    for level, curves in contours.curves.items():
        if contours.is_index(level):
            for curve in sorted(curves, key=len, reverse=True)[:2]:
                # Curve length [inch].
                length = np.hypot(*np.diff(curve, axis=0).T).sum() / sheet.scale
                if length > 0.6:
                    sheet.labels.put(f"{level:g}", along(curve), color=BROWN, fontsize=SMALL)


def _draw_frame(sheet: Sheet) -> None:
    """Draw coordinates along the frame, with sufficient spacing."""
    axes, (west, east, south, north) = sheet.axes, sheet.extent
    step = round_step(sheet.scale * APART)
    ticks: dict[str, Any] = {"labelsize": SMALL, "length": 2.5, "pad": 2}
    axes.tick_params(**ticks)
    axes.set_xticks(_inner(west, east, step), [f"{tick:.10g}" for tick in _inner(west, east, step)])
    axes.set_yticks(
        _inner(south, north, step), [f"{tick:.10g}" for tick in _inner(south, north, step)],
        rotation=90, va="center",
    )  # fmt: skip
    axes.set(xlim=(west, east), ylim=(south, north), aspect="equal")
    axes.spines[:].set_visible(True)
    axes.spines[:].set_color(INK)


def _inner(low: float, high: float, step: float) -> list[float]:
    """Round numbers between two limits, with space for their labels."""
    margin = 0.3 * step
    first = int(np.ceil((low + margin) / step))
    return [step * k for k in range(first, int(np.floor((high - margin) / step)) + 1)]


def _draw_strip(sheet: Sheet, crs: str) -> None:
    """Draw scale bar, contour interval, grid north arrow, and coordinate system."""
    from matplotlib.patches import Polygon, Rectangle

    figure, inches = sheet.figure, sheet.figure.dpi_scale_trans
    base = sheet.bottom - TICKS - STRIP + 0.2
    left, right = LEFT, figure.get_figwidth() - RIGHT
    half = round_step(0.2 * sheet.scale)
    for k, colour in enumerate((INK, "white")):
        style: dict[str, Any] = {"facecolor": colour, "edgecolor": INK, "linewidth": 0.6}
        corner = left + k * half / sheet.scale, base
        figure.add_artist(Rectangle(corner, half / sheet.scale, 0.05, transform=inches, **style))
    texts: dict[str, Any] = {"fontsize": SMALL, "transform": inches, "va": "bottom"}
    for k, end in enumerate(("0", localised(f"{half:g}"), localised(f"{2 * half:g} m"))):
        at = left + k * half / sheet.scale
        figure.text(at, base + 0.08, end, ha="center" if k else "left", **texts)
    tip = [(right - 0.1, base + 0.2), (right - 0.16, base), (right - 0.1, base + 0.05)]
    tip += [(right - 0.04, base)]
    figure.add_artist(Polygon(tip, facecolor=INK, edgecolor=INK, linewidth=0.5, transform=inches))
    figure.text(right - 0.24, base + 0.02, "N", ha="center", **texts | {"fontsize": 9})
    under = base - 0.18
    figure.text(left, under, f"{scale_text(sheet.scale / INCH, sheet.paper)}; {crs}", **texts)
    if sheet.contours is not None and sheet.contours.curves:
        note = say("map.contours", interval=sheet.contours.interval)
        figure.text(right - 0.4, base + 0.02, note, ha="right", color=BROWN, **texts)
