# SPDX-License-Identifier: BSD-3-Clause
"""Statistics at a line as functions of the number of boulders run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.line_statistics import numbers
from rockfall.analysis.precision.intervals import Sources, sources
from rockfall.analysis.precision.samples import Values
from rockfall.quantities import AT_LINES
from rockfall.result.crossings import line_values

if TYPE_CHECKING:
    import xarray as xr

History = dict[str, list[dict[str, float]]]  # quantity -> statistics after each size

STATISTICS = ("mean", "std", "q95")
NUMBERS = [("fraction", "fraction"), *((q, name) for q in AT_LINES for name in STATISTICS)]
FIRST = 30  # smallest number of boulders
STEPS = 24  # maximum length of the list from `sizes`


def sizes(source: Sources) -> list[int]:
    """Numbers of boulders, evenly spaced in their logarithm up to all boulders; multiples of a full
    cycle of sources if there are enough boulders."""
    source_count, boulders = source.count, source.number.size
    n = np.geomspace(min(FIRST, boulders), boulders, STEPS).round().astype(int)
    n = np.where(n > source_count, n // source_count * source_count, n)
    return sorted({*n.tolist(), boulders})


def mixed(source: Sources) -> np.ndarray:
    """Order of boulders (indices) in which every initial part is a sample of all boulders. Sources
    take turns in the same random order, as often as they release boulders. The order within a
    source is unchanged."""
    by_source = np.argsort(source.number, kind="stable")
    boulders = np.bincount(source.number)
    first = np.cumsum(boulders) - boulders
    number = source.number[by_source]
    turn = np.arange(number.size) - first[number]
    late = np.random.default_rng(0).random(boulders.size)
    return by_source[np.argsort((turn + late[number]) / boulders[number], kind="stable")]


def known_of(number: np.ndarray, source: Sources) -> Sources:
    """Sources of the first boulders of `mixed`. They are strata only if each source has the same
    number of boulders; otherwise the number from each source is random."""
    whole = number.size == source.number.size
    if source.sampled or whole or not np.ptp(np.bincount(number, minlength=source.count)):
        return Sources.of(number, source.sampled)
    return Sources.alone(number.size)


def history(result: xr.Dataset, line: int, n: list[int]) -> History:
    """Statistics at the line with this index after each number of boulders in `n`."""
    source = sources(result)
    order = mixed(source)
    number = source.number[order]
    values = {quantity: line_values(result, quantity, line)[order] for quantity in AT_LINES}
    numbers_by_size: History = {quantity: [] for quantity in AT_LINES}
    for size in n:
        released = known_of(number[:size], source)
        for quantity in AT_LINES:
            numbers_by_size[quantity].append(
                numbers(Values(values[quantity][:size], released), quantity)
            )
    return numbers_by_size
