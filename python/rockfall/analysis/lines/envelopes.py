# SPDX-License-Identifier: BSD-3-Clause
"""Statistics of boulders at a point of a section: mean, 95 % quantile and maximum."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np

from rockfall.analysis.line_statistics import sample_numbers, with_limits, withheld
from rockfall.analysis.precision.intervals import Sources, ranks_around

QUANTITIES = ("speed", "energy_total", "jump_height", "passing_height")
NUMBERS = ("mean", "q95")


def envelope_names(prefix: str = "") -> list[str]:
    """Names of the statistics at a point."""
    names = [column for number in NUMBERS for column in with_limits(number)]
    return [f"{prefix}{quantity}_{name}" for quantity in QUANTITIES for name in [*names, "max"]]


def envelopes(
    values: Mapping[str, np.ndarray], source: Sources, prefix: str = ""
) -> dict[str, float]:
    """Statistics of the values that are not NaN, by `envelope_names`. A statistic without a
    complete interval is omitted; the maximum is always given."""
    columns: dict[str, float] = {}
    for quantity in QUANTITIES:
        is_known = np.isfinite(values[quantity])
        if not is_known.any():
            continue
        numbers = sample_numbers(values[quantity][is_known], source[is_known])
        few = withheld(numbers)
        names = [column for name in NUMBERS if name not in few for column in with_limits(name)]
        columns |= {f"{prefix}{quantity}_{name}": numbers[name] for name in [*names, "max"]}
    return columns


def fewest_for(level: float) -> int:
    """Minimum number of independent boulders for which a quantile has both limits."""
    return next(n for n in itertools.count(2) if _has_limits(n, level))


def _has_limits(n: int, level: float) -> bool:
    low, high = ranks_around(n, level, n)
    return bool(low >= 1 and high <= n)
