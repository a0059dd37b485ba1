# SPDX-License-Identifier: BSD-3-Clause
"""Numbers at a line after the first boulders of a run, from few to all."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.line_statistics import line_numbers
from rockfall.analysis.precision.intervals import Sources, sources

if TYPE_CHECKING:
    import xarray as xr

    History = dict[str, list[dict[str, float]]]  # quantity -> its numbers after each of the sizes

SHOWN = ("speed", "passing_height", "energy_total")
NUMBERS = [("fraction", "fraction"), *((q, name) for q in SHOWN for name in ("mean", "std", "q95"))]
FIRST = 30  # minimum number of boulders
STEPS = 24  # number of sizes


def sizes(source: Sources) -> list[int]:
    """Numbers of boulders, evenly spaced in their logarithm, up to all; complete turns of the
    sources where there are enough."""
    source_count, boulders = source.count, source.number.size
    n = np.geomspace(min(FIRST, boulders), boulders, STEPS).round().astype(int)
    n = np.where(n > source_count, n // source_count * source_count, n)
    return sorted({*n.tolist(), boulders})


def mixed(source: Sources) -> np.ndarray:
    """Order of boulders in which each initial part is a sample of all: the sources take turns, in
    the same random order in each turn, and as often as they release boulders. The order within a
    source is unchanged."""
    by_source = np.argsort(source.number, kind="stable")
    boulders = np.bincount(source.number)
    first = np.cumsum(boulders) - boulders
    number = source.number[by_source]
    turn = np.arange(number.size) - first[number]
    late = np.random.default_rng(0).random(boulders.size)
    return by_source[np.argsort((turn + late[number]) / boulders[number], kind="stable")]


def known_of(number: np.ndarray, source: Sources) -> Sources:
    """Sources of the first boulders of `mixed`: strata only if all sources have the same number of
    boulders; before that, the selection of sources is random."""
    whole = number.size == source.number.size
    if source.sampled or whole or not np.ptp(np.bincount(number, minlength=source.count)):
        return Sources.of(number, source.sampled)
    return Sources.alone(number.size)


def history(result: xr.Dataset, line: int, n: list[int]) -> History:
    """Numbers at the line of this index after each of `n` boulders."""
    names = ["start_x", "start_y", *(n for n in result if result[n].dims == ("line", "boulder"))]
    at_line = result[names].isel(line=[line])  # copies of all lines would take memory
    source = sources(result)
    order = mixed(source)
    ordered, number = at_line.isel(boulder=order), source.number[order]
    numbers: History = {quantity: [] for quantity in SHOWN}
    for size in n:
        part, released = ordered.isel(boulder=slice(size)), known_of(number[:size], source)
        for quantity in SHOWN:
            numbers[quantity].append(line_numbers(part, 0, quantity, released))
    return numbers
