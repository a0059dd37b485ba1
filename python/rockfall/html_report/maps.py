# SPDX-License-Identifier: BSD-3-Clause
"""Maps of a result that zoom: inline SVG over shaded relief, with the numbers of the cells.

All maps of a page show the same window of the terrain and move together. Their unit is a cell of
the picture, which is one or more cells of the raster.
"""

from __future__ import annotations

import base64
import io
import zlib
from collections.abc import Iterator
from html import escape
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.analysis.extent import of_none, reached
from rockfall.html_report.markup import data_uri
from rockfall.plots.map_figures import (
    MOST_WAYS,
    UNITS,
    first_inside,
    map_note,
    merged,
    shade,
)

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.colors import Normalize

    from rockfall.result.trajectories import Terrain

MOST_CELLS = 4_000_000  # of the pictures of all maps: a page has a few MB, however many there are
MOST_POINTS = 3000  # stops that are drawn


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

    def place(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Points [m] as (n, 2) in cells of the picture, from its north-western corner."""
        return np.column_stack([(x - self.west) / self.cell, (self.north - y) / self.cell])


def window_of(result: xr.Dataset) -> Window:
    """The window round all that boulders reached, within the raster where maps tell its size."""
    left, cell, _, top, _, _ = map(float, result["crs"].attrs["GeoTransform"].split())
    west, east, south, north = reached(result)
    first = np.floor([(top - north) / cell, (west - left) / cell]).astype(int)
    last = np.ceil([(top - south) / cell, (east - left) / cell]).astype(int)
    if {"y", "x"} <= set(result.sizes):
        first, last = np.maximum(first, 0), np.minimum(last, (result.sizes["y"], result.sizes["x"]))
    cells = np.prod((last - first).astype(float)) * max(1, len(_names(result)))
    step = int(np.ceil(np.sqrt(cells / MOST_CELLS)))
    ny, nx = (int(size) for size in -(-(last - first) // step))
    row, column = (int(index) for index in first)
    return Window(left + column * cell, top - row * cell, cell * step, nx, ny, step, row, column)


def _names(result: xr.Dataset) -> list[str]:
    return [name for name, variable in result.data_vars.items() if variable.dims == ("y", "x")]


def map_notes(result: xr.Dataset, terrain: Terrain | None) -> list[str]:
    """What to know before reading the maps."""
    step = window_of(result).step
    notes = []
    if terrain is None:
        notes.append("The terrain model of the run was not found: there is no relief.")
    if step > 1:
        notes.append(f"Each dot shows the greatest value of {step} x {step} cells of the raster.")
    return notes


def maps(result: xr.Dataset, terrain: Terrain | None) -> Iterator[str]:
    """Each map of a result as HTML, the one of the stops first."""
    window = window_of(result)
    drawn = _shapes(result, window)
    relief = _relief(terrain, window)
    yield _figure(
        window, "Where boulders end", relief + _ways(result, window) + drawn, _key(result)
    )
    again = '<use href="#relief"/>' if relief else ""
    for name in _names(result):
        layer, legend, about = _layer(result, name, window)
        title = str(result[name].attrs["long_name"])
        title = title[0].upper() + title[1:]
        if note := map_note(result, name):
            legend += f'\n<p class="legend">{escape(note)}</p>'
        yield _figure(window, title, again + layer + drawn, legend, about)


def blocks_max(values: np.ndarray, window: Window) -> np.ndarray:
    """The raster in cells of the picture: the greatest of each block, NaN where there is none."""
    step = window.step
    part = values[window.row :, window.column :][: window.ny * step, : window.nx * step]
    return merged(part, step, np.fmax).astype("f4")


def _layer(result: xr.Dataset, name: str, window: Window) -> tuple[str, str, str]:
    """The coloured cells of a map, its legend, and attributes with its numbers for the script."""
    from matplotlib import colormaps

    unit, scale = _unit(result[name])
    values = blocks_max(result[name].values, window)
    values[~(values > of_none(result, name))] = np.nan  # no boulder: nothing is drawn
    values *= np.float32(scale)
    some = values[np.isfinite(values)]
    about = f'data-unit="{escape(unit)}" data-values="{_packed(values)}"'
    if not some.size:
        return "", '<p class="legend">No cell has a value.</p>', about
    norm, ticks = _scale(some)
    colours = (colormaps["viridis_r"](np.linspace(0, 1, 255))[:, :3] * 255).round().astype("u1")
    index = np.where(np.isfinite(values), 1 + 254 * np.clip(norm(values).filled(0), 0, 1), 0)
    content = _png(index.astype("u1"), np.vstack([[[255, 255, 255]], colours]).astype("u1"))
    layer = _image(content, 0, 0, window.nx, window.ny, ' class="layer"')
    return layer, _bar(colours, norm, ticks, unit), about


def _unit(variable: xr.DataArray) -> tuple[str, float]:
    """The unit in which a map is shown, and the factor that brings it there."""
    unit = str(variable.attrs["units"])
    if unit == "1":
        return ("boulders", 1.0) if variable.dtype.kind in "iu" else ("%", 100.0)
    return UNITS.get(unit, (unit, 1.0))


def _scale(some: np.ndarray) -> tuple[Normalize, list[float]]:
    """From values to 0..1, by their logarithm where they span more than two powers of ten, and
    round numbers for the legend."""
    from matplotlib.colors import LogNorm, Normalize
    from matplotlib.ticker import LogLocator, MaxNLocator

    low, high = float(some.min()), float(some.max())
    if high > 100 * low:
        norm, ticks = LogNorm(low, high, clip=True), LogLocator(numticks=5).tick_values(low, high)
    else:
        norm, ticks = Normalize(0, high, clip=True), MaxNLocator(4).tick_values(0, high)
    return norm, [float(t) for t in ticks if norm.vmin <= t <= 1.0001 * high]


def _bar(colours: np.ndarray, norm: Normalize, ticks: list[float], unit: str) -> str:
    """The legend of a map: colours, and round numbers where they belong."""
    stops = ", ".join("#" + bytes(c).hex() for c in colours[:: len(colours) // 12])
    marks = "".join(
        f'<span style="left:{100 * float(norm(tick)):.1f}%">{tick:,g}</span>' for tick in ticks
    )
    return (
        f'<div class="legend"><div class="bar" style="background:linear-gradient(90deg,{stops})">'
        f'</div><div class="ticks">{marks}</div><div>[{escape(unit)}]</div></div>'
    )


def _packed(values: np.ndarray) -> str:
    """Numbers of the cells, to five digits, compressed, as text (little-endian float32)."""
    bits = np.ascontiguousarray(values, "<f4").view("<u4")
    known = np.isfinite(values)
    bits = np.where(known, (bits + 0x40) & ~np.uint32(0x7F), np.uint32(0x7FC00000))
    return base64.b64encode(zlib.compress(bits.astype("<u4").tobytes(), 9)).decode()


def _relief(terrain: Terrain | None, window: Window) -> str:
    """The shaded relief of the terrain as a picture."""
    if terrain is None:
        return ""
    z, grid = terrain
    left, top = (window.west - grid.west) / grid.cell, (grid.north - window.north) / grid.cell
    wide, high = (cells * window.cell / grid.cell for cells in (window.nx, window.ny))
    rows = slice(max(0, int(top)), max(0, int(np.ceil(top + high))))
    columns = slice(max(0, int(left)), max(0, int(np.ceil(left + wide))))
    step = max(1, int(window.cell / grid.cell + 0.5))
    z = np.asarray(z[rows, columns][::step, ::step], "f8")
    if min(z.shape) < 2:
        return ""
    dots = (255 * shade(z, grid.cell * step)).astype("u1")
    x, y = grid.west + columns.start * grid.cell, grid.north - rows.start * grid.cell
    (corner,) = window.place(np.array([x]), np.array([y]))
    size = np.array([z.shape[1], z.shape[0]]) * step * grid.cell / window.cell
    return _image(_png(dots), *corner, *size, ' id="relief"')


def _png(index: np.ndarray, colours: np.ndarray | None = None) -> bytes:
    """A picture of grey levels, or of colours by number, of which number 0 is clear."""
    from PIL import Image

    image, about = Image.fromarray(index), {}
    if colours is not None:
        image.putpalette(colours.tobytes())
        about = {"transparency": 0}
    buffer = io.BytesIO()
    image.save(buffer, "PNG", optimize=True, **about)
    return buffer.getvalue()


def _image(content: bytes, x: float, y: float, wide: float, high: float, about: str) -> str:
    return (
        f'<image{about} href="{data_uri(content, "image/png")}" x="{x:.6g}" y="{y:.6g}" '
        f'width="{wide:.6g}" height="{high:.6g}" preserveAspectRatio="none"/>'
    )


def _shapes(result: xr.Dataset, window: Window) -> str:
    """Evaluation lines with their names, and releases."""
    shapes = []
    if "line_vertex_line" in result:
        vertices = window.place(result["line_vertex_x"].values, result["line_vertex_y"].values)
        owner = result["line_vertex_line"].values
        for k, name in enumerate(result["line"].values):
            shapes.append(_path("line", [vertices[owner == k]]))
            shapes.append(_label(str(name), vertices[owner == k], window))
    start = np.column_stack([result["start_x"].values, result["start_y"].values])
    start = np.unique(start, axis=0)
    start = start[:: -(-len(start) // MOST_POINTS)]
    shapes.append(_path("start", [[point] for point in window.place(*start.T)]))
    return "".join(shapes)


def _label(name: str, way: np.ndarray, window: Window) -> str:
    """The name of a line where it first lies within the window."""
    at = first_inside(*way.T, (0, window.nx, 0, window.ny))
    if at is None:
        return ""
    above = "-.3em" if at[1] > 0.05 * window.ny else "1em"  # or below, near the upper edge
    return f'<text x="{at[0]:.6g}" y="{at[1]:.6g}" dx=".3em" dy="{above}">{escape(name)}</text>'


def _ways(result: xr.Dataset, window: Window) -> str:
    """Trajectories, and ends of boulders, of many the first of each so many."""
    ways = ""
    if "trajectory_boulder" in result:
        cuts = np.flatnonzero(np.diff(result["trajectory_boulder"].values)) + 1
        vertices = window.place(result["trajectory_x"].values, result["trajectory_y"].values)
        ways = _path("way", np.split(vertices, cuts)[:MOST_WAYS])
    x, y = result["stop_x"].values, result["stop_y"].values
    every = -(-x.size // MOST_POINTS)
    return ways + _path("stop", [[point] for point in window.place(x[::every], y[::every])])


def _path(kind: str, ways: list) -> str:
    """Lines, or dots for those of one point, as one path of two decimals."""
    text = "".join(
        "M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in way) + ("h0" if len(way) == 1 else "")
        for way in ways
    )
    return f'<path class="{kind}" d="{text}"/>'


def _key(result: xr.Dataset) -> str:
    """What the shapes of the first map are."""
    every = -(-result.sizes["boulder"] // MOST_POINTS)
    stops = "ends of boulders" + (f" (one of {every} is drawn)" if every > 1 else "")
    shapes = [("start", "M12 5h0", "release"), ("stop", "M12 5h0", stops)]
    if "trajectory_boulder" in result:
        shapes.append(("way", "M0 5h24", "recorded trajectories"))
    if "line_vertex_line" in result:
        shapes.append(("line", "M0 5h24", "evaluation lines"))
    return '<ul class="key">{}</ul>'.format(
        "".join(
            f'<li><svg viewBox="0 0 24 10" aria-hidden="true"><path class="{kind}" d="{d}"/></svg>'
            f"{escape(name)}</li>"
            for kind, d, name in shapes
        )
    )


def _figure(window: Window, title: str, content: str, legend: str, about: str = "") -> str:
    """A map with its buttons, legend and the line that says what is under the pointer."""
    return (
        f'<figure class="map">\n<figcaption><b>{escape(title)}</b></figcaption>\n'
        f'<svg viewBox="0 0 {window.nx} {window.ny}" tabindex="0" role="application" '
        f'aria-label="Map: {escape(title)}. Plus and minus zoom, arrows move, 0 shows all." '
        f'style="aspect-ratio:{window.nx}/{window.ny}" data-west="{window.west!r}" '
        f'data-north="{window.north!r}" data-cell="{window.cell!r}" {about}>{content}</svg>\n'
        '<div class="tools"><button type="button" data-zoom="2" aria-label="Zoom in">+</button>'
        '<button type="button" data-zoom="0.5" aria-label="Zoom out">−</button>'
        '<button type="button" data-zoom="0" aria-label="Show all">all</button>'
        f'<output aria-live="polite"></output></div>\n{legend}\n</figure>'
    )
