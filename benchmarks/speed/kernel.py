# SPDX-License-Identifier: BSD-3-Clause
"""Cost of a rebound in two builds that take turns: by model, with maps, on fine cells.

    python -m benchmarks.speed.kernel [--commit 7080d106] [--boulders 10000] [--repeat 5]

The commit and the current sources are built in a temporary folder, as for a release (four minutes
of CPU time). `cases/vaujany`, and the half-metre relief of `walk.py`; CPU time of the kernel on one
thread, minima over the turns. The builds take turns run by run, each in one process that reads its
scenes once, so that other work on the machine meets all of them alike, and memory is warm.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import rockfall
from benchmarks.machine import NOTHING, VAUJANY, machine
from benchmarks.speed.table_rebound import RADIUS, TABLES
from benchmarks.speed.throughput import EVERY_MAP, MAPS, measure
from benchmarks.speed.walk import FINEST, on_cells
from rockfall.scene.read import read_scene
from rockfall.scene.scene import Scene

LAW = {"form": "table", "ratio": None, "sets": None}
#: Rows printed relative to another row, as a ratio or a difference.
OVER = {f"table {name}": "matrix" for name in TABLES}
MORE = {"seven maps": "two lines", "every map": "two lines"}


def scenes(boulders: int, folder: Path) -> dict[str, Scene]:
    """The scene of each row."""
    vaujany = rockfall.read_case(VAUJANY).replace(case={"boulders": boulders})
    surface = {"zones": None, "table": None, "uniform_mean_radius": RADIUS}
    bare = vaujany.replace(output=NOTHING, line=[])
    cases = {"bare": bare, "matrix": bare.replace(surface=surface)}
    for name in TABLES:
        cases[f"table {name}"] = bare.replace(surface=surface, impact=LAW | {"table": name})
    cases["talus, seven maps"] = cases["table talus"].replace(output=NOTHING | {"maps": MAPS})
    for name, maps in {"two lines": None, "seven maps": MAPS, "every map": EVERY_MAP}.items():
        cases[name] = vaujany.replace(output=NOTHING | {"maps": maps})
    found = {name: read_scene(case) for name, case in cases.items()}
    for name, maps in {"cells of 0.5 m": None, "cells of 0.5 m, seven maps": MAPS}.items():
        arrays, case = on_cells(FINEST, boulders // 100, folder)
        found[name] = read_scene(case.replace(output=NOTHING | {"maps": maps}), **arrays)
    return found


def answer(boulders: int, folder: Path) -> None:
    """Print the rows; then, for each row read, its CPU nanoseconds per rebound in this build."""
    found = scenes(boulders, folder)
    print(json.dumps(list(found)), flush=True)
    for row in sys.stdin:
        print(measure(found[row.strip()], 1, 1).rebound(), flush=True)


def ask(child: subprocess.Popen, row: str) -> float:
    """CPU nanoseconds per rebound of one run of a child."""
    print(row, file=child.stdin, flush=True)
    return float(child.stdout.readline())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--commit", default="7080d106")
    parser.add_argument("--boulders", type=int, default=10_000)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--child", action="store_true", help="run what the parent asks for")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as top:
        if given.child:
            answer(given.boulders, Path(top))
            return
        from benchmarks.builds import build, extracted  # unknown to a child of an old commit

        print(machine())
        paths = {
            name: build(extracted(commit, Path(top) / name))
            for name, commit in ((given.commit, given.commit), ("here", ""))
        }
        command = [sys.executable, "-P", __file__, "--child", "--boulders", str(given.boulders)]
        children = [
            subprocess.Popen(
                ["env", f"PYTHONPATH={path}", *command],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            )
            for path in paths.values()
        ]  # fmt: skip
        rows = [json.loads(child.stdout.readline()) for child in children][0]
        turns = [
            {row: [ask(child, row) for child in children] for row in rows}
            for _ in range(given.repeat)
        ]
        for child in children:
            child.stdin.close()
            child.wait()
    before, here = (
        {row: min(turn[row][build] for turn in turns) for row in rows} for build in (0, 1)
    )
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
