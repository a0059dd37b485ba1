# SPDX-License-Identifier: BSD-3-Clause
"""Make the tables of impacts that are shipped with the program, from its laboratory of blocks and,
`rocky-slope`, from that of rocks:

    python tools/ship_tables.py [GROUND ... | rocky-slope]

Half a minute each, on two cores, `rocky-slope` half an hour; `rockfall lab remake` makes
one again from what it says itself. Of a ground whose values evidence leaves open, each shape comes
with an ensemble: draws of these values (data/lab_draws.csv, made by benchmarks.physics.posterior).
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import xarray as xr

from rockfall.impact_tables import ENSEMBLE, save_ensemble, save_table
from rockfall.lab.blocks.case import BlockCase, draws_of, grounds
from rockfall.lab.blocks.contacts import run_throws
from rockfall.lab.blocks.shapes import SHAPES
from rockfall.lab.case import read_lab_case
from rockfall.lab.sequences import run_sequences
from rockfall.lab.tables import KEPT, table_of

ROOT = Path(__file__).resolve().parents[1]
THROWS, SEED = 2_000, 1
THROWS_OF_DRAW = 1_000
ROCKS = "rocky-slope"
FOLDER = ROOT / "python" / "rockfall" / "data" / "impact_tables"


def contacts_of(ground: str) -> Iterator[tuple[str, xr.Dataset]]:
    """The tables of a ground, by name, and the contacts that each is made from."""
    if ground == ROCKS:
        yield ROCKS, run_sequences(read_lab_case(ROOT / "cases" / ROCKS / "throws.nml"))
        return
    for shape in SHAPES:
        lab = {"ground": ground, "shape": shape, "throws": THROWS, "seed": SEED}
        yield f"{ground}-{shape}", run_throws(BlockCase(lab=lab))


def make_ensemble(ground: str, shape: str, path: Path) -> None:
    """The draws of a ground, each with a seed of its own."""
    draws = draws_of(ground)
    tables = []
    for number, values in enumerate(draws, start=1):
        lab = {"ground": ground, "shape": shape, "throws": THROWS_OF_DRAW, "seed": SEED + number}
        contacts = run_throws(BlockCase(lab=lab, ground=values))
        tables.append(table_of([contacts], KEPT // len(draws)))
    save_ensemble(tables, path)


def main() -> None:
    for ground in sys.argv[1:] or [*grounds(), ROCKS]:
        made = []
        for name, contacts in contacts_of(ground):
            made.append(FOLDER / f"{name}.nc")
            save_table(table_of([contacts]), made[-1])
        for shape in SHAPES if draws_of(ground) else ():
            made.append(FOLDER / f"{ground}{ENSEMBLE}-{shape}.nc")
            make_ensemble(ground, shape, made[-1])
        for path in made:
            print(f"{path.name}: {path.stat().st_size / 1e6:.2f} MB", flush=True)


if __name__ == "__main__":
    main()
