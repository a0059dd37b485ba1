# SPDX-License-Identifier: BSD-3-Clause
"""What an array of elevations must be, wherever it comes from."""

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.grid import row_blocks

HIGHEST = 1e7  # [m] what is higher is no elevation, but a mark that the file does not tell of


def elevation_dtype(stored: np.dtype | str, name: str) -> np.dtype:
    """float32 for what it holds exactly (integers of 8 and 16 bits too), float64 for the rest."""
    stored = np.dtype(stored)
    if stored.kind not in "iuf":
        raise RockfallError(f"{name}: elevations are of type {stored}, real numbers are needed")
    return np.dtype(np.float32 if np.can_cast(stored, np.float32) else np.float64)


def check_elevations(name: str, z: np.ndarray) -> None:
    """Refuse rasters too small for a patch, infinite elevations, and rasters without any."""
    ny, nx = z.shape
    if min(nx, ny) < 2:
        raise RockfallError(f"{name}: {nx} x {ny} cells, at least 2 x 2 are needed")
    if not check_known(name, z):
        raise RockfallError(f"{name}: all cells are nodata")


def check_known(name: str, z: np.ndarray, row: int = 0) -> bool:
    """Whether any cell has an elevation; absurd ones are refused. The array begins at a row."""
    some = False
    for rows in row_blocks(z.shape):
        absurd = np.argwhere(np.abs(z[rows]) > HIGHEST)
        if absurd.size:
            at = tuple(absurd[0] + (rows.start, 0))
            rule = "finite" if np.isinf(z[at]) else "within 1e7 m of zero"
            raise RockfallError(
                f"{name}: row {row + at[0] + 1}, column {at[1] + 1}: elevation {z[at]:g}: "
                f"must be {rule} or nodata"
            )
        some = some or not np.isnan(z[rows]).all()
    return some
