# SPDX-License-Identifier: BSD-3-Clause
"""How sure a table of the laboratory of rocks is, by its throws, at Vaujany:

    python -m benchmarks.lab.throws CONTACTS.nc [--slopes 8] [--first 500] [--boulders 1000]

CONTACTS is what `rockfall lab impact` has written for a case that throws. Prints the relative
errors of mean speed, height and energy at EL1 and EL2 (benchmarks.physics.observed) by a table of
all contacts, and, for each R_b/R_m, their standard errors: fifths of the throws at that ratio are
left out in turn.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

import rockfall
from benchmarks.lab.ratios import PARTS
from benchmarks.machine import machine
from benchmarks.physics.observed import CASES, LINES, QUANTITIES, measure
from rockfall.impact_tables import save_table
from rockfall.lab.sequences import open_sequences
from rockfall.lab.tables import table_of


def errors(contacts: xr.Dataset, seeds: range, boulders: int) -> np.ndarray:
    """Relative errors of the means at the lines, over slopes, by a table of the contacts."""
    printed = pd.read_csv(CASES / "paper.csv").set_index(["line", "method", "quantity"])["mean"]
    places = [(line, quantity) for line in LINES for quantity in QUANTITIES]
    seen = np.array([printed[line, "observed", quantity] for line, quantity in places])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "table.nc"
        save_table(table_of([contacts]), path)
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("contacts", type=Path)
    parser.add_argument("--slopes", type=int, default=8)
    parser.add_argument("--first", type=int, default=500)
    parser.add_argument("--boulders", type=int, default=1000)
    given = parser.parse_args()
    contacts = open_sequences(given.contacts)
    seeds = range(given.first, given.first + given.slopes)
    print(machine())
    print("| | " + " | ".join(f"{line}, {name}" for line in LINES for name in QUANTITIES) + " |")
    print("|---" * (1 + len(LINES) * len(QUANTITIES)) + "|")
    found = errors(contacts, seeds, given.boulders)
    print("| errors | " + " | ".join(f"{error:+.0%}" for error in found) + " |", flush=True)
    for ratio in np.unique(contacts["ratio"].values):
        parts = np.array(
            [errors(without(contacts, ratio, part), seeds, given.boulders) for part in range(PARTS)]
        )
        error = parts.std(axis=0) * np.sqrt(PARTS - 1)
        print(f"| ± by throws at {ratio:g} | " + " | ".join(f"{e:.0%}" for e in error) + " |")


if __name__ == "__main__":
    main()
