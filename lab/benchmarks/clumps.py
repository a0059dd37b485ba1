# SPDX-License-Identifier: BSD-3-Clause
"""Effect of angular rocks (clumps of spheres) and angular boulders in the rock laboratory:

    python -m lab.benchmarks.clumps [--ratios 1 2 4] [--throws 200]

Repeats the throws of rocky-slope's throws.nml with each boulder shape on spheres and on clumps.
Prints, for contacts after flights at 5 to 30 degrees, means relative to |V_in|: V_t and V_n after
the contact, the fraction of rotational energy, and turns below 22.5 degrees. Also prints the energy
after the contact, the fraction of throws that stop, the solid fraction, and the CPU time per
contact. Standard errors are between layers.
"""

import argparse
from pathlib import Path

import numpy as np
import xarray as xr

from lab.benchmarks.rocky import relief_at
from rockfall_lab.case import LabCase, read_lab_case
from rockfall_lab.spheres.sequences import run_sequences

CASE = Path(__file__).parents[1] / "cases" / "rocky-slope" / "throws.nml"
VARIANTS = [
    ("spheres", "sphere"), ("clumps", "sphere"), ("spheres", "compact"),
    ("clumps", "compact"), ("clumps", "elongated"), ("clumps", "platy"),
]  # fmt: skip
ANGLES = 5.0, 30.0  # range of incidence angles [degree]
STOPS = 2  # exit code of a record
ON_LAYER = 10  # throws per layer


def variant(ratio: float, rocks: str, shape: str, throws: int) -> LabCase:
    """Case with a given shape of rocks and boulders."""
    case = read_lab_case(CASE)
    relief = [relief_at(case, ratio)]
    return case.replace(
        lab={"ratios": [ratio], "seed": 417},
        packing={"clumps": rocks == "clumps"},
        throw={"throws": [throws], "on_layer": ON_LAYER, "shape": shape, "relief": relief},
    )


def layer_means(data: xr.Dataset) -> np.ndarray:
    """Means (layers, quantities) over the contacts of each layer."""
    column = {name: data[name].values.astype(float) for name in data}
    flight = (column["entry"] == 0) & (column["incidence"] >= ANGLES[0])
    flight &= column["incidence"] <= ANGLES[1]
    angle = np.radians(np.where(flight, column["incidence"], ANGLES[0]))
    moving = column["vt_out"] ** 2 + column["vn_out"] ** 2
    spinning = data.attrs["inertia_factor"] * column["w_out"] ** 2
    quantities = [
        column["vt_out"] / np.cos(angle),
        column["vn_out"] / np.sin(angle),
        spinning / np.maximum(moving + spinning, 1e-12),
        np.abs(column["lateral"]) < 22.5,
        column["energy_out"],
    ]
    rows = []
    for layer in np.unique(column["layer"]):
        here = column["layer"] == layer
        at = here & flight
        if not at.any():
            continue
        stopped = (column["exit"][here] == STOPS).sum() / ON_LAYER
        rows.append([np.mean(values[at]) for values in quantities] + [stopped])
    return np.array(rows)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--ratios", type=float, nargs="+", default=[1.0, 2.0, 4.0])
    parser.add_argument("--throws", type=int, default=200)
    given = parser.parse_args()
    names = "R_t", "R_n", "rotation", "turns < 22.5", "energy left", "stopped"
    print(
        "| R_b/R_m | rocks | boulder | " + " | ".join(names) + " | solid | CPU [ms] | unfinished |"
    )
    print("|---" * (len(names) + 6) + "|")
    for ratio in given.ratios:
        for rocks, shape in VARIANTS:
            data = run_sequences(variant(ratio, rocks, shape, given.throws), threads=1)
            rows = layer_means(data)
            error = rows.std(axis=0, ddof=1) / np.sqrt(len(rows))
            cells = [f"{m:.3f} ± {e:.3f}" for m, e in zip(rows.mean(axis=0), error, strict=True)]
            about = {name: float(np.atleast_1d(data.attrs[name])[0]) for name in data.attrs
                     if name in ("solid", "cpu_seconds", "unfinished")}  # fmt: skip
            time = 1000 * about["cpu_seconds"] / data.sizes["contact"]
            print(
                f"| {ratio:g} | {rocks} | {shape} | " + " | ".join(cells)
                + f" | {about['solid']:.3f} | {time:.0f} | {about['unfinished']:.0f} |", flush=True,
            )  # fmt: skip


if __name__ == "__main__":
    main()
