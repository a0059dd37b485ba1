# SPDX-License-Identifier: BSD-3-Clause
"""Text output of a comparison of variants for a terminal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rockfall.analysis.variants import UNDECIDED
from rockfall.quantities import number
from rockfall.text.table import table as aligned

if TYPE_CHECKING:
    import pandas as pd

LABELS = {  # quantity and statistic: label with its unit, and the factor to it
    ("speed", "mean"): ("speed, mean [m/s]", 1.0),
    ("speed", "q95"): ("speed, 95 % [m/s]", 1.0),
    ("upper_edge", "mean"): ("highest point, mean [m]", 1.0),
    ("upper_edge", "q95"): ("highest point, 95 % [m]", 1.0),
    ("energy_total", "mean"): ("energy, mean [kJ]", 1e-3),
    ("energy_total", "q95"): ("energy, 95 % [kJ]", 1e-3),
}
NOTE = (
    "Below a number: its difference from the first variant, with the 95 % interval of the Monte "
    "Carlo error; ? if that contains 0, or too few boulders pass to have one. Speeds, highest "
    "points and energies are those of the boulders that pass: a barrier stops slow ones, so that "
    "these numbers may rise while fewer pass."
)


def variants_text(table: pd.DataFrame) -> str:
    """A table for each line, with a column for each variant."""
    blocks = [aligned(rows_of(of_line)) for _, of_line in table.groupby("line", sort=False)]
    return "\n\n".join([*blocks, NOTE])


def rows_of(of_line: pd.DataFrame) -> Iterator[list[str]]:
    """Rows of a line: a header, then each number above its difference."""
    variants = list(dict.fromkeys(of_line["variant"]))
    yield [str(of_line["line"].iloc[0]), *variants]
    passing = of_line["statistic"][of_line["quantity"] == "passing"].unique()
    above = {("passing", name): (_label(name), 100.0) for name in passing}
    for (quantity, statistic), (label, factor) in (above | LABELS).items():
        chosen = of_line[(of_line["quantity"] == quantity) & (of_line["statistic"] == statistic)]
        rows = chosen.set_index("variant")
        yield [label, *(number(factor * rows["value"][name]) for name in variants)]
        yield ["", *(difference_text(rows.loc[name], factor) for name in variants)]


def _label(statistic: str) -> str:
    """Label of a fraction that passes."""
    threshold = statistic.removeprefix("above_")
    return "passing [%]" if threshold == statistic else f"with {threshold} kJ or more [%]"


def difference_text(row: pd.Series, factor: float) -> str:
    """Difference and its interval, with a question mark if undecided; "" for the first variant."""
    if not isinstance(row["verdict"], str):
        return ""
    value, low, high = (signed(factor * row[f"difference{end}"]) for end in ("", "_low", "_high"))
    interval = f" ({low} to {high})" if low != "-" and high != "-" else ""
    return value + interval + (" ?" if row["verdict"] == UNDECIDED else "")


def signed(value: float) -> str:
    """A number with its sign."""
    return ("+" if value > 0 else "") + number(value)
