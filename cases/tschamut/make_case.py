# SPDX-License-Identifier: BSD-3-Clause
"""Make the inputs of case.nml from the published runs at Tschamut.

    python make_case.py [--data FOLDER] [--half calibration|held-out|all] [-o FOLDER]

Downloads the tables (pip install 'rockfall[field]'), or takes them from FOLDER or from the folder
in the environment variable ROCKFALL_FIELD_DATA. Writes dem.asc; releases.csv, with the start of
tracking, the velocity there, volume, density and shape of the block; observed.csv, with the
stopping place of each run. File names with -1, -2, -4 are for single blocks. Halves are runs at odd
and even positions in the order of their names: the first half is for calibration, the second for
validation (docs/archive/field_protocol.md).
"""

import argparse
import csv
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.atomic import atomic_write
from rockfall.io.tables import Row, read_table

HERE = Path(__file__).resolve().parent
sys.path.append(str(HERE.parents[1]))

from benchmarks.field_data import fetch  # noqa: E402

HALVES = {"calibration": (0, 2), "held-out": (1, 2), "all": (0, 1)}  # first position, step
BLOCKS = {"1": "compact", "2": "elongated", "4": "platy"}  # shapes from published sizes
FARTHEST = 1e6  # maximum distance [m]
FASTEST = 100.0  # maximum speed [m/s]
RELEASE = (
    "name", "x", "y", "velocity_x", "velocity_y", "velocity_z", "volume", "density", "block_shape",
)  # fmt: skip
OBSERVED = "x", "y", "start_x", "start_y", "run", "block"


def rows_of(runs: list[Row], rests: dict[str, Row]) -> tuple[list[list[Any]], list[list[Any]]]:
    """Rows of releases and of observed stopping places."""
    releases, observed = [], []
    for run in runs:
        name, block = run.text("trajectory_id"), run.choice("block_id", BLOCKS)
        if name not in rests:
            raise RockfallError(f"{run.where}: run {name} has no place of rest")
        start = [run.number(key, -FARTHEST, FARTHEST) for key in ("x_m", "y_m")]
        speed = [run.number(key, -FASTEST, FASTEST) for key in ("vx_mps", "vy_mps", "vz_mps")]
        volume = 4 / 3 * np.pi * run.number("radius_m", 0.01, 10) ** 3
        density = run.number("mass_kg", 0.1, 1e6) / volume
        rest = [rests[name].number(key, -FARTHEST, FARTHEST) for key in ("x_m", "y_m")]
        block_numbers = f"{volume:.8g}", f"{density:.8g}"
        releases.append([name, *start, *speed, *block_numbers, BLOCKS[block]])
        observed.append([*rest, *start, name, block])
    return releases, observed


def write(path: Path, columns: tuple[str, ...], rows: list[list[Any]]) -> None:
    """Write a table as CSV."""
    with atomic_write(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)


def make(half: str, data: Path | None, folder: Path) -> None:
    """Write the inputs of a half into a folder."""
    files = fetch("tschamut2014", data)
    _, _, starts = read_table(files["release_points.csv"])
    _, _, ends = read_table(files["observed_deposition.csv"])
    first, step = HALVES[half]
    runs = sorted(starts, key=lambda row: row.text("trajectory_id"))[first::step]
    releases, observed = rows_of(runs, {row.text("trajectory_id"): row for row in ends})
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_write(folder / "dem.asc") as part:
        shutil.copyfile(files["terrain.asc"], part)
    write(folder / "releases.csv", RELEASE, releases)
    write(folder / "observed.csv", OBSERVED, observed)
    for block in BLOCKS:
        mine = [k for k, row in enumerate(observed) if row[-1] == block]
        write(folder / f"releases-{block}.csv", RELEASE, [releases[k] for k in mine])
        write(folder / f"observed-{block}.csv", OBSERVED, [observed[k] for k in mine])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, help="folder that holds the tables")
    parser.add_argument("--half", choices=HALVES, default="calibration")
    parser.add_argument("-o", metavar="FOLDER", type=Path, dest="folder", default=HERE)
    given = parser.parse_args()
    try:
        make(given.half, given.data, given.folder)
    except RockfallError as error:
        print(f"make_case.py: {error}", file=sys.stderr)
        return error.code
    return 0


if __name__ == "__main__":
    sys.exit(main())
