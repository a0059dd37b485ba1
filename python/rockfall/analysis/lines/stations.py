# SPDX-License-Identifier: BSD-3-Clause
"""Stations of a section along a drawn line."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rockfall.errors import RockfallError
from rockfall.quantities import round_step
from rockfall.terrain.polyline import lengths

STATIONS = 100  # approximate number without a given interval
MAX_STATIONS = 10_000


class SectionLine(NamedTuple):
    """A section: vertices as x + iy [m], the half-width of its corridor [m], and the interval
    between stations [m]; None for a round interval that gives about 100 stations."""

    vertices: np.ndarray
    within: float = 10.0
    every: float | None = None


class Stations(NamedTuple):
    """Short lines across a section that extend `within` [m] to either side: distances along the
    section [m], places as x + iy [m], and unit vectors along the section there."""

    distance: np.ndarray
    place: np.ndarray
    direction: np.ndarray
    within: float


def stations_of(line: SectionLine) -> Stations:
    """Stations at equal intervals from the first vertex of a section, and one station at its end.
    Raises RockfallError for a line without length, width or interval."""
    vertices, within, every = line
    if vertices.size < 2 or not np.isfinite(vertices).all():
        raise RockfallError("section: must have two or more vertices")
    vertices = vertices[np.append(True, np.abs(np.diff(vertices)) > 0)]
    if vertices.size < 2:
        raise RockfallError("section: must have a length above 0 m")
    at = lengths(vertices)
    every = round_step(at[-1] / STATIONS) if every is None else every
    for name, value in (("within", within), ("every", every)):
        if not 0 < value < np.inf:
            raise RockfallError(f"{name} = {value}: must be > 0 m")
    if (number := at[-1] / every) > MAX_STATIONS:
        raise RockfallError(
            f"every = {every}: gives {number:,.0f} stations, at most {MAX_STATIONS:,}"
        )
    distance = np.append(np.arange(0.0, at[-1] * (1 - 1e-9), every), at[-1])
    side = np.clip(np.searchsorted(at, distance, side="right") - 1, 0, vertices.size - 2)
    directions = np.diff(vertices)
    directions = (directions / abs(directions))[side]
    return Stations(distance, np.interp(distance, at, vertices), directions, within)
