# SPDX-License-Identifier: BSD-3-Clause
"""Cost of a rebound in two builds that take turns: by model, with maps, on fine cells.

    python -m benchmarks.speed.kernel [--commit 7080d106] [--boulders 10000] [--repeat 5]

The commit and the current sources are built in a temporary folder, as for a release (four minutes
of CPU time). `cases/vaujany`, and the half-metre relief of `walk.py`; CPU time of the kernel on one
thread, minima over the turns.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

import rockfall
from benchmarks.machine import NOTHING, VAUJANY, machine, run_child
from benchmarks.speed.table_rebound import RADIUS, TABLES
from benchmarks.speed.throughput import EVERY_MAP, MAPS, measure
from benchmarks.speed.walk import FINEST, on_cells
from rockfall.scene.read import read_scene

LAW = {"form": "table", "ratio": None, "sets": None}
#: Rows printed relative to another row, as a ratio or a difference.
OVER = {f"table {name}": "matrix" for name in TABLES}
MORE = {"seven maps": "two lines", "every map": "two lines"}


def rows(boulders: int, folder: Path) -> dict[str, float]:
    """CPU nanoseconds per rebound in each scene, by the imported build."""
    vaujany = rockfall.read_case(VAUJANY).replace(case={"boulders": boulders})
    surface = {"zones": None, "table": None, "uniform_mean_radius": RADIUS}
    bare = vaujany.replace(output=NOTHING, line=[])
    cases = {"bare": bare, "matrix": bare.replace(surface=surface)}
    for name in TABLES:
        cases[f"table {name}"] = bare.replace(surface=surface, impact=LAW | {"table": name})
    cases["talus, seven maps"] = cases["table talus"].replace(output=NOTHING | {"maps": MAPS})
    for name, maps in {"two lines": None, "seven maps": MAPS, "every map": EVERY_MAP}.items():
        cases[name] = vaujany.replace(output=NOTHING | {"maps": maps})
    found = {name: measure(read_scene(case), 1, 1).rebound() for name, case in cases.items()}
    for name, maps in {"cells of 0.5 m": None, "cells of 0.5 m, seven maps": MAPS}.items():
        arrays, case = on_cells(FINEST, boulders // 100, folder)
        scene = read_scene(case.replace(output=NOTHING | {"maps": maps}), **arrays)
        found[name] = measure(scene, 1, 1).rebound()
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--commit", default="7080d106")
    parser.add_argument("--boulders", type=int, default=10_000)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--child", action="store_true", help="print the rows of this build")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as top:
        if given.child:
            print(json.dumps(rows(given.boulders, Path(top))))
            return
        from benchmarks.builds import build, extracted  # unknown to a child of an old commit

        print(machine())
        paths = {
            name: build(extracted(commit, Path(top) / name))
            for name, commit in ((given.commit, given.commit), ("here", ""))
        }
        command = [sys.executable, "-P", __file__, "--child", "--boulders", str(given.boulders)]
        least: dict[str, dict[str, float]] = {name: {} for name in paths}
        for _ in range(given.repeat):
            for name, path in paths.items():
                said, _, _ = run_child("env", f"PYTHONPATH={path}", *command)
                for row, found in json.loads(said).items():
                    least[name][row] = min(found, least[name].get(row, found))
    before, here = least.values()
    print(f"| ns a rebound | {given.commit} | here | ratio |\n|---|---|---|---|")
    for row in here:
        print(f"| {row} | {before[row]:.0f} | {here[row]:.0f} | {here[row] / before[row]:.2f} |")
    for row, other in OVER.items():
        ratios = [one[row] / one[other] for one in (before, here)]
        print(f"| {row}, over {other} | {ratios[0]:.2f} | {ratios[1]:.2f} | |")
    for row, other in MORE.items():
        more = [one[row] - one[other] for one in (before, here)]
        print(f"| {row}, over {other} | +{more[0]:.0f} | +{more[1]:.0f} | |")


if __name__ == "__main__":
    main()
