# SPDX-License-Identifier: BSD-3-Clause
"""A site beside a case by every law, as tables for a terminal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rockfall.analysis.validation import BOUNDS, Validation
from rockfall.quantities import QUANTITIES, percent
from rockfall.text.table import table

if TYPE_CHECKING:
    import pandas as pd

TITLES = {
    "mean": "mean", "std": "std", "q05": "5 %", "q50": "50 %", "q95": "95 %",
    "lateral_std": "lateral std", "ks": "KS", "p": "p", "wasserstein": "Wasserstein",
}  # fmt: skip
BARE = ("ks", "p")  # without a unit


def validation_text(found: Validation) -> str:
    """For each place and quantity what was observed, and a row for each law: means over seeds and
    their standard errors."""
    mean, std = (percent(BOUNDS[name]) for name in ("mean", "std"))
    seeds = f"seeds {found.seeds[0]} to {found.seeds[-1]}"
    text = [
        f"{found.title}: {found.boulders:,} boulders by each law, {seeds}; bounds: mean within "
        f"{mean}, std within {std}"
    ]
    for _, rows in found.table.groupby(["line", "quantity"], sort=False):
        text.append(table(_at(rows)))
    return "\n".join([*text, *(f"  {note}" for note in found.notes)])


def _at(rows: pd.DataFrame) -> Iterator[list[str]]:
    line, about = rows["line"].iloc[0], QUANTITIES[rows["quantity"].iloc[0]]
    names = [name for name in TITLES if name in set(rows["statistic"])]
    n = f"{rows['n_observed'].iloc[0]:,.0f} observed" if rows["n_observed"].notna().any() else ""
    place = f"{line}, {about.label}" if line else "run-out in plan"
    yield [f"  {place} [{about.unit}]", *(TITLES[name] for name in names)]
    observed = rows.drop_duplicates("statistic").set_index("statistic")
    yield [f"  {n or 'observed'}", *(
        "" if observed.loc[name, "observed"] != observed.loc[name, "observed"]
        else _cell(observed.loc[name], "observed", about.factor) for name in names
    )]  # fmt: skip
    for law, of_law in rows.groupby("law", sort=False):
        each = of_law.set_index("statistic")
        cells = []
        for name in names:
            factor = 1.0 if name in BARE else about.factor
            cell = _cell(each.loc[name], "simulated", factor)
            cells.append(f"{cell} {each.loc[name, 'verdict']}".rstrip())
        yield [f"  {law}", *cells]


def _cell(row: pd.Series, whose: str, factor: float) -> str:
    """A number and its standard error, to two of its digits."""
    value, error = factor * row[whose], factor * row[f"{whose}_error"]
    if value != value:
        return "-"
    return f"{value:.3g}" + (f" +- {error:.1g}" if error == error else "")
