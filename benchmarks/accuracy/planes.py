# SPDX-License-Identifier: BSD-3-Clause
"""Boulders by the shipped sets and tables on planes: the fraction that passes 200 m, speed, jump
height.

    python -m benchmarks.accuracy.planes [--boulders 10000] [-o docs]

For each set and each R_b/R_m from 1 to 5: the neutral slope, on which a bounce down the fall line
loses the speed that the next flight gains. For the sets in `FULL` and each shipped impact table
(compact blocks), on slopes of 24 to 46 degrees: the fraction of the boulders that pass a line 200 m
below the release, in plan; their mean speed there, and the 95 % quantile of their jump height.
Writes validation/planes.md, with standard errors, and figures/planes.png.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np

import rockfall
from benchmarks.machine import ROOT
from rockfall.analysis.line_statistics import line_numbers
from rockfall.analysis.planes.plane_bounce import neutral_slope, set_rebound
from rockfall.analysis.precision.intervals import sources
from rockfall.errors import RockfallError
from rockfall.grounds import table_names
from rockfall.grounds.impact_sets import shipped_sets
from rockfall.io.atomic import atomic_write
from rockfall.io.rasters.grid import Grid
from rockfall.kernel_rules import Z
from rockfall.plots.style import BLUE, GREEN, GREY, INK, VERMILION, new_figure, plain, save, styled
from rockfall.scene.rebounds.sets import Sets, read_sets

SLOPES = range(24, 47, 2)  # slopes [degree]
PRINTED = range(26, 47, 4)  # slopes on the page; the figure has all
RATIOS = range(1, 6)
FULL = ("vaujany-observed",)  # sets with results at the line
DISTANCE = 200.0  # distance from the release to the line [m]
CELL, WIDE, ABOVE, BELOW = 8.0, 1200.0, 120.0, 40.0  # [m] cell, width, lengths above and below
VOLUME = 1.0  # volume [m3]
RADIUS = float(np.cbrt(0.75 / np.pi * VOLUME))  # radius [m]
DROP = 5.0  # drop height [m]
SEEDS = range(1, 6)  # seeds for the errors of neutral slopes
FLOWN = 1000  # number of boulders for a neutral slope
FIRST, LAST = 20, 60  # contacts that count; earlier ones depend on the release
COMPLETE = 0.99  # fraction of boulders that must have all contacts before the plane ends
FEW = 20  # minimum number of boulders at the line for a mean
RATIO_OF_TABLES = 2  # R_b/R_m for tables that need it
COLOURS = [INK, BLUE, GREEN, VERMILION, GREY]  # one colour per ratio
HOW = {"fraction": ("fraction passing", "%", 1), "speed": ("mean speed", "m/s", 1),
       "height": ("95 % quantile of the jump height", "m", 2)}  # fmt: skip
ON_PAGE = ("fraction", "speed")  # tables on the page; the figure has all


class Number(NamedTuple):
    """Value with its standard error; NaN if unknown."""

    value: float
    error: float = np.nan


def plane(slope: float) -> tuple[np.ndarray, Grid]:
    """Elevations and grid of a plane that falls to the south by `slope` [degree]. The tangent is
    rounded to a multiple of 2^-40, so that each patch is exactly plane."""
    tangent = round(np.tan(np.radians(slope)) * 2**40) / 2**40
    nx, ny = int(WIDE / CELL), int((ABOVE + DISTANCE + BELOW) / CELL)
    z = np.repeat(tangent * CELL * np.arange(ny, 0.0, -1)[:, None], nx, axis=1)
    return z, Grid(0.0, ny * CELL, CELL, nx, ny)


def at_line(
    slope: float, boulders: int, seed: int, **groups: dict[str, Any]
) -> tuple[dict[str, float], dict[str, float]]:
    """Statistics of speed and jump height of boulders at the line."""
    z, grid = plane(slope)
    top = grid.north - ABOVE
    case = rockfall.Case(
        case={"boulders": boulders, "seed": seed},
        boulder={"volume_mean": VOLUME},
        release={"x": WIDE / 2, "y": top, "drop_height": DROP},
        line=[{"name": "line", "x": [0.0, WIDE], "y": [top - DISTANCE] * 2}],
        **groups,
    )
    result = rockfall.run(case, dem=z, transform=grid)
    source = sources(result)
    return line_numbers(result, 0, "speed", source), line_numbers(result, 0, "jump_height", source)


def measure(path: Path, slope: float, ratio: float, boulders: int) -> dict[str, Number]:
    """Statistics of boulders at the line by an impact set, with standard errors, by the names in
    HOW."""
    rocks = {"uniform_mean_radius": RADIUS / ratio}
    impact = {"sets": str(path), "rest_angle": 90.0}  # only the set: slow boulders rest
    return numbers(*at_line(slope, boulders, 1, surface=rocks, impact=impact), boulders)


def measure_table(name: str, slope: float, boulders: int) -> dict[str, Number]:
    """Statistics of boulders at the line by an impact table, which may need a rock size."""
    rocks = {"uniform_mean_radius": RADIUS / RATIO_OF_TABLES}
    impact = {"form": "table", "table": name}
    return numbers(*at_line(slope, boulders, 1, surface=rocks, impact=impact), boulders)


def numbers(speed: dict[str, float], height: dict[str, float], boulders: int) -> dict[str, Number]:
    """Fraction that passes, mean speed and quantile of the jump height, with standard errors."""
    n, fraction = speed["n"], speed["fraction"]
    found = {"fraction": Number(fraction, np.sqrt(fraction * (1 - fraction) / boulders))}
    none = Number(np.nan)
    found["speed"] = Number(speed["mean"], speed["std"] / np.sqrt(n)) if n >= FEW else none
    known = n and np.isfinite(height["q95_high"] - height["q95_low"])
    half = (height["q95_high"] - height["q95_low"]) / 2 if known else np.nan
    found["height"] = Number(height["q95"], half / Z) if known else none
    return found


def neutral(sets: Sets, ratio: int) -> Number:
    """Neutral slope [degree] of one of the five sets, with its standard error over seeds."""
    rebound = set_rebound(sets.mean[ratio - 1], sets.covariance[ratio - 1])
    found = [neutral_slope(rebound, seed=seed) for seed in SEEDS]
    return Number(float(np.mean(found)), float(np.std(found, ddof=1) / np.sqrt(len(found))))


def growth_flown(path: Path, ratio: int, slope: float) -> float:
    """Mean logarithm of the growth of speed in a bounce, for boulders that run down the fall line
    of a plane ('to_aspect'). They are slow, to stay on the plane; growth does not depend on speed.
    Refuses runs in which fewer than COMPLETE of the boulders reach contact LAST."""
    z, grid = plane(slope)
    case = rockfall.Case(
        case={"boulders": FLOWN, "seed": 7},
        surface={"uniform_mean_radius": RADIUS / ratio},
        impact={
            "sets": str(path), "turning": "to_aspect", "stop_speed": 1e-12, "impact_limit": LAST,
        },
        boulder={"volume_mean": VOLUME},
        release={"x": WIDE / 2, "y": grid.north - ABOVE, "drop_height": 1e-6},
        output={"trajectories": FLOWN},
    )  # fmt: skip
    result = rockfall.run(case, dem=z, transform=grid)
    hit = np.isfinite(result["trajectory_in_n"].values) & (result["trajectory_ratio"].values > 0)
    boulder = result["trajectory_boulder"].values[hit]
    complete = np.bincount(boulder, minlength=FLOWN + 1) == LAST
    if complete[1:].mean() < COMPLETE:
        raise RockfallError(f"{path}: boulders ended before contact {LAST} of the plane")
    speed = np.sqrt(sum(result[f"trajectory_out_{v}"].values[hit] ** 2 for v in "tn"))
    logs = np.log(speed[complete[boulder]]).reshape(-1, LAST)
    return float((logs[:, -1] - logs[:, FIRST]).mean() / (logs.shape[1] - 1 - FIRST))


def neutral_flown(path: Path, ratio: int, law: float) -> float:
    """Neutral slope [degree] from simulated flights, near `law`, that from the set's distribution:
    growth is nearly linear within a degree."""
    low, high = law - 1, law + 1
    ends = [growth_flown(path, ratio, slope) for slope in (low, high)]
    return low - ends[0] * (high - low) / (ends[1] - ends[0])


class Measured(NamedTuple):
    """Results of a set, or of all tables: statistics at the line by (slope, column), where a column
    is an R_b/R_m or a table; and for a set, neutral slopes by column, from its distribution and
    from simulated flights."""

    name: str
    columns: list[str]
    at_line: dict[tuple[int, str], dict[str, Number]]
    neutral: dict[str, Number] = {}
    flown: dict[str, float] = {}


def look(path: Path, boulders: int) -> Iterator[Measured]:
    """Yield measurements of the set in a file; nothing for an ensemble."""
    sets, *more = read_sets(path)
    if more:
        return
    columns = {f"R_b/R_m = {ratio}": ratio for ratio in RATIOS}
    at_line = {
        (slope, name): measure(path, slope, ratio, boulders)
        for slope in SLOPES
        for name, ratio in columns.items()
        if sets.name in FULL
    }
    slopes = {name: neutral(sets, ratio) for name, ratio in columns.items()}
    flown = {
        name: neutral_flown(path, ratio, slopes[name].value) for name, ratio in columns.items()
    }
    yield Measured(f"`{sets.name}`", list(columns), at_line, slopes, flown)


def look_at_tables(boulders: int) -> Measured:
    """Measure all shipped impact tables."""
    at_line = {
        (slope, name): measure_table(name, slope, boulders)
        for slope in SLOPES
        for name in table_names()
    }
    return Measured("Tables of impacts", table_names(), at_line)


def text(number: Number, digits: int, scale: float = 1.0) -> str:
    """Text of a value with its standard error. Percentages have no standard error here: the page
    states it once."""
    value, error = number
    if np.isnan(value):
        return "-"
    if scale == 100.0:
        return f"{scale * value:.{digits}f}"
    return f"{scale * value:.{digits}f} ± {scale * error:.{digits}f}"


def table(first: str, columns: list[str], rows: dict[str, list[str]]) -> Iterator[str]:
    """Markdown table."""
    yield f"| {first} | " + " | ".join(columns) + " |"
    yield "| --- |" + " --: |" * len(columns)
    yield from (f"| {name} | " + " | ".join(cells) + " |" for name, cells in rows.items())
    yield ""


def neutral_rows(one: Measured) -> dict[str, list[str]]:
    """Rows of neutral slopes: from the distribution of the set, and from simulated flights."""
    return {
        one.name: [text(one.neutral[column], 1) for column in one.columns],
        f"{one.name}, flown": [f"{one.flown[column]:.1f}" for column in one.columns],
    }


def with_numbers(sets: list[Measured], tables: Measured) -> list[Measured]:
    """Sets and tables with results at the line."""
    return [one for one in (*sets, tables) if one.at_line]


def page(sets: list[Measured], tables: Measured, boulders: int) -> str:
    lines = [
        "# Shipped impact sets and tables on planes",
        "",
        *wrap(
            "This page compares rebound models on planes. Each number is from "
            f"{boulders:,} boulders, released {DROP:g} m above a plane, {DISTANCE:g} m (in plan) "
            "uphill of the line. R_b/R_m is constant, and boulders may turn past the aspect. "
            f"Impact tables use compact blocks, with R_b/R_m = {RATIO_OF_TABLES} where a size is "
            f"needed. For sets other than `{'`, `'.join(FULL)}` only neutral slopes are given. "
            "`benchmarks/accuracy/planes.py` writes the page and its figure, which also shows "
            "jump heights.",
            100,
        ),
        "",
        *wrap(
            f"± is the standard error (of fractions: at most {50 / np.sqrt(boulders):.1f} %), and "
            "- means too few boulders. On the **neutral slope** boulders that go straight down "
            "neither gain nor lose speed over many bounces; boulders that turn descend less "
            "steeply. On steeper planes they accelerate without a terminal velocity. *Flown* "
            "slopes are measured on simulated boulders; other slopes are computed from the set.",
            100,
        ),
        "",
        "![fraction passing, mean speed and jump height against the slope](../figures/planes.png)",
        "",
        "## Neutral slopes [degree]",
        "",
        *table(
            "set", sets[0].columns, dict(row for one in sets for row in neutral_rows(one).items())
        ),
    ]  # fmt: skip
    for one in with_numbers(sets, tables):
        lines += [f"## {one.name}", ""]
        for key in ON_PAGE:
            label, unit, digits = HOW[key]
            scale = 100.0 if unit == "%" else 1.0
            lines += table(
                f"{label} [{unit}]",
                one.columns,
                {
                    f"{slope} degrees": [
                        text(one.at_line[slope, column][key], digits, scale)
                        for column in one.columns
                    ]
                    for slope in SLOPES
                    if slope in PRINTED
                },
            )
    return "\n".join(lines).rstrip("\n") + "\n"


@styled
def draw(found: list[Measured]):
    """Draw a row of panels for each set and one for all tables; triangles along the fractions mark
    neutral slopes."""
    figure = new_figure(9.0, 2.4 * len(found) + 0.6)
    panels = figure.subplots(len(found), len(HOW), squeeze=False, sharex=True, sharey="col")
    for row, one in zip(panels, found, strict=True):
        for panel, (key, (label, unit, _)) in zip(row, HOW.items(), strict=True):
            scale = 100.0 if unit == "%" else 1.0
            for k, column in enumerate(one.columns):
                colour, style = COLOURS[k % len(COLOURS)], "-" if k < len(COLOURS) else "--"
                known = [one.at_line[slope, column][key] for slope in SLOPES]
                values, errors = (scale * np.array(part) for part in zip(*known, strict=True))
                panel.errorbar(SLOPES, values, errors, color=colour, linewidth=1, linestyle=style,
                               marker="o", markersize=2, label=column)  # fmt: skip
                if key == "fraction" and column in one.neutral:
                    panel.plot(one.neutral[column].value, -4, "^", color=colour, markersize=5,
                               clip_on=False)  # fmt: skip
            panel.set(title=plain(one.name.strip("`")), ylabel=f"{label} [{unit}]")
        row[1].legend(fontsize=5, loc="upper left", frameon=False)
    for panel in panels[-1]:
        panel.set_xlabel("slope [degree]")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boulders", type=int, default=10_000)
    parser.add_argument("-o", metavar="FOLDER", type=Path, dest="folder", default=ROOT / "docs")
    options = parser.parse_args()
    sets = [one for path in shipped_sets().values() for one in look(path, options.boulders)]
    tables = look_at_tables(options.boulders)
    for name in ("validation", "figures"):
        (options.folder / name).mkdir(parents=True, exist_ok=True)
    with atomic_write(options.folder / "validation" / "planes.md") as part:
        part.write_text(page(sets, tables, options.boulders), encoding="utf-8")
    save(draw(with_numbers(sets, tables)), options.folder / "figures" / "planes.png", dpi=130)


if __name__ == "__main__":
    main()
