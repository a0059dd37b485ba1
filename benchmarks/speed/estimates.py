# SPDX-License-Identifier: BSD-3-Clause
"""Memory and time estimated by `rockfall check`, compared with `rockfall run`.

    python -m benchmarks.speed.estimates [--scale 1] [--only lines]

Cases with few and many boulders, small and large terrain, with and without maps and bin counts,
complete and in windows; many evaluation lines with all rows and with none. CPU time is for the
complete program, from start to written file.
"""

import argparse
import itertools
import re
import tempfile
from multiprocessing import get_context
from pathlib import Path

import numpy as np

import rockfall
from benchmarks.machine import NOTHING, VAUJANY, machine
from benchmarks.speed.valley import MAPS, SAME, program, relief, steep_cells, write_tiff
from rockfall.result import variables

BYTES = {"MB": 1e6, "GB": 1e9}
SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0}
AIM = 0.15, 0.25  # targets for memory, for time
LINES = 200, 5000


def estimated(said: str, word: str, units: dict[str, float]) -> float:
    """Value [byte or s] from a row of `rockfall check` such as `memory about 2.0 GB ...`."""
    number, unit = re.search(rf"^  {word} +about ([\d.]+) (\w+)", said, re.MULTILINE).groups()
    return float(number) * units[unit]


def compare(what: str, case: rockfall.Case, folder: Path, *options: str) -> bool:
    """Print a row of the table; return True if both values are within the target."""
    path = folder / "case.nml"
    path.write_text(case.text())
    said, _, _ = program("check", path, *options)
    memory, time = estimated(said, "memory", BYTES), estimated(said, "time", SECONDS)
    _, cpu, peak = program("run", path, "--quiet", "-o", folder / "out.nc", "--overwrite", *options)
    off = memory / peak - 1, time / cpu - 1
    print(f"{what:46}{memory / 1e6:9.0f}{peak / 1e6:8.0f}{off[0]:+7.0%}", end="")
    print(f"{time:10.1f}{cpu:8.1f}{off[1]:+7.0%}", flush=True)
    return all(abs(one) <= aim for one, aim in zip(off, AIM, strict=True))


def make_files(dem: Path, cells: Path, side: int, sources: int) -> None:
    random = np.random.default_rng(1)
    z = relief(side, random)
    write_tiff(dem, z)
    write_tiff(cells, steep_cells(z, sources, random))


def valley(folder: Path, side: int, sources: int, each: int, maps: list[str] | None):
    """Case on synthetic relief. Its files are made once in another process, because the peak memory
    of a program includes that of its parent."""
    dem, cells = folder / f"dem{side}.tif", folder / f"cells{side}_{sources}.tif"
    if not cells.exists():
        making = get_context("spawn").Process(target=make_files, args=(dem, cells, side, sources))
        making.start()
        making.join()
    return rockfall.Case(
        case={"boulders": each},
        terrain={"dem": dem},
        release={"cells": cells, "drop_height": 2.0},
        output=NOTHING | {"maps": maps},
        **SAME,
    )


def lines(count: int) -> list[dict]:
    """Lines across the slope of cases/vaujany, from the top down."""
    return [
        {"name": f"{k}", "x": [1.25, 198.75], "y": [570.0 - 560.0 * k / count] * 2}
        for k in range(count)
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scale", type=float, default=1.0, help="of the numbers of boulders")
    parser.add_argument("--only", choices=["lines"], help="the rows of many lines")
    given = parser.parse_args()
    scale = given.scale
    print(machine())
    print(f"\n{'':46}{'memory MB':>17}{'off':>7}{'CPU s':>18}{'off':>7}")
    print(f"{'':46}{'estimate':>9}{'taken':>8}{'':7}{'estimate':>10}{'taken':>8}")
    vaujany = rockfall.read_case(VAUJANY)
    every = {"maps": list(variables.MAP), "rebounds": True, "trajectories": 0}
    absolute = {
        "terrain": {"dem": VAUJANY.parent / "dem.tif"},
        "surface": {key: VAUJANY.parent / vaujany.surface[key] for key in ("zones", "table")},
    }
    good = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        n = max(1, int(scale * 50_000))
        for count, kept, maps in itertools.product(LINES, ("all", "none"), (None, MAPS)):
            output = NOTHING | {"maps": maps, "kept": kept}
            case = vaujany.replace(case={"boulders": n}, output=output, **absolute)
            case = case.replace(line=lines(count))
            what = f"vaujany, {n:,} x {count} lines, kept {kept}, {len(maps or [])} maps"
            good.append(compare(what, case, folder))
        for boulders, output in () if given.only else (
            (10_000, every), (1_000_000, NOTHING), (1_000_000, every)
        ):  # fmt: skip
            n = max(1, int(scale * boulders))
            what = f"vaujany, {n:,} boulders, {'all maps' if output is every else 'no maps'}"
            case = vaujany.replace(case={"boulders": n}, output=output, **absolute)
            good.append(compare(what, case, folder))
        for side, sources, each, maps in () if given.only else (
            (1000, 2000, 50, MAPS), (4000, 10_000, 100, None), (4000, 10_000, 100, MAPS),
            (4000, 100_000, 5, ["passages", "reach_probability", "energy_mean"]),
        ):  # fmt: skip
            n = max(1, int(scale * each))
            what = f"relief of {side}², {sources:,} x {n}, {len(maps or [])} maps"
            good.append(compare(what, valley(folder, side, sources, n, maps), folder))
        if not given.only:
            n = max(1, int(scale * 100))
            case = valley(folder, 4000, 10_000, n, ["passages"])
            good.append(compare("the same, passages, in windows", case, folder, "--memory", "60MB"))
    print(f"\n{sum(good)} of {len(good)} within {AIM[0]:.0%} of memory and {AIM[1]:.0%} of time")


if __name__ == "__main__":
    main()
