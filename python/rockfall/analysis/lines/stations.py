# SPDX-License-Identifier: BSD-3-Clause
"""Line of a section given by the user (coordinate pairs, or a line layer), and its stations."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.rasters.grid import Grid
from rockfall.io.vectors.layers import read_lines
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


def drawn_line(drawn: Any, layer: str | None, grid: Grid, remarks: list[str]) -> np.ndarray:
    """Vertices x + iy [m] of a section, from pairs x, y (n, 2) or from a file with a single line
    (in `layer`, if it has several). Lines are reprojected to the CRS of the terrain grid, with a
    note in `remarks`. Other input raises a RockfallError."""
    if isinstance(drawn, str | Path):
        features, _ = read_lines(drawn, layer, grid, remarks)
        parts = [part for feature in features for part in feature]
        if len(parts) > 1:
            raise RockfallError(
                f"{drawn}: has {len(parts):,} lines: a section requires exactly one"
            )
        return _vertices(parts[0])
    if layer is not None:
        raise RockfallError(f"section: layer = '{layer}': requires a file with a line")
    try:
        pairs = np.asarray(drawn, float)
    except (TypeError, ValueError):
        pairs = np.empty(0)
    if pairs.ndim != 2 or pairs.shape[1] != 2:
        raise RockfallError("section: a line must be pairs x, y, or a file with a line")
    return _vertices(pairs)


def _vertices(pairs: np.ndarray) -> np.ndarray:
    return pairs[:, 0] + 1j * pairs[:, 1]


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
