# SPDX-License-Identifier: BSD-3-Clause
"""Hazard zones, intensities and risk over the terrain relief."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from rockfall.analysis.hazard.zones import uncertain_of, zones_of
from rockfall.case import case_in
from rockfall.files.hazard_files import colours_of
from rockfall.files.risk_files import has_risk
from rockfall.files.segment_files import has_segments
from rockfall.io.rasters.arrays import grid_of, north_up
from rockfall.language import Number, say, word
from rockfall.plots.cartography.labels import beside
from rockfall.plots.cartography.marks import NET, OBJECT, SMALL, draw_line, inside
from rockfall.plots.cartography.rasters import draw_image
from rockfall.plots.cartography.sheet import PAGE, Room, Sheet, finish, new_sheet
from rockfall.plots.extent import Extent, around
from rockfall.plots.figures import Figure
from rockfall.plots.hazard.risk_figure import draw_risk, risk_key
from rockfall.plots.hazard.segment_figure import roads_of_segments, segment_figure
from rockfall.plots.style import INK, LINE, capital, styled
from rockfall.result.maps.flat_maps import layers
from rockfall.result.maps.map_labels import map_label
from rockfall.result.trajectories import Terrain, flags_of

if TYPE_CHECKING:
    from matplotlib import figure
    from matplotlib.axes import Axes

OPAQUE = 0.7  # opacity of class colours, over a visible relief
HATCH = "/////"
LOOKS = {False: LINE, True: NET}  # style for lines (False) and barriers (True)


def hazard_figures(hazard: xr.Dataset, terrain: Terrain | None = None) -> list[Figure]:
    """Figures of a hazard: zones, intensity by return period, risk of exposed objects, and each
    segmented road."""
    minimum_area = case_in(hazard.attrs).hazard["minimum_area"]
    key = "hazard.classes_of_area" if minimum_area else "hazard.classes"
    shown = [
        Figure(
            "hazard_class",
            say("front.zones_of_hazard"),
            say(key, area=minimum_area),
            partial(zones_figure, hazard, terrain),
        )
    ]
    for name, data in layers(hazard["intensity"]).items():
        period = name.removeprefix("intensity_").removesuffix("years")
        title = say("hazard.intensity", period=Number(period))
        text = f"{capital(map_label(name, data.attrs['long_name']))}."
        shown.append(Figure(name, title, text, partial(_map_figure, hazard, data, terrain)))
    if has_risk(hazard):
        draw = partial(_risk_figure, hazard, terrain)
        shown.append(Figure("risk", say("hazard.risk_title"), say("hazard.risk"), draw))
    roads = roads_of_segments(hazard) if has_segments(hazard) else []
    for k, road in enumerate(roads, start=1):
        name = "segments" if len(roads) == 1 else f"segments_{k}"
        draw = partial(segment_figure, hazard, road)
        shown.append(Figure(name, say("hazard.road_title"), say("hazard.road"), draw))
    return shown


@styled
def zones_figure(
    hazard: xr.Dataset, terrain: Terrain | None = None, room: Room = PAGE
) -> figure.Figure:
    """Map of hazard zones, hatched where the class is uncertain, with objects."""
    sheet = begun(hazard, terrain, zone_key(hazard), room)
    draw_zones(sheet, hazard)
    finish(sheet, hazard["crs"].attrs)
    return sheet.figure


def draw_zones(sheet: Sheet, hazard: xr.Dataset) -> None:
    """Draw zones (hatched where uncertain), lines, barriers and objects."""
    zones, colours = zones_of(hazard), colours_of(hazard["hazard_class"])
    for number, colour in colours.items():
        style = {"facecolor": colour, "edgecolor": INK, "linewidth": 0.4, "alpha": OPAQUE}
        _draw_polygons(sheet.axes, zones.shapes[zones.number == number], **style)
    hatched = {"facecolor": "none", "edgecolor": INK, "linewidth": 0.0, "hatch": HATCH}
    _draw_polygons(sheet.axes, uncertain_of(hazard).shapes, **hatched)
    draw_places(sheet, hazard)


def draw_places(sheet: Sheet, hazard: xr.Dataset) -> None:
    """Draw the lines and barriers of a hazard's case, and the objects."""
    for is_barrier, name, x, y in _lines(hazard):
        draw_line(sheet, x, y, LOOKS[is_barrier])
        if (here := inside(x, y, sheet.extent))[0].size:
            sheet.labels.put(name, beside(*here), weight="bold", fontsize=SMALL)
    _draw_objects(sheet, hazard)


def zone_key(hazard: xr.Dataset) -> list[Any]:
    """Legend of the zones, highest class first, and of lines and barriers."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    doubtful = Patch(facecolor="none", edgecolor=INK, hatch=HATCH, label=say("hazard.not_certain"))
    words = {False: "axis.evaluation_line", True: "tables.barrier"}
    kinds = {is_barrier for is_barrier, *_ in _lines(hazard)}
    lines = [Line2D([], [], label=say(words[k]), **LOOKS[k]) for k in words if k in kinds]
    return [*_key(hazard["hazard_class"]), doubtful, *lines]


def _draw_polygons(axes: Axes, shapes: np.ndarray, **options: Any) -> None:
    """Draw polygons, including holes, as a single patch."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    rings = [ring for shape in shapes for ring in (shape.exterior, *shape.interiors)]
    if rings:
        paths = [Path(np.array(ring.coords), closed=True) for ring in rings]
        # add_patch would trace the outlines for limits, which a map has already
        axes.add_artist(PathPatch(Path.make_compound_path(*paths), **options))


@styled
def _map_figure(hazard: xr.Dataset, data: xr.DataArray, terrain: Terrain | None) -> figure.Figure:
    sheet = begun(hazard, terrain, _key(data))
    _draw_classes(sheet.axes, *north_up(data), data)
    _draw_objects(sheet, hazard)
    finish(sheet, hazard["crs"].attrs)
    return sheet.figure


@styled
def _risk_figure(hazard: xr.Dataset, terrain: Terrain | None) -> figure.Figure:
    sheet = begun(hazard, terrain, risk_key(hazard))
    draw_risk(sheet, hazard)
    finish(sheet, hazard["crs"].attrs)
    return sheet.figure


def begun(hazard: xr.Dataset, terrain: Terrain | None, key: list[Any], room: Room = PAGE) -> Sheet:
    """New map with an extent that includes all places reached by boulders, and the objects."""
    return new_sheet(extent_of(hazard, terrain), terrain, key, room=room)


def extent_of(hazard: xr.Dataset, terrain: Terrain | None) -> Extent:
    """Extent that includes all places reached by boulders, and the objects."""
    x, y = _reached(hazard)
    west, east, south, north = _objects_extent(hazard)
    x, y = np.append(x, [west, east]), np.append(y, [south, north])
    x, y = x[np.isfinite(x)], y[np.isfinite(y)]
    return around(x, y, grid_of(hazard["hazard_class"])[0].cell, terrain)


def places_extent(hazard: xr.Dataset) -> Extent:
    """Extent of the objects, and of lines where boulders arrive; NaN if there are none."""
    x, y = _reached(hazard)
    reached = (x.min(), x.max(), y.min(), y.max()) if x.size else (0.0, 0.0, 0.0, 0.0)
    boxes = [_objects_extent(hazard)]
    for is_barrier, _, line_x, line_y in _lines(hazard):
        here_x, here_y = inside(line_x, line_y, reached)
        if not is_barrier and here_x.size:
            boxes.append((here_x.min(), here_x.max(), here_y.min(), here_y.max()))
    west, east, south, north = np.array(boxes).T
    return np.fmin.reduce(west), np.fmax.reduce(east), np.fmin.reduce(south), np.fmax.reduce(north)


def _reached(hazard: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates x of columns and y of rows with a cell that boulders reach."""
    passed = hazard["hit_frequency"].values > 0
    return hazard["x"].values[passed.any(axis=0)], hazard["y"].values[passed.any(axis=1)]


def _objects_extent(hazard: xr.Dataset) -> Extent:
    """Extent of the objects; NaN if there are none."""
    import shapely

    if "object" not in hazard.dims:
        return np.nan, np.nan, np.nan, np.nan
    shapes = shapely.from_wkt(hazard["object_geometry"].values.astype(str))
    west, south, east, north = shapely.total_bounds(shapes)
    return west, east, south, north


def _draw_classes(axes: Axes, numbers: np.ndarray, grid: Any, data: xr.DataArray) -> None:
    """Draw class colours; cells without a class are blank."""
    from matplotlib.colors import ListedColormap

    colours = colours_of(data)
    first, last = min(colours), max(colours)
    shown = np.where(np.isin(numbers, list(colours)), numbers, np.nan)
    style: dict[str, Any] = {"clim": (first - 0.5, last + 0.5), "opacity": OPAQUE}
    draw_image(axes, shown, grid, cmap=ListedColormap(list(colours.values())), **style)


def _key(data: xr.DataArray) -> list[Any]:
    from matplotlib.patches import Patch

    words = {number: word(name) for name, number in flags_of(data).items()}
    return [
        Patch(color=colour, label=words[number], alpha=OPAQUE)
        for number, colour in reversed(colours_of(data).items())
    ]


def _lines(hazard: xr.Dataset) -> Iterator[tuple[bool, str, np.ndarray, np.ndarray]]:
    """Barrier flag, name and vertices of each line and barrier in a hazard, except lying logs."""
    case = case_in(hazard.attrs)
    for is_barrier, groups in ((False, case.line), (True, case.barrier)):
        for group in groups:
            if "x" in group and "diameter" not in group:
                vertices = np.array(group["x"], float), np.array(group["y"], float)
                yield is_barrier, str(group.get("name", "")), *vertices


def _draw_objects(sheet: Sheet, hazard: xr.Dataset) -> None:
    """Draw named outlines, lines and points."""
    import shapely

    if "object" not in hazard.dims:
        return
    shapes = shapely.from_wkt(hazard["object_geometry"].values.astype(str))
    for name, shape in zip(hazard["object"].values, shapes, strict=True):
        for part in getattr(shape, "geoms", [shape]):
            curve = part.exterior if part.geom_type == "Polygon" else part
            x, y = np.array(curve.coords).T
            draw_line(sheet, x, y, OBJECT | ({"marker": "+"} if x.size == 1 else {}))
        ring = shapely.get_coordinates(shape).T
        sheet.labels.put(str(name), beside(*ring))
