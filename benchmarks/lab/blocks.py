# SPDX-License-Identifier: BSD-3-Clause
"""The laboratory of blocks: is its physics sound, what does a contact cost, six field impacts.

    python -m benchmarks.lab.blocks [--impacts 6000] [--throws 300] [--field CSV] [--only WORD]

`gain`: the most energy after an impact on flat ground, over that before, of N impacts at 2 to 30
m/s, shared among the grounds. `step`: how far means change with half the time step, and with half
the longest edge of the facets, in units of |V_in|. `cost`: CPU time of a contact, and how contacts
end, for each ground and shape. `field`: translational energy after / before of six impacts of a
block of 780 kg on an alpine meadow (Caviezel et al. 2019, Earth Surface Dynamics 7, 199; a table
with columns mass_kg, radius_m, incoming_total_speed_mps, impact_angle_deg,
published_energy_transition_ratio), whose spin was not measured: W/V is drawn from 0 to 1. Exit
status 1 if an impact has gained more than 1e-4, or half the step changes a mean by more than 0.002.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from benchmarks.machine import machine
from rockfall.io.tables import read_table
from rockfall.lab.blocks.case import BlockCase, grounds
from rockfall.lab.blocks.contacts import run_throws
from rockfall.lab.blocks.shapes import SHAPES

GAIN, CHANGE = 1e-4, 2e-3
GRAVITY = (
    0.1  # [m/s2] where an impact alone is looked at: what a block falls in it adds next to nothing
)
MEANS = "vt_out", "vn_out", "w_out", "energy_out"


def impact_case(name: str, impacts: int, **groups: dict) -> BlockCase:
    """Single impacts on flat ground."""
    throw = {"slope": [0, 0], "speed": [2, 10, 30], "gravity": GRAVITY}
    return BlockCase(
        lab={"ground": name, "throws": impacts, "contacts": 1},
        ground={"relief": 0} | groups.pop("ground", {}),
        throw=throw | groups.pop("throw", {}),
        **groups,
    )


def gain(arguments: argparse.Namespace) -> bool:
    sound = True
    each = -(-arguments.impacts // len(grounds()))
    for ground in grounds():
        case = impact_case(ground, each)
        data = run_throws(case)
        # energy from what the block fell is not gained
        fall = -2 * GRAVITY * case.block["radius"] * data["rise"] / data["speed"] ** 2
        most = float((data["energy_out"] - fall.clip(min=0)).max())
        sound &= most <= 1 + GAIN
        print(f"  {ground:16s}{each:6d} impacts: at most {most:.5f} of the energy before")
    return sound


def step(arguments: argparse.Namespace) -> bool:
    sound = True
    for ground in "rock", "compact", "meadow", "soft-soil":
        case = impact_case(ground, arguments.throws * 4)
        means = {
            "": run_throws(case),
            "half the step": run_throws(case, step=0.5),
            "half the edge": run_throws(case.replace(block={"edge": 0.5})),
        }
        base = np.array([float(means[""][name].mean()) for name in MEANS])
        print(
            f"  {ground:16s}" + ", ".join(f"{n} {v:.4f}" for n, v in zip(MEANS, base, strict=True))
        )
        for name, data in list(means.items())[1:]:
            change = np.array([float(data[one].mean()) for one in MEANS]) - base
            print(f"    {name}: " + ", ".join(f"{value:+.4f}" for value in change))
            if name == "half the step":
                sound &= bool(np.abs(change).max() <= CHANGE)
    return sound


def cost(arguments: argparse.Namespace) -> bool:
    for ground in grounds():
        for shape in SHAPES:
            case = BlockCase(lab={"ground": ground, "shape": shape, "throws": arguments.throws})
            data = run_throws(case)
            n = data.sizes["contact"]
            ends = np.bincount(data["exit"].values, minlength=3) / n
            each = 1000 * data.attrs["cpu_seconds"] / n
            print(
                f"  {ground:16s}{shape:10s}{n:6d} contacts{each:7.3f} ms;"
                f" flies {ends[0]:.2f}, rolls on {ends[1]:.2f}, stops {ends[2]:.3f}"
            )
    return True


def field(arguments: argparse.Namespace) -> bool:
    if not arguments.field:
        print("  left out: needs --field IMPACTS.csv")
        return True
    rows = list(read_table(arguments.field)[2])
    measured = [row.number("published_energy_transition_ratio", 0, 10) for row in rows]
    print(f"  measured             {np.round(measured, 2)} mean {np.mean(measured):.2f}")
    for strength in 0.5e6, 1e6, 2e6:
        found = []
        for row in rows:
            mass, radius = row.number("mass_kg", 1, 1e6), row.number("radius_m", 0.01, 10)
            speed = row.number("incoming_total_speed_mps", 0.1, 100)
            angle = row.number("impact_angle_deg", 0.1, 90)
            case = impact_case(
                "meadow", arguments.throws,
                block={"radius": radius, "density": mass / (4 / 3 * np.pi * radius**3)},
                ground={"yield_pressure": strength},
                throw={
                    "speed": [speed] * 3, "angle": [angle] * 3, "spin": [0, 0.5, 1],
                    "gravity": 9.81,
                },
            )  # fmt: skip
            data = run_throws(case)
            found.append(float((data["vt_out"] ** 2 + data["vn_out"] ** 2).mean()))
        values = f"{np.round(found, 2)} mean {np.mean(found):.2f}"
        print(f"  p_y {strength / 1e6:3.1f} MPa, flat   {values}")
    return True


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--impacts", type=int, default=6000)
    parser.add_argument("--throws", type=int, default=300)
    parser.add_argument("--field", type=Path)
    parser.add_argument("--only", default="", help="gain, step, cost or field")
    arguments = parser.parse_args()
    print(machine())
    sound = True
    for look in gain, step, cost, field:
        if arguments.only in look.__name__:
            print(look.__name__)
            sound &= look(arguments)
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main())
