# SPDX-License-Identifier: BSD-3-Clause
"""Boulders that bounce down an infinite plane, with rebounds from an impact set.

On a plane, a flight between two bounces keeps V_n and W and adds 2 tan(slope) V_n to V_t for any
gravity, and a rebound is linear in speed. A bounce is therefore a random change of direction with
a factor on the speed, and there is no terminal speed. If the mean logarithm of the factor is
negative, boulders stop; if it is positive, they accelerate without limit. At the neutral slope in
between, half of the boulders never stop.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rockfall.scene.rebounds.coefficients import covariance_root
from rockfall.scene.rebounds.kernel_rebounds import MAX_DRAWS, admissible, limited

FIRST, LAST = 20, 60  # first and last bounce counted, after the start-up phase
FLATTEST, STEEPEST, NEAR = 5.0, 75.0, 0.05  # search range and tolerance of a neutral slope [degree]
USUAL, RISE = 34.0, 0.015  # initial guess [degree], and change of growth per degree there

#: Maps V_in (n, 3) to V_out (n, 3).
Rebound = Callable[[np.ndarray, np.random.Generator], np.ndarray]


@dataclass(frozen=True)
class Growth:
    """Mean and spread of the logarithm of the speed ratio between successive bounces."""

    mean: float
    std: float
    error: float  # standard error of the mean


def set_rebound(mean: np.ndarray, covariance: np.ndarray) -> Rebound:
    """Rebounds by an impact set: V_out = A V_in, redrawn until admissible, as in the kernel."""
    root = covariance_root(covariance)

    def rebound(v_in: np.ndarray, generator: np.random.Generator) -> np.ndarray:
        v_out = np.empty_like(v_in)
        todo = np.arange(len(v_in))
        for _ in range(MAX_DRAWS):
            a = (mean + generator.standard_normal((len(todo), 9)) @ root.T).reshape(-1, 3, 3)
            v_out[todo] = np.einsum("nij,nj->ni", a, v_in[todo])
            todo = todo[~admissible(v_in[todo], v_out[todo])]
            if not todo.size:
                return v_out
        v_out[todo] = limited(v_in[todo], v_out[todo])
        return v_out

    return rebound


def mixed_rebound(rebounds: Sequence[Rebound], weights: np.ndarray) -> Rebound:
    """Rebounds by one of several rules, drawn for each rebound with probability `weights`."""

    def rebound(v_in: np.ndarray, generator: np.random.Generator) -> np.ndarray:
        v_out = np.empty_like(v_in)
        rule = generator.choice(len(weights), len(v_in), p=weights)
        for k in np.unique(rule):
            v_out[rule == k] = rebounds[k](v_in[rule == k], generator)
        return v_out

    return rebound


def speed_of(v: np.ndarray) -> np.ndarray:
    """Speed (n,) [m/s] in the plane of V_t and V_n."""
    return np.sqrt(v[:, 0] ** 2 + v[:, 1] ** 2)


def _fly(v: np.ndarray, slope: float) -> np.ndarray:
    """Velocities V_t, V_n, W (n, 3) before the next bounce; a boulder thrown uphill falls back."""
    v_in = np.stack([v[:, 0] + 2 * np.tan(np.radians(slope)) * v[:, 1], -v[:, 1], v[:, 2]], axis=1)
    back = v_in[:, 0] < 0
    v_in[back] *= [-1, 1, -1]  # the frame of reference turns with the boulder
    return v_in


def growth(rebound: Rebound, slope: float, boulders: int = 1000, seed: int = 1) -> Growth:
    """Growth of speed per bounce on a plane of this slope [degree], after a start-up phase."""
    generator = np.random.default_rng(seed)
    v = np.tile([10.0, 2.0, 8.0], (boulders, 1))
    logs = []
    for bounce in range(LAST):
        before = speed_of(v)
        v = rebound(_fly(v, slope), generator)
        factor = speed_of(v) / before
        v /= factor[:, None]  # only directions matter
        if bounce >= FIRST:
            logs.append(np.log(factor))
    each = np.mean(logs, axis=0)
    error = each.std(ddof=1) / np.sqrt(boulders)
    return Growth(float(each.mean()), float(np.std(logs)), float(error))


def neutral_slope(rebound: Rebound, boulders: int = 1000, seed: int = 1) -> float:
    """Slope on which speeds neither grow nor decay [degree], from 5 to 75, by the secant method
    within a bracket. (Importing SciPy's brentq takes longer than this search.)"""
    low, high, slope = FLATTEST, STEEPEST, USUAL
    rise, last = RISE, None
    while high - low > NEAR:
        mean = growth(rebound, slope, boulders, seed).mean
        low, high = (slope, high) if mean < 0 else (low, slope)
        if last:
            rise = (mean - last[1]) / (slope - last[0]) or RISE
        last, neutral = (slope, mean), slope - mean / rise
        if not low < neutral < high:
            neutral = (low + high) / 2
        elif abs(neutral - slope) < NEAR:
            return neutral
        slope = neutral
    return (low + high) / 2
