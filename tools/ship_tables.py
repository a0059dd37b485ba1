# SPDX-License-Identifier: BSD-3-Clause
"""Make the shipped impact tables with the block laboratory (`rocky-slope`: with the rock
laboratory):

    python tools/ship_tables.py [--contacts FOLDER] [ploughed-compact ... | rocky-slope]

A plane has one file per block shape and relief slope, with one part per dimensionless ground
strength, strength/(rho_b g R_b). One plane therefore covers all boulder sizes and all soils
(theory, chapter 5). A plane takes up to half an hour on one core, `rocky-slope` two hours;
`rockfall lab remake` reproduces a file from its provenance. Contacts stored in FOLDER are not
simulated again.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import xarray as xr

from rockfall.grounds.impact_tables import USUAL_WEIGHT, save_table
from rockfall.io.atomic import atomic_write
from rockfall.io.netcdf import load_dataset
from rockfall.kernel_rules import USUAL_DENSITY
from rockfall_lab.blocks.case import CONSTANTS, BlockCase, restitution_of
from rockfall_lab.blocks.contacts import run_throws
from rockfall_lab.case import read_lab_case
from rockfall_lab.spheres.sequences import run_sequences
from rockfall_lab.tables import table_of

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "python" / "rockfall" / "data" / "impact_tables"
ROCKS = "rocky-slope"
GROUNDS = {"ploughed": "meadow", "hard": "rock"}  # shipped grounds that provide all other values
RADIUS = 0.4  # R_b of the blocks [m]; 5 m/s is then 2.5 sqrt(g R_b)
SPEED = 0.6, 10.0, 42.0  # speeds of throws: 0.3 to 21 sqrt(g R_b) [m/s]
KEPT = 3_000  # number of contacts in each part that become records


class Plane(NamedTuple):
    """Plane of impact tables, with a part for each ground strength and slope of the relief."""

    strengths: tuple[float, ...]  # dimensionless: N
    reliefs: tuple[float, ...]  # slopes of the relief [degree]
    throws: int  # throws per part
    seed: int  # seed of the first part


PLOUGHED = tuple(1.5 * 2.0**k for k in range(10))
HARD = 12.0, 30.0, 75.0, 190.0, 470.0, 1200.0, 3000.0
PLANES = {
    "ploughed-compact": Plane(PLOUGHED, (7.0, 9.0, 11.5, 14.0, 16.5, 19.0, 22.0), 600, 1000),
    "hard-compact": Plane(HARD, (10.0, 13.0, 16.0, 19.0), 600, 1500),
    "ploughed-elongated": Plane(PLOUGHED, (7.0, 10.0, 13.0, 16.0, 19.0, 22.0), 400, 2000),
    "hard-elongated": Plane(HARD, (11.0, 16.0), 400, 2500),
    "ploughed-platy": Plane(PLOUGHED, (7.0, 10.0, 13.0, 16.0, 19.0, 22.0), 400, 3000),
    "hard-platy": Plane(HARD, (11.0, 16.0), 400, 3500),
}
SEEDS_OF_STRENGTH = 20  # increment of the seed from one strength to the next


def part_case(name: str, column: int, row: int) -> BlockCase:
    """Laboratory case for one part of a plane."""
    model, shape = name.split("-")
    plane = PLANES[name]
    pressure = float(f"{plane.strengths[column] * USUAL_WEIGHT * RADIUS:.6g}")
    seed = plane.seed + SEEDS_OF_STRENGTH * column + row
    return BlockCase(
        lab={"ground": GROUNDS[model], "shape": shape, "throws": plane.throws, "seed": seed},
        block={"radius": RADIUS, "density": USUAL_DENSITY},
        ground={
            **CONSTANTS[model], "yield_pressure": pressure, "relief": plane.reliefs[row],
            "restitution": restitution_of(pressure, USUAL_DENSITY), "fitted_radius": RADIUS,
            "yield_exponent": 0.0, "rest_angle": 0.0,
        },
        throw={"speed": [*SPEED]},
    )  # fmt: skip


def contacts_of(case: BlockCase, path: Path | None) -> xr.Dataset:
    """Contacts of a case, read from the file `path` if it exists, else simulated and stored. Exits
    if the file belongs to another case."""
    if path and path.exists():
        found = load_dataset(path)
        if found.attrs["lab_case"] != case.text():
            raise SystemExit(f"{path}: is of another case: remove it")
        return found
    data = run_throws(case)
    if path:
        with atomic_write(path) as part:
            data.to_netcdf(part)
    return data


def make(name: str, folder: Path | None) -> None:
    """Make the files of a plane, or of the rock table."""
    if name == ROCKS:
        case = read_lab_case(ROOT / "lab/cases" / ROCKS / "throws.nml")
        save_table(table_of([run_sequences(case)]), FOLDER / f"{ROCKS}.nc")
        return
    plane = PLANES[name]
    for row, relief in enumerate(plane.reliefs):
        parts = [
            contacts_of(
                part_case(name, column, row),
                folder and folder / f"{name}-{strength:g}-{relief:g}.nc",
            )
            for column, strength in enumerate(plane.strengths)
        ]
        path = FOLDER / f"{name}-{relief:g}.nc"
        save_table(table_of(parts, KEPT * len(parts)), path)
        print(f"{path.name}: {path.stat().st_size / 1e6:.2f} MB", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--contacts", type=Path)
    parser.add_argument("names", nargs="*", default=[*PLANES])
    given = parser.parse_args()
    for name in given.names:
        make(name, given.contacts)


if __name__ == "__main__":
    main()
