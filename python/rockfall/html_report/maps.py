# SPDX-License-Identifier: BSD-3-Clause
"""Maps of a result that zoom: pictures and paths for inline SVG over shaded relief, with the
numbers of the cells.

All maps of a page show the same window of the terrain and move together. Their unit is a cell of
the picture, which is one or more cells of the raster.
"""

from __future__ import annotations

import base64
import io
import zlib
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rockfall.plots.extent import of_none, reached
from rockfall.plots.map_figures import (
    FEW_SOURCES,
    MAX_TRAJECTORIES,
    colours,
    cropped,
    first_inside,
    map_note,
    merged,
    norm_of,
    shade,
    shown_as,
)
from rockfall.plots.style import capital
from rockfall.protection.barriers import barriers_of
from rockfall.result.trajectories import lines, spread, vertices_of

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.colors import Normalize

    from rockfall.plots.extent import Extent
    from rockfall.result.trajectories import Terrain

MAX_CELLS = 4_000_000  # of the pictures of all maps: a page has a few MB, however many there are
MAX_POINTS = 3000  # sources and stops that are drawn


class Window(NamedTuple):
    """The part of the raster that boulders reached, and how it is drawn.

    `west` and `north` are its outer edges [m], `cell` the side of a cell of the picture [m], which
    is `step` cells of the raster; `row` and `column` are those of the raster where it begins.
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
        """Points [m] as (n, 2) in cells of the picture, from its north-western corner."""
        return np.column_stack([(x - self.west) / self.cell, (self.north - y) / self.cell])


class Image(NamedTuple):
    """A picture as a data URI, and where it lies in the window [cells]."""

    uri: str
    x: float
    y: float
    wide: float
    high: float


class Legend(NamedTuple):
    """Colours of a colour bar from its left to its right, and its ticks: place [%] -> text."""

    colours: list[str]
    ticks: dict[float, str]


class Map(NamedTuple):
    """A map variable: its cells as a picture and as packed numbers; neither where it is blank."""

    title: str
    unit: str
    values: str
    notes: str
    layer: Image | None = None
    legend: Legend | None = None


def map_section(result: xr.Dataset, terrain: Terrain | None) -> dict[str, object]:
    """All that the template of the maps needs; of many sources and stops some are drawn."""
    window = window_of(result)
    start = np.unique(np.column_stack([result["start_x"], result["start_y"]]), axis=0)
    every = -(-result.sizes["boulder"] // MAX_POINTS)
    x, y = result["stop_x"].values[::every], result["stop_y"].values[::every]
    recorded = spread(vertices_of(result, "x", "y"), MAX_TRAJECTORIES)
    barriers = barriers_of(result)
    kinds = ["barrier" if k in barriers else "line" for k in range(result.sizes.get("line", 0))]
    return {
        "window": window,
        "relief": _relief(terrain, window),
        "maps": list(maps(result, window)),
        "lines": [
            (kinds[k], name, _path([window.place(*line)]), _label(window.place(*line), window))
            for k, (name, *line) in enumerate(lines(result))
        ],
        "kinds": {*kinds},
        "sources": _dots(window.place(*start[:: -(-len(start) // MAX_POINTS)].T)),
        "source_class": "source" if len(start) < FEW_SOURCES else "source many",
        "trajectories": _path(window.place(*one) for one in recorded),
        "stops": _dots(window.place(x, y)),
        "every": every,
    }


def window_of(result: xr.Dataset) -> Window:
    """The window round all that boulders reached, within the raster where maps tell its size."""
    left, cell, _, top, _, _ = map(float, result["crs"].attrs["GeoTransform"].split())
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


def maps(result: xr.Dataset, window: Window) -> Iterator[Map]:
    """Every map variable of a result; nothing is drawn where no boulder passed."""
    for name in _names(result):
        unit, factor = shown_as(result[name])
        values = blocks_max(result[name].values, window)
        values[~(values > of_none(result, name))] = np.nan
        values *= np.float32(factor)
        title = capital(result[name].attrs["long_name"])
        found = Map(title, unit, _packed(values), map_note(result, name))
        yield found if np.isnan(values).all() else found._replace(**_coloured(values, window))


def blocks_max(values: np.ndarray, window: Window) -> np.ndarray:
    """The raster in cells of the picture: the maximum of each block, NaN where there is none."""
    step = window.step
    part = values[window.row :, window.column :][: window.ny * step, : window.nx * step]
    return merged(part, step, np.fmax).astype("f4")


def _coloured(values: np.ndarray, window: Window) -> dict[str, Any]:
    """Layer and legend of the values of a map."""
    norm = norm_of(values)
    table = (colours(255)[:, :3] * 255).round().astype("u1")
    index = np.where(np.isfinite(values), 1 + 254 * np.clip(norm(values).filled(0), 0, 1), 0)
    content = _png(index.astype("u1"), np.vstack([[[255, 255, 255]], table]).astype("u1"))
    ticks = {round(100 * float(norm(tick)), 1): f"{tick:,g}" for tick in _ticks(norm)}
    legend = Legend(["#" + bytes(c).hex() for c in table[:: len(table) // 12]], ticks)
    return {"layer": Image(content, 0, 0, window.nx, window.ny), "legend": legend}


def _ticks(norm: Normalize) -> list[float]:
    """Round numbers for a legend."""
    from matplotlib.colors import LogNorm
    from matplotlib.ticker import LogLocator, MaxNLocator

    locator = LogLocator(numticks=5) if isinstance(norm, LogNorm) else MaxNLocator(4)
    low, high = norm.vmin, norm.vmax
    assert low is not None and high is not None
    found = np.asarray(locator.tick_values(low, high)).tolist()
    return [tick for tick in found if low <= tick <= 1.0001 * high]


def _packed(values: np.ndarray) -> str:
    """Numbers of the cells, to five digits, compressed, as text (little-endian float32)."""
    bits = np.ascontiguousarray(values, "<f4").view("<u4")
    known = np.isfinite(values)
    bits = np.where(known, (bits + 0x40) & ~np.uint32(0x7F), np.uint32(0x7FC00000))
    return base64.b64encode(zlib.compress(bits.astype("<u4").tobytes(), 9)).decode()


def _relief(terrain: Terrain | None, window: Window) -> Image | None:
    """The shaded relief of the terrain."""
    if terrain is None:
        return None
    z, grid = cropped(*terrain, False, window.extent, np.add)
    (corner,) = window.place(np.array([grid.west]), np.array([grid.north]))
    size = np.array([grid.nx, grid.ny]) * grid.cell / window.cell
    return Image(_png((255 * shade(z, grid.cell)).astype("u1")), *corner, *size)


def _png(index: np.ndarray, table: np.ndarray | None = None) -> str:
    """A picture of grey levels, or of colours by number, of which number 0 is clear."""
    from PIL import Image as Picture

    image, about = Picture.fromarray(index), {}
    if table is not None:
        image.putpalette(table.tobytes())
        about = {"transparency": 0}
    buffer = io.BytesIO()
    image.save(buffer, "PNG", optimize=True, **about)
    return data_uri(buffer.getvalue(), "image/png")


def data_uri(content: bytes, kind: str) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def _path(curves: Iterable[np.ndarray]) -> str:
    """Polylines (n, 2) as one SVG path of two decimals."""
    return "".join("M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in curve) for curve in curves)


def _dots(points: np.ndarray) -> str:
    """Points (n, 2) as one SVG path of strokes without length."""
    return "".join(f"M{x:.2f} {y:.2f}h0" for x, y in points)


def _label(line: np.ndarray, window: Window) -> tuple[float, float, bool] | None:
    """Where the name of a line stands, and whether below it, as near the upper edge."""
    x, y = line.T
    at = first_inside(x, y, (0, window.nx, 0, window.ny))
    return at and (*at, at[1] <= 0.05 * window.ny)
