# SPDX-License-Identifier: BSD-3-Clause
"""Effect of the rest angle: boulders of 0.8 m3 at a line 180 m down planes, by the shipped sets.

    python -m benchmarks.physics.rest [--boulders 2000] [--seeds 5]

Prints for each rock radius, slope and rest angle, as means over seeds with standard errors: the
fraction that passes, the mean speed and the 95 % quantile of energy of passing boulders, and the
fraction of all boulders that passes with more than 300 kJ.
"""

import argparse

import numpy as np

import rockfall
from benchmarks.machine import machine
from rockfall.io.rasters.grid import Grid
from rockfall.result.crossings import at_lines

CELL, ROWS, COLUMNS = 2.5, 120, 60
ROCKS = (0.12, 0.28, 0.58)  # R_m [m]; R_b = 0.58 m
SLOPES = (33, 35, 37, 39)  # slopes [degree]
ANGLES = (90.0, 37.0, 34.0, 30.0)  # rest angles [degree]
HIGH = 300e3  # energy threshold [J]


def measure(slope: float, rocks: float, angle: float, boulders: int, seed: int) -> list[float]:
    """Passing fraction, mean speed [m/s], 95 % quantile of energy [kJ], fraction above HIGH."""
    y = np.mgrid[ROWS - 1 : -1 : -1, 0:COLUMNS][0] * CELL
    width = COLUMNS * CELL
    case = rockfall.Case(
        case={"title": "plane", "seed": seed, "boulders": boulders},
        surface={"uniform_mean_radius": rocks},
        impact={"rest_angle": angle},
        boulder={"volume": "fixed", "volume_mean": 0.8},
        release={"x": [width / 2], "y": [280.0], "drop_height": 5.0},
        line=[{"name": "line", "x": [0.0, width], "y": [100.0, 100.0]}],
    )
    place = Grid(0.0, ROWS * CELL, CELL, COLUMNS, ROWS)
    result = rockfall.run(case, dem=500 + np.tan(np.radians(slope)) * y, transform=place)
    kinds = "translational", "rotational"
    energy = sum(at_lines(result)[f"line_energy_{kind}"].values[0] for kind in kinds)
    passed = np.isfinite(energy)
    if passed.sum() < 20:
        return [passed.mean(), np.nan, np.nan, (energy > HIGH).mean()]
    speed = at_lines(result)["line_speed"].values[0][passed].mean()
    return [passed.mean(), speed, np.quantile(energy[passed], 0.95) / 1e3, (energy > HIGH).mean()]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--boulders", type=int, default=2000)
    parser.add_argument("--seeds", type=int, default=5)
    given = parser.parse_args()
    print(machine())
    print("| R_m [m] | slope | rest angle | passes | speed [m/s] | energy 95 % [kJ] | > 300 kJ |")
    print("|---|---|---|---|---|---|---|")
    for rocks in ROCKS:
        for slope in SLOPES:
            for angle in ANGLES:
                found = np.array([
                    measure(slope, rocks, angle, given.boulders, 100 + seed)
                    for seed in range(given.seeds)
                ])  # fmt: skip
                error = found.std(axis=0, ddof=1) / np.sqrt(given.seeds)
                texts = [f"{a:.3g} ± {b:.1g}" for a, b in zip(found.mean(0), error, strict=True)]
                print(f"| {rocks} | {slope} | {angle:g} |", " | ".join(texts), "|", flush=True)


if __name__ == "__main__":
    main()
