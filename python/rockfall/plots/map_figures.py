# SPDX-License-Identifier: BSD-3-Clause
"""Maps of a result over shaded relief."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from rockfall.io.rasters.arrays import north_up
from rockfall.io.rasters.grid import Grid
from rockfall.language import localised, say, word
from rockfall.plots.cartography.basemap import Basemap
from rockfall.plots.cartography.marks import draw_marks, key_of
from rockfall.plots.cartography.rasters import cropped, draw_image, edges
from rockfall.plots.cartography.sheet import PAGE, SMALL, Room, Sheet, finish, new_sheet
from rockfall.plots.extent import reached
from rockfall.plots.style import INK, OBSERVED, VERMILION, styled
from rockfall.quantities import with_unit
from rockfall.result.maps.classes import STATUS_MARKERS, Classes, Limits, classes_of, shown_as
from rockfall.result.maps.map_labels import map_comment, map_label
from rockfall.result.maps.passages import PASSED, of_none, thin_cells
from rockfall.result.motion import spread
from rockfall.result.samples import simulated
from rockfall.result.trajectories import Terrain, ends, vertices_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_TRAJECTORIES = 200  # maximum trajectories drawn
LIMIT = 0.01  # fraction of boulders at the outline (paper, Fig. 10)
BAR = 0.48  # height reserved for the colour bar [inch]
LETTER = 0.062  # letter width in its label [inch]
OPAQUE = 0.8  # opacity of colours over the visible relief


class Look(NamedTuple):
    """Map settings of the user: class limits by unit, and a background image."""

    limits: Limits | None = None
    basemap: Basemap | None = None


@styled
def map_figure(
    result: xr.Dataset,
    name: str,
    terrain: Terrain | None = None,
    observed: np.ndarray | None = None,
    look: Look | None = None,
    room: Room = PAGE,
) -> Figure:
    """Map variable of the result in classes, blank where no boulder passed, with observed stopping
    places (n, 2).

    Classes and colours are the same for every result. Passages and fractions are percentages of all
    boulders, with an outline at 1 %. If a map has more cells than the image has dots, each dot
    shows the maximum of its cells.
    """
    look = look or Look()
    key = [*key_of(result), *_observed_key(observed)]
    extent = reached(result, terrain, observed)
    sheet = new_sheet(extent, terrain, key, BAR, look.basemap, room)
    _draw_map(sheet, result, name, look.limits)
    _draw_observed(sheet.axes, observed)
    return _finished(sheet, result)


@styled
def trajectories_figure(
    result: xr.Dataset, terrain: Terrain | None = None, look: Look | None = None
) -> Figure:
    """Plan view of recorded trajectories, at most `MAX_TRAJECTORIES`."""
    from matplotlib.lines import Line2D

    key = [*key_of(result), Line2D([], [], label=say("axis.trajectory"), color=VERMILION, lw=0.7)]
    basemap = (look or Look()).basemap
    sheet = new_sheet(reached(result, terrain), terrain, key, 0.0, basemap, PAGE)
    from matplotlib.collections import LineCollection

    paths = [xy.T for xy in spread(vertices_of(result, "x", "y"), MAX_TRAJECTORIES)]
    style: dict[str, Any] = {"colors": VERMILION, "linewidths": 0.5, "alpha": 0.7}
    sheet.axes.add_collection(LineCollection(paths, rasterized=True, **style), autolim=False)
    return _finished(sheet, result)


@styled
def stops_figure(
    result: xr.Dataset,
    terrain: Terrain | None = None,
    observed: np.ndarray | None = None,
    look: Look | None = None,
    room: Room = PAGE,
) -> Figure:
    """End points of boulders, with a marker for each status, and observed stops (n, 2)."""
    key = [*key_of(result), *_stops_key(result), *_observed_key(observed)]
    basemap = (look or Look()).basemap
    extent = reached(result, terrain, observed)
    sheet = new_sheet(extent, terrain, key, 0.0, basemap, room)
    _draw_stops(sheet.axes, result)
    _draw_observed(sheet.axes, observed)
    return _finished(sheet, result)


def _finished(sheet: Sheet, result: xr.Dataset) -> Figure:
    draw_marks(sheet, result)
    finish(sheet, result["crs"].attrs)
    return sheet.figure


def is_fraction(name: str) -> bool:
    """Return True if a map shows fractions of all boulders."""
    return name == "passages" or name.startswith("reach_probability")


def map_note(result: xr.Dataset, name: str) -> str:
    """Note on the values that are left blank, and on the boulders behind the map."""
    attrs = result[name].attrs
    notes = map_comment(name, attrs)
    if "min_passages" in attrs:
        notes.append(say("map.blank_below", n=attrs["min_passages"]))
    if "thin_below" in attrs:
        notes.append(say("map.thin_below", n=attrs["thin_below"]))
    elif of_none(result, name):
        notes.append(say("map.blank_where_none", value=100 * of_none(result, name)))
    return "; ".join(notes)


def map_values(result: xr.Dataset, name: str) -> tuple[np.ndarray, str]:
    """Map values, NaN where no boulder passed, and their displayed unit (% for passages)."""
    values = np.where(result[name].values > of_none(result, name), result[name].values, np.nan)
    if name == "passages":
        return 100 * values / simulated(result), "%"
    unit, factor = shown_as(result[name])
    return factor * values, unit


def _draw_map(sheet: Sheet, result: xr.Dataset, name: str, limits: Limits | None) -> None:
    """Draw a map variable in class colours, with the colour bar below."""
    values, unit = map_values(result, name)
    values, grid = cropped(*north_up(result[name], values), sheet.extent, np.fmax)
    classes = classes_of(unit, limits)
    attrs = result[name].attrs
    passing = say("axis.boulders_that_pass")
    label = with_unit(
        passing if name in PASSED else map_label(name, attrs["long_name"]), word(unit)
    )
    if fewest := attrs.get("min_passages", 0):
        label += f"; {say('axis.blank', n=fewest)}"
    label += f"; {say('map.outline')}" if is_fraction(name) else ""
    _draw_classes(sheet, values, grid, classes, fill(label, int(sheet.bar[2] / LETTER)))
    thin = thin_cells(result, name)
    if thin is not None:
        part, _ = cropped(*north_up(result[name], thin), sheet.extent, np.logical_and)
        _hatch(sheet.axes, (part > 0) & np.isfinite(values), grid)
    if is_fraction(name):
        _draw_outline(sheet.axes, np.nan_to_num(values) >= 100 * LIMIT, grid)


def _draw_classes(
    sheet: Sheet, values: np.ndarray, grid: Grid, classes: Classes, label: str
) -> None:
    """Draw values in class colours, with the colour bar below the map."""
    from matplotlib.colors import BoundaryNorm, ListedColormap

    colours = ListedColormap(list(classes.colours))
    # classes include their upper limit; Matplotlib's do not
    ends = [-np.inf, *np.nextafter(classes.limits, np.inf), np.inf]
    norm = BoundaryNorm(ends, len(classes.colours))
    draw_image(sheet.axes, values, grid, norm=norm, cmap=colours, opacity=OPAQUE)
    left, bottom, wide = sheet.bar
    place = sheet.box(left, bottom, wide, 0.1)
    bar = sheet.figure.add_axes(place)
    number = len(classes.colours)
    bar.imshow([range(number)], cmap=colours, aspect="auto", extent=(0, number, 0, 1))
    bar.set_xticks(range(1, number), [*map(localised, classes.ticks)])
    bar.tick_params(labelsize=SMALL, length=2, pad=1.5)
    bar.set(yticks=[])
    bar.set_xlabel(label, labelpad=2)
    bar.spines[:].set_visible(True)


def _draw_stops(axes: Axes, result: xr.Dataset) -> None:
    """Draw end points of boulders, with a marker for each status."""
    size = float(np.clip(90 / np.sqrt(result.sizes["boulder"]), 1.2, 6))
    for name, here in ends(result).items():
        if here.any():
            x, y = result["stop_x"].values[here], result["stop_y"].values[here]
            look = _marker(name, size) | {"alpha": 0.7, "label": _ended(name, here)}
            axes.plot(x, y, rasterized=True, **look)


def _stops_key(result: xr.Dataset) -> list[Any]:
    from matplotlib.lines import Line2D

    return [
        Line2D([], [], label=_ended(name, here), **_marker(name, 5))
        for name, here in ends(result).items()
        if here.any()
    ]


def _ended(name: str, here: np.ndarray) -> str:
    return say(f"ended.{name}", n=here.sum())


def _marker(status: str, size: float) -> dict[str, Any]:
    marker, colour = STATUS_MARKERS[status]
    look = {"marker": marker, "linestyle": "", "color": colour}
    wide = {"markeredgewidth": 0.6 if marker in "x+" else 0}
    return look | wide | {"markersize": size * (1 if marker == "." else 1.2)}


def _draw_outline(axes: Axes, inside: np.ndarray, grid: Grid) -> None:
    """Draw the edges that separate cells inside from cells outside."""
    from matplotlib.collections import LineCollection

    style: dict[str, Any] = {"colors": INK, "linewidths": 0.9, "capstyle": "round"}
    outline = LineCollection(list(edges(inside, grid)), rasterized=True, **style)
    axes.add_collection(outline, autolim=False)


def _hatch(axes: Axes, cells: np.ndarray, grid: Grid) -> None:
    """Hatch cells whose values are uncertain."""
    from matplotlib import rc_context

    if cells.any():
        with rc_context({"hatch.linewidth": 0.4, "hatch.color": INK}):
            axes.contourf(grid.x, grid.y, cells, [0.5, 1], colors="none", hatches=["//////"])


def _observed_key(stops: np.ndarray | None) -> list[Any]:
    from matplotlib.lines import Line2D

    look = OBSERVED | {"linestyle": "", "label": _seen(stops)} if stops is not None else {}
    return [Line2D([], [], **look)] if look else []


def _seen(stops: np.ndarray) -> str:
    return say("axis.observed_stop", n=len(stops))


def _draw_observed(axes: Axes, stops: np.ndarray | None) -> None:
    if stops is not None:
        axes.plot(*np.transpose(stops), **OBSERVED | {"linestyle": "", "label": _seen(stops)})
