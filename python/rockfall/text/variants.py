# SPDX-License-Identifier: BSD-3-Clause
"""Text output of a comparison of variants for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.population import population_notes
from rockfall.case import case_of
from rockfall.language import say
from rockfall.quantities import QUANTITIES, Quantity, number, with_unit
from rockfall.result.crossings import line_names
from rockfall.result.samples import kept_note
from rockfall.studies.variants import UNDECIDED
from rockfall.text.table import table as aligned

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

STATISTICS = {"mean": "mean", "q95": "95 %"}
NOTE = (
    "Below a number: its difference from the first variant, with the 95 % interval of the Monte "
    "Carlo error; ? if that contains 0, or too few boulders pass to have one. Speeds, highest "
    "points and energies are those of the boulders that pass: a barrier stops slow ones, so that "
    "these numbers may rise while fewer pass."
)


def variants_text(table: pd.DataFrame, note: str = "") -> str:
    """A table for each line, with a column for each variant; `note` is on the boulders."""
    blocks = [aligned(rows_of(of_line)) for _, of_line in table.groupby("line", sort=False)]
    return "\n\n".join([*blocks, NOTE, *([note] if note else [])])


def comparison_notes(results: Mapping[str, xr.Dataset]) -> Iterator[str]:
    """Notes on the boulders that numbers of variants are of, and on lines of one name in two
    places."""
    first = next(iter(results.values()))
    yield from population_notes(case_of(first))
    if note := kept_note(first):
        yield note
    places: dict[str, tuple[str, np.ndarray]] = {}
    for name, result in results.items():
        for k, line in enumerate(line_names(result)):
            here = np.array([result[f"line_vertex_{axis}"].values for axis in "xy"])
            here = here[:, result["line_vertex_line"].values == k]
            before, place = places.setdefault(line, (name, here))
            if not np.array_equal(here, place):
                yield say("variants.moved_line", line=line, name=name, before=before)


def rows_of(of_line: pd.DataFrame) -> Iterator[list[str]]:
    """Rows of a line: a header, then each number above its difference."""
    yield [str(of_line["line"].iloc[0]), *of_line["variant"].unique()]
    for (quantity, statistic), rows in of_line.groupby(["quantity", "statistic"], sort=False):
        display = QUANTITIES["fraction" if quantity == "passing" else quantity]
        yield [
            _label(display, statistic),
            *(value_text(row, display.factor, " to ") for _, row in rows.iterrows()),
        ]
        yield ["", *(difference_text(row, display.factor) for _, row in rows.iterrows())]


def _label(display: Quantity, statistic: str) -> str:
    """Label of a row, with its unit."""
    threshold = statistic.removeprefix("above_")
    if threshold != statistic:
        return with_unit(f"with {threshold} kJ or more", display.unit)
    if statistic in STATISTICS:
        return with_unit(f"{display.label}, {STATISTICS[statistic]}", display.unit)
    return display.title


def value_text(row: pd.Series, factor: float, to: str) -> str:
    """A number; where no boulder passes, with the upper limit of the fraction, as a road that none
    of some hundred reach may still be reached."""
    value = number(factor * row["value"])
    is_none = row["value"] == 0 and row["value_high"] > 0
    return f"{value}{to}{number(factor * row['value_high'], up=True)}" if is_none else value


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
