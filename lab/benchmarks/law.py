# SPDX-License-Identifier: BSD-3-Clause
"""Compare the motion of boulders by an impact table with that of simulated blocks, on planes:

    python -m lab.benchmarks.law [--ground meadow] [--shape compact] [--relief 14]
        [--blocks 300] [--seed 77]

Throws blocks of R_b = 0.4 m at 5 m/s, 30 degrees from the plane, without spin, down planes in the
laboratory, for up to 600 contacts, and the same number of boulders in the program, by a table of
2,000 other throws. Prints the fraction that passes 25 to 200 m along the slope and the mean speed
there, and the Wasserstein distance of the run-outs, truncated at 300 m.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
from scipy.stats import wasserstein_distance

import rockfall
from benchmarks.machine import machine
from lab.benchmarks.plane import plane
from rockfall.grounds.impact_tables import save_table
from rockfall.result.crossings import at_lines
from rockfall_lab.blocks.case import BlockCase
from rockfall_lab.blocks.contacts import run_throws
from rockfall_lab.tables import table_of

RADIUS, SPEED, ANGLE = 0.4, 5.0, 30.0  # R_b [m], speed [m/s], angle to the plane [degree]
MARKS = 25.0, 50.0, 100.0, 200.0  # distances along the slope [m]
FAR = 300.0  # maximum run-out [m]
SLOPES = 12, 15, 20, 25, 30, 38  # slopes [degree]
CELL, COLUMNS, ABOVE = 2.5, 80, 8  # cell size [m], columns, rows above the release


def thrown(case: BlockCase, slope: float, blocks: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Run-outs (blocks,) [m] of laboratory blocks, and their speeds at the marks (blocks, marks)
    [m/s], NaN for marks that are not reached. Within a contact, the squared speed is linear in the
    distance."""
    throw = {"slope": [slope] * 2, "speed": [SPEED] * 3, "angle": [ANGLE] * 3, "spin": [0.0] * 3}
    one = case.replace(lab={"throws": blocks, "contacts": 600, "seed": seed}, throw=throw)
    data = run_throws(one)
    column = {name: data[name].values.astype(float) for name in data}
    pull, press = (
        data.attrs["gravity"] * part
        for part in (np.sin(np.radians(slope)), np.cos(np.radians(slope)))
    )
    turned = np.radians(column["heading"] + column["lateral"])
    out = column["vt_out"] * column["speed"]
    # velocity at the end: down the slope, across it, normal to it
    down = out * np.cos(turned) + pull * column["duration"]
    across, off = out * np.sin(turned), column["vn_out"] * column["speed"]
    begins = column["downhill"] * RADIUS
    ends = begins + column["advance"] * np.cos(np.radians(column["heading"])) * RADIUS
    reach, speed = np.zeros(blocks), np.full((blocks, len(MARKS)), np.nan)
    for k in range(blocks):
        rows = np.flatnonzero(column["sequence"] == k + 1)
        place = np.column_stack([begins[rows], ends[rows]]).ravel()
        reach[k] = place.max()
        for m, mark in enumerate(MARKS):
            after = int(np.argmax(place >= mark))
            if place[after] < mark or after == 0:
                continue
            row, way = rows[(after - 1) // 2], mark - place[after - 1]
            leaves = down[row] ** 2 + across[row] ** 2 + off[row] ** 2
            if after % 2:  # within the contact of this row
                square = column["speed"][row] ** 2
                square += way / (place[after] - place[after - 1]) * (leaves - square)
            else:  # in the flight after the contact
                time = (np.sqrt(down[row] ** 2 + 2 * pull * way) - down[row]) / pull
                square = leaves + 2 * pull * way + press * time * (press * time - 2 * off[row])
            speed[k, m] = np.sqrt(square)
    return reach, speed


def drawn(table: Path, slope: float, boulders: int) -> tuple[np.ndarray, np.ndarray]:
    """Run-outs [m] of boulders in the program, and their speeds at the marks [m/s], as from
    `thrown`."""
    angle = np.radians(slope)
    rows = int((FAR * np.cos(angle) + 60) / CELL)
    top, width = (rows - ABOVE) * CELL, COLUMNS * CELL
    down = np.array([0.0, -np.cos(angle), -np.sin(angle)])
    out = np.array([0.0, -np.sin(angle), np.cos(angle)])
    towards = np.radians(ANGLE)
    velocity = SPEED * (np.cos(towards) * down - np.sin(towards) * out)
    case = rockfall.Case(
        folder=table.parent,
        case={"title": "plane", "seed": 3, "boulders": boulders},
        impact={"form": "table", "table": table.name},
        boulder={"volume": "fixed", "volume_mean": 4 / 3 * np.pi * RADIUS**3, "density": 2700.0},
        release={"x": [width / 2], "y": [top], "drop_height": 0.001, "velocity": velocity.tolist()},
        line=[
            {"name": f"{mark:g} m", "x": [0.0, width], "y": [top - mark * np.cos(angle)] * 2}
            for mark in MARKS
        ],
    )
    result = rockfall.run(case, **plane(slope, rows, COLUMNS, CELL))
    return (top - result.stop_y.values) / np.cos(angle), at_lines(result)["line_speed"].values.T


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--ground", default="meadow")
    parser.add_argument("--shape", default="compact")
    parser.add_argument("--relief", type=float, default=14.0)
    parser.add_argument("--blocks", type=int, default=300)
    parser.add_argument("--seed", type=int, default=77)
    given = parser.parse_args()
    case = BlockCase(
        lab={"ground": given.ground, "shape": given.shape, "throws": 2000, "seed": given.seed + 1},
        block={"radius": RADIUS},
        ground={"relief": given.relief},
    )
    print(machine())
    print(f"{given.ground}, {given.shape}, relief {given.relief:g} degrees")
    print("| slope | by | " + " | ".join(f"{mark:g} m" for mark in MARKS) + " | Wasserstein [m] |")
    print("|---" * (3 + len(MARKS)) + "|")
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "table.nc"
        save_table(table_of([run_throws(case)]), table)
        for slope in SLOPES:
            found = {
                "blocks": thrown(case, slope, given.blocks, given.seed),
                "table": drawn(table, slope, 4 * given.blocks),
            }
            apart = wasserstein_distance(*(np.minimum(one, FAR) for one, _ in found.values()))
            for name, (_, speed) in found.items():
                passed = np.isfinite(speed)
                cells = [
                    f"{part.mean():.2f}, {one[part].mean():.1f} m/s" if part.any() else "0"
                    for one, part in zip(speed.T, passed.T, strict=True)
                ]
                end = f"{apart:.1f}" if name == "table" else ""
                print(f"| {slope} | {name} | " + " | ".join(cells) + f" | {end} |", flush=True)


if __name__ == "__main__":
    main()
