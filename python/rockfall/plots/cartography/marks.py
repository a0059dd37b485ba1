# SPDX-License-Identifier: BSD-3-Clause
"""Map marks in addition to values: sources, evaluation lines, barriers, objects."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from rockfall.language import say
from rockfall.plots.cartography.labels import beside
from rockfall.plots.cartography.rasters import edges, occupied
from rockfall.plots.cartography.sheet import Sheet
from rockfall.plots.extent import Extent
from rockfall.plots.style import BARRIER, BLUE, INK, LINE
from rockfall.protection.barriers import barriers_of
from rockfall.result.crossings import MOST_LINES, most_crossed
from rockfall.result.trajectories import lines

SMALL = 7  # font size for names
FEW_SOURCES = 20  # fewer sources are drawn individually
FINEST = 2.5  # minimum cell side in the source outline [points]
ROCK = "#00604a"  # colour of sources
SOURCE: dict[str, Any] = {"color": ROCK, "linewidth": 0.8}
NET: dict[str, Any] = BARRIER | {"color": BLUE, "linewidth": 2.4}  # style on class colours
OBJECT: dict[str, Any] = {"color": INK, "linewidth": 1.1}
CASING = 1.6  # width of the white halo of a line [points]


def starts(result: xr.Dataset) -> np.ndarray:
    """Distinct start points (n, 2) [m]."""
    places = np.column_stack([result["start_x"], result["start_y"]]).astype("f8")
    once = np.unique(places.view("c16").ravel())  # ten times as fast as unique rows
    return once[:, np.newaxis].view("f8")


def key_of(result: xr.Dataset) -> list[Any]:
    """Legend handles for the marks on a result's map."""
    from matplotlib.lines import Line2D

    few = len(starts(result)) < FEW_SOURCES
    source: dict[str, Any] = {"marker": "^", "ls": "", "mfc": "white", "mec": INK, "ms": 5}
    source = source if few else {"marker": "s", "ls": "", "mfc": "none", "mec": ROCK, "ms": 5}
    handles = [Line2D([], [], mew=0.7, label=say("label.release"), **source)]
    nets = barriers_of(result)
    if len(lines(result)) > len(nets):
        handles.append(Line2D([], [], label=say("axis.evaluation_line"), **LINE))
    if nets:
        handles.append(Line2D([], [], label=say("tables.barrier"), **NET))
    return handles


def draw_marks(sheet: Sheet, result: xr.Dataset) -> None:
    """Draw sources, lines and barriers, with the names of those in `named`."""
    draw_sources(sheet, starts(result))
    nets, shown = barriers_of(result), named(result)
    for k, (name, x, y) in enumerate(lines(result)):
        draw_line(sheet, x, y, NET if k in nets else LINE)
        if k not in shown:
            continue
        sheet.labels.put(name, beside(*inside(x, y, sheet.extent)), weight="bold", fontsize=SMALL)


def named(result: xr.Dataset) -> set[int]:
    """Indices of the lines whose names fit on a figure: those that the most boulders pass, and
    barriers."""
    return {*most_crossed(result, MOST_LINES), *barriers_of(result)}


def draw_line(sheet: Sheet, x: np.ndarray, y: np.ndarray, look: dict[str, Any]) -> None:
    """Draw a polyline with a halo that separates it from the map."""
    from matplotlib.patheffects import Normal, withStroke

    casing = withStroke(linewidth=look["linewidth"] + CASING, foreground="white", alpha=0.8)
    sheet.axes.plot(x, y, path_effects=[casing, Normal()], **look)


def draw_sources(sheet: Sheet, places: np.ndarray) -> None:
    """Draw sources individually if few, otherwise as the outline of their cells."""
    from matplotlib.collections import LineCollection

    if len(places) < FEW_SOURCES:
        sheet.axes.plot(*places.T, "^", ms=5, mfc="white", mec=INK, mew=0.8)
        return
    sides = list(edges(*outlined(places, FINEST * sheet.dots)))
    style: dict[str, Any] = {"colors": ROCK, "linewidths": SOURCE["linewidth"], "rasterized": True}
    sheet.axes.add_collection(LineCollection(sides, capstyle="round", **style), autolim=False)


def outlined(places: np.ndarray, finest: float) -> tuple[Any, Any]:
    """Mask of the cells that contain sources, and its grid. The cell side is the median
    source spacing, at least `finest` [m]."""
    apart = [np.diff(np.unique(c.round(3))) for c in places.T]
    spacing = float(np.median(np.concatenate(apart))) if any(map(len, apart)) else finest
    return occupied(places, max(spacing, finest))


def inside(x: np.ndarray, y: np.ndarray, extent: Extent) -> tuple[np.ndarray, np.ndarray]:
    """Closely spaced points on a polyline, in order, without those outside an extent."""
    along = np.linspace(0, x.size - 1, 200 * (x.size - 1) + 1)
    x, y = (np.interp(along, np.arange(c.size), c) for c in (x, y))
    here = (x >= extent[0]) & (x <= extent[1]) & (y >= extent[2]) & (y <= extent[3])
    return x[here], y[here]
