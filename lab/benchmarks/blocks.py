# SPDX-License-Identifier: BSD-3-Clause
"""Block laboratory: checks of its physics, cost of a contact, six field impacts.

    python -m lab.benchmarks.blocks [--impacts 6000] [--throws 300] [--field CSV] [--only WORD]

`gain`: maximum ratio of the energy after an impact on flat ground to the energy before, for N
impacts at 2 to 30 m/s, divided among the grounds. `step`: change of means with half the time step,
and with half the longest facet edge, in units of |V_in|. `cost`: CPU time per contact, and ends of
contacts, for each ground and shape. `planes`: blocks on planes of meadow with more and less relief.
`field`: translational energy after / before of six impacts of a block of 780 kg on an alpine meadow
(Caviezel et al. 2019, Earth Surface Dynamics 7, 199; a table with columns mass_kg, radius_m,
incoming_total_speed_mps, impact_angle_deg, published_energy_transition_ratio), whose spin was not
measured: W/V is drawn from 0 to 1, or is 0, or 1. Exit status 1 if an impact gains more than 1e-4,
or halving the step changes a mean by more than 0.002.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from benchmarks.machine import machine
from rockfall.grounds.shapes import SHAPES
from rockfall.io.tables import Row, read_table
from rockfall_lab.blocks.case import BlockCase, grounds
from rockfall_lab.blocks.contacts import run_throws

GAIN, CHANGE = 1e-4, 2e-3
GRAVITY = 0.1  # [m/s2] for single impacts: almost no energy is gained by the fall
MEANS = "vt_out", "vn_out", "w_out", "energy_out"


def impact_case(name: str, impacts: int) -> BlockCase:
    """Case of single impacts on flat ground."""
    return BlockCase(
        lab={"ground": name, "throws": impacts, "contacts": 1},
        ground={"relief": 0},
        throw={"slope": [0, 0], "speed": [2, 10, 30], "gravity": GRAVITY},
    )


def gain(arguments: argparse.Namespace) -> bool:
    sound = True
    each = -(-arguments.impacts // len(grounds()))
    for ground in grounds():
        case = impact_case(ground, each)
        data = run_throws(case)
        # the energy of the block's fall is not a gain
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


def planes(arguments: argparse.Namespace) -> bool:
    print("  meadow; of blocks set off at 5 m/s the part that passes 100 m, their mean speed there")
    print("  and at 200 m [m/s], and the part of contacts that turn less than 22.5 degrees")
    n = max(10, arguments.throws // 7)
    for relief in 13.5, 18, 22, 26:
        for slope in 24, 30, 38:
            case = BlockCase(
                lab={"ground": "meadow", "throws": n, "contacts": 200},
                ground={"relief": relief},
                throw={
                    "slope": [slope, slope], "speed": [5, 5, 5], "angle": [30, 30, 30],
                    "spin": [0, 0, 0],
                },
            )  # fmt: skip
            data = run_throws(case)
            sequence, speed = data["sequence"].values, data["speed"].values
            way = data["downhill"].values * case.block["radius"]
            first = {at: _first_beyond(sequence, way, at) for at in (100, 200)}
            means = [speed[k].mean() if len(k) else np.nan for k in first.values()]
            straight = np.abs(data["lateral"].values[data["entry"] == 0]) < 22.5
            print(
                f"  relief {relief:4.1f}, slope {slope}: {len(first[100]) / n:4.2f}"
                f" {means[0]:5.1f} {means[1]:5.1f} {straight.mean():5.2f}"
            )
    return True


def _first_beyond(sequence: np.ndarray, way: np.ndarray, at: float) -> np.ndarray:
    """Index of each throw's first contact beyond a distance down the plane [m]."""
    beyond = np.flatnonzero(way > at)
    return beyond[np.unique(sequence[beyond], return_index=True)[1]]


def field(arguments: argparse.Namespace) -> bool:
    if not arguments.field:
        print("  left out: needs --field IMPACTS.csv")
        return True
    rows = list(read_table(arguments.field)[2])
    measured = [row.number("published_energy_transition_ratio", 0, 10) for row in rows]
    print(f"  {'measured':40s}{np.round(measured, 2)} mean {np.mean(measured):.2f}")
    for strength, spin, relief in (
        (1e6, (0, 0.5, 1), 0), (0.5e6, (0, 0.5, 1), 0), (2e6, (0, 0.5, 1), 0),
        (1e6, (0, 0, 0), 0), (1e6, (1, 1, 1), 0), (1e6, (0, 0.5, 1), 13.5),
    ):  # fmt: skip
        left = [energy_left(row, arguments.throws, strength, spin, relief) for row in rows]
        about = f"p_y {strength / 1e6:3.1f} MPa, W/V {spin}, relief {relief}"
        print(f"  {about:40s}{np.round(left, 2)} mean {np.mean(left):.2f}")
    return True


def energy_left(row: Row, throws: int, strength: float, spin: tuple, relief: float) -> float:
    """Translational energy after / before, averaged over attitudes and blocks."""
    radius, speed = (
        row.number(name, 0.01, 100) for name in ("radius_m", "incoming_total_speed_mps")
    )
    angle = row.number("impact_angle_deg", 0.1, 90)
    case = BlockCase(
        lab={"ground": "meadow", "throws": throws, "contacts": 1},
        block={
            "radius": radius,
            "density": row.number("mass_kg", 1, 1e6) / (4 / 3 * np.pi * radius**3),
        },
        ground={"yield_pressure": strength, "relief": relief},
        throw={"slope": [0, 0], "speed": [speed] * 3, "angle": [angle] * 3, "spin": spin},
    )
    data = run_throws(case)
    return float((data["vt_out"] ** 2 + data["vn_out"] ** 2).mean())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--impacts", type=int, default=6000)
    parser.add_argument("--throws", type=int, default=300)
    parser.add_argument("--field", type=Path)
    parser.add_argument("--only", default="", help="gain, step, cost, planes or field")
    arguments = parser.parse_args()
    print(machine())
    sound = True
    for look in gain, step, cost, planes, field:
        if arguments.only in look.__name__:
            print(look.__name__)
            sound &= look(arguments)
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main())
