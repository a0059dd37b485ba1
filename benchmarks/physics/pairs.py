# SPDX-License-Identifier: BSD-3-Clause
"""Pairs of ground strength and relief that agree with field evidence: for each strength, the relief
that gives the observed speeds or run-outs.

    python -m benchmarks.physics.pairs talus [--strengths 2e5 ...] [--sigma 0.65] [--slopes 12]
    python -m benchmarks.physics.pairs meadow --data FOLDER [--strengths 1e6 ...] [--sigma 0 0.65]

Talus is fitted to the mean speeds observed at both lines of Vaujany, on slopes generated as in
cases/vaujany from seed 3000 on. Meadow is fitted to the mean run-out of the calibration half of
Tschamut (FOLDER as in benchmarks.physics.tschamut), with the shape of each block. Prints the other
statistics for each pair; docs/archive/field_protocol.md lists the resulting choices.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

import rockfall
from benchmarks.machine import machine
from benchmarks.physics import tschamut
from benchmarks.physics.laws import Law, changed_ground
from benchmarks.physics.observed import CASES, LINES, measure
from rockfall.grounds import shipped_rows, yielding_ground

FIRST, BOULDERS = 3000, 2000  # seed of the first slope; boulders per slope
SEEDS, OF_RUN = (1, 2, 3), 60  # seeds at Tschamut; boulders per run
TOLERANCE, TRIES = 0.005, 6  # relative tolerance of the mean; maximum number of reliefs
DEGREES = 0.1  # rounding of reliefs
PER_DEGREE = -0.04  # first guess: relative change of the mean per degree of relief

Found = tuple[float, dict[str, float]]  # relative error of the mean, and printed values


def on_talus(tried: Law, slopes: int) -> Found:
    """Relative error of the mean speed at Vaujany, and errors at both lines [%]."""
    printed = pd.read_csv(CASES / "paper.csv").set_index(["line", "method", "quantity"])
    paper = rockfall.read_case(CASES / "case.nml")
    case = paper.replace(**tried.of("compact"))
    runs = [measure(case, FIRST + k, BOULDERS) for k in range(slopes)]
    errors = {
        f"{line} {quantity} {number}": np.mean([run.loc[(line, quantity), number] for run in runs])
        / printed.loc[(line, "observed", quantity), number]
        - 1
        for line in LINES
        for quantity in ("speed", "passing_height", "energy_translational")
        for number in ("mean", "std", "max")
    }
    mean = float(np.mean([errors[f"{line} speed mean"] for line in LINES]))
    return mean, {name: 100 * error for name, error in errors.items()}


def on_meadow(tried: Law, data: Path) -> Found:
    """Relative error of the mean run-out at Tschamut, and statistics of the run-outs."""
    runs, place = tschamut.observed(data, "calibration"), tschamut.terrain(data)
    seen = np.mean([np.hypot(*(run.rest - run.start)) for run in runs])
    tables = [
        tschamut.described(
            runs, [tschamut.simulated(run, tried, place, OF_RUN, seed) for run in runs]
        )
        for seed in SEEDS
    ]
    found = {name: float(np.mean([table[name] for table in tables])) for name in tables[0]}
    return found["mean"] / seen - 1, found


def fitted(start: float, error_of: Callable[[float], Found]) -> Iterator[tuple[float, Found]]:
    """Yield reliefs [degree] with their results, by the secant method, until the mean agrees within
    TOLERANCE or after TRIES reliefs."""
    relief, before = start, None
    for _ in range(TRIES):
        found = error_of(relief)
        yield relief, found
        slope = PER_DEGREE
        if before and abs(before[1] - found[0]) > 1e-4 and before[0] != relief:
            slope = (found[0] - before[1]) / (relief - before[0])
        before = relief, found[0]
        step = float(np.clip(-found[0] / slope, -4.0, 4.0))
        if abs(found[0]) < TOLERANCE or round(relief + step, 1) == relief:
            return
        relief = round(relief + step, 1)


def main(words: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("ground", choices=["talus", "meadow"])
    parser.add_argument("--data", type=Path)
    parser.add_argument("--strengths", type=float, nargs="+")
    parser.add_argument("--sigma", type=float, nargs="+")
    parser.add_argument("--slopes", type=int, default=12)
    given = parser.parse_args(words)
    own = yielding_ground(shipped_rows().rows[given.ground])[1]
    print(machine())
    pairs = product(given.strengths or [own.strength], given.sigma or [own.strength_sigma])
    for strength, sigma in pairs:

        def error_of(relief: float, strength: float = strength, sigma: float = sigma) -> Found:
            values = {"strength": strength, "strength_sigma": sigma, "relief": relief}
            tried = changed_ground(f"{strength:g}-{sigma:g}-{relief:g}", given.ground, **values)
            if given.ground == "talus":
                return on_talus(tried, given.slopes)
            return on_meadow(tried, given.data)

        *_, (relief, (error, numbers)) = fitted(own.relief, error_of)
        text = ", ".join(f"{name} {value:.4g}" for name, value in numbers.items())
        print(
            f"{strength:g} Pa, {sigma:g}: {relief:.1f} degrees ({error:+.3f}): {text}", flush=True
        )


if __name__ == "__main__":
    main()
