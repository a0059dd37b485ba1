# SPDX-License-Identifier: BSD-3-Clause
"""Coverage of intervals, and number of boulders in runs with `--until`.

    python -m benchmarks.accuracy.intervals [--parts 100] [--repetitions 2000]

First `cases/vaujany`: samples of 10,000 boulders, and how often the 95 % intervals of statistics at
the lines, including return levels, contain the value for all samples together. Then runs with
`--until` on a known distribution (60 % of the boulders cross, with lognormal speeds): boulders at
the end relative to theory, and how often the last interval contains the truth.
"""

import argparse

import numpy as np
import xarray as xr

import rockfall
from benchmarks.machine import NOTHING, VAUJANY, machine
from known_law import stages, theory
from rockfall.analysis import return_levels as tails
from rockfall.analysis.line_statistics import QUANTITIES, line_numbers
from rockfall.analysis.precision.intervals import sources
from rockfall.result.crossings import line_names, line_values
from rockfall.studies.run_until import read_rules

SIZE = 10_000  # boulders per sample
SHOWN = ("fraction", "mean", "std", "q50", "q90", "q95", "q98", "q99")
RULES = ("share@L<3%", "speed.mean@L<1%", "speed.std@L<3%", "speed.q50@L<1.5%", "speed.q95@L<2%")


def held(parts: list[xr.Dataset], truth: xr.Dataset) -> None:
    """Print how often intervals of `line_statistics` contain the value of the long run."""
    print(f"{'':30}" + "".join(f"{name:>7}" for name in SHOWN))
    source, all_sources = sources(parts[0]), sources(truth)
    for k, line in enumerate(line_names(truth)):
        for quantity in QUANTITIES:
            right = line_numbers(truth, k, quantity, all_sources)
            found = [line_numbers(part, k, quantity, source) for part in parts]
            shares = [
                np.mean([row[f"{n}_low"] <= right[n] <= row[f"{n}_high"] for row in found])
                for n in SHOWN
            ]
            print(f"{line:6}{quantity:24}" + "".join(f"{share:7.2f}" for share in shares))


def levels_held(parts: list[xr.Dataset], truth: xr.Dataset) -> None:
    """Print how often return-level intervals contain the value of the long run, over lines and
    quantities."""
    # Numbers of intervals that contain the value, exist, and were requested:
    counts = {N: [0, 0, 0] for N in tails.LEVELS}
    for k in range(truth.sizes["line"]):
        for quantity in tails.QUANTITIES:
            known = _known(truth, quantity, k)
            for part in parts:
                found = tails.tail(_known(part, quantity, k)).levels
                for N, level in found.items():
                    right = np.quantile(known, 1 - 1 / N)
                    given = level.refused is None
                    count = (given and level.low <= right <= level.high, given, True)
                    counts[N] = [a + b for a, b in zip(counts[N], count, strict=True)]
    for N, (hold, given, asked) in counts.items():
        about = f"{hold / given:.3f} of the intervals hold" if given else "always refused"
        print(f"1 in {N:,}: {given:,} of {asked:,} given; {about}")


def _known(result: xr.Dataset, quantity: str, line: int) -> np.ndarray:
    values = line_values(result, quantity, line)
    return values[~np.isnan(values)]


def ends(rule: str, repetitions: int, random: np.random.Generator) -> None:
    """Print when a rule stops runs of the known distribution, and the coverage at the end."""
    asked = read_rules(rule, ["L"])
    statistic = asked[0].statistic
    truth, need = theory(statistic, asked[0].limit)
    stops, holds = [], []
    for _ in range(repetitions):
        result = stages(asked, random)
        row = line_numbers(result, 0, "speed", sources(result))
        stops.append(result.sizes["boulder"] / need)
        holds.append(row[f"{statistic}_low"] <= truth <= row[f"{statistic}_high"])
    low, high = np.quantile(stops, [0.025, 0.975])
    near = np.mean(np.abs(np.array(stops) - 1) <= 0.2)
    print(f"{rule:20}{need:10,.0f}{f'{low:.2f}..{high:.2f}':>18}{near:13.0%}{np.mean(holds):8.1%}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--parts", type=int, default=100)
    parser.add_argument("--repetitions", type=int, default=2000)
    options = parser.parse_args()
    print(machine(), "\n")
    case = rockfall.read_case(VAUJANY).replace(
        case={"boulders": SIZE * options.parts},
        output=NOTHING,
    )
    truth = rockfall.run(case, progress=True)
    parts = [
        truth.isel(boulder=slice(k * SIZE, (k + 1) * SIZE)).load() for k in range(options.parts)
    ]
    print(f"cases/vaujany, {options.parts} samples of {SIZE:,}: intervals that hold the long run")
    held(parts, truth)
    print("\nReturn levels")
    levels_held(parts, truth)
    print(f"\n--until, {options.repetitions:,} repetitions")
    print(f"{'rule':20}{'theory':>10}{'95 % of n/theory':>18}{'within 20 %':>13}{'held':>8}")
    random = np.random.default_rng(5)
    for rule in RULES:
        ends(rule, options.repetitions, random)


if __name__ == "__main__":
    main()
