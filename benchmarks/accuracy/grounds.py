# SPDX-License-Identifier: BSD-3-Clause
"""Shipped grounds on planes: boulders that pass 200 m, their speed and jump height, and the slope
on which half pass.

    python -m benchmarks.accuracy.grounds [--boulders 1000] [-o docs]

For each ground, the stochastic impact set, and slopes of 15 to 55 degrees: the fraction of the
boulders that pass a line 200 m below the release, in plan; their mean speed there, and the 95 %
quantile of their jump height. Values are means over seeds, with standard errors between seeds.
Writes the last section of archive/classical_grounds.md, and figures/grounds.png.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from textwrap import fill
from typing import NamedTuple

import numpy as np

from benchmarks.accuracy.planes import (
    DISTANCE,
    DROP,
    FEW,
    HOW,
    RADIUS,
    VOLUME,
    Number,
    at_line,
    text,
)
from benchmarks.machine import ROOT
from rockfall.grounds import GroundTable, other_tables, shipped_grounds
from rockfall.io.atomic import atomic_write
from rockfall.plots.style import BLUE, GREEN, GREY, INK, VERMILION, new_figure, save, styled

SLOPES = range(15, 56, 5)  # slopes [degree]
SEEDS = range(1, 6)
FLATTEST, STEEPEST, NEAR = 2.0, 80.0, 0.1  # range and tolerance of the half-passing slope [degree]
OBSTACLES = 0.1  # size of obstacles, used by rockyfor3d [m]
RATIOS = (1, 3, 5)  # R_b/R_m for the impact set
COLOURS = {
    "impact_sets": INK, "rockyfor3d": BLUE, "pfeiffer_bowen": VERMILION, "constant": GREEN,
    "bourrier_hungr": GREY,
}  # fmt: skip
BEGIN = "## On planes\n"


def mean(values: list[float]) -> Number:
    """Mean over several seeds, with its standard error; NaN if a value is NaN."""
    return Number(float(np.mean(values)), float(np.std(values, ddof=1) / np.sqrt(len(values))))


class Kind(NamedTuple):
    """Ground, with the mean radius of rocks on it [m]."""

    label: str
    model: str
    ground: str
    radius: float
    table: str | None = None  # ground table, if not the usual one


class Measured(NamedTuple):
    kind: Kind
    half: Number  # slope on which half of the boulders pass [degree]
    at_line: dict[int, dict[str, Number]]  # results by slope


def kinds() -> Iterator[Kind]:
    """The impact set with rocks of several sizes, the rows of the shipped ground table, and rows of
    other shipped tables that differ."""
    for ratio in RATIOS:
        label = f"vaujany-observed, R_b/R_m = {ratio}"
        yield Kind(label, "impact_sets", "vaujany-observed", RADIUS / ratio)
    usual = GroundTable(shipped_grounds())
    for name, row in usual.rows.items():
        if row.cells["model"] != "absorbs":
            yield Kind(name, row.cells["model"], name, OBSTACLES / 2)
    for table, path in other_tables().items():
        other = GroundTable(path)
        for name, row in other.rows.items():
            if other.ground(name).text != usual.ground(name).text:
                label = f"{table}: {name}"
                yield Kind(label, row.cells["model"], name, OBSTACLES / 2, table)


def run(kind: Kind, slope: float, boulders: int, seed: int) -> dict[str, float]:
    """Statistics of boulders at the line, by the names in HOW; NaN if fewer than FEW pass."""
    surface = {"uniform_mean_radius": kind.radius, "ground": kind.ground}
    if kind.table:
        surface["ground_table"] = kind.table
    speed, height = at_line(slope, boulders, seed, surface=surface)
    known = speed["n"] >= FEW
    return {
        "fraction": speed["fraction"],
        "speed": speed["mean"] if known else np.nan,
        "height": height["q95"] if known else np.nan,
    }


def measure(kind: Kind, slope: float, boulders: int) -> dict[str, Number]:
    found = [run(kind, slope, boulders, seed) for seed in SEEDS]
    return {name: mean([one[name] for one in found]) for name in HOW}


def half_slope(kind: Kind, boulders: int, seed: int) -> float:
    """Slope on which half of the boulders pass [degree], by bisection."""
    low, high = FLATTEST, STEEPEST
    while high - low > NEAR:
        middle = (low + high) / 2
        passing = run(kind, middle, boulders, seed)["fraction"] > 0.5
        low, high = (low, middle) if passing else (middle, high)
    return (low + high) / 2


def look(kind: Kind, boulders: int) -> Measured:
    half = mean([half_slope(kind, boulders, seed) for seed in SEEDS])
    return Measured(kind, half, {slope: measure(kind, slope, boulders) for slope in SLOPES})


def section(found: list[Measured], boulders: int) -> Iterator[str]:
    yield BEGIN
    about = (
        f"{len(SEEDS)} seeds of {boulders:,} boulders of {VOLUME:g} m3 for each number, released "
        f"{DROP:g} m above a plane; a line {DISTANCE:g} m further down, in plan. Obstacles are "
        f"{OBSTACLES:g} m high. ± is the standard error over the seeds; - where too few pass. The "
        f"slope on which half of them pass is found to {NEAR / 2:g} degrees. "
        "`python -m benchmarks.accuracy.grounds` writes this section and its figure."
    )
    yield fill(about, 100, break_on_hyphens=False) + "\n"
    about = "fraction passing, mean speed and jump height against the slope"
    yield f"![{about}](../figures/grounds.png)\n"
    yield "| ground | model | half of the boulders pass from [degree] |\n| --- | --- | --: |"
    for one in found:
        yield f"| {one.kind.label} | {one.kind.model.replace('_', ' ')} | {text(one.half, 1)} |"
    for name, (label, unit, digits) in HOW.items():
        head = " | ".join(f"{slope} degrees" for slope in SLOPES)
        yield f"\n| {label} [{unit}] | {head} |\n| --- |" + " --: |" * len(SLOPES)
        for one in found:
            scale = 100.0 if unit == "%" else 1.0
            cells = (text(one.at_line[slope][name], digits, scale) for slope in SLOPES)
            yield f"| {one.kind.label} | {' | '.join(cells)} |"


@styled
def draw(found: list[Measured]):
    """Draw a panel for each statistic, with a line for each ground in the colour of its model."""
    figure = new_figure(9.0, 3.2)
    panels = figure.subplots(1, len(HOW), squeeze=False)[0]
    for panel, (name, (label, unit, _)) in zip(panels, HOW.items(), strict=True):
        scale = 100.0 if unit == "%" else 1.0
        for one in found:
            values = [scale * one.at_line[slope][name].value for slope in SLOPES]
            colour = COLOURS.get(one.kind.model, GREY)
            panel.plot(SLOPES, values, color=colour, lw=0.9, marker="o", ms=2)
        panel.set(xlabel="slope [degree]", ylabel=f"{label} [{unit}]")
    for model, colour in COLOURS.items():
        panels[0].plot([], [], color=colour, label=model.replace("_", " "))
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(COLOURS)
    )
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boulders", type=int, default=1000)
    parser.add_argument("-o", metavar="FOLDER", type=Path, dest="folder", default=ROOT / "docs")
    options = parser.parse_args()
    found = [look(kind, options.boulders) for kind in kinds()]
    page = Path("archive/classical_grounds.md")
    before = (ROOT / "docs" / page).read_text(encoding="utf-8").split(BEGIN)[0]
    for name in "archive", "figures":
        (options.folder / name).mkdir(parents=True, exist_ok=True)
    with atomic_write(options.folder / page) as part:
        after = "\n".join(section(found, options.boulders))
        part.write_text(f"{before}{after}\n", encoding="utf-8")
    save(draw(found), options.folder / "figures" / "grounds.png", dpi=130)


if __name__ == "__main__":
    main()
