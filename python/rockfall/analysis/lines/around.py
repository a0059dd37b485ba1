# SPDX-License-Identifier: BSD-3-Clause
"""Boulders that reach a line past the ends of barriers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from rockfall.case import case_of
from rockfall.result.crossings import line_names, line_values

if TYPE_CHECKING:
    import xarray as xr

MAX_AROUND = 0.01  # fraction of the boulders of a line that may pass around the ends of barriers


def goes_around(result: xr.Dataset, line: int, barriers: Sequence[int]) -> np.ndarray:
    """Mask (boulder,) of the boulders that reach a line without meeting any of these barriers
    before. Lines and barriers are given by index."""
    there = line_values(result, "time", line)
    around = np.isfinite(there)
    for barrier in barriers:
        around &= ~(line_values(result, "time", barrier) <= there)
    return around


def barriers_above(result: xr.Dataset, line: int) -> list[int]:
    """Indices of the barriers, without lying logs, that a boulder meets without having met the
    line before."""
    nets = {net["name"] for net in case_of(result).barrier if "diameter" not in net}
    there = line_values(result, "time", line)
    return [
        k
        for k, name in enumerate(line_names(result))
        if name in nets and k != line and _meets_first(line_values(result, "time", k), there)
    ]


def _meets_first(here: np.ndarray, there: np.ndarray) -> bool:
    """Return True for a boulder that arrives here at a time and did not arrive there before."""
    return bool((np.isfinite(here) & ~(there < here)).any())


def around_by_line(
    result: xr.Dataset, lines: Sequence[int]
) -> Iterator[tuple[int, list[int], np.ndarray]]:
    """Lines with more than `MAX_AROUND` of the boulders passing around barriers above them,
    relative to the boulders that reach the line or a barrier: line, barriers, and the mask of
    `goes_around`."""
    for line in lines:
        if barriers := barriers_above(result, line):
            around = goes_around(result, line, barriers)
            came = np.isfinite([line_values(result, "time", k) for k in (line, *barriers)])
            if around.sum() > MAX_AROUND * came.any(axis=0).sum():
                yield line, barriers, around
