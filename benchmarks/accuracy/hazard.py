# SPDX-License-Identifier: BSD-3-Clause
"""Uncertainty of a hazard assessment: cases/settlement with many seeds.

Prints means over seeds with standard errors, as in the README of the case. For small runs it also
prints how often the intervals of cells contain the mean frequency of all large runs, and how often
a class reported as certain equals their class.

    python cases/settlement/make_terrain.py && python -m benchmarks.accuracy.hazard
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import rockfall
from rockfall.analysis.hazard.classes import CLASSES, Matrix, hazard_classes
from rockfall.files.hazard_files import object_table
from rockfall.io.rasters.arrays import grid_of

FOLDER = Path(__file__).parents[2] / "cases/settlement"
FEW = 20  # boulders per source in a small run
NEAR = 1.6  # factor to a threshold, within which a cell is at the edge of a zone
RARE = 1e-4  # minimum frequency of the cells examined [1/year]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=8, help="of large runs")
    parser.add_argument("--small", type=int, default=40, help="small runs")
    given = parser.parse_args()
    case = rockfall.read_case(FOLDER / "case.nml")
    large = [run(case, seed) for seed in range(given.seeds)]
    print(f"{given.seeds} seeds, {int(large[0].boulders[0]):,} boulders in each scenario")
    for name, values in numbers(large).items():
        mean, error = np.mean(values), np.std(values, ddof=1) / np.sqrt(len(values))
        print(f"  {name:40} {mean:.4g} +- {error:.2g}")
    truth = frequency_of(large)
    matrix, small = Matrix.of(case), case.replace(case={"boulders": FEW})
    held, right = [], []
    for seed in range(given.small):
        found = run(small, 1000 + seed)
        held.append(list(held_in(found, truth, matrix)))
        right.append(right_in(found, truth, matrix))
    print(f"{given.small} seeds, {int(found.boulders[0]):,} boulders in each scenario")
    levels = ["hits", "above 30 kJ", "above 300 kJ"]
    levels += [f"{level}, at the edge of a zone" for level in levels]
    for level, parts in zip(levels, np.transpose(held), strict=True):
        print(f"  intervals of {level}: {np.mean(parts):.3f} hold the frequency")
    certain, same = np.mean(right, axis=0)
    print(f"  certain: {certain:.3f} of the cells; of these, {same:.4f} have the right class")


def run(case: rockfall.Case, seed: int):
    return rockfall.hazard(case.replace(case={"seed": seed}), objects=FOLDER / "objects.geojson")


def numbers(runs: list) -> dict[str, list[float]]:
    """Statistics of the case's README, by name, for each run."""
    found: dict[str, list[float]] = {}
    for one in runs:
        cell = grid_of(one.hazard_class)[0].cell
        for k in range(len(CLASSES) - 1, 0, -1):
            here = one.hazard_class.values == k
            found.setdefault(f"{CLASSES[k]}, area [m2]", []).append(here.sum() * cell**2)
            certain = 100 * one.hazard_class_certain.values[here].mean()
            found.setdefault(f"{CLASSES[k]}, certain [%]", []).append(certain)
        for _, row in object_table(one).iterrows():
            for name in ("frequency", "frequency_above_30kJ", "frequency_above_300kJ", "risk"):
                found.setdefault(f"{row['object']}, {name}", []).append(row[name])
    return found


def frequency_of(runs: list) -> np.ndarray:
    """Annual frequencies of cells (levels, y, x), averaged over all runs: all hits, then each
    threshold."""
    parts = [one.hit_exceedance_frequency.values.astype("f8") for one in runs]
    passing = [one.hit_frequency.values.astype("f8") for one in runs]
    return np.concatenate([np.mean(passing, axis=0)[None], np.mean(parts, axis=0)])


def held_in(found, truth: np.ndarray, matrix: Matrix) -> Iterator[float]:
    """Yield the fraction of cells whose interval contains the true frequency, for each level: over
    the cells with at least the frequency RARE, then over cells at the edge of a zone."""
    ends = []
    for end in ("_low", "_high"):
        hits = found[f"hit_frequency{end}"].values
        ends.append(np.concatenate([hits[None], found[f"hit_exceedance_frequency{end}"].values]))
    held = (ends[0] <= truth) & (truth <= ends[1])
    ratio = truth[..., None] * matrix.periods
    at_edge = ((ratio > 1 / NEAR) & (ratio < NEAR)).any(axis=-1)
    for cells in truth >= RARE, at_edge:
        yield from (float(level[of].mean()) for level, of in zip(held, cells, strict=True))


def right_in(found, truth: np.ndarray, matrix: Matrix) -> tuple[float, float]:
    """Fraction of cells in a zone whose class is reported as certain, and the fraction of these
    cells whose class is right."""
    classes = hazard_classes(truth, matrix, truth[0] > 0)
    certain = (found.hazard_class_certain.values > 0) & (classes > 0)
    same = np.maximum(found.hazard_class.values, 1) == classes  # treat none and residual as equal
    return certain.sum() / (classes > 0).sum(), float(same[certain].mean())


if __name__ == "__main__":
    main()
