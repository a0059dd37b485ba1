# SPDX-License-Identifier: BSD-3-Clause
"""A plane of tables for boulders of all sizes, compared with tables thrown at their size:

    python -m lab.benchmarks.sizes talus [--radii 0.35 0.6 1 1.8 3] [--slopes 30 34 38]

A table of a size is thrown with blocks of that R_b, on the ground as they meet it, all of one
strength; the plane of tables chooses between parts (theory, eq. 5.25). Prints for compact boulders
on planes the fraction that passes 200 m, with a standard error, and the mean speed there, by both.
"""

import argparse
import tempfile
import warnings
from pathlib import Path

import numpy as np

import rockfall
from benchmarks.machine import machine
from lab.benchmarks.plane import plane
from rockfall.grounds.impact_tables import save_table
from rockfall.result.crossings import at_lines
from rockfall_lab.blocks.case import BlockCase, grounds
from rockfall_lab.blocks.contacts import run_throws
from rockfall_lab.tables import table_of

SHAPE, DENSITY, BOULDERS = "compact", 2700.0, 600
LENGTH, LINE, SPEED = 400.0, 200.0, 5.0  # [m], down the plane; [m/s]
CELL, COLUMNS, ABOVE = 2.5, 120, 8


def on_plane(table: str, radius: float, slope: float, folder: Path) -> str:
    """What boulders by a table do on a plane."""
    angle = np.radians(slope)
    rows = int((LENGTH * np.cos(angle) + 80) / CELL)
    top, width = (rows - ABOVE) * CELL, COLUMNS * CELL
    at = top - LINE * np.cos(angle)
    case = rockfall.Case(
        folder=folder,
        case={"boulders": BOULDERS, "seed": 7},
        impact={"form": "table", "table": table},
        surface={"uniform_mean_radius": 0.1},
        boulder={
            "volume": "fixed", "volume_mean": 4 / 3 * np.pi * radius**3, "density": DENSITY,
            "ground_strength_sigma": 0.0,
        },
        release={
            "x": [width / 2], "y": [top], "drop_height": 0.5,
            "velocity": [0.0, -SPEED * np.cos(angle), -SPEED * np.sin(angle)],
        },
        line=[{"name": "line", "x": [0.0, width], "y": [at, at]}],
    )  # fmt: skip
    result = rockfall.run(case, **plane(slope, rows, COLUMNS, CELL))
    speeds = at_lines(result)["line_speed"].isel(line=0).values
    speeds = speeds[~np.isnan(speeds)]
    part = len(speeds) / BOULDERS
    error = np.sqrt(part * (1 - part) / BOULDERS)
    return f"{part:.2f} ± {error:.2f}" + (f", {speeds.mean():.1f} m/s" if len(speeds) else "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("ground", choices=list(grounds()))
    parser.add_argument("--radii", type=float, nargs="+", default=[0.35, 0.6, 1, 1.8, 3])
    parser.add_argument("--slopes", type=float, nargs="+", default=[30, 34, 38])
    parser.add_argument("--throws", type=int, default=1500)
    given = parser.parse_args()
    warnings.simplefilter("ignore")  # a table asks for no rocks
    print(machine())
    print(
        "| R_b [m] | relief [degree] | slope | by the plane of tables | by a table of this size |"
    )
    print("|---|---|---|---|---|")
    lab = {"ground": given.ground, "shape": SHAPE, "throws": given.throws}
    for radius in given.radii:
        case = BlockCase(lab=lab).at_radius(radius)
        with tempfile.TemporaryDirectory() as folder:
            save_table(table_of([run_throws(case)]), Path(folder) / "own.nc")
            for slope in given.slopes:
                found = [
                    on_plane(table, radius, slope, Path(folder))
                    for table in (given.ground, "own.nc")
                ]
                cells = [f"{radius:g}", f"{case.ground['relief']:.1f}", f"{slope:g}", *found]
                print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
