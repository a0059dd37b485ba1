# SPDX-License-Identifier: BSD-3-Clause
"""Fraction of boulders that pass 80 m down a plane, by the height from which they are dropped:

    python -m lab.benchmarks.drops [--table talus rocky-slope] [--slopes 33 35] [--radius 0.6]
        [--ratio 5.6] [--boulders 500]

Boulders have no initial speed, so all land in the same way, and boulders from low heights draw from
the few slow records in one bin of the table.
"""

import argparse

import numpy as np

import rockfall
from benchmarks.machine import machine
from lab.benchmarks.plane import plane
from rockfall.result.crossings import at_lines

DROPS = 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 5.0  # drop heights [m]
# Cell size [m], columns, rows, rows above the release, distance of the line [m]:
CELL, COLUMNS, ROWS, ABOVE, PASSED = 2.0, 60, 100, 10, 80.0


def passing(table: str, slope: float, drop: float, given: argparse.Namespace) -> float:
    """Fraction of boulders that pass PASSED [m] down a plane."""
    top = (ROWS - ABOVE) * CELL
    at = top - PASSED * np.cos(np.radians(slope))
    case = rockfall.Case(
        case={"boulders": given.boulders, "seed": 1},
        impact={"form": "table", "table": table},
        surface={"uniform_mean_radius": given.radius / given.ratio},
        boulder={"volume": "fixed", "volume_mean": 4 / 3 * np.pi * given.radius**3},
        release={"x": [COLUMNS * CELL / 2], "y": [top], "drop_height": drop},
        line=[{"name": "line", "x": [0.0, COLUMNS * CELL], "y": [at, at]}],
    )
    result = rockfall.run(case, **plane(slope, ROWS, COLUMNS, CELL))
    return float((~np.isnan(at_lines(result)["line_speed"].values[0])).mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--table", nargs="+", default=["talus", "rocky-slope"])
    parser.add_argument("--slopes", type=float, nargs="+", default=[33.0, 35.0])
    parser.add_argument("--radius", type=float, default=0.6)
    parser.add_argument("--ratio", type=float, default=5.6)
    parser.add_argument("--boulders", type=int, default=500)
    given = parser.parse_args()
    print(machine())
    print("| table | slope | " + " | ".join(f"{drop:g} m" for drop in DROPS) + " |")
    print("|---" * (2 + len(DROPS)) + "|")
    for table in given.table:
        for slope in given.slopes:
            found = [passing(table, slope, drop, given) for drop in DROPS]
            row = " | ".join(f"{fraction:.2f}" for fraction in found)
            print(f"| {table} | {slope:g} | {row} |", flush=True)


if __name__ == "__main__":
    main()
