# SPDX-License-Identifier: BSD-3-Clause
"""Energy after contacts from the shipped impact tables on flat ground, where no contact may gain
energy:

    python -m benchmarks.stability.flat_ground [--boulders 2000]

Boulders of each shape are thrown at 3 to 40 m/s over level ground (R_b = 0.4 m, R_b/R_m = 2), and
all contacts, several millions, are recorded. Prints for each table the number of contacts, the
maximum ratio of the energy after and before (translation and rotation), and the number of gains.
"""

import argparse

import numpy as np

import rockfall
from benchmarks.machine import machine
from rockfall.grounds import table_names
from rockfall.grounds.shapes import SHAPES
from rockfall.io.rasters.grid import Grid

THROWN = (3, -1), (10, -3), (25, -2), (25, -15), (40, -30)  # velocity along and up [m/s]
CELL, COLUMNS, ROWS = 10.0, 400, 200  # cell size [m], numbers of cells
VOLUME, RADIUS = 0.268, 0.2  # volume [m3], R_m [m]
INERTIA = 0.4  # I/(m R_b^2)


def energies_left(
    table: str, shape: str, velocity: tuple[float, float], boulders: int
) -> np.ndarray:
    """Ratio of the energy after and before each contact."""
    case = rockfall.Case(
        case={"boulders": boulders, "seed": 3},
        surface={"uniform_mean_radius": RADIUS},
        impact={"form": "table", "table": table},
        boulder={"volume": "fixed", "volume_mean": VOLUME, "block_shape": shape},
        release={
            "x": [200.0], "y": [CELL * ROWS / 2], "drop_height": 1.0,
            "velocity": [float(velocity[0]), 0.0, float(velocity[1])],
        },
        output={"trajectories": boulders},
    )  # fmt: skip
    level = np.zeros((ROWS, COLUMNS))
    result = rockfall.run(case, dem=level, transform=Grid(0.0, CELL * ROWS, CELL, COLUMNS, ROWS))
    before, after = (
        sum(
            factor * result[f"trajectory_{state}_{part}"].values ** 2
            for part, factor in (("t", 1.0), ("n", 1.0), ("w", INERTIA))
        )
        for state in ("in", "out")
    )
    contacts = np.isfinite(before) & np.isfinite(after) & (before > 0)
    return after[contacts] / before[contacts]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boulders", type=int, default=2000)
    given = parser.parse_args()
    print(machine())
    print("| table | contacts | most energy left | gained |")
    print("|---|---|---|---|")
    for table in table_names():
        left = np.concatenate(
            [
                energies_left(table, shape, velocity, given.boulders)
                for shape in SHAPES
                for velocity in THROWN
            ]
        )
        print(f"| {table} | {left.size:,} | {left.max():.6f} | {(left > 1).sum()} |", flush=True)


if __name__ == "__main__":
    main()
