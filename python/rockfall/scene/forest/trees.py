# SPDX-License-Identifier: BSD-3-Clause
"""Stems for the kernel, and their totals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

HECTARE = 1.0e4  # m2
MAX_DBH = 1000.0  # [cm]
MAX_DENSITY = 1e6  # stems per hectare
SQUARE = 25.0  # [m] side of the squares that count as forest if they contain a stem
STEM = 32  # bytes per stem in the kernel, in addition to these arrays


class Trees(NamedTuple):
    """Stems, with one value per stem in each array."""

    x: np.ndarray  # map coordinates [m]
    y: np.ndarray
    dbh: np.ndarray  # diameter at breast height [cm]
    factor: np.ndarray  # toughness of the species, silver fir = 1

    @property
    def bytes(self) -> int:
        """Memory used here and in the kernel."""
        return sum(values.nbytes for values in self) + STEM * self.x.size

    def area(self) -> float:
        """Forest area [ha]: total area of the squares with a stem."""
        column, row = (np.floor(values / SQUARE).astype("i8") for values in (self.x, self.y))
        squares = np.unique(column - column.min() + (np.ptp(column) + 1) * (row - row.min())).size
        return squares * SQUARE**2 / HECTARE

    def basal_area(self) -> float:
        """Basal area of all stems at breast height [m2]."""
        return float(np.pi / 4 * ((0.01 * self.dbh) ** 2).sum())

    def select(self, chosen: np.ndarray) -> Trees:
        """The chosen stems."""
        return Trees(*(values[chosen] for values in self))


class Stand(NamedTuple):
    """Stand of a polygon layer with its stems, as stored in a result."""

    name: str
    area: float  # on the terrain [ha]
    stated: float  # stems per hectare, in the layer
    stems: int  # standing: after thinnings and clearings

    @property
    def density(self) -> float:
        """Stems per hectare; 0 outside the terrain."""
        return self.stems / self.area if self.area > 0 else 0.0


class Planted(NamedTuple):
    """Stems before thinnings."""

    trees: Trees
    remain: np.ndarray | None = None  # number of each stem, for thinning
    stand: np.ndarray | None = None  # index of its stand; None without stands
