# SPDX-License-Identifier: BSD-3-Clause
"""Generalised Pareto distribution (GPD) of values above a threshold: fit, test, and choice of the
threshold.

The fit is implemented here: SciPy's takes four times as long, and it has no test of a GPD whose
parameters were fitted to clustered values.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

FALSE = 0.05  # rate of falsely rejected thresholds
MAX_PLACE = 2.0  # upper end of the search variable of `fit_gpd`, near the largest shape found


class Fit(NamedTuple):
    """GPD of the values above a threshold: P(X > x | X > u) = (1 + shape (x - u) / scale)**(-1 /
    shape); `p_value` belongs to its Anderson-Darling test.
    """

    threshold: float
    exceedances: int
    shape: float
    scale: float
    p_value: float


def fit_gpd(
    excess: np.ndarray, threshold: float, weight: float = 1.0, max_place: float = MAX_PLACE
) -> Fit:
    """Maximum-likelihood GPD of ordered values, sought along the line of `best_of`; the search
    variable is log(1 + theta max) / log(n), which is near the shape. `weight` is the fraction of
    independent values."""
    top, reach = excess.max(), np.log(excess.size)

    def theta(place: float) -> float:
        grown = np.expm1(place * reach)
        return (grown if abs(grown) > 1e-9 else 1e-9) / top  # not 0: exponential

    from scipy.optimize import minimize_scalar

    best = minimize_scalar(
        lambda place: best_of(theta(place), excess)[2], bounds=(-1, max_place), method="bounded",
        options={"xatol": 1e-8},
    )  # fmt: skip
    shape, scale, _ = best_of(theta(best.x), excess)
    p_value = _p_value(weight * _anderson_darling(excess, shape, scale), shape)
    return Fit(threshold, excess.size, float(shape), float(scale), p_value)


def best_of(theta: float, excess: np.ndarray) -> tuple[float, float, float]:
    """Maximum-likelihood shape and scale for a given theta = shape / scale, and the negative
    log-likelihood per value, up to a constant (Grimshaw 1993)."""
    shape = np.log1p(theta * excess).mean()
    return shape, shape / theta, np.log(shape / theta) + shape


def _anderson_darling(excess: np.ndarray, shape: float, scale: float) -> float:
    """The statistic A2 of ordered values (Anderson and Darling 1954)."""
    log_beyond = -np.log1p(shape * excess / scale) / shape
    log_below = np.log(-np.expm1(log_beyond))
    odd = 2 * np.arange(1, excess.size + 1) - 1
    return -excess.size - (odd * (log_below + log_beyond[::-1])).mean()


def _p_value(a2: float, shape: float) -> float:
    """Probability of a larger A2 if the GPD holds and both its parameters were fitted.

    A2 tends to a sum of chi-squares with the eigenvalues of a covariance as weights (Choulakian and
    Stephens 2001, section 3); its distribution is an integral (Imhof 1961, eq. 3.2).
    """
    a2 = min(a2, 12.0)  # the sum below has a period of 25; the probability vanishes far earlier
    shape = max(shape, -0.49)  # the covariance of the fit ends at -0.5
    shape = shape if abs(shape) > 1e-4 else 1e-4
    t, weight = _quadrature()
    beyond, log_beyond = 1 - t, np.log1p(-t)
    power = np.expm1(shape * log_beyond)
    slope = np.stack([power / shape, (shape * log_beyond - power) / shape**2]) * beyond
    covariance = (1 + shape) * np.array([[2, -1], [-1, 1 + shape]])  # of log scale and shape
    kernel = np.minimum.outer(t, t) - np.outer(t, t) - slope.T @ covariance @ slope
    kernel *= np.sqrt(np.outer(weight, weight) / np.outer(t * beyond, t * beyond))
    u = 0.25 + 0.5 * np.arange(400)
    turn = np.outer(u, np.linalg.eigvalsh(kernel))
    angle = np.arctan(turn).sum(axis=1) / 2 - a2 * u / 2
    damping = np.exp(np.log1p(turn**2).sum(axis=1) / 4)
    return float(np.clip(0.5 + 0.5 * (np.sin(angle) / (u * damping)).sum() / np.pi, 0, 1))


@cache
def _quadrature() -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights in 0 to 1; as slow as the eigenvalues, so cached."""
    node, weight = np.polynomial.legendre.leggauss(60)
    return (node + 1) / 2, weight / 2


def lowest_valid(tried: Sequence[Fit]) -> Fit | None:
    """The lowest threshold that ForwardStop keeps (Bader, Yan and Zhang 2018, eq. 4)."""
    p = np.minimum([fit.p_value for fit in tried], 1 - 1e-12)
    mean = -np.log1p(-p).cumsum() / np.arange(1, p.size + 1)
    given_up = np.flatnonzero(mean <= FALSE)
    lowest = given_up[-1] + 1 if given_up.size else 0
    return tried[lowest] if lowest < len(tried) else None
