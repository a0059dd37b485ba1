# SPDX-License-Identifier: BSD-3-Clause
"""Coverage of intervals for boulders from many sources, and agreement of predicted numbers of
boulders.

    python -m benchmarks.accuracy.sources [--dem FILE] [--repetitions 500] [--seeds 20]

First sources with known probabilities: how often the intervals contain the truth. Then a slope with
cliffs (the given elevation raster with its steepest cells as sources, or a synthetic slope): the
printed interval compared with the scatter between new seeds, and the numbers of boulders required
for the same interval by `--until`, `rockfall convergence` and reports.
"""

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

import rockfall
from benchmarks.machine import machine
from rockfall.analysis.line_statistics import line_numbers, sample_numbers
from rockfall.analysis.precision.intervals import (
    Sources,
    boulders_needed,
    fraction_interval,
    half_width,
    sources,
)
from rockfall.io.rasters.geotiff import write_geotiff
from rockfall.io.rasters.grid import Grid
from rockfall.kernel_rules import Z
from rockfall.studies.convergence import KEYS, MIN_REFERENCE, MIN_TURNS, converge
from rockfall.studies.run_until import evaluate, read_rules

NUMBERS = ("fraction", "mean", "std", "q95")
KINDS: dict[str, Callable] = {  # probability of passing for places at 0 to 1 along the sources
    "alike": lambda at: np.full(at.size, 0.3),
    "a gully": lambda at: 0.5 * np.clip(np.sin(6 * at), 0, 1) + 0.05,
    "unlike": lambda at: np.random.default_rng(1).beta(0.5, 1.0, at.size),
    "all or none": lambda at: (at < 0.3).astype(float),
}
SIZES = ((1, 1000), (5, 200), (20, 10), (300, 1), (300, 2), (300, 20), (3000, 2))
CELL, SOURCES, EACH = 5.0, 3232, 31
RULES = ("fraction@road<1%", "speed.mean@road<1%", "energy_total.q95@road<2%")


def covered(kind: str, of: int, each: int, repetitions: int) -> np.ndarray:
    """Fraction of intervals that contain the truth, for each of `NUMBERS`. Speeds of passing
    boulders increase with the probability of their source."""
    random = np.random.default_rng(of)
    chance = KINDS[kind]((np.arange(of) + 0.5) / of)
    number = np.repeat(np.arange(of), each)
    where = Sources.of(number)

    def speeds(at: np.ndarray) -> np.ndarray:
        values = 10 + 5 * chance[at] + random.normal(0, 1, at.size)
        return np.where(random.random(at.size) < chance[at], values, np.nan)

    many = np.tile(np.arange(of), -(-1_000_000 // of))
    values = speeds(many)
    values = values[np.isfinite(values)]
    sample = sample_numbers(values, Sources.alone(values.size))
    truth = [chance.mean(), *(sample[name] for name in NUMBERS[1:])]
    held = []
    for _ in range(repetitions):
        v = speeds(number)
        crossed = np.isfinite(v)
        row = sample_numbers(v[crossed], where[crossed])
        _, row["fraction_low"], row["fraction_high"] = fraction_interval(crossed, where)
        limits = [[row.get(f"{n}_{end}", np.nan) for end in ("low", "high")] for n in NUMBERS]
        held.append([np.nan if np.isnan(low + high) else low <= right <= high
                     for (low, high), right in zip(limits, truth, strict=True)])  # fmt: skip
    return np.nanmean(np.array(held, float), axis=0) if not np.isnan(held).all() else held[0]


def slope(path: str | None) -> tuple[np.ndarray, Grid]:
    """Elevations [m], NaN if unknown, and their grid."""
    if path is None:
        x, y = np.meshgrid(np.arange(240) * CELL, np.arange(240) * CELL)
        z = 600 - 0.6 * y + 30 * np.sin(x / 90) + 5 * np.sin(x / 17 + y / 23)
        for top, middle in ((250, 400), (380, 850)):  # make two cliffs
            z -= 60 / (1 + np.exp(-(y - top - 0.1 * x) / 12)) * np.exp(-(((x - middle) / 260) ** 4))
        return z, Grid(0.0, 1200.0, CELL, 240, 240)
    import rasterio

    with rasterio.open(path) as file:
        z = file.read(1, masked=True).astype(float).filled(np.nan)
        return z, Grid(file.bounds.left, file.bounds.top, file.res[0], file.width, file.height)


def case_of_slope(z: np.ndarray, grid: Grid) -> tuple[rockfall.Case, dict]:
    """Case and its arrays: sources are the steepest cells between the median and the upper quartile
    of elevation; a fifth of the boulders stop beyond the road, which runs from west to east."""
    fall, right = np.gradient(z, grid.cell)
    steep, levels = np.hypot(fall, right), np.nanquantile(z, [0.5, 0.75])
    steep[~((z > levels[0]) & (z < levels[1]))] = 0
    cells = (steep >= np.sort(steep[np.isfinite(steep)])[-SOURCES]).astype("i4")
    arrays = {"dem": z, "transform": grid, "cells": cells}
    case = rockfall.Case(
        case={"boulders": EACH, "seed": 1}, surface={"uniform_mean_radius": 0.35},
        boulder={"volume": "normal", "volume_mean": 0.8, "volume_std": 0.15},
        terrain={}, release={"drop_height": 1.0, "cells": "cells.tif"},
    )  # fmt: skip
    few = rockfall.run(case.replace(case={"boulders": 2}), **arrays)
    down = np.sign(np.nanmean(fall))  # 1: falls to the north, -1: to the south
    y = float(np.quantile(few["stop_y"], 0.8 if down > 0 else 0.2))
    row = int((grid.north - y) / grid.cell)
    known = np.flatnonzero(np.isfinite(z[row]))
    x = [grid.west + (k + 0.5) * grid.cell for k in (known[0], known[-1])]
    return case.replace(line=[{"name": "road", "x": x, "y": [y, y]}]), arrays


def scatter(case: rockfall.Case, arrays: dict, seeds: int) -> None:
    """Print intervals next to the scatter of the statistics between seeds."""
    rules, rows = read_rules(",".join(RULES), ["road"]), {rule: [] for rule in RULES}
    for seed in range(1, seeds + 1):
        result = rockfall.run(case.replace(case={"seed": seed}), **arrays)
        for sampled in (False, True):
            where = sources(result)
            where = Sources.of(where.number, sampled)
            for rule in rules:
                row = line_numbers(result, 0, rule.quantity, where)
                half = half_width(row, rule.statistic) * row[rule.statistic]
                rows[rule.text].append((row[rule.statistic], half))
    print(f"\n{result.sizes['boulder']:,} boulders of {where.count:,} sources, {seeds} seeds")
    print(
        f"{'':28}{'number':>10}{'std of seeds':>18}{'half/1.96':>12}{'over it':>16}{'sample':>10}"
    )
    for rule, found in rows.items():
        (value, half), (_, sample) = np.array(found).reshape(seeds, 2, 2).transpose(1, 2, 0)
        std, sd = value.std(ddof=1), half.mean() / Z
        error = std / np.sqrt(2 * (seeds - 1))
        ratio = f"{sd / std:.2f} +- {sd / std * error / std:.2f}"
        spread = f"{std:.3g} +- {error:.1g}"
        print(f"{rule:28}{value.mean():10.4g}{spread:>20}{sd:10.3g}{ratio:>16}"
              f"{sample.mean() / Z:10.3g}")  # fmt: skip


def promised(case: rockfall.Case, arrays: dict) -> None:
    """Print the numbers of boulders that `--until`, `rockfall convergence` and reports require for
    the same interval."""
    few = arrays["cells"].copy()
    few.ravel()[np.flatnonzero(few)[np.arange(few.sum()) % 8 > 0]] = 0  # many per block
    arrays = arrays | {"cells": few}
    result = rockfall.run(case, **arrays)
    where, boulders = sources(result), result.sizes["boulder"]
    found = converge_here(case, arrays)
    cost = found.cost.set_index(KEYS)
    print(f"\nBoulders over all of {where.count:,} sources, from {boulders:,} of a run")
    print(f"{'':28}{'--until':>10}{'report':>10}{'ended at':>10}{'convergence':>20}")
    for rule in read_rules(",".join(RULES), ["road"]):
        row = line_numbers(result, 0, rule.quantity, where)
        crossed = np.inf if rule.statistic == "fraction" else row["n"]
        report = boulders_needed(boulders, half_width(row, rule.statistic), rule.limit, crossed)
        until = evaluate([rule], result)[0].need * where.count
        end = rockfall.run_until(case, rule.text, cap=100_000, **arrays).sizes["boulder"]
        quantity = "boulders" if rule.statistic == "fraction" else rule.quantity
        if ("road", quantity, rule.statistic) not in cost.index:  # too few boulders in a block
            print(f"{rule.text:28}{until:10,.0f}{report:10,.0f}{end:10,}{'-':>20}")
            continue
        error = found.error.set_index(KEYS).loc[[("road", quantity, rule.statistic)]]
        measured = cost.loc[
            ("road", quantity, rule.statistic), f"boulders_{100 * rule.limit:g}_percent"
        ]
        spread = 2 / np.sqrt(2 * error["blocks"].max())  # relative error of a squared RMS
        print(f"{rule.text:28}{until:10,.0f}{report:10,.0f}{end:10,}"
              f"{f'{measured:,.0f} +- {spread * measured:,.0f}':>20}")  # fmt: skip


def converge_here(case: rockfall.Case, arrays: dict):
    """Run `rockfall convergence` on files."""
    with tempfile.TemporaryDirectory() as folder:
        for name in ("dem", "cells"):
            write_geotiff(
                Path(folder) / f"{name}.tif", arrays[name].astype("f4"), arrays["transform"]
            )
        files = case.replace(terrain={"dem": "dem.tif"})
        path = Path(folder) / "case.nml"
        path.write_text(files.text())
        reference = max(MIN_REFERENCE, MIN_TURNS * int(arrays["cells"].sum()))
        return converge(rockfall.read_case(path), boulders=[10, EACH], reference=reference)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--dem")
    parser.add_argument("--repetitions", type=int, default=500)
    parser.add_argument("--seeds", type=int, default=20)
    options = parser.parse_args()
    print(machine(), "\n")
    error = 100 * np.sqrt(0.05 * 0.95 / options.repetitions)
    print(f"Intervals that hold the truth [%], standard error {error:.1f}")
    print(f"{'sources':14}{'number':>8}{'each':>6}" + "".join(f"{name:>10}" for name in NUMBERS))
    for kind in KINDS:
        for of, each in SIZES:
            if of > 1 or kind == "alike":
                held = covered(kind, of, each, options.repetitions)
                print(f"{kind:14}{of:8,}{each:6}" + "".join(f"{100 * one:10.1f}" for one in held))
    case, arrays = case_of_slope(*slope(options.dem))
    scatter(case, arrays, options.seeds)
    promised(case, arrays)


if __name__ == "__main__":
    main()
