# SPDX-License-Identifier: BSD-3-Clause
"""Stems for the kernel, and totals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

HECTARE = 1.0e4  # m2
MAX_DBH = 1000.0  # [cm]
MAX_DENSITY = 1e6  # stems per hectare
SQUARE = 25.0  # side of the squares [m] that count as forest if they contain a stem
STEM = 32  # bytes per stem in the kernel, in addition to these arrays


class Trees(NamedTuple):
    """Stems; each array has a value per stem."""

    x: np.ndarray  # map coordinates [m]
    y: np.ndarray
    dbh: np.ndarray  # diameter at breast height [cm]
    factor: np.ndarray  # toughness of the species relative to silver fir

    @property
    def bytes(self) -> int:
        """Memory of the stems here and in the kernel [bytes]."""
        return sum(values.nbytes for values in self) + STEM * self.x.size

    def area(self) -> float:
        """Forest area [ha]: squares that contain a stem."""
        column, row = (np.floor(values / SQUARE).astype("i8") for values in (self.x, self.y))
        squares = np.unique(column - column.min() + (np.ptp(column) + 1) * (row - row.min())).size
        return squares * SQUARE**2 / HECTARE

    def basal_area(self) -> float:
        """Basal area of all stems [m2]."""
        return float(np.pi / 4 * ((0.01 * self.dbh) ** 2).sum())

    def select(self, chosen: np.ndarray) -> Trees:
        """Stems with these indices or this mask."""
        return Trees(*(values[chosen] for values in self))


class Stand(NamedTuple):
    """Stand of a polygon layer and its stems, as stored in a result."""

    name: str
    area: float  # area on the terrain [ha]
    stated: float  # stems per hectare in the layer
    stems: int  # number of stems after thinning and clearing

    @property
    def density(self) -> float:
        """Stems per hectare; 0 if the stand is outside the terrain."""
        return self.stems / self.area if self.area > 0 else 0.0


class Planted(NamedTuple):
    """Stems, with the data that thinning needs."""

    trees: Trees
    remain: np.ndarray | None = None  # random number of each stem, used for thinning
    stand: np.ndarray | None = None  # stand index of each stem; None without stands
