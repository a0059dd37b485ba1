# SPDX-License-Identifier: BSD-3-Clause
"""Line of a section given by the user: coordinate pairs, or a line layer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.rasters.grid import Grid
from rockfall.io.vectors.layers import read_lines


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
