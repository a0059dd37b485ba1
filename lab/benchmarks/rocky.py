# SPDX-License-Identifier: BSD-3-Clause
"""Impact table of the rock laboratory compared with the paper, field data, and on planes:

    python -m lab.benchmarks.rocky CONTACTS.nc [--slopes 20 23 ...] [--cost]

CONTACTS is the output of `rockfall lab impact` for a case with throws. Prints for each R_b/R_m: R_n
by incidence, compared with Wyllie's field curve R_n = 19.5 theta^-1.03; R_t; the rotational
fraction of the energy; turns; and the neutral slope, on which half of the boulders by the table
pass 100 m, compared with the friction angle of stones on scree. Standard errors omit fifths of the
layers in turn (of the throws, with fewer than five layers). --cost prints the CPU time per contact
at R_b/R_m = 1 to 20 instead, for the case of the contacts.
"""

import argparse
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np
import xarray as xr

import rockfall
from benchmarks.machine import machine
from lab.benchmarks.plane import plane
from rockfall.grounds.impact_tables import save_table
from rockfall_lab.case import LabCase, lab_case_of
from rockfall_lab.spheres.sequences import open_sequences, run_sequences
from rockfall_lab.tables import table_of

CLASSES = (3, 15), (15, 30), (30, 45), (45, 60), (60, 90)  # classes of incidence [degree]
TURNS = 0, 22.5, 45, 181  # class limits of turns [degree]
# tan(angle) = tan(internal) + k R_m/R_b: Statham 1976, ranges after Dorren 2003, eq. 1
INTERNAL, PER_SIZE = (20.3, 33.8), (0.17, 0.26)  # [degree], [-]
PARTS = 5  # number of groups of layers, omitted in turn
RATIOS, THROWS = (1, 2, 3, 5, 8, 12, 20), (20, 20, 10, 5, 3, 2, 1)  # used by --cost
# Block radius [m], initial speed [m/s], distance to pass [m], cell size [m], columns, rows above:
RADIUS, SPEED, PASSED, CELL, COLUMNS, ABOVE = 0.4, 5.0, 100.0, 2.5, 80, 8


def wyllie(angle: np.ndarray) -> np.ndarray:
    """Wyllie's R_n of field impacts at an angle to the ground [degree]."""
    return 19.5 * angle**-1.03


def scree_friction(ratio: float) -> str:
    """Range of the friction angle [degree], as text, of stones on scree whose rocks are `ratio`
    times smaller."""
    low, high = np.degrees(np.arctan(np.tan(np.radians(INTERNAL)) + np.array(PER_SIZE) / ratio))
    return f"{low:.1f} to {high:.1f}"


def with_error(values: np.ndarray) -> str:
    if len(values) < 2:
        return "-"
    return f"{values.mean():.2f} ± {values.std(ddof=1) / np.sqrt(len(values)):.2f}"


def rows_of(data: xr.Dataset) -> dict[str, str]:
    """Statistics of contacts after flights, as text by name."""
    column = {str(name): values.values.astype(float) for name, values in data.items()}
    flight = (column["entry"] == 0) & (column["incidence"] > 0)
    angle = column["incidence"]
    r_n = np.maximum(column["vn_out"], 0) / np.sin(np.radians(np.maximum(angle, 0.1)))
    found = {"contacts": f"{len(angle)}, {int(flight.sum())} from a flight"}
    for low, high in CLASSES:
        these = flight & (angle >= low) & (angle < high)
        curve = f" ({wyllie(angle[these]).mean():.2f})" if these.any() else ""
        found[f"R_n at {low} to {high} degrees (Wyllie)"] = with_error(r_n[these]) + curve
    steep = flight & (angle >= 80)
    found["R_n at 80 to 90"] = with_error(r_n[steep])
    grazing = flight & (angle < 60)
    r_t = column["vt_out"][grazing] / np.cos(np.radians(angle[grazing]))
    found["R_t below 60"] = with_error(r_t)
    leaves = flight & (column["exit"] == 0)
    square = column["speed"][leaves] ** 2
    turning = 0.4 * column["w_out"][leaves] ** 2 * square
    moving = (column["vt_out"][leaves] ** 2 + column["vn_out"][leaves] ** 2) * square
    found["part of rotation in the energy"] = f"{turning.sum() / (turning + moving).sum():.2f}"
    turn = np.abs(column["lateral"][leaves])
    turn = np.where(column["vt_out"][leaves] < 0, 180 - turn, turn)
    parts = np.histogram(turn, TURNS)[0] / max(1, leaves.sum())
    found["turns below 22.5, to 45, above"] = ", ".join(f"{part:.2f}" for part in parts)
    ends = np.bincount(column["exit"].astype(int), minlength=3) / len(angle)
    found["flies, rolls on, stops"] = ", ".join(f"{part:.2f}" for part in ends)
    return found


def passing(table: Path, ratio: float, slope: float, boulders: int = 400) -> float:
    """Fraction of boulders that pass 100 m down a plane of this slope [degree], by a table."""
    angle = np.radians(slope)
    rows = int((PASSED * np.cos(angle) + 60) / CELL)
    top, width = (rows - ABOVE) * CELL, COLUMNS * CELL
    case = rockfall.Case(
        folder=table.parent,
        case={"title": "plane", "seed": 3, "boulders": boulders},
        impact={"form": "table", "table": table.name},
        surface={"uniform_mean_radius": RADIUS / ratio},
        boulder={"volume": "fixed", "volume_mean": 4 / 3 * np.pi * RADIUS**3, "density": 2650.0},
        release={
            "x": [width / 2], "y": [top], "drop_height": 0.5,
            "velocity": [0.0, -SPEED * np.cos(angle), -SPEED * np.sin(angle)],
        },
    )  # fmt: skip
    result = rockfall.run(case, **plane(slope, rows, COLUMNS, CELL))
    way = (top - result.stop_y.values) / np.cos(angle)
    return float((way > PASSED).mean())


def neutral_slope(data: xr.Dataset, ratio: float, slopes: list[float]) -> float:
    """Slope on which half of the boulders pass [degree]; NaN if it is outside the range of
    `slopes`."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "table.nc"
        save_table(table_of([data]), path)
        passed = np.maximum.accumulate([passing(path, ratio, slope) for slope in slopes])
    if passed[0] >= 0.5 or passed[-1] < 0.5:
        return np.nan
    k = int(np.argmax(passed >= 0.5))
    part = (0.5 - passed[k - 1]) / (passed[k] - passed[k - 1])
    return slopes[k - 1] + part * (slopes[k] - slopes[k - 1])


def slope_with_error(data: xr.Dataset, ratio: float, slopes: list[float]) -> str:
    one = data.isel(contact=data["ratio"].values == ratio)
    whole = neutral_slope(one, ratio, slopes)
    group = one["layer"].values
    if len(np.unique(group)) < PARTS:  # few layers: resample throws, as if they were independent
        group = one["sequence"].values
    left = [
        neutral_slope(one.isel(contact=group % PARTS != part), ratio, slopes)
        for part in range(PARTS)
    ]
    error = np.sqrt((PARTS - 1) * np.var(left))
    return f"{whole:.1f} ± {error:.1f}"


def relief_at(case: LabCase, ratio: float) -> float:
    """Relief of the layer [degree] at any ratio, interpolated in the logarithm of the ratio; beyond
    the ratios of the case, that of the nearest."""
    relief = np.broadcast_to(case.throw["relief"], len(case.lab["ratios"]))
    return float(np.interp(np.log(ratio), np.log(case.lab["ratios"]), relief))


def cost(case: LabCase) -> None:
    print(
        "| R_b/R_m | solid fraction | contacts | CPU of a contact, with its part of a layer [ms] |"
    )
    print("|---|---|---|---|")
    for ratio, throws in zip(RATIOS, THROWS, strict=True):
        own = {"throws": [throws], "relief": [relief_at(case, ratio)]}
        one = case.replace(lab={"ratios": [ratio]}, throw=own)
        clock = time.process_time()
        data = run_sequences(one, threads=1)
        each = 1000 * (time.process_time() - clock) / data.sizes["contact"]
        solid = float(np.atleast_1d(data.attrs["solid"])[0])
        print(f"| {ratio} | {solid:.3f} | {data.sizes['contact']} | {each:.0f} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("contacts", type=Path)
    parser.add_argument("--slopes", type=float, nargs="+", default=[*range(8, 45, 3)])
    parser.add_argument("--cost", action="store_true")
    given = parser.parse_args()
    warnings.simplefilter("ignore")  # a table with one ratio needs no rock sizes
    data = open_sequences(given.contacts)
    print(machine())
    if given.cost:
        cost(lab_case_of(data.attrs["lab_case"], str(given.contacts)))
        return
    ratios = np.unique(data["ratio"].values).tolist()
    columns = {
        f"{ratio:g}": rows_of(data.isel(contact=data["ratio"].values == ratio)) for ratio in ratios
    }
    columns["all"] = rows_of(data)
    print("| R_b/R_m | " + " | ".join(columns) + " |")
    print("|---" * (1 + len(columns)) + "|")
    for name in columns["all"]:
        print(f"| {name} | " + " | ".join(one[name] for one in columns.values()) + " |")
    found = [slope_with_error(data, ratio, given.slopes) for ratio in ratios]
    print("| neutral slope [degree] | " + " | ".join(found) + " | |", flush=True)
    print("| scree [degree] | " + " | ".join(map(scree_friction, ratios)) + " | |", flush=True)


if __name__ == "__main__":
    main()
