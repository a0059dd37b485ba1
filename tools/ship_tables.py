# SPDX-License-Identifier: BSD-3-Clause
"""Make the tables of impacts that are shipped with the program, from its laboratory of blocks and,
`rocky-slope`, from that of rocks:

    python tools/ship_tables.py [GROUND ... | rocky-slope]

A minute and a half each, on two cores, `rocky-slope` an hour; `rockfall lab remake` makes one again
from what it says itself. A table of blocks has a part for each of their sizes. Of a ground whose
values evidence leaves open, each shape comes with an ensemble: draws of these values
(data/lab_draws.csv, made by benchmarks.physics.posterior).
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import xarray as xr

from rockfall.grounds.impact_tables import ENSEMBLE, save_ensemble, save_table
from rockfall.lab.blocks.case import BlockCase, draws_of, grounds
from rockfall.lab.blocks.contacts import run_throws
from rockfall.lab.blocks.shapes import SHAPES
from rockfall.lab.case import read_lab_case
from rockfall.lab.sequences import run_sequences
from rockfall.lab.tables import table_of

ROOT = Path(__file__).resolve().parents[1]
SIZES, THROWS, SEED = (0.2, 0.35, 0.6, 1.05, 1.8), 1_000, 1  # R_b [m]; throws of each
SIZES_OF_DRAW, THROWS_OF_DRAW = (0.2, 0.6, 1.8), 500
KEPT_OF_DRAW = 10_200
ROCKS = "rocky-slope"
FOLDER = ROOT / "python" / "rockfall" / "data" / "impact_tables"


def contacts_of(ground: str) -> Iterator[tuple[str, list[xr.Dataset]]]:
    """The tables of a ground, by name, and the contacts that each is made from."""
    if ground == ROCKS:
        yield ROCKS, [run_sequences(read_lab_case(ROOT / "cases" / ROCKS / "throws.nml"))]
        return
    for shape in SHAPES:
        case = BlockCase(lab={"ground": ground, "shape": shape, "throws": THROWS, "seed": SEED})
        yield f"{ground}-{shape}", [run_throws(case.at_radius(size)) for size in SIZES]


def make_ensemble(ground: str, shape: str, path: Path) -> None:
    """The draws of a ground, each with a seed of its own."""
    tables = []
    for number, values in enumerate(draws_of(ground), start=1):
        lab = {"ground": ground, "shape": shape, "throws": THROWS_OF_DRAW, "seed": SEED + number}
        case = BlockCase(lab=lab, ground=values)
        contacts = [run_throws(case.at_radius(size)) for size in SIZES_OF_DRAW]
        tables.append(table_of(contacts, KEPT_OF_DRAW))
    save_ensemble(tables, path)


def main() -> None:
    for ground in sys.argv[1:] or [*grounds(), ROCKS]:
        made = []
        for name, contacts in contacts_of(ground):
            made.append(FOLDER / f"{name}.nc")
            save_table(table_of(contacts), made[-1])
        for shape in SHAPES if draws_of(ground) else ():
            made.append(FOLDER / f"{ground}{ENSEMBLE}-{shape}.nc")
            make_ensemble(ground, shape, made[-1])
        for path in made:
            print(f"{path.name}: {path.stat().st_size / 1e6:.2f} MB", flush=True)


if __name__ == "__main__":
    main()
