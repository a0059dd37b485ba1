# SPDX-License-Identifier: BSD-3-Clause
"""Cost of many evaluation lines: run, lines and report, by several builds.

    python -m benchmarks.speed.crossings [--lines 1000] [--pieces 1] [--boulders 100000]
        [--repeat 3] [--commit 7080d106] [--other PYTHON ...] [--commands run lines report]
        [--killed]

The slope of `cases/vaujany` with lines across it, or with fewer lines cut into pieces, like
segments of a road. `--commit` and `--other` are those of `products.py`; results are minima over the
turns. On a busy machine use the CPU times. `--killed` also kills runs after their first save and
resumes them: the result must be bit-identical to an uninterrupted run. For `kept =
'none'`, heaps with four children per node and tails boulder by boulder were not faster.
"""

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.builds import pythons_of
from benchmarks.machine import VAUJANY, best_turns, machine, run_child
from benchmarks.speed.many import kill_on_the_way, same

MB = 1e6
COMMANDS = {
    "run": ("run", "case.nml", "-o", "out.nc", "--overwrite", "--quiet"),
    "none": ("run", "none.nml", "-o", "none.nc", "--overwrite", "--quiet"),
    "lines": ("lines", "out.nc"),
    "report": ("report", "out.nc", "-o", "out.html", "--overwrite"),
}
ACROSS = 104.75  # length of a line [m]: 37 % of all pairs of line and boulder cross
FILES = {"run": "out.nc", "none": "none.nc", "report": "out.html"}


CASE = """&case boulders = {boulders}, seed = 20090601 /
&terrain dem = '{place}/dem.tif' /
&surface zones = '{place}/zones.tif', table = '{place}/zones.csv' /
&boulder volume = 'normal', volume_mean = 0.8, volume_std = 0.15 /
&release x = 100.0, y = 587.5, drop_height = 5.0 /
&output kept = {kept} /
"""


def write_case(folder: Path, lines: int, boulders: int, pieces: int = 1) -> None:
    """Write two cases with lines cut into pieces, from 15 m below the release down: case.nml keeps
    all crossings, none.nml keeps no crossings. Uses only keys known to all builds."""
    rows, width = lines // pieces, ACROSS / pieces
    ends = (
        (1.25 + width * piece, 570.0 - 560.0 * row / rows)
        for row in range(rows)
        for piece in range(pieces)
    )
    groups = "".join(
        f"&line name = '{k}', x = {x:.4f}, {x + width:.4f}, y = {y:.4f}, {y:.4f} /\n"
        for k, (x, y) in enumerate(ends)
    )
    for name, kept in (("case", "'all'"), ("none", "'none'")):
        text = CASE.format(boulders=boulders, place=VAUJANY.parent, kept=kept)
        (folder / f"{name}.nml").write_text(text + groups)


def killed(python: str, folder: Path, command: str, seconds: float) -> None:
    """Kill a run, resume it, and print whether it equals the uninterrupted run."""
    case = COMMANDS[command][1]
    words = [python, "-m", "rockfall", "run", case, "--quiet", "-o", "killed.nc"]
    kill_on_the_way(folder, words, seconds)
    run_child(*words, "--resume", cwd=folder)
    found = "the same bits" if same(folder / FILES[command], folder / "killed.nc") else "OTHER BITS"
    print(f"{command}: killed and resumed: {found}", flush=True)
    (folder / "killed.nc").unlink()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lines", type=int, default=1000)
    parser.add_argument("--pieces", type=int, default=1)
    parser.add_argument("--boulders", type=int, default=100_000)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--commit", nargs="*", default=[])
    parser.add_argument("--other", nargs="*", default=[])
    parser.add_argument("--commands", nargs="+", default=["run", "lines"], choices=COMMANDS)
    parser.add_argument("--killed", action="store_true")
    given = parser.parse_args()
    print(machine())
    print(f"{given.lines:,} lines, {given.boulders:,} boulders")
    with TemporaryDirectory(dir=Path.cwd()) as top:
        pythons = pythons_of(given.commit, given.other, Path(top))
        folders = [Path(top) / f"{k}" for k in range(len(pythons))]
        for folder in folders:
            folder.mkdir()
            write_case(folder, given.lines, given.boulders, given.pieces)
        walls = {}
        for command in given.commands:
            best = best_turns(pythons, folders, [*COMMANDS[command]], given.repeat)
            for python, folder, (wall, cpu, peak) in zip(pythons, folders, best, strict=True):
                size = (folder / FILES[command]).stat().st_size if command in FILES else 0
                print(f"{command:7} {wall:7.1f} s, {cpu:7.1f} s of CPU ({cpu / best[0][1]:.2f}), "
                      f"{peak / MB:7,.0f} MB, file {size / MB:,.1f} MB  {python}",
                      flush=True)  # fmt: skip
            walls[command] = best[-1][0]
        for command in {"run", "none"} & walls.keys() if given.killed else ():
            # last, because it reads complete results
            killed(pythons[-1], folders[-1], command, walls[command] / 2)


if __name__ == "__main__":
    main()
