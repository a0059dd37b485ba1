# SPDX-License-Identifier: BSD-3-Clause
"""Dams and walls of earth: an edit of the terrain before boulders fly over it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.grid import Grid
from rockfall.terrain.height import height
from rockfall.terrain.polyline import beside, lengths


def with_dam(z: np.ndarray, grid: Grid, dam: Mapping[str, Any], name: str) -> np.ndarray:
    """Elevations (ny, nx), row 0 the northernmost, with one dam; `name` is for messages.

    The crest lies `height` above the terrain below it, is `crest_width` wide and falls off to both
    sides at `slope` until it meets the terrain: max(z, crest - tan(slope) (d - crest_width / 2)) at
    the distance d from its line. Cells without an elevation stay so.
    """
    vertices = np.array(dam["x"]) + 1j * np.array(dam["y"])
    line, crest = _crest(z, grid, vertices, name)
    crest = crest + dam["height"]
    fall = np.tan(np.radians(dam["slope"]))
    far = dam["crest_width"] / 2 + (crest.max() - np.nanmin(z)) / fall
    rows, columns = (
        slice(*np.searchsorted(sign * centres, [low - far, high + far]))
        for sign, centres, low, high in (
            (-1, grid.y, -vertices.imag.max(), -vertices.imag.min()),
            (1, grid.x, vertices.real.min(), vertices.real.max()),
        )
    )
    apart, along = beside(grid.x[columns] + 1j * grid.y[rows, None], vertices)
    top = np.interp(along, line, crest) - fall * np.maximum(0.0, apart - dam["crest_width"] / 2)
    raised = z.copy()
    raised[rows, columns] = np.maximum(z[rows, columns], top)
    return raised


def _crest(
    z: np.ndarray, grid: Grid, vertices: np.ndarray, name: str
) -> tuple[np.ndarray, np.ndarray]:
    """Distances along the line of a crest, every half cell or less, and the terrain there."""
    ends = lengths(vertices)
    line = np.union1d(ends, np.arange(0.0, ends[-1], grid.cell / 2))
    x, y = (np.interp(line, ends, part) for part in (vertices.real, vertices.imag))
    margin = grid.cell / 2
    if not (
        (x >= grid.west + margin).all() and (x <= grid.east - margin).all()
        and (y >= grid.south + margin).all() and (y <= grid.north - margin).all()
    ):  # fmt: skip
        raise RockfallError(
            f"{name}: &dam x, y: must lie between the outer cell centres of the DEM"
        )
    found = height(z, grid, x, y)
    if np.isnan(found).any():
        raise RockfallError(f"{name}: &dam x, y: must lie on terrain with an elevation")
    return line, found
