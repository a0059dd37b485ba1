# SPDX-License-Identifier: BSD-3-Clause
"""Numbers at the evaluation lines as text, with their 95 % confidence intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from rockfall.analysis.line_statistics import line_statistics
from rockfall.language import Number, Text, say, translated
from rockfall.quantities import QUANTITIES, number

if TYPE_CHECKING:
    import xarray as xr

    Row = Mapping[str, float]  # of line_statistics
    Numbers = Mapping[str, Row]  # by quantity
    Rows = Mapping[str, Numbers]  # by line

TOO_FEW = "(–)"
STATISTICS = ("mean", "std", "q50", "q90", "q95", "q98", "q99")
ONE_SIDED = ("interval.from", "interval.up_to")  # messages


def rows_of(result: xr.Dataset) -> Rows:
    """`line_statistics` by line and quantity."""
    return {
        str(line): {row["quantity"]: row.to_dict() for _, row in part.iterrows()}
        for line, part in line_statistics(result).groupby("line", sort=False)
    }


def in_unit(value: float, quantity: str) -> Number:
    """Number in the unit in which the quantity is shown."""
    return number(QUANTITIES[quantity].factor * value)


def in_lines(*cell: object) -> str:
    """Cell of several lines, in the language in force."""
    return "\n".join(map(translated, cell))


def interval_text(low: object, high: object) -> Text:
    """Two limits in brackets."""
    return say("interval.both", low=low, high=high)


def interval(row: Row, name: str, quantity: str) -> str:
    """Confidence interval of a number in brackets; empty without a number."""
    return estimate(row, name, quantity)[1]


def estimate(row: Row, name: str, quantity: str) -> tuple[Number, str]:
    """Number in the unit shown and its interval in brackets, with justified digits: the last one is
    a twentieth to a half of the interval's half-width. `TOO_FEW` if there are too few boulders."""
    value, low, high = (
        QUANTITIES[quantity].factor * row.get(f"{name}{end}", math.nan)
        for end in ("", "_low", "_high")
    )
    if math.isnan(low) and math.isnan(high):
        return number(value), "" if math.isnan(value) else TOO_FEW
    half = max(abs(value - end) for end in (low, high) if not math.isnan(end))
    decimals = min(4, -math.floor(math.log10(half / 2))) if half else 2
    value_, low_, high_ = (
        Number("-" if math.isnan(number) else f"{round(number, decimals):,.{max(decimals, 0)}f}")
        for number in (value, low, high)
    )
    if math.isnan(high):
        return value_, say("interval.from", low=low_)
    if math.isnan(low):
        return value_, say("interval.up_to", high=high_)
    return value_, interval_text(low_, high_)
