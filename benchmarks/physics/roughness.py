# SPDX-License-Identifier: BSD-3-Clause
"""Effect of the `roughness_angle` of classical grounds on planes and at sites.

    python -m benchmarks.physics.roughness [FOLDER] [--row ROW ...] [--angle 4 8 12 16 20 25]
        [--slopes 8]

FOLDER has the tables of benchmarks.physics.tschamut; without it, that site is omitted. Prints as
Markdown, for each row of the shipped table and each angle: run-outs of the calibration half of
Tschamut (2 seeds of 50 boulders a run; standard errors are below 1 m); the fraction of boulders
that exceed 0.8 m/s per degree and their mean maximum speed on planes of 30, 38 and 45 degrees
(benchmarks.physics.runaway); and relative errors of mean speed, passing height and energy at line
EL1 of Vaujany (benchmarks.physics.observed; standard errors are below 4 %).
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd

import rockfall
from benchmarks.machine import machine
from benchmarks.physics.laws import Law, ground
from benchmarks.physics.observed import CASES, FIRST, METHODS, measure
from benchmarks.physics.runaway import beyond
from benchmarks.physics.tschamut import Run, described, observed, simulated, terrain

ROWS = (
    "pfeiffer_soil", "pfeiffer_talus", "pfeiffer_rock", "constant_meadow", "constant_talus",
    "rock_ledge", "bourrier_hungr_soft", "bourrier_hungr", "soil_1", "soil_4",
    "rockyfor3d-2023:soil_4",
)  # fmt: skip
ANGLES = 4, 8, 12, 16, 20, 25  # roughness angles [degree]
PLANES = 30, 38, 45  # slopes of planes [degree]
SEEDS, BOULDERS, ON_PLANES, ON_SLOPES = (1, 2), 50, 400, 1000
QUANTITIES = {"speed": "speed", "passing_height": "height", "energy_translational": "energy"}
LINE = "EL1"


def on_pasture(law: Law, runs: list[Run], place: tuple) -> list[str]:
    """Mean run-out and Wasserstein distance [m], averaged over seeds."""
    found = [
        described(runs, [simulated(run, law, place, BOULDERS, seed) for run in runs])
        for seed in SEEDS
    ]
    return [f"{np.mean([one[name] for one in found]):.0f}" for name in ("mean", "Wasserstein")]


def on_talus(law: Law, slopes: int, seen: pd.DataFrame) -> list[str]:
    """Relative error of the mean of each quantity at the line, as text."""
    case = rockfall.read_case(CASES / METHODS["B"]).replace(**law.of("compact"))
    runs = [measure(case, FIRST + k, ON_SLOPES) for k in range(slopes)]
    errors = []
    for quantity in QUANTITIES:
        printed = seen.loc[(LINE, "observed", quantity), "mean"]
        mean = np.mean([run.loc[(LINE, quantity), "mean"] for run in runs])
        errors.append(f"{mean / printed - 1:+.0%}" if np.isfinite(mean) else "-")
    return errors


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--row", action="append", dest="rows")
    parser.add_argument("--angle", type=float, nargs="+", default=ANGLES)
    parser.add_argument("--slopes", type=int, default=8)
    given = parser.parse_args()
    pasture = given.folder and (observed(given.folder, "calibration"), terrain(given.folder))
    seen = pd.read_csv(CASES / "paper.csv").set_index(["line", "method", "quantity"])
    print(machine())
    columns = ["row", "roughness"]
    columns += ["Tschamut: mean", "Wasserstein"] if pasture else []
    columns += [f"{slope} degrees" for slope in PLANES]
    columns += [f"{LINE}: {name}" for name in QUANTITIES.values()]
    print("|", " | ".join(columns), "|")
    print("|---" * len(columns) + "|")
    for row in given.rows or ROWS:
        for angle in given.angle:
            law = ground(f"{row}@{angle:g}")
            cells = [f"`{row}`", f"{angle:g}"]
            cells += on_pasture(law, *pasture) if pasture else []
            for slope in PLANES:
                part, speed = beyond(law, slope, ON_PLANES)
                cells.append(f"{part:.2f}, {speed:.0f} m/s")
            cells += on_talus(law, given.slopes, seen)
            print("|", " | ".join(cells), "|", flush=True)


if __name__ == "__main__":
    main()
