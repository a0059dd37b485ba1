# SPDX-License-Identifier: BSD-3-Clause
"""Make the tables of impacts that are shipped with the program, from its laboratory of blocks:

    python tools/ship_tables.py [GROUND ...]

Half a minute each, on two cores; `rockfall lab remake` makes one again from what it says itself.
"""

import sys
from pathlib import Path

from rockfall.impact_tables import SHAPES, save_table
from rockfall.lab.blocks.case import BlockCase, grounds
from rockfall.lab.blocks.contacts import run_throws
from rockfall.lab.tables import table_of

ROOT = Path(__file__).resolve().parents[1]
THROWS, SEED = 2_000, 1
FOLDER = ROOT / "python" / "rockfall" / "data" / "impact_tables"


def main() -> None:
    for ground in sys.argv[1:] or grounds():
        for shape in SHAPES:
            lab = {"ground": ground, "shape": shape, "throws": THROWS, "seed": SEED}
            path = FOLDER / f"{ground}-{shape}.nc"
            save_table(table_of([run_throws(BlockCase(lab=lab))]), path)
            print(f"{path.name}: {path.stat().st_size / 1e6:.2f} MB", flush=True)


if __name__ == "__main__":
    main()
