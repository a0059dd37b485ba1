# SPDX-License-Identifier: BSD-3-Clause
"""Coverage of intervals from few passing boulders, and on which side they miss the truth.

    python -m benchmarks.accuracy.few_passages [--repetitions 1000] [--boulders 200000]

`--boulders 0` runs only the known distributions.

Long runs of `cases/vaujany`, `cases/forested-slope` (with and without its forest) and
`cases/protected-road`, past lines that many or few boulders reach, are the truth. Short runs with
4, 10, 26, 100 and 300 passages on average are drawn from them, with equal numbers of boulders from
each source. Then known distributions: lognormal, exponential, and values half or most of which are
0. The constants of the method were fixed on other lines and seeds of these cases (northings 110,
200, 50, 73; 150, 73; 180, 80; 210, 270, 330, 402).
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

import rockfall
from benchmarks.machine import NOTHING, ROOT, machine
from rockfall.analysis.line_statistics import sample_numbers
from rockfall.analysis.precision.intervals import Sources
from rockfall.result.crossings import line_values

PASSAGES = (4, 10, 26, 100, 300)
LINES = {  # case file -> ends of lines and their northings [m]
    "vaujany/case.nml": ((1.25, 198.75), (441.72, 300.0, 240.0)),
    "forested-slope/bare.nml": ((1.5, 238.5), (60.0, 40.0)),
    "forested-slope/forest.nml": ((1.5, 238.5), (110.0,)),
    "protected-road/road.nml": ((1.5, 238.5), (140.0, 96.0)),
}
QUANTITIES = ("speed", "energy_total", "passing_height")
NUMBERS = ("mean", "std", "q50", "q95")
LAWS = {  # draw n values
    "exponential": lambda random, n: random.exponential(size=n),
    "lognormal, sigma 0.5": lambda random, n: np.exp(0.5 * random.normal(size=n)),
    "lognormal, sigma 1": lambda random, n: np.exp(random.normal(size=n)),
    "half are 0": lambda random, n: random.exponential(size=n) * (random.random(n) < 0.5),
    "1 of 20 is 10 times": (
        lambda random, n: random.exponential(size=n) * np.where(random.random(n) < 0.05, 10, 1)
    ),
    "4 of 5 are 0": lambda random, n: random.exponential(size=n) * (random.random(n) < 0.2),
}
SEED = 20261123


class Population(NamedTuple):
    """Values of boulders, one row per source; NaN if a boulder does not pass."""

    name: str
    values: np.ndarray


def of_cases(boulders: int) -> Iterator[Population]:
    """Yield the population of each quantity at each line of the long runs."""
    with tempfile.TemporaryDirectory() as folder:
        for file, (ends, northings) in LINES.items():
            case = rockfall.read_case(_with_terrain(ROOT / "cases" / file, Path(folder)))
            lines = [{"name": f"y{y:g}", "x": list(ends), "y": [y, y]} for y in northings]
            each = {"boulders": boulders // np.size(case.release["x"]), "seed": SEED}
            result = rockfall.run(case.replace(case=each, line=lines, output=NOTHING))
            for k, line in enumerate(lines):
                for quantity in QUANTITIES:
                    values = line_values(result, quantity, k).reshape(-1, each["boulders"])
                    yield Population(f"{quantity} {file} {line['name']}", values)


def _with_terrain(case: Path, folder: Path) -> Path:
    """Path of the case in a copy of its folder, with the terrain made if missing."""
    place = folder / case.parent.name
    if not place.exists():
        shutil.copytree(case.parent, place)
    if not [*place.glob("dem.*")]:
        subprocess.run([sys.executable, place / "make_terrain.py"], check=True)
    return place / case.name


def of_laws(size: int) -> Iterator[Population]:
    """Yield populations from the known distributions, in which half of the boulders pass."""
    for name, law in LAWS.items():
        random = np.random.default_rng(SEED)
        values = law(random, size)
        yield Population(name, np.where(random.random(size) < 0.5, values, np.nan)[None])


def drawn(found: Population, passages: float, random: np.random.Generator) -> tuple:
    """Values of the passing boulders of a short run, and their sources. Each source has the same
    number of boulders, chosen for a mean number of passages."""
    of, size = found.values.shape
    each = max(2, round(passages / np.isfinite(found.values).sum(axis=1).mean() * size / of))
    chosen = random.integers(size, size=(of, each)) + size * np.arange(of)[:, None]
    values = found.values.ravel()[chosen.ravel()]
    passed = np.isfinite(values)
    source = Sources.of(np.repeat(np.arange(of), each))
    return values[passed], source[passed]


def judged(found: Population, passages: float, repetitions: int, seed: int) -> np.ndarray:
    """Flags (repetitions, NUMBERS, 4): the interval has a lower limit, has an upper limit; the
    truth is below it, is above it."""
    random = np.random.default_rng(seed)
    values = found.values[np.isfinite(found.values)]
    truth = {"mean": values.mean(), "std": values.std()}
    truth |= {"q50": np.quantile(values, 0.5), "q95": np.quantile(values, 0.95)}
    rows = np.zeros((repetitions, len(NUMBERS), 4), bool)
    for row in rows:
        values, source = drawn(found, passages, random)
        if not values.size:
            continue
        numbers = sample_numbers(values, source)
        for k, name in enumerate(NUMBERS):
            low, high = (numbers.get(f"{name}_{end}", np.nan) for end in ("low", "high"))
            row[k] = low == low, high == high, truth[name] < low, truth[name] > high
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=1000)
    parser.add_argument("--boulders", type=int, default=200_000)
    options = parser.parse_args()
    print(machine(), "\n")
    tables = defaultdict(list)
    cases = of_cases(options.boulders) if options.boulders else ()
    for number, found in enumerate((*cases, *of_laws(400_000))):
        kind = found.name.split()[0] if found.name.split()[0] in QUANTITIES else found.name
        for passages in PASSAGES:
            rows = judged(found, passages, options.repetitions, SEED + 100 * number + passages)
            for k, name in enumerate(NUMBERS):
                tables[kind, name, passages].append((rows[:, k], found.name))
    print("Percentages of the repetitions: both limits are given; of those with a limit, the truth")
    print(
        "lies above the upper one, below the lower one (nominal 2.5 each); and neither: on average"
    )
    print("over lines, and at the worst of them.\n")
    print(f"{'':24}number  passages   given   above   below    held   worst")
    for (kind, name, passages), parts in tables.items():
        rows = np.concatenate([part for part, _ in parts])
        given, above, below = (rows[:, 0] & rows[:, 1]).mean(), _miss(rows, 1), _miss(rows, 0)
        worst, line = min((1 - _miss(part, 1) - _miss(part, 0), line) for part, line in parts)
        cells = "".join(
            f"{100 * one:8.1f}" if given else f"{'-':>8}"
            for one in (above, below, 1 - above - below, worst)
        )
        line = line.split()[-1] if given and len(parts) > 1 else ""
        print(f"{kind:24}{name:>6}{passages:10}{100 * given:8.1f}{cells} {line}")


def _miss(rows: np.ndarray, end: int) -> float:
    """Fraction of the repetitions with the truth beyond their limit, among those that have a limit;
    0 if none has."""
    return rows[:, 2 + end].sum() / max(1, rows[:, end].sum())


if __name__ == "__main__":
    main()
