# SPDX-License-Identifier: BSD-3-Clause
"""Compare simulated run-outs, for each rebound model, with those of real blocks on an alpine
pasture (Volkwein and Gerber 2018, EnviDat, doi:10.16904/envidat.34):

    python -m benchmarks.physics.tschamut FOLDER [--half calibration|held-out] [--seeds 101 102]
        [--law NAME=TABLE ...] [--ground ROW ...] [--axes meadow] [--boulders 100] [--write]

FOLDER, or its subfolder tschamut2014, contains the files release_points.csv,
observed_deposition.csv, block_metadata.csv and terrain.asc, derived from the data in
github.com/ofuhrer/rust_rockfall (commit 722f7c7, data/processed/tschamut2014). Models are those of
benchmarks.physics.laws (--law: impact tables, --ground: rows of ground tables); the matrix with R_m
= 0.2 m is always run. --half selects the runs for calibration (default) or those held out. With
--axes, tables are simulated for the published size of each block. docs/archive/field_protocol.md
lists the choices made in advance. --write stores the results of the named models in the table of
evidence.
"""

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

import rockfall
from benchmarks import evidence
from benchmarks.machine import machine
from benchmarks.physics.laws import Law, add_laws, matrix, table
from rockfall.grounds.impact_tables import save_table
from rockfall.io.rasters.grid import Grid
from rockfall.io.tables import read_table
from rockfall.studies.validation import distribution_numbers
from rockfall_lab.blocks.case import BlockCase
from rockfall_lab.blocks.contacts import run_throws
from rockfall_lab.tables import table_of

THROWS, RADIUS = 1_000, 0.2  # tables by axes: number of throws; R_b [m]
SHAPE_OF_BLOCK = {"1": "compact", "2": "elongated", "4": "platy"}
TITLES = {
    "mean": "mean", "std": "std", "q05": "5 %", "q50": "50 %", "q95": "95 %", "ks": "KS", "p": "p",
    "wasserstein": "Wasserstein",
}  # fmt: skip
RECORDED = {  # title: unit, quantity, and place within a half
    "mean": ("m", "run_out_mean", ""), "std": ("m", "run_out_std", ""),
    "5 %": ("m", "run_out_q05", ""), "50 %": ("m", "run_out_q50", ""),
    "95 %": ("m", "run_out_q95", ""), "KS": ("", "run_out_ks", ""),
    "Wasserstein": ("m", "run_out_wasserstein", ""), "azimuth std": ("degree", "azimuth_std", ""),
} | {f"block {k}": ("m", "run_out_mean", f", block {k}") for k in SHAPE_OF_BLOCK}  # fmt: skip
DISTANCES = "KS", "Wasserstein"  # statistics without an observed value
HALVES = {"calibration": 0, "held-out": 1}  # positions of runs, sorted by trajectory_id, from 0


@dataclass(frozen=True)
class Run:
    """Observed boulder: block, radius [m], mass [kg], first position, velocity and stop."""

    block: str
    radius: float
    mass: float
    start: np.ndarray  # x and y of the first position [m]
    velocity: np.ndarray  # velocity there (x, y, z) [m/s]
    rest: np.ndarray  # x and y of the stop [m]


def _data(folder: Path) -> Path:
    """Folder of the site's files: a subfolder with the name of its archive, or the folder itself,
    as in `benchmarks.field_data`."""
    own = folder / "tschamut2014"
    return own if own.is_dir() else folder


def observed(folder: Path, half: str) -> list[Run]:
    """Observed runs of a half ("calibration" or "held-out"), sorted by name."""
    _, _, starts = read_table(_data(folder) / "release_points.csv")
    _, _, rests = read_table(_data(folder) / "observed_deposition.csv")
    rest = {row.cells["trajectory_id"]: row for row in rests}
    rows = sorted(starts, key=lambda row: row.cells["trajectory_id"])[HALVES[half] :: 2]

    def numbers(cells: dict[str, str], *names: str) -> np.ndarray:
        return np.array([float(cells[name]) for name in names])

    return [
        Run(
            row.cells["block_id"],
            *numbers(row.cells, "radius_m", "mass_kg").tolist(),
            numbers(row.cells, "x_m", "y_m"),
            numbers(row.cells, "vx_mps", "vy_mps", "vz_mps"),
            numbers(rest[row.cells["trajectory_id"]].cells, "x_m", "y_m"),
        )
        for row in rows
    ]


def terrain(folder: Path) -> tuple[np.ndarray, Grid]:
    """Elevations and grid of the site's stand-in terrain."""
    lines = (_data(folder) / "terrain.asc").read_text().splitlines()
    head = {name.lower(): float(value) for name, value in (line.split() for line in lines[:5])}
    first = 6 if lines[5].lower().startswith("nodata") else 5
    z = np.array([[float(one) for one in line.split()] for line in lines[first:]])
    if first == 6:
        z[z == float(lines[5].split()[1])] = np.nan
    ny, cell = int(head["nrows"]), head["cellsize"]
    return z, Grid(head["xllcorner"], head["yllcorner"] + ny * cell, cell, int(head["ncols"]), ny)


def simulated(run: Run, law: Law, place: tuple[np.ndarray, Grid], boulders: int, seed: int):
    """Stopping places (boulders, 2) [m] of boulders simulated from the release of an observed
    run."""
    volume = 4 / 3 * np.pi * run.radius**3
    shape = SHAPE_OF_BLOCK[run.block]
    groups: dict[str, dict[str, Any]] = {
        "case": {"title": "Tschamut", "seed": seed, "boulders": boulders},
        "boulder": {"volume": "fixed", "volume_mean": volume, "density": run.mass / volume},
        "release": {
            "x": [run.start[0]], "y": [run.start[1]], "drop_height": 0.001,
            "velocity": run.velocity.tolist(),
        },
    }  # fmt: skip
    case = rockfall.Case(**law.added(groups, shape))
    result = rockfall.run(case, dem=place[0], transform=place[1])
    return np.stack([result.stop_x.values, result.stop_y.values], axis=1)


def azimuths(way: np.ndarray) -> np.ndarray:
    """Azimuths of vectors (n, 2), relative to their mean direction [degree]."""
    angle = np.arctan2(way[:, 1], way[:, 0])
    middle = np.arctan2(np.sin(angle).mean(), np.cos(angle).mean())
    return np.degrees((angle - middle + np.pi) % (2 * np.pi) - np.pi)


def described(runs: list[Run], rests: list[np.ndarray]) -> dict[str, float]:
    """Statistics by title of the run-outs to stopping places `rests`, which have equal numbers for
    each run, compared with the observed run-outs."""
    ways = np.concatenate([rest - run.start for run, rest in zip(runs, rests, strict=True)])
    out = np.hypot(*ways.T)
    seen = np.array([np.hypot(*(run.rest - run.start)) for run in runs])
    numbers = distribution_numbers(seen, out, np.ones(len(out)))
    found = {title: numbers[name].simulated for name, title in TITLES.items()}
    found["azimuth std"] = azimuths(ways).std(ddof=1)
    for block in SHAPE_OF_BLOCK:
        some = [
            np.hypot(*(rest - run.start).T)
            for run, rest in zip(runs, rests, strict=True)
            if run.block == block
        ]
        found[f"block {block}"] = np.concatenate(some).mean() if some else np.nan
    return found


def by_axes(folder: Path, ground: str, tables: Path) -> Law:
    """Model with tables simulated for the published size of each block."""
    for row in read_table(_data(folder) / "block_metadata.csv")[2]:
        shape = SHAPE_OF_BLOCK[row.cells["block_id"]]
        axes = sorted((float(row.cells[f"size_{axis}_m"]) for axis in "xyz"), reverse=True)
        lab = {"ground": ground, "shape": "axes", "throws": THROWS}
        case = BlockCase(lab=lab, block={"axes": axes}).at_radius(RADIUS)
        save_table(table_of([run_throws(case)]), tables / f"{shape}.nc")
    return table(f"{ground}, own axes={tables}/{{shape}}.nc")


def compare(given: argparse.Namespace, laws: list[Law]) -> None:
    """Print run-outs by rebound models compared with the observed run-outs."""
    runs, place = observed(given.folder, given.half), terrain(given.folder)
    print(machine())
    seen = described(runs, [run.rest[None, :] for run in runs])
    print(f"{given.half} half: {len(runs)} runs; mean over {len(given.seeds)} seeds and its error")
    print("| law | " + " | ".join(seen) + " |")
    print("|---" * (len(seen) + 1) + "|")
    print("| observed | " + " | ".join(f"{value:.3g}" for value in seen.values()) + " |")
    rows = []
    for law in laws:
        found = [
            described(runs, [simulated(run, law, place, given.boulders, seed) for run in runs])
            for seed in given.seeds
        ]
        cells = []
        for name in seen:
            values = np.array([one[name] for one in found])
            error = values.std(ddof=1) / np.sqrt(len(values)) if len(values) > 1 else np.nan
            cells.append(f"{values.mean():.3g}" + (f" ± {error:.1g}" if len(values) > 1 else ""))
        print(f"| {law.name} | " + " | ".join(cells) + " |", flush=True)
        for title, (unit, quantity, part) in RECORDED.items():
            key = "tschamut", given.half + part, quantity, law.name
            one = nan if title in DISTANCES else seen[title]
            rows.append(evidence.row(key, unit, one, [numbers[title] for numbers in found]))
    if given.write:
        evidence.record(made for made in rows if made.model in {law.name for law in given.law})


def main(words: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--half", choices=HALVES, default="calibration")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--boulders", type=int, default=100)
    parser.add_argument("--axes", metavar="GROUND", help="blocks of their own axes at a ground")
    parser.add_argument("--write", action="store_true")
    add_laws(parser)
    given = parser.parse_args(words)
    with tempfile.TemporaryDirectory() as tables:
        laws = [matrix(), *given.law]
        if given.axes:
            laws.append(by_axes(given.folder, given.axes, Path(tables)))
        compare(given, laws)


if __name__ == "__main__":
    main()
