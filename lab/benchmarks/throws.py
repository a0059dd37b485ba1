# SPDX-License-Identifier: BSD-3-Clause
"""Uncertainty of a rock-laboratory table due to its throws, at Vaujany:

    python -m lab.benchmarks.throws CONTACTS.nc ... [--slopes 8] [--first 500] [--boulders 1000]
        [--orders 8]

CONTACTS are outputs of `rockfall lab impact` for cases with throws. Prints the relative errors of
mean speed, height and energy at EL1 and EL2 (benchmarks.physics.observed) for a table of all
contacts, and for a table with all contacts as records; the standard deviation of these errors over
random orders of the throws, each of which selects other records; and, for each R_b/R_m, standard
errors with all records, omitting fifths of the throws at that ratio in turn.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

import rockfall
from benchmarks.machine import machine
from benchmarks.physics.observed import CASES, LINES, QUANTITIES, measure
from rockfall.grounds.impact_tables import save_table
from rockfall_lab.spheres.sequences import open_sequences
from rockfall_lab.tables import KEPT, table_of

ALL = 10**9  # number of records
PARTS = 5  # number of groups of throws, omitted in turn


def errors(files: list[xr.Dataset], seeds: range, boulders: int, kept: int = KEPT) -> np.ndarray:
    """Relative errors of the means at the lines, averaged over slopes, by the table made from
    `files`."""
    printed = pd.read_csv(CASES / "paper.csv").set_index(["line", "method", "quantity"])["mean"]
    places = [(line, quantity) for line in LINES for quantity in QUANTITIES]
    seen = np.array([printed[line, "observed", quantity] for line, quantity in places])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "table.nc"
        save_table(table_of(files, kept), path)
        impact = {"form": "table", "table": str(path)}
        case = rockfall.read_case(CASES / "case.nml").replace(impact=impact)
        means = [measure(case, seed, boulders)["mean"] for seed in seeds]
    return np.mean([[one[place] for place in places] for one in means], axis=0) / seen - 1


def without(contacts: xr.Dataset, ratio: float, part: int) -> xr.Dataset:
    """Contacts without a fifth of the throws at a ratio."""
    at_ratio = contacts["ratio"].values == ratio
    throws = np.unique(contacts["sequence"].values[at_ratio])
    left_out = np.isin(contacts["sequence"].values, throws[part::PARTS])
    return contacts.isel(contact=~(at_ratio & left_out))


def reordered(contacts: xr.Dataset, random: np.random.Generator) -> xr.Dataset:
    """Contacts with the throws in another order."""
    throws, own = np.unique(contacts["sequence"].values, return_inverse=True)
    return contacts.assign(sequence=("contact", random.permutation(throws)[own]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("contacts", type=Path, nargs="+")
    parser.add_argument("--slopes", type=int, default=8)
    parser.add_argument("--first", type=int, default=500)
    parser.add_argument("--boulders", type=int, default=1000)
    parser.add_argument("--orders", type=int, default=8)
    given = parser.parse_args()
    files = [open_sequences(path).load() for path in given.contacts]
    seeds = range(given.first, given.first + given.slopes)
    print(machine())
    print("| | " + " | ".join(f"{line}, {name}" for line in LINES for name in QUANTITIES) + " |")
    print("|---" * (1 + len(LINES) * len(QUANTITIES)) + "|")

    def row(title: str, numbers: np.ndarray, form: str) -> None:
        print(f"| {title} | " + " | ".join(format(one, form) for one in numbers) + " |", flush=True)

    row("errors", errors(files, seeds, given.boulders), "+.1%")
    row("by all records", errors(files, seeds, given.boulders, ALL), "+.1%")
    random = np.random.default_rng(1)
    orders = [
        errors([reordered(one, random) for one in files], seeds, given.boulders)
        for _ in range(given.orders)
    ]
    if given.orders > 1:
        row("± by the choice of records", np.std(orders, axis=0, ddof=1), ".1%")
    for k, contacts in enumerate(files):
        for ratio in np.unique(contacts["ratio"].values):
            parts = [
                errors(
                    [*files[:k], without(contacts, ratio, part), *files[k + 1 :]],
                    seeds,
                    given.boulders,
                )
                for part in range(PARTS)
            ]
            row(f"± by throws at {ratio:g}", np.std(parts, axis=0) * np.sqrt(PARTS - 1), ".1%")


if __name__ == "__main__":
    main()
