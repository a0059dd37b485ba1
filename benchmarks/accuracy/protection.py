# SPDX-License-Identifier: BSD-3-Clause
"""Effects of forest and net on the boulders at the road of `cases/forested-slope`.

    python -m benchmarks.accuracy.protection [--seeds 20] [--boulders 5000]

Fraction that passes, and 95 % quantiles of energy and height at the road, without protection, with
the net, with the forest and with both. Uses new seeds of boulders and trees, on the slope of the
case and on a slope with another relief that is 2 degrees steeper. Differences are paired by seed,
with the same boulders. "Undecided" marks differences whose 95 % interval contains zero.
"""

from __future__ import annotations

import argparse
import importlib.util
import shutil
import tempfile
from pathlib import Path
from types import ModuleType

import numpy as np

import rockfall
from benchmarks.machine import ROOT

PLACE = ROOT / "cases" / "forested-slope"
FIRST = 1001  # first seed
SLOPES = {"The slope of the case": (), "Other relief, 2 degrees steeper": (1, 2.0)}
PAIRS = [
    ("net", "bare"),
    ("forest", "bare"),
    ("forest-and-net", "bare"),
    ("forest-and-net", "forest"),
]


def script(name: str) -> ModuleType:
    """Import a script of the case."""
    spec = importlib.util.spec_from_file_location(name, PLACE / f"{name}.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def cases(folder: Path) -> dict[str, rockfall.Case]:
    """The three cases in the folder, and a case with the net but without forest."""
    names = "bare", "forest", "forest-and-net"
    shutil.copy(PLACE / "zones.csv", folder)
    found = {name: rockfall.read_case(shutil.copy(PLACE / f"{name}.nml", folder)) for name in names}
    net = found["forest-and-net"].barrier
    road = found["forest-and-net"].line
    return {"bare": found["bare"], "net": found["bare"].replace(line=road, barrier=net), **found}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--boulders", type=int, default=5000, help="from each of eight sources")
    arguments = parser.parse_args()
    expected, terrain = script("expected"), script("make_terrain")
    seeds = range(FIRST, FIRST + arguments.seeds)
    for title, slope in SLOPES.items():
        with tempfile.TemporaryDirectory() as folder:
            terrain.write(Path(folder), *slope)
            found = {
                name: np.array([
                    expected.at_road(expected.run(case, seed, boulders=arguments.boulders))
                    for seed in seeds
                ])
                for name, case in cases(Path(folder)).items()
            }  # fmt: skip
        print(f"\n{title}, {arguments.seeds} seeds of {8 * arguments.boulders:,} boulders\n")
        print(*expected.rows(found, PAIRS), sep="\n")


if __name__ == "__main__":
    main()
