# SPDX-License-Identifier: BSD-3-Clause
"""Fraction of boulders that reach a road by volume, and jumps between impact sets.

    python -m benchmarks.accuracy.volumes [--boulders 400000] [-o docs/figures]

Slope of 38 degrees over 200 m in plan, then 25 degrees; rocks of R_m = 0.2 m; volumes of 0.1 to 4
m3. Draws volumes.png, the fraction of each of 40 classes with its 95 % interval, by
`ratio = 'nearest'` and `'between'`, and prints the largest step between neighbours over its
standard error.
"""

from __future__ import annotations

import argparse
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import rockfall
from benchmarks.machine import NOTHING, ROOT, machine
from rockfall.io.rasters.grid import Grid
from rockfall.plots.style import BLUE, VERMILION, new_figure, save, styled
from rockfall.result.crossings import at_lines

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CELL, COLUMNS, ROWS = 5.0, 40, 80
SMALLEST, LARGEST, CLASSES = 0.1, 4.0, 40  # volumes [m3]
ROCKS = 0.2  # R_m [m]
SETS = "laboratory-spheres", "vaujany-observed"
COLOURS = {"nearest": VERMILION, "between": BLUE}


def slope() -> tuple[np.ndarray, Grid]:
    along = CELL * np.arange(ROWS)
    gradient = np.tan(np.radians(np.where(along < 210, 38.0, 25.0)))
    z = 600 - CELL * np.concatenate(([0.0], np.cumsum(gradient[:-1])))
    return np.tile(z[:, None], (1, COLUMNS)), Grid(0.0, ROWS * CELL, CELL, COLUMNS, ROWS)


def reaching(
    boulders: int, classes: int = CLASSES, seed: int = 1, **impact: str
) -> tuple[np.ndarray, np.ndarray]:
    """Number of boulders in each volume class, and the fraction that reaches the road."""
    z, grid = slope()
    case = rockfall.Case(
        case={"boulders": boulders, "seed": seed},
        surface={"uniform_mean_radius": ROCKS},
        impact=impact,
        boulder={
            "volume": "uniform", "volume_min": SMALLEST, "volume_max": LARGEST, "density": 2700.0,
        },
        release={"x": COLUMNS * CELL / 2, "y": ROWS * CELL - 10, "drop_height": 2.0},
        line=[{"name": "road", "x": [0.0, COLUMNS * CELL], "y": [ROWS * CELL - 300] * 2}],
        output=NOTHING,
    )  # fmt: skip
    result = rockfall.run(case, dem=z, transform=grid)
    part = (result.volume.values - SMALLEST) / (LARGEST - SMALLEST)
    of_class = np.minimum((classes * part).astype(int), classes - 1)
    number = np.bincount(of_class, minlength=classes)
    passed = np.isfinite(at_lines(result)["line_speed"].values[0])
    return number, np.bincount(of_class, passed, classes) / number


@styled
def draw(found: dict[tuple[str, str], tuple[np.ndarray, np.ndarray]]) -> Figure:
    edges = np.linspace(SMALLEST, LARGEST, CLASSES + 1)
    figure = new_figure(7.0, 3.0)
    for ax, name in zip(figure.subplots(1, len(SETS), sharey=True), SETS, strict=True):
        for ratio, colour in COLOURS.items():
            fraction, error = found[name, ratio]
            middles, half = (edges[1:] + edges[:-1]) / 2, 196 * error
            ax.errorbar(middles, 100 * fraction, half, color=colour, label=f"'{ratio}'", lw=1)
        ax.set(title=name, xlabel="volume [m³]", ylim=(0, None))
        ax.legend()
    figure.axes[0].set_ylabel("boulders that reach the road [%]")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boulders", type=int, default=400_000)
    parser.add_argument("-o", "--folder", type=Path, default=ROOT / "docs" / "figures")
    given = parser.parse_args()
    print(machine())
    found = {}
    for name, ratio in product(SETS, COLOURS):
        number, fraction = reaching(given.boulders, sets=name, ratio=ratio)
        error = np.sqrt(fraction * (1 - fraction) / number)
        found[name, ratio] = fraction, error
        step = np.diff(fraction) / np.hypot(error[1:], error[:-1])
        print(f"{name}, {ratio}: largest step {np.abs(step).max():.1f} standard errors")
    save(draw(found), given.folder / "volumes.png", dpi=130)


if __name__ == "__main__":
    main()
