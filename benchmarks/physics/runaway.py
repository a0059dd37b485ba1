# SPDX-License-Identifier: BSD-3-Clause
"""Fraction of boulders that exceed 0.8 m/s per degree, the limit of observations, on planes of 30
to 45 degrees over 400 m, and their mean maximum speed, by rebound models:

    python -m benchmarks.physics.runaway [--law NAME=TABLE ...] [--ground ROW ...]
        [--boulders 400] [--radius 0.4] [--slopes 30 34 38 42 45] [--terrain DEM ...]
        [--write]

Models are those of benchmarks.physics.laws; the matrix with R_m = 0.2 m is always run. Boulders
have R_b = 0.4 m and a release speed of 5 m/s. --terrain uses real terrain instead of planes: two
boulders of 0.5 m3 from each cell steeper than 50 degrees. --write stores fractions on planes in the
table of evidence.
"""

import argparse
from collections.abc import Sequence
from math import nan
from pathlib import Path

import numpy as np

import rockfall
from benchmarks.evidence import record, with_origin
from benchmarks.machine import machine
from benchmarks.physics.laws import ROCKS, Law, add_laws, matrix
from rockfall.analysis.validity.extrapolation import faster_than_observed
from rockfall.io.rasters.grid import Grid

SLOPES = 30, 34, 38, 42, 45  # slopes [degree]
LIMIT = 0.8  # maximum speed observed, over slope [m/s per degree]
NAMES = {matrix().name: f"vaujany-observed, R_m {ROCKS:g} m"}  # names in the table of evidence
RADIUS, LENGTH, CELL, COLUMNS = 0.4, 400.0, 2.5, 160  # [m]


def beyond(
    law: Law, slope: float, boulders: int, seed: int = 1, radius: float = RADIUS
) -> tuple[float, float]:
    """Fraction of boulders on a plane whose maximum speed exceeds LIMIT times the slope [degree],
    and the mean of the maximum speeds [m/s]."""
    angle = np.radians(slope)
    rows = int(LENGTH * np.cos(angle) / CELL) + 12
    z = 500 + np.tan(angle) * CELL * np.mgrid[rows - 1 : -1 : -1, 0:COLUMNS][0]
    groups = {
        "case": {"title": "plane", "seed": seed, "boulders": boulders},
        "boulder": {"volume": "fixed", "volume_mean": 4 / 3 * np.pi * radius**3, "density": 2700.0},
        "release": {
            "x": [COLUMNS * CELL / 2], "y": [(rows - 10) * CELL], "drop_height": 0.5,
            "velocity": [0.0, -5 * np.cos(angle), -5 * np.sin(angle)],
        },
    }  # fmt: skip
    case = rockfall.Case(**law.added(groups, "compact"))
    result = rockfall.run(case, dem=z, transform=Grid(0.0, rows * CELL, CELL, COLUMNS, rows))
    fastest = result.speed_max.values
    return float(np.mean(fastest > LIMIT * slope)), float(fastest.mean())


def beyond_on(terrain: str, law: Law) -> tuple[float, float]:
    """Fraction of boulders faster than observed, and their mean maximum speed [m/s], on a real
    terrain."""
    groups = {
        "case": {"title": "terrain", "seed": 3, "boulders": 2},
        "terrain": {"dem": terrain},
        "boulder": {"volume": "fixed", "volume_mean": 0.5, "density": 2700.0},
        "release": {"steep_cells": True, "slope_threshold": 50.0, "drop_height": 1.0},
    }
    result = rockfall.run(rockfall.Case(**law.added(groups, "compact")))
    return float(faster_than_observed(result).mean()), float(result.speed_max.mean())


def main(words: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--terrain", nargs="+", default=[])
    add_laws(parser)
    parser.add_argument("--boulders", type=int, default=400)
    parser.add_argument("--slopes", type=float, nargs="+", default=SLOPES)
    parser.add_argument("--radius", type=float, default=RADIUS, help="R_b on planes [m]")
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args(words)
    print(machine())
    columns = given.terrain or [f"{slope:g} degrees" for slope in given.slopes]
    print("| law | " + " | ".join(Path(one).stem for one in columns) + " |")
    print("|---" * (1 + len(columns)) + "|")
    rows = []
    for law in [matrix(), *given.law]:
        found = [beyond_on(terrain, law) for terrain in given.terrain]
        found = found or [
            beyond(law, slope, given.boulders, radius=given.radius) for slope in given.slopes
        ]
        cells = [f"{part:.2f}, {speed:.0f} m/s" for part, speed in found]
        print(f"| {law.name} | " + " | ".join(cells) + " |", flush=True)
        for slope, (part, _) in zip([] if given.terrain else given.slopes, found, strict=False):
            place = f"{slope:g} degrees, R_b {given.radius:g} m"
            key = "long-plane", place, "faster_than_observed", NAMES.get(law.name, law.name)
            spread = np.sqrt(part * (1 - part) / given.boulders)
            rows.append(with_origin(key, "", nan, part, spread))
    if given.write:
        record(rows)


if __name__ == "__main__":
    main()
