# SPDX-License-Identifier: BSD-3-Clause
"""Make the tables of impacts that are shipped with the program, from its laboratory of blocks and,
`rocky-slope`, from that of rocks:

    python tools/ship_tables.py [GROUND ... | rocky-slope]

Half a minute each, on two cores, `rocky-slope` a quarter of an hour; `rockfall lab remake` makes
one again from what it says itself.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import xarray as xr

from rockfall.impact_tables import SHAPES, save_table
from rockfall.lab.blocks.case import BlockCase, grounds
from rockfall.lab.blocks.contacts import run_throws
from rockfall.lab.case import read_lab_case
from rockfall.lab.sequences import run_sequences
from rockfall.lab.tables import table_of

ROOT = Path(__file__).resolve().parents[1]
THROWS, SEED = 2_000, 1
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


def main() -> None:
    for ground in sys.argv[1:] or [*grounds(), ROCKS]:
        for name, contacts in contacts_of(ground):
            path = FOLDER / f"{name}.nc"
            save_table(table_of([contacts]), path)
            print(f"{path.name}: {path.stat().st_size / 1e6:.2f} MB", flush=True)


if __name__ == "__main__":
    main()
