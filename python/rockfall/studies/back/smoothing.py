# SPDX-License-Identifier: BSD-3-Clause
"""Smoothing of the log-likelihoods of members, which removes the noise of their runs, by a
Gaussian process (Rasmussen and Williams 2006, chapter 2; Järvenpää et al. 2021).

The mean is quadratic in each direction; departures from it follow a Matérn process of smoothness
5/2 with a length in each direction. At a deficit t below the maximum, the noise has the variance a
+ b t, because each boulder matters more far from the observations. Lengths, amplitude, a and b are
maximum-likelihood estimates. Members do not share boulders, because this would correlate their
noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FAR = 10.0  # larger deficits do not affect the posterior, and are compressed logarithmically
FITTED = 200  # members used to fit the hyperparameters
TREND = 100.0  # prior variance of the quadratic's coefficients: uninformative
LENGTH, AMPLITUDE, NOISE, SLOPE = (0.1, 30.0), (0.1, 100.0), (1e-3, 30.0), (1e-3, 3.0)
FIRST = (2.0, 5.0, 1.0, 0.3)  # initial values of the hyperparameters


def smoothed(points: np.ndarray, levels: np.ndarray, log_likelihood: np.ndarray) -> np.ndarray:
    """Smoothed log-likelihoods of points (n, dimensions), -inf where the input is -inf. The values
    in a direction with `levels`, such as impact sets, are unordered."""
    is_finite = np.isfinite(log_likelihood)
    smooth = np.full(is_finite.size, -np.inf)
    if not is_finite.any():
        return smooth
    points, deficit = points[is_finite], log_likelihood[is_finite].max() - log_likelihood[is_finite]
    y = -np.where(deficit < FAR, deficit, FAR * (1 + np.log(np.maximum(deficit, FAR) / FAR)))
    chosen = np.unique(np.linspace(0, y.size - 1, FITTED).astype(int))
    numbers = _process(points[chosen], levels, y[chosen]).likeliest()
    smooth[is_finite] = _process(points, levels, y).mean(numbers)
    return smooth


def _process(points: np.ndarray, levels: np.ndarray, y: np.ndarray) -> _Process:
    from scipy.special import ndtr

    ordered = points[:, levels == 0]
    which = np.floor(levels * ndtr(points))
    squares = [
        (a[:, None] - a) ** 2 if not level else 1.0 * (b[:, None] != b)
        for a, b, level in zip(points.T, which.T, levels, strict=True)
    ]
    trend = np.column_stack([np.ones(len(points)), ordered, ordered**2])
    return _Process(y, squares, TREND * trend @ trend.T)


@dataclass
class _Process:
    """Values, squared distances in each direction, and covariance of the quadratic. `numbers` are
    the logarithms of the lengths, amplitude, a and b."""

    y: np.ndarray
    squares: list[np.ndarray]
    trend: np.ndarray

    def likeliest(self) -> np.ndarray:
        from scipy.optimize import minimize

        k = len(self.squares)
        first, bounds = [FIRST[0]] * k + [*FIRST[1:]], [LENGTH] * k + [AMPLITUDE, NOISE, SLOPE]
        limits, most = np.log(bounds), {"maxiter": 60}
        return minimize(self._cost, np.log(first), jac=True, bounds=limits, options=most).x

    def mean(self, numbers: np.ndarray) -> np.ndarray:
        """Posterior mean without the noise."""
        from scipy.linalg import cho_solve

        smooth = self._matern(numbers)[0] + self.trend
        return smooth @ cho_solve(self._factor(smooth, numbers), self.y)

    def _factor(self, smooth: np.ndarray, numbers: np.ndarray) -> tuple[np.ndarray, bool]:
        from scipy.linalg import cho_factor

        noise, slope = np.exp(numbers[-2:])
        return cho_factor(smooth + np.diag(noise - slope * self.y), lower=True)

    def _matern(self, numbers: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """Covariance (n, n) of the points, with derivatives with respect to the logarithms of the
        lengths."""
        *lengths, amplitude = np.exp(numbers[:-2])
        parts = [square / length**2 for square, length in zip(self.squares, lengths, strict=True)]
        r = np.sqrt(5 * sum(parts))
        near = amplitude**2 * np.exp(-r)
        return near * (1 + r + r**2 / 3), [near * 5 / 3 * (1 + r) * part for part in parts]

    def _cost(self, numbers: np.ndarray) -> tuple[float, np.ndarray]:
        """Negative log marginal likelihood, with its gradient."""
        from scipy.linalg import cho_solve

        matern, by_length = self._matern(numbers)
        factor = self._factor(matern + self.trend, numbers)
        inverse = cho_solve(factor, np.eye(self.y.size))
        pulled = inverse @ self.y
        cost = self.y @ pulled / 2 + np.log(np.diag(factor[0])).sum()
        open_ = inverse - np.outer(pulled, pulled)
        noise, slope = np.exp(numbers[-2:])
        of_noise = [noise * np.trace(open_), -slope * np.diag(open_) @ self.y]
        gradient = [*((open_ * slope).sum() for slope in (*by_length, 2 * matern)), *of_noise]
        return float(cost), np.array(gradient) / 2
