# SPDX-License-Identifier: BSD-3-Clause
"""Numbers at the evaluation lines as text, with their 95 % confidence intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from rockfall.analysis.line_statistics import line_statistics
from rockfall.quantities import QUANTITIES, number

if TYPE_CHECKING:
    import xarray as xr

    Row = Mapping[str, float]  # of line_statistics
    Numbers = Mapping[str, Row]  # by quantity
    Rows = Mapping[str, Numbers]  # by line

STATISTICS = {"mean": "mean", "std": "standard deviation"}
STATISTICS |= {f"q{level}": f"{level} % quantile" for level in (50, 90, 95, 98, 99)}


def rows_of(result: xr.Dataset) -> Rows:
    """`line_statistics` by line and quantity."""
    return {
        str(line): {row["quantity"]: row.to_dict() for _, row in part.iterrows()}
        for line, part in line_statistics(result).groupby("line", sort=False)
    }


def in_unit(value: float, quantity: str) -> str:
    """A number in the unit in which the quantity is shown."""
    return number(QUANTITIES[quantity].factor * value)


def interval(row: Row, name: str, quantity: str) -> str:
    """The confidence interval of a number in brackets; empty where it has none."""
    low, high = (row.get(f"{name}_{end}", math.nan) for end in ("low", "high"))
    if math.isnan(low) and math.isnan(high):
        return ""
    if math.isnan(high):
        return f"(from {in_unit(low, quantity)}; too few boulders for an upper limit)"
    if math.isnan(low):
        return f"(to {in_unit(high, quantity)}; too few boulders for a lower limit)"
    return f"({in_unit(low, quantity)} to {in_unit(high, quantity)})"
