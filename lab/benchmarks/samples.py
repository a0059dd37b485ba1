# SPDX-License-Identifier: BSD-3-Clause
"""Uncertainty of a table due to its throws: tables of the same ground with other throws, on planes.

    python -m lab.benchmarks.samples talus [--seeds 11 12 13 14] [--kept 32000 16000 10666]
        [--slopes 26 28 30 32 34 38] [--throws 2000] [--radius 0.6]

Prints for each table the fraction of compact boulders of the blocks' size, RADIUS [m], that passes
200 m, its binomial standard error, and the mean speed there. Each table keeps KEPT contacts as
records.
"""

import argparse
import tempfile
import warnings
from pathlib import Path

from benchmarks.machine import machine
from lab.benchmarks.sizes import SHAPE, on_plane
from rockfall.grounds.impact_tables import save_table
from rockfall_lab.blocks.case import BlockCase, grounds
from rockfall_lab.blocks.contacts import run_throws
from rockfall_lab.tables import KEPT, table_of


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("ground", choices=list(grounds()))
    parser.add_argument("--seeds", type=int, nargs="+", default=[11, 12, 13, 14])
    parser.add_argument("--kept", type=int, nargs="+", default=[KEPT, KEPT // 2, KEPT // 3])
    parser.add_argument("--slopes", type=float, nargs="+", default=[26, 28, 30, 32, 34, 38])
    parser.add_argument("--throws", type=int, default=2000)
    parser.add_argument("--radius", type=float, default=0.6, help="R_b [m]")
    given = parser.parse_args()
    warnings.simplefilter("ignore")  # a table needs no rock sizes
    print(machine())
    print("| records | seed | " + " | ".join(f"{slope:g} degrees" for slope in given.slopes) + " |")
    print("|---" * (2 + len(given.slopes)) + "|")
    lab = {"ground": given.ground, "shape": SHAPE, "throws": given.throws}
    own = {"impact": {"table": "own.nc"}}
    for seed in given.seeds:
        case = BlockCase(lab=lab | {"seed": seed}).at_radius(given.radius)
        contacts = run_throws(case)
        for kept in given.kept:
            with tempfile.TemporaryDirectory() as folder:
                save_table(table_of([contacts], kept), Path(folder) / "own.nc")
                found = [on_plane(own, given.radius, slope, Path(folder)) for slope in given.slopes]
            print(f"| {kept} | {seed} | {' | '.join(found)} |", flush=True)


if __name__ == "__main__":
    main()
