# SPDX-License-Identifier: BSD-3-Clause
"""Stations of a section along a drawn line."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rockfall.errors import RockfallError
from rockfall.quantities import round_step
from rockfall.terrain.polyline import lengths

STATIONS = 100  # approximate default number of stations
MAX_STATIONS = 10_000


class SectionLine(NamedTuple):
    """A section: vertices x + iy [m], half-width of its corridor [m], and interval between
    stations [m] (None: a round interval that gives about 100 stations)."""

    vertices: np.ndarray
    within: float = 10.0
    every: float | None = None


class Stations(NamedTuple):
    """Short lines across a section that extend `within` [m] on either side: distances along the
    section [m], positions x + iy [m], and unit vectors along the section."""

    distance: np.ndarray
    place: np.ndarray
    direction: np.ndarray
    within: float


def stations_of(line: SectionLine) -> Stations:
    """Stations at equal intervals from the first vertex of a section, plus a station at its end.
    Raises RockfallError for a zero length, width or interval, and for too many stations."""
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
            f"every = {every}: gives {number:,.0f} stations: must be at most {MAX_STATIONS:,}"
        )
    distance = np.append(np.arange(0.0, at[-1] * (1 - 1e-9), every), at[-1])
    side = np.clip(np.searchsorted(at, distance, side="right") - 1, 0, vertices.size - 2)
    directions = np.diff(vertices)
    directions = (directions / abs(directions))[side]
    return Stations(distance, np.interp(distance, at, vertices), directions, within)
