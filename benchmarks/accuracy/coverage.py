# SPDX-License-Identifier: BSD-3-Clause
"""Coverage of intervals for groups of boulders, windows along a line, and cells.

    python -m benchmarks.accuracy.coverage [--repetitions 300] [--maps 200]

On the synthetic slope with cliffs from `benchmarks.accuracy.sources`: runs from one source, from
many similar sources (neighbours) and from many different sources (anywhere above the road), and the
fraction of intervals that contain the mean over all repetitions. Then maps, for fixed sources, and
for sampled sources that are drawn again for each run.
"""

import argparse
from collections import defaultdict

import numpy as np
import pandas as pd
import xarray as xr

import rockfall
from benchmarks.accuracy.sources import slope
from benchmarks.machine import machine
from rockfall.analysis.line_statistics import line_statistics
from rockfall.analysis.lines.profile import line_profile

ROAD, WIDTH = 500.0, 50.0  # northing of the line, windows along it [m]
CLASSES = (0.7, 0.9)  # limits between volume classes [m3]
LEVELS = (0, 10, 20, 50, 200, np.inf)  # classes of mean passages for which coverage is printed
NUMBERS = ("fraction", "mean", "std", "q50", "q95")
KINDS = {"one": (1, 5000), "alike": (50, 100), "unlike": (50, 100), "singles": (5000, 1)}


def places(kind: str, of: int, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates x, y [m] of `of` sources."""
    if kind in ("one", "alike"):
        return 360 + 0.1 * np.arange(of), np.full(of, 640.0)
    return random.uniform(150, 1050, of), random.uniform(ROAD + 60, 900, of)


def case_of(x: np.ndarray, y: np.ndarray, each: int, seed: int, **groups: dict) -> rockfall.Case:
    """Case with boulders of different volumes from given places, above a road."""
    return rockfall.Case(
        case={"boulders": each, "seed": seed}, terrain={}, surface={"uniform_mean_radius": 0.2},
        boulder={"volume": "normal", "volume_mean": 0.8, "volume_std": 0.15},
        release={"x": x.tolist(), "y": y.tolist(), "drop_height": 2.0, **groups.pop("release", {})},
        line=[{"name": "road", "x": [30.0, 1170.0], "y": [ROAD, ROAD]}], **groups,
    )  # fmt: skip


class Held:
    """Counts of intervals that contain the truth, that exist, and that were requested, by statistic
    and class of passages."""

    def __init__(self) -> None:
        self.of: dict[tuple, list] = defaultdict(list)

    def add(self, name: str, low, high, truth, passages) -> None:
        """Add the counts of one repetition."""
        low, high, truth = (np.asarray(one, float) for one in (low, high, truth))
        level = np.digitize(passages, LEVELS) - 1
        given = np.isfinite(low) & np.isfinite(high)
        for k in np.unique(level):
            mine = level == k
            holds = (low <= truth) & (truth <= high)
            self.of[name, k].append(((holds & given)[mine].sum(), (given & mine).sum(), mine.sum()))

    def show(self, about: str) -> None:
        """Print coverage with its standard error over repetitions, and the percentage of intervals
        that exist."""
        for (name, k), found in sorted(self.of.items()):
            holds, given, asked = np.array(found, float).T
            if not given.sum():
                continue
            share = holds.sum() / given.sum()
            error = (holds - share * given).std(ddof=1) * np.sqrt(len(found)) / given.sum()
            level = f"{LEVELS[k]:g} to {LEVELS[k + 1]:g}"
            part = 100 * given.sum() / asked.sum()
            print(
                f"{about:24}{name:24}{level:>10}{100 * share:9.1f} +- {100 * error:.1f}{part:8.0f}"
            )


def of_lines(kind: str, repetitions: int, terrain: dict) -> None:
    """Print the coverage for groups and windows; repetitions are separate parts of one long run."""
    of, each = KINDS[kind]
    x, y = places(kind, of, np.random.default_rng(1))
    case = case_of(x, y, each * repetitions, 1, output={"rebounds": False})
    long = rockfall.run(case, **terrain)
    turn = (long["boulder"].values - 1) % (each * repetitions) // each
    own = np.argsort(turn, kind="stable").reshape(repetitions, of * each)
    tables = {
        "by source": (lambda part: line_statistics(part, "source"), ["source", "quantity"]),
        "by volume": (
            lambda part: line_statistics(part, "volume", CLASSES),
            ["volume", "quantity"],
        ),
        "along": (lambda part: line_profile(part, "road", WIDTH), ["start"]),
    }
    for name, (table, keys) in tables.items():
        held, truth = Held(), _numbers(table(long), keys)
        for k in range(repetitions):
            found = _numbers(table(long.isel(boulder=own[k])), keys).reindex(truth.index)
            for number in truth.columns:
                if number == "n" or number.endswith(("_low", "_high")):
                    continue
                low, high = (found.get(f"{number}_{end}", np.nan) for end in ("low", "high"))
                held.add(number, low, high, truth[number], truth["n"] / repetitions)
        held.show(f"{kind}: {name}")


def _numbers(table: pd.DataFrame, keys: list[str]) -> pd.DataFrame:
    if "quantity" in table:
        table = table[table["quantity"].isin(["speed", "energy_total", "passing_height"])]
    table = table.set_index(keys)
    kept = [c for c in table if c.split("_low")[0].split("_high")[0] in NUMBERS or c == "n"
            or c.startswith(("energy_total", "passing_height"))]  # fmt: skip
    return table[kept]


def of_maps(reading: str, of: int, each: int, repetitions: int, terrain: dict) -> None:
    """Print the coverage for cells, from separate runs."""
    names = ["reach_probability", "energy_q50", "energy_q95"]
    maps = ["passages", *(n + end for n in names for end in ("", "_low", "_high"))]
    groups = {"output": {"maps": maps, "map_extent": "terrain", "rebounds": False}}
    release = {"release": {"sources": "sample" if reading == "sample" else "all"}}
    random = np.random.default_rng(2)
    x, y = places("unlike", of, random)
    many = places("unlike", 2_000, np.random.default_rng(3)) if reading == "sample" else (x, y)
    boulders = repetitions * of * each // len(many[0])
    truth = rockfall.run(case_of(*many, boulders, 10_000, **groups), **terrain)
    passages = truth["passages"].values * (of * each / truth.sizes["boulder"])
    held, seen = Held(), passages >= 1
    for seed in range(1, repetitions + 1):
        if reading == "sample":
            x, y = places("unlike", of, random)
        found: xr.Dataset = rockfall.run(case_of(x, y, each, seed, **groups, **release), **terrain)
        for name in names:
            low, high = (found[f"{name}_{end}"].values[seen] for end in ("low", "high"))
            held.add(name, low, high, truth[name].values[seen], passages[seen])
    held.show(f"{reading}: {of} x {each}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=300)
    parser.add_argument("--maps", type=int, default=200)
    options = parser.parse_args()
    print(machine(), "\n")
    z, grid = slope(None)
    terrain = {"dem": z, "transform": grid}
    print(f"{'':24}{'number':24}{'passages':>10}{'held [%]':>16}{'given [%]':>11}")
    for kind in KINDS if options.repetitions else ():
        of_lines(kind, options.repetitions, terrain)
    for reading in ("given", "sample") if options.maps else ():
        for of, each in ((20, 50), (200, 5)):
            of_maps(reading, of, each, options.maps, terrain)


if __name__ == "__main__":
    main()
