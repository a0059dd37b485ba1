# SPDX-License-Identifier: BSD-3-Clause
"""Tables of the laboratory of rocks at ratios R_b/R_m beside tables without them, on planes:

    python -m benchmarks.lab.ratios CONTACTS.nc ... --at 4 --ratios 1 2 8

CONTACTS are what `rockfall lab impact` has written for cases that throw. Prints, for boulders at
R_b/R_m = AT by a table of RATIOS, on planes of SLOPES (30 and 38 degrees) up to 8 contacts: mean
speed before a contact, R_n of contacts steeper than 3 degrees, and the fraction that stops;
standard errors leave out fifths of the throws in turn.
"""

import argparse
import tempfile
import warnings
from pathlib import Path

import numpy as np
import xarray as xr

import rockfall
from benchmarks.lab.plane import plane
from rockfall.grounds.impact_tables import save_table
from rockfall.lab.sequences import open_sequences
from rockfall.lab.tables import table_of
from rockfall.result.trajectories import vertices_of

PARTS = 5  # of the throws, left out one after the other
RADIUS, SPEED, BOULDERS = 0.4, 8.0, 1500  # [m], [m/s]
FLATTEST = 0.05  # sine of the incidence from which R_n counts
CELL, COLUMNS, ROWS, TOP = 2.5, 40, 200, 480.0  # [m]


def selected(files: list[xr.Dataset], ratios: list[float], without: int = -1) -> list[xr.Dataset]:
    """Contacts of some ratios, without a fifth of the throws."""
    parts = []
    for data in files:
        kept = np.isin(data["ratio"].values, ratios) & (data["sequence"].values % PARTS != without)
        if kept.any():
            parts.append(data.isel(contact=kept))
    return [xr.concat(parts, "contact", combine_attrs="override")]


def on_plane(table: Path, ratio: float, slope: float, contacts: int) -> np.ndarray:
    """Mean speed [m/s], R_n and fraction that stops, of boulders by a table down a plane."""
    angle = np.radians(slope)
    case = rockfall.Case(
        folder=table.parent,
        case={"boulders": BOULDERS, "seed": 11},
        impact={"form": "table", "table": table.name, "impact_limit": contacts},
        surface={"uniform_mean_radius": RADIUS / ratio},
        boulder={"volume": "fixed", "volume_mean": 4 / 3 * np.pi * RADIUS**3, "density": 2650.0},
        release={
            "x": [COLUMNS * CELL / 2], "y": [TOP], "drop_height": 2.0,
            "velocity": [0.0, -SPEED * np.cos(angle), -SPEED * np.sin(angle)],
        },
        output={"trajectories": BOULDERS},
    )  # fmt: skip
    result = rockfall.run(case, **plane(slope, ROWS, COLUMNS, CELL))
    rows = vertices_of(result, "in_t", "in_n", "out_n")
    tangential, normal, out = np.concatenate(rows, axis=1)
    speed = np.hypot(tangential, normal)
    met = speed > 0  # vertices that are no contacts have none
    steep = met & (-normal > FLATTEST * speed)
    r_n = (np.maximum(out[steep], 0) / -normal[steep]).mean()
    return np.array([speed[met].mean(), r_n, (result["status"].values == 1).mean()])


def numbers(
    files: list[xr.Dataset], given: argparse.Namespace, slope: float, without: int = -1
) -> np.ndarray:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "table.nc"
        save_table(table_of(selected(files, given.ratios, without)), path)
        return on_plane(path, given.at, slope, given.up_to)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("contacts", type=Path, nargs="+")
    parser.add_argument("--at", type=float, required=True)
    parser.add_argument("--ratios", type=float, nargs="+", required=True)
    parser.add_argument("--slopes", type=float, nargs="+", default=[30.0, 38.0])
    parser.add_argument("--up-to", type=int, default=8, help="contacts")
    given = parser.parse_args()
    warnings.simplefilter("ignore")  # a table of one ratio asks for no rocks
    files = [open_sequences(path) for path in given.contacts]
    print("| slope | speed [m/s] | R_n | stopped |\n|---|---|---|---|")
    for slope in given.slopes:
        whole = numbers(files, given, slope)
        left = [numbers(files, given, slope, part) for part in range(PARTS)]
        error = np.sqrt((PARTS - 1) * np.var(left, axis=0))
        cells = [f"{one:.2f} ± {of:.2f}" for one, of in zip(whole, error, strict=True)]
        print(f"| {slope:g} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
