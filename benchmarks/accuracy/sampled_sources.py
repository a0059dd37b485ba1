# SPDX-License-Identifier: BSD-3-Clause
"""Coverage of intervals if sources are a sample: fractions of boulders, frequencies at a place, and
fractions over scenarios with common random numbers.

    python -m benchmarks.accuracy.sampled_sources [--repetitions 1000] [--seed 1]

Boulders pass with the probability of their source; sources are drawn again in each repetition.
Intervals that miss the truth are below it (unsafe) or above.
"""

import argparse
from collections.abc import Callable

import numpy as np
from scipy.stats import norm

from benchmarks.machine import machine
from rockfall.analysis.precision.clusters import Clusters
from rockfall.analysis.precision.intervals import Sources, fraction_interval
from rockfall.analysis.precision.weighted import Weighted
from rockfall.kernel_rules import count_limits

KINDS: dict[str, Callable] = {  # probability of passing for sources at 0 to 1, with a given mean
    "alike": lambda at, mean: np.full(at.shape, mean),
    "unlike": lambda at, mean: norm.sf(np.sqrt(2) * norm.isf(mean) + norm.ppf(at)),
    "a gully": lambda at, mean: np.where(at < 2 * mean, 0.5, 0.0),
    "all or none": lambda at, mean: np.where(at < mean, 1.0, 0.0),
}
SIZES = ((5, 200), (10, 20), (30, 100), (100, 20), (300, 3), (1000, 10))
FEWER = np.array([1.0, 0.6, 0.3])  # fraction of passing boulders by scenario
PRODUCTS = "fraction", "frequency", "scenarios"


def held(kind: str, of: int, each: int, mean: float, repetitions: int, random) -> np.ndarray:
    """Fractions (products, 3) of intervals that contain the truth, are below it, and above it."""
    number = np.repeat(np.arange(of), each)
    source, means = Sources.of(number, sampled=True), mean * FEWER
    pooled = Weighted(np.repeat(1 / number.size, 3 * number.size), np.tile(number, 3))
    truth, found = np.array([mean, mean, means.mean()]), np.zeros((len(PRODUCTS), 3))
    for _ in range(repetitions):
        at, chance = random.random(of), random.random(number.size)
        passes = [KINDS[kind](at, own)[number] - chance for own in means]
        boulders = np.flatnonzero(passes[0] > 0)
        per_cluster = Clusters(source, each).at(boulders, passes[0][boulders])
        limits = (
            fraction_interval(passes[0] > 0, source)[1:],
            np.ravel(count_limits(np.array([boulders.size]), number.size, per_cluster)),
            pooled.fraction(np.concatenate(passes) > 0)[1:],
        )
        low, high = np.transpose(limits)
        found += np.transpose([(low <= truth) & (truth <= high), high < truth, low > truth])
    return found / repetitions


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    print(machine(), "\n")
    random = np.random.default_rng(options.seed)
    error = 100 * np.sqrt(0.05 * 0.95 / options.repetitions)
    print(f"Intervals that contain the truth, lie below it, above it [%]; errors {error:.1f}")
    print(f"{'sources':14}{'number':>8}{'each':>6}{'passing':>10}", end="")
    print("".join(f"{name:>21}" for name in PRODUCTS))
    by_level: dict[str, list[np.ndarray]] = {}
    for kind in KINDS:
        for of, each in SIZES:
            n = of * each
            levels = {"common": 0.3, "30": 30 / n, "8": 8 / n, "1": 1 / n}
            for level, mean in levels.items():
                row = 100 * held(kind, of, each, mean, options.repetitions, random)
                by_level.setdefault(level, []).append(row)
                show(f"{kind:14}{of:8,}{each:6}{level:>10}", row)
    for level, rows in by_level.items():
        show(f"{'all':28}{level:>10}", np.mean(rows, axis=0))


def show(about: str, row: np.ndarray) -> None:
    print(about + "".join("".join(f"{one:7.1f}" for one in three) for three in row), flush=True)


if __name__ == "__main__":
    main()
