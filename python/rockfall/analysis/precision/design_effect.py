# SPDX-License-Identifier: BSD-3-Clause
"""Number of independent boulders that give a fraction with the same certainty as clustered
boulders. A cluster is the boulders of a sampled source, or the boulders with the same number in
several runs."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from rockfall.kernel_rules import Z
from rockfall.limits import MIN_FOR_MEAN

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

SIMPSON = np.r_[1, np.tile([4, 2], 199), 4, 1] / 1200.0  # Simpson weights for 401 values
STEPS = np.arange(SIMPSON.size, dtype=float)
MOST_FREEDOM = 1000  # degrees of freedom above which the distribution is nearly normal
ROUNDING = 1e-9  # rounding error of sums


def independent_boulders(n: np.ndarray, held: np.ndarray, heaviest: float = 1.0) -> float:
    """Number of independent boulders that give a fraction the same variance as clustered boulders.
    `n` and `held` (clusters,) are the weights of all and of the chosen boulders, `heaviest` is the
    largest weight of a boulder.

    The variance is taken between clusters (linearised; Cochran 1977). Only clusters with chosen
    boulders show how similar these are, so the quantile is Student's. Its degrees of freedom are
    the number of these clusters, or of clusters with other boulders if smaller, minus one. With
    fewer than MIN_FOR_MEAN chosen or other boulders, a cluster counts as one boulder.
    """
    total, chosen = float(n.sum()), float(held.sum())
    most, fewest = total / heaviest, total / float(n.max(initial=heaviest))
    fraction = chosen / total if total else 0.0
    informative = int(
        informative_clusters(
            np.count_nonzero(held > ROUNDING * n), np.count_nonzero(n - held > ROUNDING * n)
        )
    )
    few = min(chosen, total - chosen) < (MIN_FOR_MEAN - ROUNDING) * heaviest
    if few or informative < 2:
        return fewest
    m, residual = n.size, held - fraction * n
    variance = float(residual @ residual) * m / (m - 1) / total**2
    half = student(informative - 1) / Z * math.sqrt(variance)
    return min(max(fraction * (1 - fraction) / half**2, fewest), most) if half else most


def informative_clusters(with_chosen: ArrayLike, with_others: ArrayLike) -> np.ndarray:
    """Number of clusters for Student's distribution, from the numbers of clusters with chosen and
    with other boulders."""
    return np.minimum(np.minimum(with_chosen, with_others), MOST_FREEDOM + 1)


@lru_cache(maxsize=2 * MOST_FREEDOM)
def student(freedom: float) -> float:
    """97.5 % quantile of Student's t for n = `freedom` >= 1. With t = sqrt(n) tan(a) the density in
    a is cos(a)**(n - 1), integrated by Simpson's rule; Newton's method finds the quantile from
    below. (Importing scipy.special takes as long as a small run.)"""
    half = freedom / 2
    density = math.exp(math.lgamma(half + 0.5) - math.lgamma(half)) / math.sqrt(math.pi)
    angle = math.atan(Z / math.sqrt(freedom))
    for _ in range(8):
        angles = STEPS * (angle / STEPS[-1])
        angles[-1] = angle
        values = density * np.cos(angles) ** (freedom - 1)
        before, angle = angle, angle + (0.475 - angle * (SIMPSON @ values)) / values[-1]
        if angle == before:
            break
    return math.sqrt(freedom) * math.tan(angle)
