# SPDX-License-Identifier: BSD-3-Clause
"""Run-outs at Tschamut (cases/tschamut) with one shape for all blocks, with a mix in the
proportions of the three blocks, and with the shape of each block:

    python -m benchmarks.physics.block_shapes [--data FOLDER] [--half held-out] [--table meadow]
        [--seeds 9301 9302 ...]

Prints a table in Markdown: Wasserstein distance to the observed run-outs, mean and standard
deviation over seeds.
"""

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import rockfall
from benchmarks.machine import NOTHING, ROOT, machine
from cases.tschamut.make_case import HALVES, make
from rockfall.analysis.observed.observations import read_observed
from rockfall.grounds.impact_tables import BLOCK_SHAPES
from rockfall.studies.validation import RUN_OUT, comparable_numbers


def ways(folder: Path) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield variants of block shapes: name, release table (written to `folder`), and keys of
    &boulder."""
    releases = pd.read_csv(folder / "releases.csv")
    shares = releases["block_shape"].value_counts(normalize=True)
    releases.drop(columns="block_shape").to_csv(folder / "alike.csv", index=False)
    for shape in BLOCK_SHAPES:
        yield f"all {shape}", "alike.csv", {"block_shape": shape}
    mix = {"block_shape": [*shares.index], "block_shape_share": shares.tolist()}
    yield "a mix", "alike.csv", mix
    yield "each its own", "releases.csv", {}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--data", type=Path)
    parser.add_argument("--half", choices=HALVES, default="held-out")
    parser.add_argument("--table", default="meadow")
    parser.add_argument("--seeds", type=int, nargs="+", default=[*range(9301, 9311)])
    given = parser.parse_args()
    print(f"{machine()}\n\n| shapes | mean [m] | Wasserstein [m] |\n|---|---|---|")
    case = rockfall.read_case(ROOT / "cases" / "tschamut" / "case.nml")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make(given.half, given.data, folder)
        seen = read_observed(folder / "observed.csv")
        case = case.replace(
            terrain={"dem": str(folder / "dem.asc")}, impact={"table": given.table}, output=NOTHING
        )
        for title, releases, boulder in ways(folder):
            rows = []
            for seed in given.seeds:
                one = case.replace(
                    case={"seed": seed}, boulder=boulder, release={"points": str(folder / releases)}
                )
                numbers = comparable_numbers([(rockfall.run(one), seen)])
                rows.append(
                    [numbers["", RUN_OUT, key].simulated for key in ("mean", "wasserstein")]
                )
            means, deviations = np.mean(rows, axis=0), np.std(rows, axis=0, ddof=1)
            cells = (f"{m:.1f} ± {d:.1f}" for m, d in zip(means, deviations, strict=True))
            print(f"| {title} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
