# SPDX-License-Identifier: BSD-3-Clause
"""Stems as the kernel takes them, and what they are together."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

HECTARE = 1.0e4  # m2
MAX_DBH = 1000.0  # [cm]
SQUARE = 25.0  # [m] side of the squares of which those that hold a stem are forest
STEM = 32  # bytes of a stem in the kernel, besides these arrays


class Trees(NamedTuple):
    """Stems, each with a value in every array."""

    x: np.ndarray  # map coordinates [m]
    y: np.ndarray
    dbh: np.ndarray  # diameter at breast height [cm]
    factor: np.ndarray  # of the species, silver fir = 1

    @property
    def bytes(self) -> int:
        """Memory, here and in the kernel."""
        return sum(one.nbytes for one in self) + STEM * self.x.size

    def area(self) -> float:
        """Of the forest [ha]: of the squares that hold a stem."""
        column, row = (np.floor(one / SQUARE).astype("i8") for one in (self.x, self.y))
        squares = np.unique(column - column.min() + (np.ptp(column) + 1) * (row - row.min())).size
        return squares * SQUARE**2 / HECTARE

    def basal_area(self) -> float:
        """Of all stems at breast height [m2]."""
        return float(np.pi / 4 * ((0.01 * self.dbh) ** 2).sum())
