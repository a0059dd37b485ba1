# SPDX-License-Identifier: BSD-3-Clause
"""Adaptive importance sampling (Cornuet et al. 2012) in the space of normal scores, where the prior
is normal with mean 0 and variance 1 in each direction.

The first points are draws from the prior. Later points come from a mixture: one fifth from the
prior, which bounds the weights, and the rest from normal kernels around the existing points, with
their weights (West 1993). The weight of a point is prior times likelihood, divided by the density
of all mixtures combined (Owen and Zhou 2000). The likelihood is smoothed over all points, because
otherwise points with favourable noise would get the largest weights. If few points carry the
weight, the likelihood is tempered, but only for the kernels.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rockfall.studies.back.smoothing import smoothed

DEFENSIVE = 0.2  # fraction of points drawn from the prior
WIDEST = 0.9  # kernel width relative to the standard deviation of all points


class Sampler:
    """Points at which the likelihood is required, and their weights. `levels` is the number of
    unordered values in each direction, 0 if values are ordered."""

    def __init__(self, first: np.ndarray, levels: np.ndarray) -> None:
        self.points, self.levels = first, levels  # (n, dimensions), drawn from the prior
        self.log_likelihood = np.empty(0)  # in the order of the runs
        self.smooth = np.empty(0)
        self.sizes = [len(first)]
        self.densities = [_log_prior(first)]  # log density of each mixture at all points
        self.mixtures: list[_Mixture] = []

    def learn(self, log_likelihood: np.ndarray) -> None:
        """Add the log-likelihoods of the points proposed last."""
        self.log_likelihood = np.append(self.log_likelihood, log_likelihood)
        self.smooth = smoothed(self.points, self.levels, self.log_likelihood)

    def log_weights(self) -> np.ndarray:
        return self.log_prior_weights() + self.smooth

    def log_prior_weights(self) -> np.ndarray:
        """Logarithms of the prior divided by the combined density of the mixtures."""
        shares = np.log(np.array(self.sizes) / sum(self.sizes))[:, None]
        mixed = np.logaddexp.reduce(np.array(self.densities) + shares, axis=0)
        return _log_prior(self.points) - mixed

    def weights(self) -> np.ndarray:
        """Weights that add up to 1; all 0 if no likelihood is finite."""
        return normalised(self.log_weights())

    def propose(self, n: int, random: np.random.Generator) -> np.ndarray:
        """Propose n further points (n, parameters), concentrated where the likelihood is high."""
        weight = self._tempered()
        mixture = _Mixture(self.points, weight)
        new = mixture.draw(n, random)
        self.mixtures.append(mixture)
        self.points = np.concatenate([self.points, new])
        self.sizes.append(n)
        self.densities = [density(self.points) for density in self._all()]
        return new

    def more_of_prior(self, points: np.ndarray) -> None:
        """Add points from the prior; for use while all likelihoods are 0."""
        self.points = np.concatenate([self.points, points])
        self.sizes[0] += len(points)
        self.densities = [density(self.points) for density in self._all()]

    def _all(self) -> list[Callable[[np.ndarray], np.ndarray]]:
        return [_log_prior, *(mixture.log_density for mixture in self.mixtures)]

    def _tempered(self) -> np.ndarray:
        """Weights whose likelihood is tempered so that enough points remain for the kernels."""
        enough = min(len(self.points) / 4, 5.0 * (self.points.shape[1] + 1))
        logs = self.log_weights()
        part, step = 1.0, 0.5
        weights = normalised(logs)
        if effective(weights) >= enough:
            return weights
        part = 0.0
        for _ in range(20):
            trial = normalised(np.where(np.isfinite(logs), (part + step) * logs, -np.inf))
            if effective(trial) >= enough:
                part += step
            step /= 2
        return normalised(np.where(np.isfinite(logs), part * logs, -np.inf))


class _Mixture:
    """Mixture of normal kernels and the prior."""

    def __init__(self, points: np.ndarray, weight: np.ndarray) -> None:
        is_weighted = weight > 0
        self.weight, dimensions = weight[is_weighted], points.shape[1]
        centre = self.weight @ points[is_weighted]
        apart = points[is_weighted] - centre
        spread = (self.weight[:, None] * apart).T @ apart
        n = effective(weight)
        # regularisation, because few points give a poor estimate
        spread += np.diag(np.full(dimensions, 1 / n + 1e-6))
        width = min(WIDEST, (4 / ((dimensions + 2) * n)) ** (1 / (dimensions + 4)))
        self.centres = centre + np.sqrt(1 - width**2) * apart
        self.factor = width * np.linalg.cholesky(spread)

    def draw(self, n: int, random: np.random.Generator) -> np.ndarray:
        points = random.standard_normal((n, self.centres.shape[1]))
        picked = random.choice(self.weight.size, n, p=self.weight)
        own = random.random(n) >= DEFENSIVE
        points[own] = self.centres[picked[own]] + points[own] @ self.factor.T
        return points

    def log_density(self, points: np.ndarray) -> np.ndarray:
        from scipy.linalg import solve_triangular
        from scipy.spatial.distance import cdist
        from scipy.special import logsumexp

        scaled, centres = (
            solve_triangular(self.factor, points_.T, lower=True).T
            for points_ in (points, self.centres)
        )
        squares = cdist(scaled, centres, "sqeuclidean")
        volume = np.log(np.diag(self.factor)).sum() + points.shape[1] / 2 * np.log(2 * np.pi)
        kernels = logsumexp(-squares / 2, axis=1, b=self.weight) - volume
        return np.logaddexp(np.log(DEFENSIVE) + _log_prior(points), np.log(1 - DEFENSIVE) + kernels)


def _log_prior(points: np.ndarray) -> np.ndarray:
    return -(points**2).sum(axis=1) / 2 - points.shape[1] / 2 * np.log(2 * np.pi)


def normalised(logs: np.ndarray) -> np.ndarray:
    """Weights that add up to 1, from logarithms; all 0 if none is finite."""
    if not np.isfinite(logs).any():
        return np.zeros(logs.size)
    weights = np.exp(logs - logs[np.isfinite(logs)].max())
    return weights / weights.sum()


def effective(weight: np.ndarray) -> float:
    """Number of equally weighted points with equal information (Kong 1992)."""
    return float(1 / (weight**2).sum()) if weight.any() else 0.0
