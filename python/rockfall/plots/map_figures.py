# SPDX-License-Identifier: BSD-3-Clause
"""Maps of a result over the shaded relief of its terrain."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from rockfall.io.arrays import grid_of
from rockfall.io.grid import Grid
from rockfall.plots.extent import PASSED, of_none, passed_map, reached
from rockfall.plots.style import (
    BARRIER,
    BLUE,
    GREEN,
    INK,
    LINE,
    NARROW,
    OBSERVED,
    VERMILION,
    WIDE,
    new_figure,
    plain,
    round_step,
    styled,
)
from rockfall.protection.barriers import barriers_of
from rockfall.quantities import SHOWN, with_unit
from rockfall.result.trajectories import ends, lines, trajectories

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    from rockfall.plots.extent import Extent
    from rockfall.result.trajectories import Terrain

DOTS = 1500  # along the longer side of a map; its picture has fewer
MAX_TRAJECTORIES = 200  # drawn
FEW_SOURCES = 20  # fewer are drawn large
LIMIT = 0.01  # pass frequency of the outline (paper, Fig. 10)
TALLEST = 7.2  # of a map [inch]
MARKERS = {  # of each status
    "stopped": (".", VERMILION),
    "absorbed": ("x", BLUE),
    "left_domain": ("^", INK),
    "impact_limit": ("s", INK),
    "hit_nodata": ("+", INK),
    "stopped_by_tree": ("v", GREEN),
    "stopped_by_barrier": ("D", BLUE),
}
COUNTED = {"tree_impacts": "hits"}  # maps that count something else than boulders
PALEST = 0.15  # of the colours: darker than the relief, in grey print too


@styled
def map_figure(
    result: xr.Dataset,
    name: str,
    terrain: Terrain | None = None,
    observed: np.ndarray | None = None,
) -> Figure:
    """A map variable of the result in colours, nothing where no boulder passed; observed stops
    (n, 2).

    Passages and fractions are percentages of all boulders, on one scale for every result, with an
    outline at 1 %. Of a map with more cells than the picture has dots, each dot shows the max of
    its cells.
    """
    figure, axes, extent = _new_map(result, terrain, observed, bar=True)
    _draw_map(axes, result, name, extent)
    _draw_observed(axes, observed)
    _draw_marks(axes, result, extent)
    if observed is not None:
        figure.legend(loc="outside lower center", handletextpad=0.4)
    return figure


@styled
def trajectories_figure(result: xr.Dataset, terrain: Terrain | None = None) -> Figure:
    """Recorded trajectories in plan."""
    figure, axes, extent = _new_map(result, terrain)
    _draw_trajectories(axes, result)
    _draw_marks(axes, result, extent)
    return figure


@styled
def stops_figure(
    result: xr.Dataset, terrain: Terrain | None = None, observed: np.ndarray | None = None
) -> Figure:
    """Where boulders ended, each status with a marker of its own; observed stops (n, 2)."""
    figure, axes, extent = _new_map(result, terrain, observed)
    _draw_stops(axes, result)
    _draw_observed(axes, observed)
    _draw_marks(axes, result, extent)
    key = figure.legend(loc="outside lower center", ncols=2, handletextpad=0.4)
    for handle in key.legend_handles:
        assert handle is not None
        handle.set(markersize=5, alpha=1)
    return figure


def is_fraction(name: str) -> bool:
    """Whether a map is drawn as a fraction of all boulders."""
    return name == "passages" or name.startswith("reach_probability")


def map_note(result: xr.Dataset, name: str) -> str:
    """Where a map is blank though it could say something, and what its numbers rest on."""
    about = result[name].attrs
    notes = [str(about["comment"])] if "comment" in about else []
    if "least_passages" in about:
        notes.append(f"blank where fewer than {about['least_passages']:,} boulders passed")
    if "thin_below" in about:
        notes.append(f"hardly known where fewer than {about['thin_below']:,} boulders passed")
    elif of_none(result, name):
        notes.append(f"blank where none passed; it is {100 * of_none(result, name):.2g} % there")
    return "; ".join(notes)


def thin_cells(result: xr.Dataset, name: str) -> np.ndarray | None:
    """Where (y, x) too few boulders passed for a number of a map to be well known; none if the map
    has no such cells, or the result does not count who passed."""
    fewest, passed = result[name].attrs.get("thin_below", 0), passed_map(result)
    if not fewest or passed is None:
        return None
    count = result[passed].values * (1 if passed == "passages" else result.sizes["boulder"])
    return np.isfinite(result[name].values) & (count < fewest - 0.5)


def shown_as(variable: xr.DataArray) -> tuple[str, float]:
    """The unit in which a map is shown, and the factor from that of the result."""
    units = variable.attrs["units"]
    if variable.dtype.kind in "iu" and units == "1":
        return COUNTED.get(str(variable.name), "boulders"), 1.0
    return SHOWN.get(units, (units, 1.0))


def colours(number: int) -> np.ndarray:
    """The colours of all maps (number, RGBA), dark where values are high."""
    from matplotlib import colormaps

    return colormaps["viridis_r"](np.linspace(PALEST, 1, number))


def norm_of(values: np.ndarray) -> Normalize:
    """From values to 0..1, by their logarithm where most are far from the max."""
    from matplotlib.colors import LogNorm, Normalize

    some = values[np.isfinite(values)]
    if not some.size:
        return Normalize(0, 1)
    if some.max() > 20 * np.quantile(some, 0.25):
        return LogNorm(some.min(), some.max())
    return Normalize(0, some.max())


def _draw_relief(axes: Axes, terrain: Terrain, extent: Extent) -> None:
    """Shaded relief with contours."""
    z, grid = cropped(*terrain, False, extent, np.add)
    draw_image(axes, shade(z, grid.cell), grid, cmap="gray", vmin=0, vmax=1)
    low, high = np.nanmin(z), np.nanmax(z)
    interval = round_step((high - low) / 12)
    levels = np.arange(low // interval + 1, high // interval + 1) * interval
    if high - low > 1e-3 and levels.size:
        shown = np.ma.masked_invalid(z)
        contours = axes.contour(
            grid.x, grid.y, shown, levels, colors=INK, linewidths=0.3, alpha=0.6
        )
        axes.clabel(contours, levels[::2], fmt="%g", fontsize=7)


def _draw_map(axes: Axes, result: xr.Dataset, name: str, extent: Extent) -> None:
    """A map variable in colours, with the scale below."""
    values, grid = cropped(result[name].values, *grid_of(result[name]), extent, np.fmax)
    values = np.where(values > of_none(result, name), values, np.nan).astype(float)
    about = result[name].attrs
    if name in PASSED:
        fraction = values / result.sizes["boulder"] if name == "passages" else values
        _draw_fraction(axes, fraction, grid, "boulders that pass [%]")
    elif is_fraction(name):
        _draw_fraction(axes, values, grid, fill(f"{about['long_name']} [%]", 46))
    else:
        unit, factor = shown_as(result[name])
        fewest = about.get("least_passages", 0)
        blank = f"; blank: fewer than {fewest} passed" if fewest else ""
        label = fill(with_unit(about["long_name"], unit) + blank, 46)
        _draw_values(axes, factor * values, grid, norm_of(factor * values), label)
        thin = thin_cells(result, name)
        if thin is not None:
            part, grid = cropped(thin, *grid_of(result[name]), extent, np.logical_and)
            _hatch(axes, (part > 0) & np.isfinite(values), grid)


def _draw_trajectories(axes: Axes, result: xr.Dataset) -> None:
    """Recorded trajectories in plan, some of very many."""
    from matplotlib.collections import LineCollection

    curves = [np.column_stack([one.x, one.y]) for one in trajectories(result, MAX_TRAJECTORIES)]
    about: dict[str, Any] = {"colors": VERMILION, "linewidths": 0.5, "alpha": 0.7}
    axes.add_collection(LineCollection(curves, rasterized=True, **about), autolim=False)


def _draw_stops(axes: Axes, result: xr.Dataset) -> None:
    """Where boulders ended, each status with a marker of its own."""
    size = float(np.clip(90 / np.sqrt(result.sizes["boulder"]), 2, 6))
    for name, here in ends(result).items():
        if here.any():
            marker, colour = MARKERS[name]
            x, y = result["stop_x"].values[here], result["stop_y"].values[here]
            about: dict[str, Any] = {"markersize": size * (1 if marker == "." else 1.2)}
            about |= {"markeredgewidth": 0.6 if marker in "x+" else 0}
            label = f"{name.replace('_', ' ')} ({here.sum():,})"
            axes.plot(x, y, marker, color=colour, label=label, alpha=0.7, rasterized=True, **about)


def shade(z: np.ndarray, cell: float) -> np.ndarray:
    """Brightness of a terrain lit from the north-west, light overall; nodata is white."""
    down, right = np.gradient(z, cell)
    light = (1 - right + down) / np.sqrt(1 + right**2 + down**2)
    dark, bright = np.nanpercentile(light, [1, 99])
    shade = 0.8 + 0.2 * np.clip((light - dark) / max(bright - dark, 1e-9), 0, 1)
    return np.where(np.isnan(shade), 1, shade)


def _new_map(
    result: xr.Dataset, terrain: Terrain | None, *places: Any, bar: bool = False
) -> tuple[Figure, Axes, Extent]:
    """A figure of all that boulders reached, with the relief in it."""
    extent = reached(result, terrain, *places)
    return *new_map(extent, terrain, 1.5 if bar else 1.2), extent


def new_map(extent: Extent, terrain: Terrain | None, below: float) -> tuple[Figure, Axes]:
    """A figure as wide as a column, or as a page for a broad map, with room [inch] below it."""
    aspect = (extent[3] - extent[2]) / (extent[1] - extent[0])
    width = NARROW if aspect > 0.8 else WIDE
    tall = min(aspect * (width - 0.85), TALLEST)
    figure = new_figure(width, tall + below)
    axes = figure.add_subplot()
    if terrain is not None:
        _draw_relief(axes, terrain, extent)
    return figure, axes


def cropped(
    values: np.ndarray, grid: Grid, flipped: bool, extent: Extent, merge: np.ufunc
) -> tuple[np.ndarray, Grid]:
    """The part of a raster within an extent, no finer than the picture: where several cells make
    one, `merge` says how (np.add: their mean)."""
    values = values[::-1] if flipped else values
    west, east, south, north = extent
    columns = _span(west - grid.west, east - grid.west, grid.cell, grid.nx)
    rows = _span(grid.north - north, grid.north - south, grid.cell, grid.ny)
    part = values[rows, columns]
    step = int(max(part.shape) / DOTS) + 1
    sizes = merged(np.ones_like(part), step, np.add) if merge is np.add else 1
    part = merged(part, step, merge) / sizes
    west, north = grid.west + columns.start * grid.cell, grid.north - rows.start * grid.cell
    return part, Grid(west, north, grid.cell * step, part.shape[1], part.shape[0])


def merged(values: np.ndarray, step: int, merge: np.ufunc) -> np.ndarray:
    """A raster with `step` x `step` cells merged to one, fewer at its southern and eastern edge."""
    for axis in (0, 1) if step > 1 else ():
        values = merge.reduceat(values, np.arange(0, values.shape[axis], step), axis=axis)
    return values


def _span(first: float, last: float, cell: float, size: int) -> slice:
    """Cells between two distances [m] from the edge of a raster, at least two of them."""
    start = int(np.clip(first // cell, 0, size - 2))
    return slice(start, int(np.clip(np.ceil(last / cell), start + 2, size)))


def draw_image(axes: Axes, values: np.ndarray, grid: Grid, **about: Any) -> None:
    """A raster where its cells lie."""
    extent = (grid.west, grid.east, grid.south, grid.north)
    axes.imshow(values, extent=extent, interpolation="nearest", **about)


def _draw_fraction(axes: Axes, fraction: np.ndarray, grid: Grid, label: str) -> None:
    """Fractions of the boulders, 0.1 to 100 % on one scale for all results, and the 1 % limit."""
    from matplotlib.colors import LogNorm

    norm = LogNorm(0.1, 100, clip=True)
    bar = _draw_values(axes, 100 * fraction, grid, norm, f"{label}; outline: 1 %")
    bar.set_ticks([0.1, 1, 10, 100], labels=["0.1", "1", "10", "100"])
    _draw_outline(axes, np.nan_to_num(fraction) >= LIMIT, grid)


def _draw_outline(axes: Axes, inside: np.ndarray, grid: Grid) -> None:
    """The edges between cells that are inside and cells that are not."""
    from matplotlib.collections import LineCollection

    inside = np.pad(inside, 1)
    row, column = np.nonzero(inside[:, 1:] != inside[:, :-1])
    upright = np.stack([[column, row - 1], [column, row]])
    row, column = np.nonzero(inside[1:] != inside[:-1])
    level = np.stack([[column - 1, row], [column, row]])
    edges = np.concatenate([upright, level], axis=2).transpose(2, 0, 1)  # (edges, ends, x and y)
    places = (grid.west, grid.north) + edges * (grid.cell, -grid.cell)
    axes.add_collection(
        LineCollection(list(places), colors=INK, linewidths=0.9, capstyle="round", rasterized=True),
        autolim=False,
    )


def _hatch(axes: Axes, cells: np.ndarray, grid: Grid) -> None:
    """Lines over cells whose numbers are hardly known."""
    from matplotlib import rc_context

    if cells.any():
        with rc_context({"hatch.linewidth": 0.4, "hatch.color": INK}):
            axes.contourf(grid.x, grid.y, cells, [0.5, 1], colors="none", hatches=["//////"])


def _draw_values(axes: Axes, values: np.ndarray, grid: Grid, norm: Normalize, label: str) -> Any:
    """Values in colours that let the relief through; their scale."""
    from matplotlib.colors import ListedColormap, LogNorm
    from matplotlib.ticker import MaxNLocator

    draw_image(axes, values, grid, norm=norm, cmap=ListedColormap(colours(256)), alpha=0.85)
    bar = axes.figure.colorbar(
        axes.images[-1], ax=axes, location="bottom", pad=0.01, shrink=0.95,
        aspect=45 if _page_width(axes) == WIDE else 22,
    )  # fmt: skip
    if isinstance(norm, LogNorm):
        bar.ax.xaxis.set_major_formatter("{x:g}")
    else:
        bar.ax.xaxis.set_major_locator(MaxNLocator(6))
    bar.set_label(label)
    bar.outline.set_linewidth(0.4)
    return bar


def _draw_observed(axes: Axes, stops: np.ndarray | None) -> None:
    if stops is not None:
        label = f"observed stop ({len(stops):,})"
        axes.plot(*np.transpose(stops), **OBSERVED | {"linestyle": "", "label": label})


def _draw_marks(axes: Axes, result: xr.Dataset, extent: Extent) -> None:
    """Where boulders start, evaluation lines and barriers, and the frame of a map."""
    from matplotlib.patheffects import withStroke

    start = np.unique(np.stack([result["start_x"].values, result["start_y"].values]), axis=1)
    if start.shape[1] < FEW_SOURCES:
        axes.plot(*start, "^", ms=6, mfc="white", mec=INK, mew=0.8)
    else:  # markers would hide each other and the map
        axes.plot(*start, ".", ms=1.2, mew=0, color=INK, alpha=0.6, rasterized=True)
    halo = [withStroke(linewidth=2, foreground="white")]
    barriers = barriers_of(result)
    for k, (name, x, y) in enumerate(lines(result)):
        axes.plot(x, y, **(BARRIER if k in barriers else LINE))
        at = first_inside(x, y, extent)
        if at is not None:
            about: dict[str, Any] = {"path_effects": halo, "clip_on": True}
            axes.annotate(plain(name), at, (3, 2), textcoords="offset points", **about)
    draw_frame(axes, extent)


def draw_frame(axes: Axes, extent: Extent) -> None:
    """The frame of a map, with its scales."""
    from matplotlib.ticker import MaxNLocator

    axes.set(xlim=extent[:2], ylim=extent[2:], xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.ticklabel_format(useOffset=False, style="plain")
    ticks = 3 if _page_width(axes) == NARROW else 6
    axes.xaxis.set_major_locator(MaxNLocator(ticks, integer=True))
    axes.spines[:].set_visible(True)


def _page_width(axes: Axes) -> float:
    """Of the figure that a map is in [inch]; none is in a part of one."""
    return cast("Figure", axes.figure).get_figwidth()


def first_inside(x: np.ndarray, y: np.ndarray, extent: Extent) -> tuple[float, float] | None:
    """Where a polyline that is followed from its start lies within an extent."""
    along = np.linspace(0, x.size - 1, 200 * (x.size - 1) + 1)
    x, y = (np.interp(along, np.arange(c.size), c) for c in (x, y))
    inside = (x >= extent[0]) & (x <= extent[1]) & (y >= extent[2]) & (y <= extent[3])
    k = int(np.argmax(inside))
    return (float(x[k]), float(y[k])) if inside[k] else None
