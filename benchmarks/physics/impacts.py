# SPDX-License-Identifier: BSD-3-Clause
"""Compare six fast impacts of a 780 kg block on an alpine meadow with impacts simulated by the
block laboratory and by its table `meadow`, and scar depths with a published formula.

    python -m benchmarks.physics.impacts CSV [--throws 300]

The impacts were measured by Caviezel et al. (2019, Earth Surface Dynamics 7, 199); field_data.py
downloads their table (chant_sura_esurf2019). Spin was not measured. Prints as Markdown the ratio of
translational energy after and before each impact: measured; in the laboratory on flat ground with
W/V drawn from 0 to 1, or 0; with the relief of `meadow` and W/V = 0; and by the table on flat
terrain with W/V = 0. Then prints scar depths, measured in two ways, compared with d = 0.1 M^(1/3)
M_E^-0.4 v^0.8 (Lu et al. 2019, Gerber 2019; M [kg], v normal to the ground [m/s]) for several soil
stiffnesses M_E [MN/m2], which were not measured. The last row has the means.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import rockfall
from benchmarks.machine import machine
from benchmarks.physics.laws import Law, table
from lab.benchmarks.blocks import energy_left
from rockfall.io.rasters.grid import Grid
from rockfall.io.tables import Row, read_table
from rockfall_lab.blocks.case import BlockCase

GROUND = "meadow"
SPIN, NO_SPIN = (0, 0.5, 1), (0, 0, 0)
STIFFNESS = 5, 10, 20  # M_E [MN/m2]
CELL, CELLS = 5.0, 80  # flat terrain: cell size [m], number of cells
BOULDERS = 2000
THROWS = 300


def by_table(row: Row, law: Law) -> float:
    """Mean ratio of translational energy after and before the first contact on flat terrain, by a
    table."""
    radius, speed = (row.number(key, 0.01, 100) for key in ("radius_m", "incoming_total_speed_mps"))
    angle = np.radians(row.number("impact_angle_deg", 0.1, 90))
    volume = 4 / 3 * np.pi * radius**3
    middle = CELL * CELLS / 2
    case = rockfall.Case(
        case={"boulders": BOULDERS, "seed": 1},
        boulder={
            "volume": "fixed", "volume_mean": volume,
            "density": row.number("mass_kg", 1, 1e6) / volume,
        },
        impact=law.of("compact")["impact"],
        release={
            "x": [middle], "y": [middle], "drop_height": 1e-6,
            "velocity": [speed * np.cos(angle), 0.0, -speed * np.sin(angle)],
        },
        output={"trajectories": BOULDERS},
    )  # fmt: skip
    z = np.full((CELLS, CELLS), 500.0)
    result = rockfall.run(case, dem=z, transform=Grid(0.0, CELL * CELLS, CELL, CELLS, CELLS))
    hit = np.flatnonzero(result["trajectory_in_n"].values < 0)
    _, first = np.unique(result["trajectory_boulder"].values[hit], return_index=True)
    before, after = (
        sum(result[f"trajectory_{when}_{v}"].values[hit[first]] ** 2 for v in "tn")
        for when in ("in", "out")
    )
    return float((after / before).mean())


def scar(mass: float, speed: float, stiffness: float) -> float:
    """Scar depth [m] of a block with a given mass [kg] and normal speed [m/s], on soil of a given
    stiffness [MN/m2]."""
    return 0.1 * mass ** (1 / 3) * (1000 * stiffness) ** -0.4 * speed**0.8


def numbers(row: Row, throws: int) -> list[float]:
    """Values of an impact in the columns of `page`, except its name."""
    met = BlockCase(lab={"ground": GROUND}).at_radius(row.number("radius_m", 0.01, 100)).ground
    strength = met["yield_pressure"]
    normal = row.number("incoming_normal_speed_mps", 0.01, 100)
    return [
        row.number("incoming_total_speed_mps", 0.01, 100),
        row.number("impact_angle_deg", 0.1, 90),
        row.number("published_energy_transition_ratio", 0, 10),
        energy_left(row, throws, strength, SPIN, 0),
        energy_left(row, throws, strength, NO_SPIN, 0),
        energy_left(row, throws, strength, NO_SPIN, met["relief"]),
        by_table(row, table(GROUND)),
        row.number("observed_scarring_depth_m", 0, 10),
        row.number("observed_scarring_depth_ifm_m", 0, 10),
        *(scar(row.number("mass_kg", 1, 1e6), normal, one) for one in STIFFNESS),
    ]


def page(path: Path, throws: int = THROWS) -> Iterator[str]:
    """Markdown table of the impacts: measured and simulated fractions of energy, and scars."""
    columns = [
        "impact", "speed [m/s]", "angle [degree]", "measured", "flat, W/V 0 to 1", "flat, W/V 0",
        "relief, W/V 0", f"table {GROUND}, W/V 0", "scar [m]", "scar, second way [m]",
        *(f"Lu, {one} MN/m2" for one in STIFFNESS),
    ]  # fmt: skip
    yield "| " + " | ".join(columns) + " |"
    yield "|---" * len(columns) + "|"
    rows = list(read_table(path)[2])
    found = np.array([numbers(row, throws) for row in rows])
    names = [row.text("scar_id") for row in rows]
    for name, values in zip([*names, "mean"], [*found, found.mean(axis=0)], strict=True):
        yield f"| {name} | " + " | ".join(_text(values)) + " |"


def _text(values: np.ndarray) -> list[str]:
    speed, angle, *others = values
    return [f"{speed:.1f}", f"{angle:.0f}", *(f"{one:.2f}" for one in others)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("table", type=Path)
    parser.add_argument("--throws", type=int, default=THROWS)
    given = parser.parse_args()
    print(machine())
    print("\n".join(page(given.table, given.throws)))


if __name__ == "__main__":
    main()
