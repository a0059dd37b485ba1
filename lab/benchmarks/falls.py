# SPDX-License-Identifier: BSD-3-Clause
"""Fraction of boulders that pass 60 m down a plane after a fall onto it: blocks in the laboratory,
and boulders by the shipped table and by a table of faster, steeper throws:

    python -m lab.benchmarks.falls [talus] [--slope 28] [--radius 0.6] [--blocks 200]
        [--drops 2 5 10 20 50 100] [--throws 2000] [--write]

In brackets: rebounds per boulder beyond the fastest record at their incidence and spin. --throws 0
omits the faster table; --write stores the fractions by the shipped table and of the blocks in the
table of evidence.
"""

import argparse
import tempfile
import warnings
from pathlib import Path

import numpy as np

import rockfall
from benchmarks.evidence import record, with_origin
from benchmarks.machine import machine
from lab.benchmarks.plane import plane
from rockfall.grounds.impact_tables import save_table
from rockfall.result.crossings import at_lines
from rockfall_lab.blocks.case import BlockCase, grounds
from rockfall_lab.blocks.contacts import run_throws
from rockfall_lab.tables import table_of

DROPS = 2.0, 5.0, 10.0, 20.0, 50.0, 100.0  # drop heights [m]
# Distance down the plane [m], cell size [m], columns, rows above and below the release:
MARK, CELL, COLUMNS, ABOVE, BELOW = 60.0, 2.5, 60, 8, 60
GRAVITY, DENSITY, BOULDERS, CONTACTS = 9.81, 2700.0, 600, 100
FASTER = {"speed": [1.0, 14.0, 60.0], "angle": [3.0, 45.0, 90.0]}  # [m/s], [degree]


def fallen(case: BlockCase, slope: float, drop: float) -> float:
    """Fraction of laboratory blocks that pass MARK [m] down a slope [degree] after a fall of `drop`
    [m]."""
    speed = np.sqrt(2 * GRAVITY * drop)
    throw = {
        "slope": [slope] * 2, "speed": [speed] * 3, "angle": [90 - slope] * 3, "spin": [0.0] * 3,
    }  # fmt: skip
    data = run_throws(case.replace(throw=throw))
    ends = data["advance"].values * np.cos(np.radians(data["heading"].values))
    place = (data["downhill"].values + np.maximum(0, ends)) * case.block["radius"]
    blocks = data["sequence"].values[place >= MARK]
    return len(np.unique(blocks)) / case.lab["throws"]


def drawn(
    table: str, folder: Path, radius: float, slope: float, drop: float
) -> tuple[float, float]:
    """Fraction of boulders that pass MARK by a table, and rebounds per boulder that are faster than
    its records."""
    along = MARK * np.cos(np.radians(slope))
    rows = ABOVE + int(along / CELL) + BELOW
    top, width = (rows - ABOVE) * CELL, COLUMNS * CELL
    case = rockfall.Case(
        folder=folder,
        case={"boulders": BOULDERS, "seed": 7},
        impact={"form": "table", "table": table},
        boulder={"volume": "fixed", "volume_mean": 4 / 3 * np.pi * radius**3, "density": DENSITY},
        release={"x": [width / 2], "y": [top], "drop_height": drop},
        line=[{"name": "line", "x": [0.0, width], "y": [top - along] * 2}],
    )
    result = rockfall.run(case, **plane(slope, rows, COLUMNS, CELL))
    passed = np.isfinite(at_lines(result)["line_speed"].values[0])
    return float(passed.mean()), int(result["rebounds_out_of_speed"]) / BOULDERS


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("ground", nargs="?", choices=list(grounds()), default="talus")
    parser.add_argument("--slope", type=float, default=28.0)
    parser.add_argument("--radius", type=float, default=0.6)
    parser.add_argument("--blocks", type=int, default=200)
    parser.add_argument("--drops", type=float, nargs="+", default=DROPS, help="[m]")
    parser.add_argument("--throws", type=int, default=2000)
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    warnings.simplefilter("ignore", UserWarning)  # warnings about drops of 100 m
    case = BlockCase(lab={"ground": given.ground, "seed": 77}).at_radius(given.radius)
    print(machine())
    print(f"{given.ground}, {given.slope:g} degrees, R_b = {given.radius:g} m")
    print("| by | " + " | ".join(f"{drop:g} m" for drop in given.drops) + " |")
    print("|---" * (1 + len(given.drops)) + "|")
    blocks = case.replace(lab={"throws": given.blocks, "contacts": CONTACTS})
    seen = [fallen(blocks, given.slope, drop) for drop in given.drops]
    print("| blocks | " + " | ".join(f"{passed:.2f}" for passed in seen) + " |", flush=True)
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder, tables = Path(name), [given.ground]
        if given.throws:
            faster = case.replace(lab={"throws": given.throws, "seed": 78}, throw=FASTER)
            save_table(table_of([run_throws(faster)]), folder / "faster.nc")
            tables.append("faster.nc")
        for table in tables:
            found = [drawn(table, folder, given.radius, given.slope, drop) for drop in given.drops]
            row = " | ".join(f"{passed:.2f} ({beyond:.1f})" for passed, beyond in found)
            print(f"| {table} | {row} |", flush=True)
            for drop, of_blocks, (passed, _) in zip(given.drops, seen, found, strict=True):
                place = f"{drop:g} m onto {given.slope:g} degrees, R_b {given.radius:g} m"
                for model, part, number in (
                    (table, passed, BOULDERS), (f"blocks on {table}", of_blocks, given.blocks)
                ):  # fmt: skip
                    error = np.sqrt(part * (1 - part) / number)
                    rows.append(
                        with_origin(("fall", place, "passing_60_m", model), "", np.nan, part, error)
                    )
    if given.write:
        record(row for row in rows if "faster.nc" not in row.model)


if __name__ == "__main__":
    main()
