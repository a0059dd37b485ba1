# SPDX-License-Identifier: BSD-3-Clause
"""Numbers at the evaluation lines as text, with their 95 % confidence intervals."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
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
    return _written(*_in_units(row, name, quantity))


def rising_estimates(row: Row, names: Sequence[str], quantity: str) -> Iterator[tuple[Number, str]]:
    """Estimates of numbers that do not fall, of which none is rounded below the one before it."""
    before, decimals = -math.inf, 0
    for name in names:
        value, low, high = _in_units(row, name, quantity)
        digits = _justified(value, low, high)
        if digits is not None:
            if round(value, digits) < before:
                digits = decimals
            before, decimals = round(value, digits), digits
        yield _written(value, low, high, digits)


def _in_units(row: Row, name: str, quantity: str) -> tuple[float, float, float]:
    """Number and its limits in the unit shown."""
    factor = QUANTITIES[quantity].factor
    value, low, high = (factor * row.get(f"{name}{end}", math.nan) for end in ("", "_low", "_high"))
    return value, low, high


def _justified(value: float, low: float, high: float) -> int | None:
    """Decimals that the interval of a number justifies; None without an interval."""
    if math.isnan(low) and math.isnan(high):
        return None
    half = max(abs(value - end) for end in (low, high) if not math.isnan(end))
    return min(4, -math.floor(math.log10(half / 2))) if half else 2


def _written(
    value: float, low: float, high: float, decimals: int | None = None
) -> tuple[Number, str]:
    decimals = _justified(value, low, high) if decimals is None else decimals
    if decimals is None:
        return number(value), "" if math.isnan(value) else TOO_FEW
    value_, low_, high_ = (
        Number("-" if math.isnan(number) else f"{round(number, decimals):,.{max(decimals, 0)}f}")
        for number in (value, low, high)
    )
    if math.isnan(high):
        return value_, say("interval.from", low=low_)
    if math.isnan(low):
        return value_, say("interval.up_to", high=high_)
    return value_, interval_text(low_, high_)
