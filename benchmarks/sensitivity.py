# SPDX-License-Identifier: BSD-3-Clause
"""How much the stand-in slope of cases/vaujany leaves open: the case with one thing changed.

    python benchmarks/sensitivity.py [--boulders 10000]

Prints for each change the share of boulders that pass EL1, their mean speed and passing height.
"""

import argparse
import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
from machine import machine

import rockfall

VAUJANY = Path(__file__).parents[1] / "cases/vaujany"
EASING = [30, 18, 2, 0]  # degrees below the talus
CHANGES = {
    "nothing": {},
    **{f"seed {seed} of the relief": {"SEED": seed} for seed in (1, 2, 3, 4)},
    "no relief": {"RELIEF": 0.0},
    "relief of 0.5 m": {"RELIEF": 0.5},
    "slope of 36 degrees": {"ANGLE": [36, 36, 36, *EASING]},
    "slope of 40 degrees": {"ANGLE": [40, 40, 40, *EASING]},
    "no roads": {"ROADS": {}},
    "no channel": {"CHANNEL": ([0, 600], [0, 0])},
    "roads lower all below": {"profile": True},
}


def recipe() -> ModuleType:
    """The script that makes the slope, fresh, so that a change is gone with it."""
    spec = importlib.util.spec_from_file_location("make_terrain", VAUJANY / "make_terrain.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def lowering(module: ModuleType):
    """Roads that take nine tenths of their fall out of the whole slope below them."""

    def profile(s: np.ndarray) -> np.ndarray:
        z = module.natural(s)
        for axis, width in module.ROADS.values():
            edges = axis - width / 2, axis + width / 2
            upper = module.natural(np.array(edges[0]))
            z = z + 0.9 * (upper - module.natural(np.clip(s, *edges)))
        return z

    return profile


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boulders", type=int, default=10_000)
    options = parser.parse_args()
    print(machine(), "\n")
    case = rockfall.read_case(VAUJANY / "case.nml").replace(
        case={"boulders": options.boulders},
        output={"maps": None, "rebounds": False, "trajectories": 0},
    )
    print(f"{'changed':28}{'share':>8}{'speed':>8}{'height':>8}   at EL1")
    for name, change in CHANGES.items():
        module = recipe()
        for key, value in change.items():
            if key == "ANGLE":
                value = (module.ANGLE[0], value)
            setattr(module, key, lowering(module) if key == "profile" else value)
        z, zones = module.slope()
        transform = module.rasterio.Affine(
            module.CELL, 0, module.WEST, 0, -module.CELL, module.NORTH
        )
        result = rockfall.run(case, dem=z, transform=transform, zones=zones)
        table = rockfall.line_statistics(result).set_index(["line", "quantity"]).loc["EL1"]
        speed, height = table.loc["speed"], table.loc["passing_height"]
        print(f"{name:28}{speed['share']:8.2f}{speed['mean']:8.1f}{height['mean']:8.2f}")


if __name__ == "__main__":
    main()
