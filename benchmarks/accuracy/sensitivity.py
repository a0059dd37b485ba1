# SPDX-License-Identifier: BSD-3-Clause
"""Sensitivity to the stand-in slope of cases/vaujany: the case with single changes.

    python -m benchmarks.accuracy.sensitivity [--boulders 10000]

Prints for each change the fraction of boulders that pass EL1, their mean speed and passing height.
"""

import argparse
from dataclasses import dataclass

import numpy as np
import rasterio

import rockfall
from benchmarks.machine import NOTHING, VAUJANY, machine
from rockfall_lab.scorecard.vaujany_slope import CELL, NORTH, ROADS, WEST, Talus, zones


@dataclass(frozen=True)
class Lowered(Talus):
    """Slope with roads whose cuts lower the whole slope below."""

    def profile(self, s: np.ndarray) -> np.ndarray:
        z = self.natural(s)
        for axis, width in ROADS.values():
            edges = axis - width / 2, axis + width / 2
            upper = self.natural(np.array(edges[0]))
            z = z + self.roads * (upper - self.natural(np.clip(s, *edges)))
        return z


CHANGES = {
    "nothing": Talus(),
    **{f"seed {seed} of the relief": Talus(seed=seed) for seed in (1, 2, 3, 4)},
    "no relief": Talus(relief=0.0),
    "relief of 0.5 m": Talus(relief=0.5),
    "slope of 36 degrees": Talus(angle=36.0),
    "slope of 40 degrees": Talus(angle=40.0),
    "no roads": Talus(roads=0.0),
    "no channel": Talus(channel=0.0),
    "roads lower all below": Lowered(),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boulders", type=int, default=10_000)
    options = parser.parse_args()
    print(machine(), "\n")
    case = rockfall.read_case(VAUJANY).replace(
        case={"boulders": options.boulders},
        output=NOTHING,
    )
    print(f"{'changed':28}{'fraction':>8}{'speed':>8}{'height':>8}   at EL1")
    transform = rasterio.Affine(CELL, 0, WEST, 0, -CELL, NORTH)
    for name, slope in CHANGES.items():
        result = rockfall.run(case, dem=slope.elevation(), transform=transform, zones=zones())
        table = rockfall.line_statistics(result).set_index(["line", "quantity"]).loc["EL1"]
        speed, height = table.loc["speed"], table.loc["passing_height"]
        print(f"{name:28}{speed['fraction']:8.2f}{speed['mean']:8.1f}{height['mean']:8.2f}")


if __name__ == "__main__":
    main()
