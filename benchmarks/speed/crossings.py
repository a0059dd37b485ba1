# SPDX-License-Identifier: BSD-3-Clause
"""What boulders at many evaluation lines cost: run, lines and report, by several builds.

    python -m benchmarks.speed.crossings [--lines 1000] [--boulders 100000] [--repeat 3]
        [--other PYTHON ...] [--commands run lines report]

The slope of `cases/vaujany` with lines across it. `--other` are Pythons of other builds of
rockfall, which take turns with this one; numbers are minima of the turns. On a busy machine look
at the CPU.
"""

import argparse
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import rockfall
from benchmarks.machine import VAUJANY, machine, run_child

MB = 1e6
COMMANDS = {
    "run": ("run", "case.nml", "-o", "out.nc", "--overwrite", "--quiet"),
    "none": ("run", "none.nml", "-o", "none.nc", "--overwrite", "--quiet"),
    "lines": ("lines", "out.nc"),
    "report": ("report", "out.nc", "-o", "out.html", "--overwrite"),
}
FILES = {"run": "out.nc", "none": "none.nc", "report": "out.html"}


def write_case(folder: Path, lines: int, boulders: int) -> None:
    """The slope with lines from 15 m below the release to its foot."""
    case = rockfall.read_case(VAUJANY / "case.nml")
    case = case.replace(
        case={"boulders": boulders}, output={"maps": None, "rebounds": False, "trajectories": 0},
        terrain={"dem": str(VAUJANY / "dem.tif")}, ensemble=None,
        surface={name: str(VAUJANY / f"zones.{end}") for name, end in
                 (("zones", "tif"), ("table", "csv"))},
        line=[{"name": f"{k}", "x": [1.25, 198.75], "y": [y, y]}
              for k, y in enumerate(570.0 - 560.0 * k / lines for k in range(lines))],
    )  # fmt: skip
    for name, kept in (("case", "all"), ("none", "none")):
        (folder / f"{name}.nml").write_text(case.replace(output={"kept": kept}).text())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lines", type=int, default=1000)
    parser.add_argument("--boulders", type=int, default=100_000)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--other", nargs="*", default=[])
    parser.add_argument("--commands", nargs="+", default=["run", "lines"], choices=COMMANDS)
    given = parser.parse_args()
    print(machine())
    print(f"{given.lines:,} lines, {given.boulders:,} boulders")
    pythons = [*given.other, sys.executable]
    with TemporaryDirectory(dir=Path.cwd()) as top:
        folders = [Path(top) / f"{k}" for k in range(len(pythons))]
        for folder in folders:
            folder.mkdir()
            write_case(folder, given.lines, given.boulders)
        for command in given.commands:
            best = [(float("inf"),) * 3] * len(pythons)
            for _ in range(given.repeat):
                for k, (python, folder) in enumerate(zip(pythons, folders, strict=True)):
                    words = [python, "-m", "rockfall", *COMMANDS[command]]
                    begun = time.perf_counter()
                    _, cpu, peak = run_child(*words, cwd=folder)
                    now = time.perf_counter() - begun, cpu, peak
                    best[k] = tuple(map(min, best[k], now))
            for python, folder, (wall, cpu, peak) in zip(pythons, folders, best, strict=True):
                size = (folder / FILES[command]).stat().st_size if command in FILES else 0
                print(f"{command:7} {wall:7.1f} s, {cpu:7.1f} s of CPU, {peak / MB:7,.0f} MB, "
                      f"file {size / MB:8,.1f} MB  {python}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
