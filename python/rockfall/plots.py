# SPDX-License-Identifier: BSD-3-Clause
"""Figures of a result, made for print and for readers who see colours differently."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

    from rockfall.grid import Grid

    Box = tuple[slice, slice]  # rows and columns of the raster
    Reference = Mapping[tuple[str, str, str], tuple[float, float]]

BLUE, VERMILION, INK, GREY = "#0072B2", "#D55E00", "#222222", "#8A8A8A"  # Okabe and Ito (2008)
OURS = {"marker": "o", "markersize": 4.5, "linewidth": 1}
PAPER = {"marker": "o", "markersize": 4.5, "markerfacecolor": "white", "linewidth": 1}
METHODS = {"A": BLUE, "B": VERMILION}
OUTLINE = {"A": ((0, (4, 3)), 1.2), "B": ("-", 1.6)}  # both are seen where they coincide
QUANTITIES = [("speed", "speed", "m/s"), ("passing_height", "passing height", "m")]
FLIGHT = {"color": BLUE, "linewidth": 0.5, "alpha": 0.6}  # one of many trajectories
CUT = {"color": INK, "linewidth": 0.9, "linestyle": (0, (5, 2))}  # an evaluation line
DOTS = 1500  # along the longer side of a map; its picture has fewer
STYLE = {
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
    "savefig.dpi": 200,
}


def overview(
    result: xr.Dataset, dem: np.ndarray, grid: Grid, path: str | Path, gravity: float = 9.81
) -> None:
    """Write a picture of a run: the map; beside it profile, jump heights and how far boulders come.

    `dem` is (ny, nx) [m] on `grid`. Passages, lines and trajectories are drawn where `result` has
    them; without trajectories there is no profile. Distances are plan distances from the start of
    each boulder, in a straight line.
    """
    import matplotlib.pyplot as plt

    box = _reached(result, grid)
    flights = _flights(result, dem, grid, gravity)
    z = dem[box]
    tall = [*_heights(result, float(np.nanmax(z) - np.nanmin(z))), 1.1] if flights else [3.0]
    high = sum(tall) + 1.6
    broad = float(np.clip((high - 1.5) * z.shape[1] / z.shape[0], 1.9, 6.0))  # the map [inch]
    with plt.rc_context(STYLE):
        figure = plt.figure(figsize=(broad + 7.2, high), layout="constrained")
        figure.get_layout_engine().set(w_pad=0.06, h_pad=0.05, wspace=0, hspace=0)
        left, right = figure.add_gridspec(1, 2, width_ratios=[broad + 0.7, 6.5])
        panels = right.subgridspec(len(tall), 1, height_ratios=tall).subplots(
            sharex=True, squeeze=False
        )[:, 0]
        _map(figure.add_subplot(left), result, dem, grid, box)
        if flights:
            _profile(panels[0], flights)
            _jumps(panels[1], flights)
        _reach(panels[-1], result)
        _mark_lines(panels, result)
        panels[0].text(
            *(0.99, 0.97, _summary(result)),
            **{"ha": "right", "va": "top", "linespacing": 1.6, "transform": panels[0].transAxes},
        )
        figure.savefig(path)
        plt.close(figure)


def line_figure(
    result_a: xr.Dataset, result_b: xr.Dataset, reference: Reference, path: str | Path
) -> None:
    """Write the distributions of speed and passing height at each line, by methods A and B.

    `reference` holds printed values to set beside them: (line, method, quantity) -> (mean, standard
    deviation), with method A, B or observed, and quantity speed or passing_height.
    """
    import matplotlib.pyplot as plt

    results = {"A": result_a, "B": result_b}
    names = [str(name) for name in result_a["line"].values]
    with plt.rc_context(STYLE):
        figure = plt.figure(figsize=(4.4 * len(names), 6.4), layout="constrained")
        figure.get_layout_engine().set(wspace=0.05)
        for block, (quantity, label, unit) in zip(
            figure.add_gridspec(2, 1), QUANTITIES, strict=True
        ):
            axes = block.subgridspec(2, len(names), height_ratios=[2.2, 1], hspace=0).subplots(
                sharex=True, sharey="row", squeeze=False
            )
            limit, width = _bins(results.values(), quantity)
            for k, name in enumerate(names):
                values = {m: r[f"line_{quantity}"].values[k] for m, r in results.items()}
                printed = {m: reference.get((name, m, quantity)) for m in (*METHODS, "observed")}
                _shares(axes[0, k], values, limit, width)
                _means(axes[1, k], values, printed)
                axes[0, k].set_title(f"{label.capitalize()} at {name}")
                axes[1, k].set_xlabel(f"{label} [{unit}]")
            axes[0, 0].set_ylim(0, 1.3 * axes[0, 0].get_ylim()[1])  # room for the legend
            axes[0, 0].set_ylabel(f"boulders [% in {width:g} {unit}]")
        figure.legend(handles=_key(), loc="outside lower center", ncols=3)
        figure.savefig(path)
        plt.close(figure)


def _heights(result: xr.Dataset, relief: float) -> tuple[float, float]:
    """Heights [inch] of a profile of `relief` [m] at true scale, and of the panel below it."""
    furthest = np.max(_from_start(result, result["stop_x"].values, result["stop_y"].values))
    return float(np.clip(6.2 * relief / max(furthest, 1.0), 1.2, 5.0)), 1.5


# The map


def _reached(result: xr.Dataset, grid: Grid) -> Box:
    """The part of the raster that boulders reached, with a margin, no finer than the picture."""
    x = np.concatenate([result["start_x"].values, result["stop_x"].values])
    y = np.concatenate([result["start_y"].values, result["stop_y"].values])
    column, row = (x - grid.west) / grid.cell, (grid.north - y) / grid.cell
    passed = _reach_map(result)
    if passed is not None:
        rows, columns = np.nonzero(passed)
        column, row = np.concatenate([column, columns]), np.concatenate([row, rows])
    longest = max(np.ptp(row), np.ptp(column))
    margin, step = 3 + 0.06 * longest, int(longest / DOTS) + 1

    def span(index: np.ndarray, size: int) -> slice:
        first, last = index.min() - margin, index.max() + 1 + margin
        return slice(max(int(first), 0), min(int(last), size), step)

    return span(row, grid.ny), span(column, grid.nx)


def _map(axes: Axes, result: xr.Dataset, dem: np.ndarray, grid: Grid, box: Box) -> None:
    """Shaded relief with contours, reach probability, trajectories, stops and lines."""
    from matplotlib.patheffects import withStroke
    from matplotlib.ticker import MaxNLocator

    x, y, z = grid.x[box[1]], grid.y[box[0]], dem[box].astype("f8")
    cell = grid.cell * box[0].step
    half = cell / 2
    extent = (x[0] - half, x[-1] + half, y[-1] - half, y[0] + half)
    picture = np.repeat(_shade(z, cell)[..., None], 3, axis=2)
    reach = _reach_map(result)
    if reach is not None:
        reach = reach[box]
        picture = _tint(axes, picture, reach)
        axes.contour(x, y, reach, [0.01], colors=INK, linewidths=0.9)
    axes.imshow(picture, extent=extent, interpolation="nearest")
    interval = _round_step((np.nanmax(z) - np.nanmin(z)) / 12)
    levels = np.arange(np.nanmin(z) // interval + 1, np.nanmax(z) // interval + 1) * interval
    contours = axes.contour(x, y, z, levels, colors=INK, linewidths=0.3, alpha=0.6)
    axes.clabel(contours, levels[::2], fmt="%g", fontsize=6)
    for line in _trajectories(result):
        axes.plot(line["x"], line["y"], color="white", lw=0.3, alpha=0.6)
    size = float(np.clip(60 / np.sqrt(result.sizes["boulder"]), 1.5, 6))
    axes.plot(result["stop_x"], result["stop_y"], ".", ms=size, mew=0, color=VERMILION, alpha=0.6)
    axes.plot(result["start_x"], result["start_y"], "^", ms=6, mfc="white", mec=INK, mew=0.8)
    halo = [withStroke(linewidth=2, foreground="white")]
    for name, line_x, line_y in _lines(result):
        axes.plot(line_x, line_y, **CUT)
        at = _first_inside(line_x, line_y, extent)
        if at is not None:
            axes.annotate(name, at, (3, 2), textcoords="offset points", path_effects=halo)
    axes.set(xlim=extent[:2], ylim=extent[2:], xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.set_title("Reach, and where boulders stop")
    axes.ticklabel_format(useOffset=False, style="plain")
    axes.xaxis.set_major_locator(MaxNLocator(4, integer=True))
    axes.spines[:].set_visible(True)


def _reach_map(result: xr.Dataset) -> np.ndarray | None:
    """Share of the boulders that passed each cell, where the run made a map of it."""
    if "passages" in result:
        return result["passages"].values / result.sizes["boulder"]
    return result["reach_probability"].values if "reach_probability" in result else None


def _first_inside(x: np.ndarray, y: np.ndarray, extent: tuple) -> tuple[float, float] | None:
    """Where a polyline that is followed from its start lies within west, east, south, north."""
    way = np.linspace(0, x.size - 1, 200 * (x.size - 1) + 1)
    x, y = (np.interp(way, np.arange(c.size), c) for c in (x, y))
    inside = (x >= extent[0]) & (x <= extent[1]) & (y >= extent[2]) & (y <= extent[3])
    k = int(np.argmax(inside))
    return (float(x[k]), float(y[k])) if inside[k] else None


def _shade(z: np.ndarray, cell: float) -> np.ndarray:
    """Brightness of a terrain lit from the north-west, light overall; nodata is white."""
    down, right = np.gradient(z, cell)
    light = (1 - right + down) / np.sqrt(1 + right**2 + down**2)
    dark, bright = np.nanpercentile(light, [1, 99])
    shade = 0.68 + 0.3 * np.clip((light - dark) / max(bright - dark, 1e-9), 0, 1)
    return np.where(np.isnan(shade), 1, shade)


def _tint(axes: Axes, picture: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """The shaded relief, coloured where boulders pass, with the scale below the map."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, LogNorm

    strength = np.linspace(0.45, 1, 256)[:, None]  # rare passages are pale
    colours = ListedColormap(1 - strength * (1 - colormaps["viridis_r"](range(256))[:, :3]))
    norm = LogNorm(1e-3, 1, clip=True)
    bar = axes.figure.colorbar(
        ScalarMappable(norm, colours), ax=axes, location="bottom", aspect=18, pad=0.01, shrink=0.9
    )
    bar.set_ticks([0.001, 0.01, 0.1, 1], labels=["0.1", "1", "10", "100"])
    bar.set_label("boulders that pass [%]; outline: 1 %")
    bar.outline.set_linewidth(0.4)
    tint = colours(norm(np.where(reach > 0, reach, 1)))[..., :3]
    return np.where(reach[..., None] > 0, tint * np.sqrt(picture), picture)


def _round_step(rough: float) -> float:
    """1, 2, 2.5 or 5 times a power of ten, the next above `rough`."""
    power = 10.0 ** np.floor(np.log10(max(rough, 1e-6)))
    return power * next(step for step in (1, 2, 2.5, 5, 10) if step * power >= 0.999 * rough)


def _lines(result: xr.Dataset) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Name, x and y of each evaluation line."""
    if "line_vertex_line" not in result:
        return []
    owner = result["line_vertex_line"].values
    x, y = result["line_vertex_x"].values, result["line_vertex_y"].values
    names = result["line"].values
    return [(str(name), x[owner == k], y[owner == k]) for k, name in enumerate(names)]


# Profile, jump heights and reach, all against the plan distance from the start


class _Flight(NamedTuple):
    """One drawn trajectory as a smooth curve: distance, elevation, ground below [m]."""

    distance: np.ndarray
    z: np.ndarray
    ground: np.ndarray


def _trajectories(result: xr.Dataset) -> list[dict[str, np.ndarray]]:
    """x, y, z, time of each recorded trajectory."""
    if "trajectory_boulder" not in result:
        return []
    owner = result["trajectory_boulder"].values
    cuts = np.flatnonzero(np.diff(owner)) + 1
    parts = {c: np.split(result[f"trajectory_{c}"].values, cuts) for c in ("x", "y", "z", "time")}
    return [dict(zip(parts, part, strict=True)) for part in zip(*parts.values(), strict=True)]


def _flights(result: xr.Dataset, dem: np.ndarray, grid: Grid, gravity: float) -> list[_Flight]:
    """The trajectories with their parabolas: two ends and the time between fix each of them."""
    flights = []
    part = np.linspace(0, 1, 13)[None, :]
    for line in _trajectories(result):
        x, y, z = (line[c][:-1, None] + part * np.diff(line[c])[:, None] for c in ("x", "y", "z"))
        z = z + gravity / 2 * np.diff(line["time"])[:, None] ** 2 * part * (1 - part)
        distance = np.hypot(x - line["x"][0], y - line["y"][0])
        flights.append(_Flight(distance.ravel(), z.ravel(), _height(dem, grid, x, y).ravel()))
    return flights


def _height(dem: np.ndarray, grid: Grid, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Bilinear elevation [m] at points within the cell centres."""
    u = (x - grid.west) / grid.cell - 0.5
    v = (grid.north - y) / grid.cell - 0.5
    i = np.clip(u.astype(int), 0, grid.nx - 2)
    j = np.clip(v.astype(int), 0, grid.ny - 2)
    u, v = u - i, v - j
    north = (1 - u) * dem[j, i] + u * dem[j, i + 1]
    south = (1 - u) * dem[j + 1, i] + u * dem[j + 1, i + 1]
    return (1 - v) * north + v * south


def _profile(axes: Axes, flights: Sequence[_Flight]) -> None:
    """Ground and trajectories at true scale."""
    for flight in flights:
        axes.plot(flight.distance, flight.ground, color=INK, lw=0.8)
        axes.plot(flight.distance, flight.z, **FLIGHT)
    axes.set_title(f"Profile with {_count(len(flights), 'trajectory', 'trajectories')}, true scale")
    axes.set_ylabel("elevation [m]")
    axes.set_aspect("equal", adjustable="datalim")


def _summary(result: xr.Dataset) -> str:
    """Title, number of boulders, how they ended and the share that passes each line."""
    status = result["status"]
    ends = zip(status.attrs["flag_values"], status.attrs["flag_meanings"].split(), strict=True)
    counts = [(end.replace("_", " "), int((status == value).sum())) for value, end in ends]
    text = [result.attrs.get("title", ""), _count(result.sizes["boulder"], "boulder", "boulders")]
    text += [f"{count:,} {end}" for end, count in counts if count]
    for k, (name, _, _) in enumerate(_lines(result)):
        text.append(f"{np.isfinite(result['line_x'].values[k]).mean():.1%} pass {name}")
    return "\n".join(text)


def _count(number: int, one: str, many: str) -> str:
    return f"{number:,} {one if number == 1 else many}"


def _jumps(axes: Axes, flights: Sequence[_Flight]) -> None:
    for flight in flights:
        axes.plot(flight.distance, flight.z - flight.ground, **FLIGHT)
    axes.set_title("Their height above the ground")
    axes.set(ylabel="jump height [m]", ylim=(0, None))


def _reach(axes: Axes, result: xr.Dataset) -> None:
    distance = np.sort(_from_start(result, result["stop_x"].values, result["stop_y"].values))
    share = 100 * np.arange(distance.size, 0, -1) / distance.size
    axes.fill_between(
        np.append(0, distance), np.append(100, share), step="pre", color=BLUE, alpha=0.2, lw=0
    )
    axes.step(np.append(0, distance), np.append(100, share), color=BLUE, lw=1)
    axes.set_title("Boulders that come at least this far")
    axes.set(ylabel="boulders [%]", xlabel="plan distance from the start [m]")
    axes.set(ylim=(0, 105), xlim=(0, 1.03 * distance[-1]))


def _mark_lines(panels: Sequence[Axes], result: xr.Dataset) -> None:
    """The lines in all panels, where half of the boulders that cross them do so nearer."""
    for k, (name, _, _) in enumerate(_lines(result)):
        x, y = result["line_x"].values[k], result["line_y"].values[k]
        if np.isnan(x).all():
            continue
        where = np.nanmedian(_from_start(result, x, y))
        for axes in panels:
            axes.axvline(where, **CUT)
        low = panels[0].get_xaxis_transform()
        panels[0].text(where, 0.02, f" {name}", transform=low)


def _from_start(result: xr.Dataset, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.hypot(x - result["start_x"].values, y - result["start_y"].values)


# Distributions at the lines


def _bins(results: Iterable[xr.Dataset], quantity: str) -> tuple[float, float]:
    """End of the axis, above all but one boulder in 500, and a round width of classes below it."""
    values = np.concatenate([r[f"line_{quantity}"].values.ravel() for r in results])
    values = values[np.isfinite(values)]
    most = float(np.quantile(values, 0.998)) if values.size else 1.0
    width = _round_step(most / 70)
    return width * np.ceil(most / width), width


def _shares(axes: Axes, values: Mapping[str, np.ndarray], limit: float, width: float) -> None:
    """Shares of all released boulders: what the bars add up to is the share that passes."""
    edges = np.arange(0, limit + width / 2, width)
    for method, v in reversed(values.items()):
        released, v = v.size, v[np.isfinite(v)]
        about = {"weights": np.full(v.size, 100 / released), "color": METHODS[method]}
        about["linestyle"], about["lw"] = OUTLINE[method]
        label = f"method {method}, {v.size / released:.1%} pass"
        axes.hist(v, edges, histtype="stepfilled", alpha=0.2, **{**about, "lw": 0})
        axes.hist(v, edges, histtype="step", label=label, **about)
    axes.set_xlim(0, limit)
    axes.tick_params(axis="x", labelbottom=False)
    axes.legend(loc="upper right", handlelength=1.8, reverse=True)


def _means(
    axes: Axes,
    values: Mapping[str, np.ndarray],
    printed: Mapping[str, tuple[float, float] | None],
) -> None:
    """Means with standard deviations, ours filled and those of the paper open."""
    for row, (method, pair) in enumerate(printed.items()):
        colour = METHODS.get(method, INK)
        v = values.get(method)
        if v is not None and np.isfinite(v).any():
            axes.errorbar(np.nanmean(v), row - 0.16, xerr=np.nanstd(v), color=colour, **OURS)
        if pair:
            where = row + 0.16 * (method in values)
            axes.errorbar(pair[0], where, xerr=pair[1], color=colour, **PAPER)
    axes.set(ylim=(len(printed) - 0.4, -0.6))
    axes.set_yticks(range(len(printed)), [f"method {m}" if m in METHODS else m for m in printed])
    axes.tick_params(axis="y", length=0)


def _key() -> list:
    from matplotlib.lines import Line2D

    return [
        Line2D([], [], color=GREY, label="this run", **OURS),
        Line2D([], [], color=GREY, label="the paper", **PAPER),
        Line2D([], [], color=GREY, label="mean and one standard deviation to each side"),
    ]
