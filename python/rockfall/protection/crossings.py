# SPDX-License-Identifier: BSD-3-Clause
"""Boulders at a line, with the values that a barrier there must withstand."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr

from rockfall.analysis.precision.intervals import Sources, sources
from rockfall.analysis.precision.weighted import Weighted
from rockfall.kernel_rules import barrier_outcomes
from rockfall.result.crossings import at_line
from rockfall.result.samples import check_rows
from rockfall.result.variables import OUTCOME


class Crossings(NamedTuple):
    """Values of each boulder that crossed a line: source and volume [m3], position along the line
    [m], speed [m/s], energies [J], heights above the ground [m]."""

    source: Sources | Weighted
    volume: np.ndarray
    position: np.ndarray
    speed: np.ndarray
    energy_total: np.ndarray
    energy_translational: np.ndarray
    passing_height: np.ndarray  # vertical height of the centre, as for &barrier
    upper_edge: np.ndarray  # vertical height of the highest point
    normal_height: np.ndarray  # height of the centre normal to the slope
    normal_upper_edge: np.ndarray

    @property
    def n(self) -> int:
        return self.volume.size

    def where(self, chosen: np.ndarray) -> Crossings:
        first, *others = self
        return Crossings(first[chosen], *(values[chosen] for values in others))


def crossings(result: xr.Dataset, line: int) -> Crossings:
    """Crossings at the line with this index. Raises a RockfallError for a result without boulder
    rows."""
    check_rows(result, "a quantity of each boulder at a line")
    at = at_line(result, line)
    numbers = (at.values(name) for name in Crossings._fields[2:])
    return Crossings(sources(result)[at.boulders], at.volumes, *numbers)


def passes(came: Crossings, height: float, capacity: float) -> np.ndarray:
    """Mask of boulders that pass over or through a barrier of the given height [m] and capacity [J]
    at first contact: the kernel's rule, without stop speed."""
    if not came.n:
        return np.zeros(0, bool)
    outcome = barrier_outcomes(height, capacity, came.passing_height, came.energy_total)
    return outcome != OUTCOME["stopped"]
