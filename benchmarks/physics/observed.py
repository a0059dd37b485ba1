# SPDX-License-Identifier: BSD-3-Clause
"""Compare simulated boulders with those observed at Vaujany, on slopes that no fit has used.

    python -m benchmarks.physics.observed [--slopes 32] [--boulders 2000] [--first 1000]
        [--sets NAME ...] [--law NAME=TABLE ...] [--ground ROW ...]
        [--radius-sigma S ...] [--write]

Table 2 of the paper lists mean, standard deviation and maximum of 100 boulders at two lines.
`vaujany-observed` is fitted to them on other slopes, `bourrier2009` to the values *simulated* in
the paper. Prints the relative errors, with standard errors, of these sets, of other given sets, and
of impact tables or classical grounds (benchmarks.physics.laws), over slopes generated as in
cases/vaujany, and the errors of the simulation in the paper. Maxima are compared as means of the
maximum of 100 boulders. --radius-sigma adds `vaujany-observed` with a separate rock size for each
boulder, and the change of the mean error of its six standard deviations. --write stores the results
in the table of evidence.
"""

import argparse
from collections.abc import Sequence
from itertools import product
from math import nan

import numpy as np
import pandas as pd
import rasterio

import rockfall
from benchmarks.evidence import record, row
from benchmarks.machine import NOTHING, ROOT, machine
from benchmarks.physics.laws import add_laws
from rockfall.result.crossings import line_values
from rockfall_lab.scorecard.vaujany_slope import CELL, NORTH, WEST, Talus, zones

CASES = ROOT / "cases" / "vaujany"
FIRST = 1000  # seed of the relief; no calibration has used it
DEFAULT = "vaujany-observed"
METHODS = {"A": "case_A.nml", "B": "case.nml"}
LINES = "EL1", "EL2"
QUANTITIES = "speed", "passing_height", "energy_translational"
AT_ONCE = 100  # number of boulders in the experiment


def measure(case: rockfall.Case, seed: int, boulders: int) -> pd.DataFrame:
    """Mean, deviation and mean maximum at the lines, by quantity; translational energy in kJ."""
    case = case.replace(case={"boulders": boulders, "seed": seed}, output=NOTHING)
    place = rasterio.Affine(CELL, 0, WEST, 0, -CELL, NORTH)
    result = rockfall.run(case, dem=Talus(seed=seed).elevation(), transform=place, zones=zones())
    table = rockfall.line_statistics(result).set_index(["line", "quantity"])[["mean", "std"]]
    table["max"] = [
        maximum(line_values(result, quantity, LINES.index(line))) if quantity in QUANTITIES else nan
        for line, quantity in table.index
    ]
    table.loc[(slice(None), "energy_translational"), :] /= 1e3
    return table


def maximum(values: np.ndarray) -> float:
    """Mean maximum of 100 passing boulders, from `values` at a line (NaN for boulders that do not
    pass); NaN if fewer than 100 pass."""
    passed = values[np.isfinite(values)]
    hundreds = passed[: len(passed) // AT_ONCE * AT_ONCE].reshape(-1, AT_ONCE)
    return float(hundreds.max(axis=1).mean()) if len(hundreds) else nan


def spread_name(sigma: float) -> str:
    """Name of the default set with a separate rock size for each boulder."""
    return f"{DEFAULT}, mean_radius_sigma {sigma:g}"


def deviation_error(run: pd.DataFrame, printed: pd.DataFrame) -> float:
    """Mean absolute error of the standard deviations of a run at both lines [%]."""
    errors = [
        run.loc[(line, quantity), "std"] / printed.loc[(line, "observed", quantity), "std"] - 1
        for line, quantity in product(LINES, QUANTITIES)
    ]
    return 100 * float(np.mean(np.abs(errors)))


def main(words: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--slopes", type=int, default=32)
    parser.add_argument("--boulders", type=int, default=2000)
    parser.add_argument("--first", type=int, default=FIRST)
    parser.add_argument("--sets", action="append", default=[], metavar="NAME")
    parser.add_argument("--radius-sigma", type=float, nargs="+", default=[], metavar="S")
    parser.add_argument("--write", action="store_true")
    add_laws(parser)
    given = parser.parse_args(words)
    printed = pd.read_csv(CASES / "paper.csv").set_index(["line", "method", "quantity"])
    paper = {name: rockfall.read_case(CASES / file) for name, file in METHODS.items()}
    cases = {f"bourrier2009, {name}": case for name, case in paper.items()}
    observed = {"sets": DEFAULT, "ratio": "between"}
    cases[DEFAULT] = paper["B"].replace(impact=observed)
    own = {spread_name(sigma): {"mean_radius_sigma": sigma} for sigma in given.radius_sigma}
    cases |= {name: cases[DEFAULT].replace(boulder=keys) for name, keys in own.items()}
    cases |= {name: paper["B"].replace(impact={"sets": name}) for name in given.sets}
    cases |= {law.name: paper["B"].replace(**law.of("compact")) for law in given.law}
    print(machine())
    runs = {
        name: [measure(case, given.first + k, given.boulders) for k in range(given.slopes)]
        for name, case in cases.items()
    }
    rows = []
    for line, quantity, number in product(LINES, QUANTITIES, ("mean", "std", "max")):
        seen = printed.loc[(line, "observed", quantity)]
        values = {f"paper, {one}": [printed.loc[(line, one, quantity), number]] for one in METHODS}
        values |= {
            name: [run.loc[(line, quantity), number] for run in of_slopes]
            for name, of_slopes in runs.items()
        }
        for name, of_slopes in values.items():
            key = "vaujany", line, f"{quantity}_{number}", name
            rows.append(row(key, seen["unit"], seen[number], of_slopes))
            error, spread = rows[-1].error, rows[-1].standard_error
            print(f"{line} {quantity} {number}, {name}: {error:+.1f} ± {spread:.1f} %")
    for name in own:
        changes = [
            deviation_error(with_own, printed) - deviation_error(without, printed)
            for with_own, without in zip(runs[name], runs[DEFAULT], strict=True)
        ]
        error = np.std(changes, ddof=1) / len(changes) ** 0.5
        print(f"{name}: deviations nearer by {-np.mean(changes):+.2f} ± {error:.2f} %")
    if given.write:
        record(rows)


if __name__ == "__main__":
    main()
