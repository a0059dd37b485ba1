# SPDX-License-Identifier: BSD-3-Clause
"""Lateral deviation at a rebound: quantiles by incidence angle, for `&impact turning = 'lab'`."""

from __future__ import annotations

import numpy as np

from rockfall.errors import RockfallError
from rockfall.scene.rebounds.sets import Lateral

LIMITS = 10.0, 20.0, 40.0  # limits between incidence classes [degrees]
MIN_IN_CLASS = 30  # minimum number of impacts to define the largest tenth
PROBABILITY = np.array([0, 10, 20, 30, 40, 50, 60, 70, 80, 90, 95, 99, 100]) / 100
PAPER = 22.5, 45.0  # limits between the classes of Bourrier et al. (2009), section 3.3 [degrees]


def incidence(v_in: np.ndarray) -> np.ndarray:
    """Angle of incoming velocities (n, 3) to the ground, (n,) [degrees]."""
    return np.degrees(np.arctan2(-v_in[:, 1], v_in[:, 0]))


def fit_lateral(v_in: np.ndarray, lateral: np.ndarray) -> Lateral:
    """Quantiles of absolute deviations (n,) [degrees], NaN if unknown, of impacts with V_in (n, 3).

    From grazing to steep, a class with too few impacts is merged with the next steeper class, the
    steepest with the class before it. Raises RockfallError for too few impacts in total.
    """
    is_known = np.isfinite(lateral)
    if is_known.sum() < MIN_IN_CLASS:
        raise RockfallError(
            f"{is_known.sum()} lateral deviations: at least {MIN_IN_CLASS} are needed for quantiles"
        )
    angle, lateral = incidence(v_in[is_known]), lateral[is_known]
    kept: list[float] = []
    for limit in LIMITS:
        below = (angle >= max(kept, default=-np.inf)) & (angle < limit)
        if min(below.sum(), (angle >= limit).sum()) >= MIN_IN_CLASS:
            kept.append(limit)
    place = np.searchsorted(kept, angle, side="right")
    quantiles = [np.quantile(lateral[place == k], PROBABILITY) for k in range(len(kept) + 1)]
    return Lateral(np.array(kept), np.array(quantiles), np.bincount(place))


def lateral_line(lateral: np.ndarray) -> str:
    """Fractions of absolute deviations (n,) [degrees] in the classes of the paper, ignoring NaN."""
    finite = lateral[np.isfinite(lateral)]
    fractions = np.bincount(np.searchsorted(PAPER, finite, side="right"), minlength=3) / finite.size
    low, high = PAPER
    return (
        f"  lateral deviation below {low:g} degrees {fractions[0]:.1%}, "
        f"to {high:g} {fractions[1]:.1%}, above {fractions[2]:.1%} ({finite.size:,} impacts)"
    )
