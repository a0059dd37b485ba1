# SPDX-License-Identifier: BSD-3-Clause
"""Time that a command takes before and after the boulders: wall and CPU seconds, and imports.

    python -m benchmarks.speed.startup [--repeat 20] [TREE ...]

Commands on a small case with an ESRI ASCII terrain and on `cases/vaujany` (GeoTIFF), with 100
boulders each; minimum and median of `--repeat` starts. TREE is a folder with an installed package
of another version. Trees take turns with the package of this Python, so that they share other load
of the machine. The first start of each, which compiles Python files, does not count. Below are
minima of five starts with -X importtime: imports by package, the interpreter, and the rest, i.e.
the command's own work and overhead of importtime.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import rockfall
from benchmarks.machine import ROOT, VAUJANY, machine

CASE = """&case boulders = 100, seed = 1 /
&terrain dem = 'dem.asc' /
&surface uniform_mean_radius = 0.25 /
&impact sets = 'vaujany-observed' /
&boulder volume = 'fixed', volume_mean = 1.0 /
&release x = 20.0, y = 20.0, drop_height = 2.0 /
&line name = 'L', x = 120.0, 120.0, y = 0.5, 39.5 /
&output maps = 'passages', 'energy_max' /
"""
COMMANDS = {
    "python -c pass": "",
    "--version": "--version",
    "--help": "--help",
    "check, ASCII": "check ascii/case.nml",
    "run, ASCII": "run ascii/case.nml --quiet -o out.nc --overwrite",
    "run, ASCII, summary": "run ascii/case.nml -o out.nc --overwrite",
    "run, vaujany": "run {vaujany} --boulders 100 --quiet -o out.nc --overwrite",
    "merge": "merge part.part1of2 part.part2of2 -o merged.nc --overwrite",
    "lines": "lines out.nc",
}
ROCKFALL = ["-m", "rockfall"]
IMPORT = re.compile(r"import time:\s+(\d+) \|\s+\d+ \|\s+(\w+)")


def start(tree: Path, folder: Path, words: list[str]) -> tuple[float, float, str]:
    """Wall and CPU seconds of a Python that imports from a tree, and its standard error output."""
    place = {"PYTHONPATH": str(tree), "PYTHONPYCACHEPREFIX": str(folder / "cache")}
    place["PYTHONDONTWRITEBYTECODE"] = ""
    begun = time.perf_counter()
    with tempfile.TemporaryFile("w+") as said:
        child = subprocess.Popen(
            [sys.executable, *words], cwd=folder, stdout=subprocess.DEVNULL, stderr=said,
            env=os.environ | place,
        )  # fmt: skip
        _, status, usage = os.wait4(child.pid, 0)
        wall = time.perf_counter() - begun
        said.seek(0)
        if status:
            sys.exit(f"{' '.join(words)}: {said.read()}")
        return wall, usage.ru_utime + usage.ru_stime, said.read()


def words_of(command: str) -> list[str]:
    """Python arguments for a command; for "", those of a Python that does nothing."""
    return [*ROCKFALL, *command.format(vaujany=VAUJANY).split()] if command else ["-c", "pass"]


def by_package(tree: Path, folder: Path, command: str) -> Counter[str]:
    """Milliseconds that a command takes to import each package, and for the rest, from the fastest
    of five starts."""
    found: list[Counter[str]] = []
    for _ in range(5):
        wall, _, said = start(tree, folder, ["-X", "importtime", *words_of(command)])
        one: Counter[str] = Counter()
        for took, package in IMPORT.findall(said):
            ours = package in sys.stdlib_module_names or package.startswith("_")
            one["standard library" if ours else package] += int(took) / 1e3
        one["interpreter and work"] = 1e3 * wall - one.total()
        found.append(one)
    return min(found, key=Counter.total)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=20)
    parser.add_argument("trees", metavar="TREE", type=Path, nargs="*")
    given = parser.parse_args()
    trees = [*(tree.absolute() for tree in given.trees), Path(rockfall.__file__).parents[1]]
    print(machine())
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "ascii").mkdir()
        (folder / "ascii/dem.asc").write_text((ROOT / "cases/plane/dem.asc").read_text())
        (folder / "ascii/case.nml").write_text(CASE)
        for part in "12":
            shard = f"run ascii/case.nml --quiet --shard {part}/2 -o part.part{part}of2"
            start(trees[-1], folder, words_of(shard))
        print(f"\n{'seconds, least and median':24}{'wall':>14}{'CPU':>16}   tree")
        for what, command in COMMANDS.items():
            took: dict[Path, list] = {tree: [] for tree in trees}
            for _ in range(1 + given.repeat):
                for tree in trees:
                    took[tree].append(start(tree, folder, words_of(command))[:2])
            for tree, seconds in took.items():
                columns = [sorted(column) for column in zip(*seconds[1:], strict=True)]
                shown = (f"{one[0]:8.3f}{one[len(one) // 2]:8.3f}" for one in columns)
                print(f"{what:22}{''.join(shown)}   {tree}", flush=True)
        for what, command in COMMANDS.items():
            for tree in trees:
                parts = by_package(tree, folder, command).most_common(12)
                said = ", ".join(f"{part} {took:.0f}" for part, took in parts if took >= 0.5)
                print(f"\n{what}, ms, {tree}: {said}", flush=True)


if __name__ == "__main__":
    main()
