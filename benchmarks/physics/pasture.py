# SPDX-License-Identifier: BSD-3-Clause
"""The relief of the laboratory's meadow, by the run-outs of the half of Tschamut that calibrates,
and by the planes (docs/validation/field/protocol.md):

    python -m benchmarks.physics.pasture FOLDER TABLES [--relief 14 ...] [--hurst 0.8 1.4]
        [--longest 16 32] [--yields 1e6] [--throws 2000]

FOLDER as of benchmarks.physics.tschamut; tables are kept in TABLES and not made again. One seed.
"""

import argparse
from itertools import product
from pathlib import Path

from benchmarks.machine import machine
from benchmarks.physics.laws import table
from benchmarks.physics.runaway import SLOPES, beyond
from benchmarks.physics.tschamut import described, observed, simulated, terrain
from rockfall.grounds.impact_tables import save_table
from rockfall.lab.blocks.case import BlockCase
from rockfall.lab.blocks.contacts import run_throws
from rockfall.lab.blocks.shapes import SHAPES
from rockfall.lab.tables import table_of

SEED, BOULDERS, ON_PLANES = 1, 100, 400


def make(path: Path, ground: str, shape: str, values: dict[str, float], throws: int) -> None:
    """The table of a ground with other values, thrown at the size of its evidence, unless it is
    there."""
    if not path.exists():
        lab = {"ground": ground, "shape": shape, "throws": throws}
        case = BlockCase(lab=lab, ground=values)
        thrown = run_throws(case.at_radius(case.ground["fitted_radius"]))
        save_table(table_of([thrown]), path)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("tables", type=Path)
    parser.add_argument("--relief", type=float, nargs="+", default=[10, 12, 14, 16, 18])
    parser.add_argument("--hurst", type=float, nargs="+", default=[0.8, 1.4])
    parser.add_argument("--longest", type=float, nargs="+", default=[16, 32])
    parser.add_argument("--yields", type=float, nargs="+", default=[1e6])
    parser.add_argument("--throws", type=int, default=2000)
    given = parser.parse_args()
    given.tables.mkdir(exist_ok=True)
    runs, place = observed(given.folder, "calibration"), terrain(given.folder)
    print(machine())
    columns = "yield [MPa] | hurst | longest | relief | mean | std | KS | Wasserstein".split(" | ")
    columns += [f"{slope} degrees" for slope in SLOPES] + ["all"]
    print("|", " | ".join(columns), "|")
    print("|---" * len(columns) + "|")
    for strength, hurst, longest, relief in product(
        given.yields, given.hurst, given.longest, given.relief
    ):
        ground = {"relief": relief, "hurst": hurst, "longest": longest, "yield_pressure": strength}
        name = f"p{strength:g}-h{hurst:g}-l{longest:g}-r{relief:g}-{given.throws}"
        for shape in SHAPES:
            make(given.tables / f"{name}-{shape}.nc", "meadow", shape, ground, given.throws)
        law = table(f"{name}={given.tables.resolve() / name}-{{shape}}.nc")
        found = described(runs, [simulated(run, law, place, BOULDERS, SEED) for run in runs])
        compact = table(f"{name}={given.tables.resolve() / name}-compact.nc")
        share = [beyond(compact, slope, ON_PLANES) for slope in SLOPES]
        cells = [f"{strength / 1e6:g}", f"{hurst:g}", f"{longest:g}", f"{relief:g}"]
        cells += [f"{found[key]:.3g}" for key in ("mean", "std", "KS", "Wasserstein")]
        cells += [f"{part:.2f}, {speed:.0f} m/s" for part, speed in share]
        cells.append(f"{sum(part for part, _ in share) / len(share):.3f}")
        print("|", " | ".join(cells), "|", flush=True)


if __name__ == "__main__":
    main()
