# SPDX-License-Identifier: BSD-3-Clause
"""Draw the figures of the README and of the concept pages, with the program's own functions.

    python tools/page_figures.py [-o docs/figures] [--boulders 10000]

Writes vaujany.png (the README's slope by the default impact set), impact.png, table_bins.png,
strength.png and return_periods.png: less than 100 kB each, legible in grey. Takes half a minute.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.patches import Circle
from PIL import Image

import rockfall
from rockfall.analysis.planes.plane_bounce import set_rebound
from rockfall.grounds.impact_tables import FIELDS, open_table, plane_files
from rockfall.io.atomic import atomic_write
from rockfall.io.rasters.dem import read_dem
from rockfall.plots.figures import figures
from rockfall.plots.style import BLUE, GREY, INK, VERMILION, new_figure, save, styled
from rockfall.result.crossings import has_crossed
from rockfall.scene.rebounds.sets import read_sets

ROOT = Path(__file__).resolve().parents[1]
VAUJANY = ROOT / "cases/vaujany/case.nml"
GROUNDS = ROOT / "python/rockfall/data/grounds.csv"
COLOURS = 64  # number of colours of a stored picture
TALL = 800  # height of the README's picture [pixels]
ARROW: dict[str, Any] = {"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, "mutation_scale": 9}
#: Block sizes by scenario, for the return-period curve.
SCENARIOS = [
    {"name": "blocks", "return_period": 5.0, "volume": "lognormal", "volume_mean": 0.3,
     "volume_std": 0.2},
    {"name": "large blocks", "return_period": 60.0, "volume": "uniform", "volume_min": 1.0,
     "volume_max": 4.0},
]  # fmt: skip


def slope(boulders: int, **groups: Any) -> rockfall.Case:
    """Case of cases/vaujany with this number of boulders per source and changed `groups`."""
    return rockfall.read_case(VAUJANY).replace(case={"boulders": boulders}, **groups)


def overview(boulders: int) -> Image.Image:
    """Draw map and profile of the slope by the default impact set, side by side."""
    result = rockfall.run(slope(boulders, impact={"sets": "vaujany-observed", "ratio": "between"}))
    drawn = {one.name: one for one in figures(result, read_dem(VAUJANY.parent / "dem.tif"))}
    parts = []
    with tempfile.TemporaryDirectory() as folder:
        for name in ("pass_frequency", "profile"):
            save(drawn[name].draw(), path := Path(folder) / f"{name}.png", dpi=200)
            picture = Image.open(path).convert("RGB")
            parts.append(picture.resize((round(picture.width * TALL / picture.height), TALL)))
    parts[0] = without_scale(parts[0])
    both = Image.new("RGB", (sum(part.width for part in parts), TALL), "white")
    for part, left in zip(parts, (0, parts[0].width), strict=True):
        both.paste(part, (left, 0))
    return both


def without_scale(sheet: Image.Image) -> Image.Image:
    """Crop a map and its key: without the scale and the blank margins, but with the axis."""
    sheet.paste("white", (0, round(0.825 * TALL), sheet.width, round(0.91 * TALL)))
    return sheet.crop((round(0.29 * sheet.width), 0, round(0.75 * sheet.width), TALL))


@styled
def impact(boulders: int):
    """Draw velocities in the local frame: one impact, and rebounds drawn from its set."""
    sets = read_sets("vaujany-observed")[0]
    v_in = np.array([12.0, -6.0, 8.0])
    rebound = set_rebound(sets.mean[2], sets.covariance[2])
    out = rebound(np.tile(v_in, (400, 1)), np.random.default_rng(1))
    figure = new_figure(6.0, 2.9)
    axes = figure.subplots()
    axes.axhspan(-3.5, -1, color=GREY, alpha=0.25, lw=0)
    axes.axhline(-1, color=GREY, lw=0.8)
    axes.text(-14.5, -2.6, "ground (mean surface)", color=INK)
    axes.add_patch(Circle((0, 0), 1, fill=False, color=INK, lw=1.2))
    axes.plot(out[:, 0], out[:, 1], ".", ms=2, color=GREY, label="400 rebounds drawn")
    for tail, tip, colour, name, place in (
        ((-v_in[0], -v_in[1]), (0, 0), BLUE, "impact $V$", (-13.6, 6.6)),
        ((0, 0), out.mean(axis=0)[:2], VERMILION, "mean rebound $V'$", (3.4, 0.3)),
        ((0, 0), (0, 8), INK, "$V_n$, normal", (0.3, 7.4)),
        ((0, 0), (17, 0), INK, "$V_t$, along the ground", (10.6, -0.9)),
    ):
        wide = 0.8 if colour == INK else 1.8
        axes.annotate("", tip, tail, arrowprops={**ARROW, "color": colour, "lw": wide})
        axes.text(*place, name, color=colour)
    turn = {**ARROW, "color": INK, "lw": 1.0, "connectionstyle": "arc3,rad=-0.4"}
    axes.annotate("", (1.6, -0.4), (0.3, 1.5), arrowprops=turn)
    axes.text(0.5, 1.8, "$W = R_b\\,\\omega$", color=INK)
    axes.legend(loc="upper right", markerscale=4)
    axes.set(xlim=(-15, 17.5), ylim=(-3.5, 8.3), aspect="equal", xlabel="along the ground [m/s]",
             ylabel="normal [m/s]")  # fmt: skip
    return figure


@styled
def table_bins(boulders: int):
    """Draw flight contacts from one part of a table, and the bins of their first two keys."""
    table = open_table(plane_files("ploughed", "compact")[11.5])
    part = len(table.size) // 2
    counts = table.bins["flight"]
    begin = part * (len(table.first) - 1) // len(table.size)
    record = table.record[table.first[begin] : table.first[begin + int(np.prod(counts))]]
    v_t, v_n, w = (record[:, FIELDS.index(name)] for name in ("vt_in", "vn_in", "w_in"))
    speed = np.hypot(v_t, v_n)
    first, second = (table.edges[f"flight_edge_{key}"][part] for key in (1, 2))
    borders = [0.0, *np.sqrt(first), 1.0]  # the key is the squared value
    low, high = 0.4, 1.1
    figure = new_figure(6.0, 3.0)
    axes = figure.subplots()
    axes.scatter(np.abs(v_n) / speed, w / speed, s=2.5, color=GREY, lw=0, label="recorded impacts")
    axes.vlines(borders[1:-1], low, high, color=INK, lw=1.0, label="first key: $(V_n/V)^2$")
    for column, edges in enumerate(second):
        axes.hlines(edges, *borders[column : column + 2], color=BLUE, lw=1.6, ls="-",
                    label=None if column else "second key: $W/V$")  # fmt: skip
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3, markerscale=3)
    axes.set(xlim=(0, 0.5), ylim=(low, high), xlabel="$|V_n|/V$, sine of the impact angle",
             ylabel="$W/V$, rotation")  # fmt: skip
    return figure


@styled
def strength(boulders: int):
    """Draw strengths of the ground under boulders on talus, and the run-out of these boulders."""
    by_table = {"sets": None, "ratio": None, "table": "talus"}
    case = slope(min(boulders, 4000), impact=by_table, ensemble={"sets": None})
    result = rockfall.run(case)
    radius = np.cbrt(0.75 / np.pi * result["volume"].values)
    with GROUNDS.open(encoding="utf-8") as file:
        row = next(row for row in csv.DictReader(file) if row["name"] == "talus")
    median, sigma, known_at = (float(row[f"strength{end}"]) for end in ("", "_sigma", "_radius"))
    deviates = rockfall.ground_strength(result).values
    pressure = 1e-6 * median * radius / known_at * np.exp(sigma * deviates)
    passes = has_crossed(result, 0)
    edges = np.quantile(pressure, np.linspace(0, 1, 11))
    tenth = np.clip(np.searchsorted(edges, pressure, side="right") - 1, 0, 9)
    percent = [100 * passes[tenth == k].mean() for k in range(10)]
    figure = new_figure(6.0, 2.5)
    left, right = figure.subplots(1, 2)
    left.hist(pressure, bins=np.geomspace(pressure.min(), pressure.max(), 25), color=GREY)
    left.set_ylabel("boulders")
    right.stairs(percent, edges, fill=True, color=BLUE, alpha=0.25)
    right.stairs(percent, edges, color=BLUE, lw=1.2)
    right.set(ylabel="boulders that pass EL1 [%]", ylim=(0, 100))
    for axes in (left, right):
        axes.set(xscale="log", xlabel="strength of the ground [MPa]", xlim=(0.01, 2))
        axes.xaxis.set_major_formatter("{x:g}")
    return figure


@styled
def return_periods(boulders: int):
    """Draw energy by return period at a line, over two scenarios, with its 95 % interval."""
    case = slope(min(boulders, 4000), impact={"sets": "vaujany-observed"}, scenario=SCENARIOS)
    curve = rockfall.exceedance(rockfall.hazard(case), "EL1").query("frequency > 0")
    energy = 1e-3 * curve["energy"].values[1:]
    figure = new_figure(6.0, 2.9)
    axes = figure.subplots()
    with np.errstate(divide="ignore"):
        period, short, long = (1 / curve[name].values[1:] for name in ("frequency", "high", "low"))
    axes.fill_betweenx(energy, short, np.minimum(long, 1e9), color=GREY, alpha=0.4, lw=0,
                       label="95 % interval")  # fmt: skip
    axes.plot(period, energy, color=INK, lw=1.4, label="boulders with more than this energy")
    for years in (30, 100, 300):
        level = np.interp(np.log(years), np.log(period), energy)
        axes.plot([years, years, 1], [0, level, level], color=BLUE, lw=0.8, ls="--")
        axes.text(years * 1.04, 20, f"{years} years", color=BLUE)
    axes.legend(loc="upper left")
    axes.set(xscale="log", xlim=(5, 1000), ylim=(0, None), xlabel="return period [years]",
             ylabel="energy at the line [kJ]")  # fmt: skip
    axes.xaxis.set_major_formatter("{x:g}")
    return figure


DRAWN: dict[str, Callable[[int], Any]] = {
    "vaujany": overview,
    "impact": impact,
    "table_bins": table_bins,
    "strength": strength,
    "return_periods": return_periods,
}


def store(picture: Image.Image, path: Path) -> None:
    """Write a picture with few colours, atomically."""
    with atomic_write(path) as part:
        picture.convert("RGB").quantize(COLOURS).save(part, format="png", optimize=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boulders", type=int, default=10_000)
    parser.add_argument("-o", metavar="FOLDER", type=Path, dest="folder",
                        default=ROOT / "docs/figures")  # fmt: skip
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    warnings.filterwarnings("ignore", module="rockfall")
    for name, draw in DRAWN.items():
        picture = draw(options.boulders)
        if not isinstance(picture, Image.Image):
            with tempfile.TemporaryDirectory() as folder:
                save(picture, path := Path(folder) / f"{name}.png", dpi=160)
                picture = Image.open(path).convert("RGB")
        store(picture, options.folder / f"{name}.png")


if __name__ == "__main__":
    main()
