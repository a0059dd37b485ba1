# SPDX-License-Identifier: BSD-3-Clause
"""Breakage of blocks with the kernel's rules: fragments, and the breaking speed."""

from typing import NamedTuple

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case, in_kernel

MAX_SPEED = _core.constant("max_speed")  # [m/s] above the speed of any boulder
SPEEDS = 1001  # number of speeds tried at a time


class Splits(NamedTuple):
    """Fragments of n blocks. An unbroken block is its own only fragment.

    Area ratios (n,), fragment volumes [m3] (n, max_fragments) padded with 0, volumes of fines [m3]
    (n,), and whether `&breakage max_fragments` limited the fragments (n,).
    """

    area_ratio: np.ndarray
    volumes: np.ndarray
    fines: np.ndarray
    is_capped: np.ndarray


def split_blocks(case: Case, volume: np.ndarray, energy: np.ndarray) -> Splits:
    """Split n blocks, given their volumes [m3] and energies normal to the ground [J], both (n,),
    with the `&breakage` group of a case whose boulders break."""
    volumes = np.zeros((case.breakage["max_fragments"], len(volume)), order="F")
    ratio, fines, capped = _core.split_blocks(in_kernel(case), volume, energy, volumes)
    return Splits(ratio, volumes.T, fines, capped.astype(bool))


def breaking_speed(case: Case, volume: float, density: float) -> float:
    """Lowest normal impact speed [m/s] that breaks a block, within 1e-6; inf if none does."""
    low, high = 0.0, MAX_SPEED
    while high - low > 1e-6:
        speeds = np.linspace(low, high, SPEEDS)
        split = split_blocks(case, np.full(SPEEDS, volume), 0.5 * density * volume * speeds**2)
        breaks = split.is_capped | (split.volumes[:, 0] < volume)
        if not breaks[-1]:
            return np.inf
        first = int(np.argmax(breaks))
        low, high = speeds[max(0, first - 1)], speeds[first]
    return float(high)
