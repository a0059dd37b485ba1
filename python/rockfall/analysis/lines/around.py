# SPDX-License-Identifier: BSD-3-Clause
"""Boulders that reach a line by passing around the ends of barriers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from rockfall.case import case_of
from rockfall.result.crossings import boulders_at, line_names, line_values, places_at, values_at
from rockfall.terrain.polyline import lengths, sides

if TYPE_CHECKING:
    import xarray as xr

MAX_AROUND = 0.01  # maximum fraction of a line's boulders that may pass around barriers


def goes_around(result: xr.Dataset, line: int, barriers: Sequence[int]) -> np.ndarray:
    """Mask (boulder,) of boulders that reach a line without first crossing any of the barriers;
    `line` and `barriers` are indices."""
    there = line_values(result, "time", line)
    around = np.isfinite(there)
    for barrier in barriers:
        around &= ~(line_values(result, "time", barrier) <= there)
    return around


def barriers_above(result: xr.Dataset, line: int) -> list[int]:
    """Indices of the barriers above a line, except lying logs: barriers that boulders cross before
    the line, on a side from which more than `MAX_AROUND` of the line's boulders come. For the
    sides, the line is extended straight beyond its ends."""
    nets = {net["name"] for net in case_of(result).barrier if "diameter" not in net}
    there, vertices = line_values(result, "time", line), _vertices(result, line)
    uphill = _uphill(result, line, vertices)
    above = []
    for k, name in enumerate(line_names(result)):
        if name in nets and k != line:
            first = ~(there < line_values(result, "time", k))[boulders_at(result, k)]
            met = places_at(result, k)[:, first]
            if np.isin(sides(met[0] + 1j * met[1], vertices), uphill).any():
                above.append(k)
    return above


def _vertices(result: xr.Dataset, line: int) -> np.ndarray:
    """Vertices of a line, x + iy [m]."""
    own = result["line_vertex_line"].values == line
    x, y = (result[f"line_vertex_{axis}"].values[own] for axis in "xy")
    return x + 1j * y


def _uphill(result: xr.Dataset, line: int, vertices: np.ndarray) -> list[int]:
    """Sides of a line (see `sides`) from which more than `MAX_AROUND` of its boulders come."""
    step, at = np.diff(vertices), values_at(result, "distance", line)
    step = step[np.clip(np.searchsorted(lengths(vertices), at) - 1, 0, step.size - 1)]
    x, y = (values_at(result, f"velocity_{axis}", line) for axis in "xy")
    came = -np.sign((np.conj(step) * (x + 1j * y)).imag)
    return [side for side in (1, -1) if (came == side).sum() > MAX_AROUND * came.size]


def around_by_line(
    result: xr.Dataset, lines: Sequence[int]
) -> Iterator[tuple[int, list[int], np.ndarray]]:
    """Yield each line for which more than `MAX_AROUND` of the boulders at the line or its barriers
    pass around these barriers: line, barriers, and the mask of `goes_around`."""
    for line in lines:
        if barriers := barriers_above(result, line):
            around = goes_around(result, line, barriers)
            came = np.isfinite([line_values(result, "time", k) for k in (line, *barriers)])
            if around.sum() > MAX_AROUND * came.any(axis=0).sum():
                yield line, barriers, around
