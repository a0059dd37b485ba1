# SPDX-License-Identifier: BSD-3-Clause
"""Generalised Pareto distribution (GPD) of values above a threshold: fit, test, threshold
selection.

The fit is implemented here, because SciPy's fit takes four times as long, and SciPy has no test
for a GPD fitted to clustered values.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

FALSE = 0.05  # significance level of the threshold selection
MAX_PLACE = 2.0  # upper end of the search variable of `fit_gpd`, about the largest possible shape
NEAR = 1e-9  # cost accepted as zero; a millionth of the cost at the 95 % limits of 2000 values
NEAR_ZERO = 1e-6  # |theta| x largest value, below which the GPD counts as exponential
SHAPES = -0.49, 2.0  # range of shapes in `_p_value`; the covariance of the fit exists above -0.5
IMHOF = 0.25 + 0.5 * np.arange(400)  # grid for Imhof's integral
DEGREE = 24  # degree of the polynomials in `_spectra`: errors of 2e-9 (2e-11 in p)


class Fit(NamedTuple):
    """GPD of values above a threshold u: P(X > x | X > u) = (1 + shape (x - u) / scale)**(-1 /
    shape). `p_value` is from the Anderson-Darling test."""

    threshold: float
    exceedances: int
    shape: float
    scale: float
    p_value: float


def fit_gpd(
    excess: np.ndarray, threshold: float, weight: float = 1.0, max_place: float = MAX_PLACE
) -> Fit:
    """Maximum-likelihood GPD of the sorted values `excess` above `threshold`: a search for the
    theta that minimises the cost of `best_of`, up to `max_place`. `weight` is the fraction of the
    values that counts as independent in the p-value."""
    place = _stationary(excess, max_place)
    if place is None:
        from scipy.optimize import minimize_scalar

        place = minimize_scalar(
            lambda place: best_of(theta_at(place, excess), excess)[2], bounds=(-1, max_place),
            method="bounded", options={"xatol": 1e-8},
        ).x  # fmt: skip
    shape, scale, _ = best_of(theta_at(place, excess), excess)
    p_value = _p_value(weight * _anderson_darling(excess, shape, scale), shape)
    return Fit(threshold, excess.size, float(shape), float(scale), p_value)


def theta_at(place: ArrayLike, excess: np.ndarray) -> np.ndarray:
    """theta = shape / scale, never 0, for a value `place` of the search variable log(1 + theta
    max(excess)) / log(n)."""
    grown = np.expm1(np.multiply(place, np.log(excess.size)))
    return np.where(np.abs(grown) > NEAR_ZERO, grown, NEAR_ZERO) / excess[-1]


def _stationary(excess: np.ndarray, max_place: float) -> float | None:
    """Value of the search variable at the optimum, by Newton's method; None if it does not
    converge within the range."""
    place, n, largest = 0.0, excess.size, excess[-1]
    reach = np.log(n)
    for _ in range(20):
        theta = float(theta_at(place, excess))
        inverse = 1 / (1 + theta * excess)
        shape, lost = -np.log(inverse).sum() / n, 1 - inverse
        mean, more = lost.sum() / n, 1 + 1 / shape
        slope = mean * more - 1  # slope multiplied by theta, curvature by its square
        curvature = 1 - (lost @ lost) / n * more - (mean / shape) ** 2
        growth = reach * (1 + 1 / (theta * largest))  # derivative of log(theta)
        bend = growth * (curvature * growth + slope * reach)
        place -= (step := slope * growth / bend)
        if not (bend > 0 and -1 < place < max_place):
            return None
        if abs(step) < 1e-9:
            return place
    return None


def best_of(theta: float | np.ndarray, excess: np.ndarray) -> tuple[float, float, float]:
    """Maximum-likelihood shape and scale (unit of `excess`) for a given theta = shape / scale, and
    the negative log-likelihood per value, up to a constant (Grimshaw 1993)."""
    shape = np.log1p(theta * excess).sum() / excess.size  # `mean` takes three times as long
    return shape, shape / theta, np.log(shape / theta) + shape


def root_of(cost: Callable[[float], float], low: float, high: float) -> float:
    """Root of a cost that has opposite signs at `low` and `high`, by the Illinois method (Dowell
    and Jarratt 1971). Importing SciPy's methods takes longer than 40 tail fits."""
    place, at_low, at_high = high, cost(low), cost(high)
    for _ in range(100):
        place = (low * at_high - high * at_low) / (at_high - at_low)
        at = cost(place)
        if abs(at) < NEAR:
            break
        if at * at_high < 0:
            low, at_low = high, at_high
        else:
            at_low /= 2
        high, at_high = place, at
    return place


def _anderson_darling(excess: np.ndarray, shape: float, scale: float) -> float:
    """Anderson-Darling statistic A2 of ordered values (Anderson and Darling 1954)."""
    log_beyond = -np.log1p(shape * excess / scale) / shape
    log_below = np.log(-np.expm1(log_beyond))
    odd = 2 * np.arange(1, excess.size + 1) - 1
    return -excess.size - (odd * (log_below + log_beyond[::-1])).mean()


def _p_value(a2: float, shape: float) -> float:
    """Probability of a larger A2 when both parameters are fitted (Imhof 1961, eq. 3.2)."""
    a2 = min(a2, 12.0)  # the sum below has a period of 25, but the p-value is 0 far earlier
    low, high = SHAPES
    place = np.clip((2 * shape - low - high) / (high - low), -1, 1)
    polynomials = np.cos(np.arange(DEGREE + 1) * np.arccos(place))  # Chebyshev
    angle, damping = np.split(polynomials @ _spectra(), 2)
    wave = np.sin(angle - a2 * IMHOF / 2) / (IMHOF * np.exp(damping))
    return float(np.clip(0.5 + 0.5 * wave.sum() / np.pi, 0, 1))


@cache
def _spectra() -> np.ndarray:
    """Chebyshev coefficients (DEGREE + 1, ...) by shape, of the angle and damping of Imhof's
    integral."""
    rule = np.polynomial.legendre.leggauss(60)
    middle, half = np.mean(SHAPES), np.ptp(SHAPES) / 2
    return np.polynomial.chebyshev.chebinterpolate(
        lambda places: np.array([_spectrum(middle + half * place, *rule) for place in places]),
        DEGREE,
    )


def _spectrum(shape: float, node: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Angle, then logarithm of the damping, on the grid of Imhof's integral. `node` and `weight`
    are a quadrature rule on (-1, 1).

    In the limit of many values, A2 is a sum of chi-squares; their weights are the eigenvalues of a
    covariance (Choulakian and Stephens 2001, section 3).
    """
    t, weight = (node + 1) / 2, weight / 2
    beyond, log_beyond = 1 - t, np.log1p(-t)
    power = np.expm1(shape * log_beyond)
    slope = np.stack([power / shape, (shape * log_beyond - power) / shape**2]) * beyond
    # parameters: log scale and shape
    covariance = (1 + shape) * np.array([[2, -1], [-1, 1 + shape]])
    kernel = np.minimum.outer(t, t) - np.outer(t, t) - slope.T @ covariance @ slope
    kernel *= np.sqrt(np.outer(weight, weight) / np.outer(t * beyond, t * beyond))
    turn = np.outer(IMHOF, np.linalg.eigvalsh(kernel))
    return np.append(np.arctan(turn).sum(axis=1) / 2, np.log1p(turn**2).sum(axis=1) / 4)


def lowest_valid(tried: Sequence[Fit]) -> Fit | None:
    """Fit with the lowest threshold that ForwardStop accepts (Bader, Yan and Zhang 2018, eq. 4);
    None if it accepts none."""
    p = np.minimum([fit.p_value for fit in tried], 1 - 1e-12)
    mean = -np.log1p(-p).cumsum() / np.arange(1, p.size + 1)
    given_up = np.flatnonzero(mean <= FALSE)
    lowest = given_up[-1] + 1 if given_up.size else 0
    return tried[lowest] if lowest < len(tried) else None
