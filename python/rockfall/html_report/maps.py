# SPDX-License-Identifier: BSD-3-Clause
"""Zoomable maps of a result: images and paths for inline SVG over shaded relief, with cell values.

All maps on a page show the same window of the terrain and move together. Their length unit is an
image cell, which covers one or more raster cells.
"""

from __future__ import annotations

import base64
import io
import zlib
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from rockfall.io.rasters.arrays import corner_of
from rockfall.language import localised, say, word
from rockfall.plots.cartography.basemap import Basemap
from rockfall.plots.cartography.labels import along
from rockfall.plots.cartography.marks import FEW_SOURCES, inside, outlined, starts
from rockfall.plots.cartography.rasters import cropped, edges, merged
from rockfall.plots.cartography.relief import contours_of, shade
from rockfall.plots.cartography.sheet import crs_text, round_scale, scale_text
from rockfall.plots.extent import Extent, reached
from rockfall.plots.map_figures import MAX_TRAJECTORIES, Look, map_note
from rockfall.plots.style import capital
from rockfall.protection.barriers import barriers_of
from rockfall.result.maps.classes import Classes, Limits, classes_of, shown_as
from rockfall.result.maps.map_labels import map_label
from rockfall.result.maps.passages import of_none, thin_cells
from rockfall.result.motion import spread
from rockfall.result.trajectories import Terrain, lines, vertices_of

MAX_CELLS = 4_000_000  # total size of all map images; keeps a page at a few MB
PRINTED = np.array([0.18, 0.2])  # maximum width and height of a map on paper [m]
NAME_DEPTH = 6  # number of times a line is halved to find places for its name
MAX_POINTS = 3000  # maximum number of stops drawn
FINEST = 1 / 400  # minimum cell side of the source outline / longer window side


class Window(NamedTuple):
    """The part of the raster reached by boulders, with the scale of its image.

    `west` and `north` are its outer edges [m]. An image cell has the side `cell` [m] and covers
    `step` by `step` raster cells. `row` and `column` are the raster indices of its first cell.
    """

    west: float
    north: float
    cell: float
    nx: int
    ny: int
    step: int
    row: int
    column: int

    @property
    def extent(self) -> Extent:
        wide, high = self.nx * self.cell, self.ny * self.cell
        return self.west, self.west + wide, self.north - high, self.north

    def place(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Coordinates (n, 2) of points [m] in image cells, from the north-western corner."""
        return np.column_stack([(x - self.west) / self.cell, (self.north - y) / self.cell])


class Image(NamedTuple):
    """An image as a data URI, and its position in the window [cells]."""

    uri: str
    x: float
    y: float
    wide: float
    high: float


class Legend(NamedTuple):
    """Class colours with their limits [%], and labels: position [%] -> text."""

    colours: list[tuple[str, float, float]]
    ticks: dict[float, str]


class Line(NamedTuple):
    """An evaluation line or barrier in the window: path, and candidate places for its name."""

    kind: str
    name: str
    path: str
    places: str


class Ground(NamedTuple):
    """Contours: interval [m], thin and bold contours as paths, and elevation labels of the bold
    ones: x, y [cells], angle [degree], elevation."""

    interval: float
    thin: str
    bold: str
    numbers: list[tuple[float, float, float, str]]


class Map(NamedTuple):
    """A map variable: its cells as packed numbers and, unless it is blank, as an image with a
    legend."""

    title: str
    unit: str
    values: str
    notes: str
    layer: Image | None = None
    thin: Image | None = None
    legend: Legend | None = None


def map_section(
    result: xr.Dataset, terrain: Terrain | None, look: Look | None = None
) -> dict[str, object]:
    """Template data of the maps; a large number of stopping points is thinned."""
    window = window_of(result)
    every = max(1, -(-result.sizes["boulder"] // MAX_POINTS))
    x, y = result["stop_x"].values[::every], result["stop_y"].values[::every]
    recorded = spread(vertices_of(result, "x", "y"), MAX_TRAJECTORIES)
    limits, basemap = look or (None, None)
    place, path = _sources(result, window)
    side = np.array([window.nx, window.ny]) * window.cell
    denominator = round_scale(float(max(side / PRINTED)))
    return {
        "window": window,
        "printed": 1000 * side[0] / denominator,
        "scale": f"{scale_text(denominator)}; {crs_text(result['crs'].attrs)}",
        "relief": _relief(terrain, window) if basemap is None else _picture(basemap, window),
        "ground": _ground(terrain, window),
        "maps": list(maps(result, window, limits)),
        "lines": (placed := list(_lines(result, window))),
        "kinds": {line.kind for line in placed},
        "sources": path,
        "source_class": place,
        "trajectories": _path(window.place(*vertex) for vertex in recorded),
        "stops": _dots(window.place(x, y)),
        "every": every,
    }


def _lines(result: xr.Dataset, window: Window) -> Iterator[Line]:
    nets = barriers_of(result)
    for k, (name, *line) in enumerate(lines(result)):
        places = window.place(*line)
        x, y = inside(places[:, 0], places[:, 1], (0, window.nx, 0, window.ny))
        shown = _spread(x.size)
        may = " ".join(f"{a:.2f} {b:.2f}" for a, b in zip(x[shown], y[shown], strict=True))
        yield Line("barrier" if k in nets else "line", name, _path([places]), may)


def _spread(size: int) -> np.ndarray:
    """Indices in the order in which places for a name are tried: middle first, then midpoints."""
    if not size:
        return np.array([], int)
    order = [(2 * k + 1) / 2**depth for depth in range(1, 1 + NAME_DEPTH)
             for k in range(2 ** (depth - 1))]  # fmt: skip
    return (np.array(order) * size).astype(int)


def _sources(result: xr.Dataset, window: Window) -> tuple[str, str]:
    """CSS class and path of the sources: points if few, outlines of their cells if many."""
    places = starts(result)
    if len(places) < FEW_SOURCES:
        return "source", _dots(window.place(*places.T))
    finest = max(window.nx, window.ny) * FINEST * window.cell
    sides = edges(*outlined(places, finest))
    return "area", _path(window.place(*side.T) for side in sides)


def _ground(terrain: Terrain | None, window: Window) -> Ground | None:
    """Contours, and candidate places for their elevation labels."""
    if terrain is None:
        return None
    contours = contours_of(terrain, window.extent)
    thin: list[np.ndarray] = []
    bold: list[np.ndarray] = []
    numbers = []
    for level, curves in contours.curves.items():
        placed = [window.place(*curve.T) for curve in curves]
        (bold if contours.is_index(level) else thin).extend(placed)
        for curve in placed if contours.is_index(level) else ():
            x, y, angle, _ = next(along(curve))
            numbers.append((x, y, angle, f"{level:g}"))
    return Ground(contours.interval, _path(thin, 1), _path(bold, 1), numbers)


def window_of(result: xr.Dataset) -> Window:
    """Window around all cells that boulders reached, within the raster if maps define one."""
    left, top, cell = corner_of(result["crs"].attrs)
    west, east, south, north = reached(result)
    first = np.floor([(top - north) / cell, (west - left) / cell]).astype(int)
    last = np.ceil([(top - south) / cell, (east - left) / cell]).astype(int)
    if {"y", "x"} <= set(result.sizes):
        first, last = np.maximum(first, 0), np.minimum(last, (result.sizes["y"], result.sizes["x"]))
    cells = np.prod((last - first).astype(float)) * max(1, len(_names(result)))
    step = int(np.ceil(np.sqrt(cells / MAX_CELLS)))
    ny, nx = (int(size) for size in -(-(last - first) // step))
    row, column = (int(index) for index in first)
    return Window(left + column * cell, top - row * cell, cell * step, nx, ny, step, row, column)


def _names(result: xr.Dataset) -> list[str]:
    return [str(name) for name, variable in result.data_vars.items() if variable.dims == ("y", "x")]


def maps(result: xr.Dataset, window: Window, limits: Limits | None = None) -> Iterator[Map]:
    """Maps of all variables of a result, blank where no boulder passed."""
    for name in _names(result):
        unit, factor = shown_as(result[name])
        values = blocks_max(result[name].values, window)
        values[~(values > of_none(result, name))] = np.nan
        values *= np.float32(factor)
        title = capital(map_label(name, result[name].attrs["long_name"]))
        map_ = Map(title, word(unit), _packed(values), map_note(result, name))
        if not np.isnan(values).all():
            map_ = map_._replace(**_coloured(values, window, classes_of(unit, limits)))
            thin = _thin(result, name, window, np.isfinite(values))
            notes = f"{map_.notes}; {say('map.hatched_there')}" if thin else map_.notes
            map_ = map_._replace(thin=thin, notes=notes)
        yield map_


def blocks_max(values: np.ndarray, window: Window) -> np.ndarray:
    """Raster in image cells: the maximum of each block; NaN for an empty block."""
    return _blocks(values, window, np.fmax).astype("f4")


def _blocks(values: np.ndarray, window: Window, merge: np.ufunc) -> np.ndarray:
    step = window.step
    part = values[window.row :, window.column :][: window.ny * step, : window.nx * step]
    return merged(part, step, merge)


def _thin(result: xr.Dataset, name: str, window: Window, shown: np.ndarray) -> Image | None:
    """White hatching over cells with uncertain values; None if all are certain."""
    thin = thin_cells(result, name)
    if thin is None:
        return None
    cells = _blocks(thin, window, np.logical_and) & shown
    if not cells.any():
        return None
    white = np.array([[0, 0, 0], [255, 255, 255]], "u1")
    return Image(_png(cells.astype("u1"), white), 0, 0, window.nx, window.ny)


def _coloured(values: np.ndarray, window: Window, classes: Classes) -> dict[str, Any]:
    """Image and legend of a map's values."""
    table = np.array([list(bytes.fromhex(rgb[1:])) for rgb in ("#ffffff", *classes.colours)], "u1")
    content = _png((1 + classes.numbers(values)).astype("u1"), table)
    places = np.linspace(0, 100, len(classes.colours) + 1).round(2).tolist()
    colours = list(zip(classes.colours, places, places[1:], strict=False))
    ticks = map(localised, classes.ticks)
    legend = Legend(colours, dict(zip(places[1:], ticks, strict=False)))
    return {"layer": Image(content, 0, 0, window.nx, window.ny), "legend": legend}


def _packed(values: np.ndarray) -> str:
    """Cell values, rounded to five digits and compressed, as text (little-endian float32)."""
    bits = np.ascontiguousarray(values, "<f4").view("<u4")
    is_known = np.isfinite(values)
    bits = np.where(is_known, (bits + 0x40) & ~np.uint32(0x7F), np.uint32(0x7FC00000))
    return base64.b64encode(zlib.compress(bits.astype("<u4").tobytes())).decode()


def _relief(terrain: Terrain | None, window: Window) -> Image | None:
    if terrain is None:
        return None
    z, grid = cropped(*terrain, window.extent, np.add)
    (corner,) = window.place(np.array([grid.west]), np.array([grid.north]))
    size = np.array([grid.nx, grid.ny]) * grid.cell / window.cell
    return Image(_png((255 * shade(z, grid.cell)).astype("u1")), *corner, *size)


def _picture(basemap: Basemap, window: Window) -> Image:
    """The user's basemap as JPEG."""
    from PIL import Image as Picture

    buffer = io.BytesIO()
    Picture.fromarray(basemap.colours).save(buffer, "JPEG", quality=80)
    west, east, south, north = basemap.extent
    (corner,) = window.place(np.array([west]), np.array([north]))
    size = np.array([east - west, north - south]) / window.cell
    return Image(data_uri(buffer.getvalue(), "image/jpeg"), *corner, *size)


def _png(index: np.ndarray, table: np.ndarray | None = None) -> str:
    """PNG of grey levels, or of palette colours; colour 0 is transparent."""
    from PIL import Image as Picture

    image, options = Picture.fromarray(index), {}
    if table is not None:
        image.putpalette(table.tobytes())
        options = {"transparency": 0}
    buffer = io.BytesIO()
    image.save(buffer, "PNG", **options)
    return data_uri(buffer.getvalue(), "image/png")


def data_uri(content: bytes, kind: str) -> str:
    """Data URI of content with a media type such as image/png."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def _path(curves: Iterable[np.ndarray], decimals: int = 2) -> str:
    """Polylines (n, 2) as an SVG path."""
    return "".join(
        "M" + "L".join(f"{x:.{decimals}f} {y:.{decimals}f}" for x, y in curve) for curve in curves
    )


def _dots(points: np.ndarray) -> str:
    """Points (n, 2) as an SVG path of zero-length strokes."""
    return "".join(f"M{x:.2f} {y:.2f}h0" for x, y in points)
