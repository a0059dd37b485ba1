# SPDX-License-Identifier: BSD-3-Clause
"""Contribution of each data set to the posterior, and conflicts between data sets.

For set k with the log-likelihood l_k, the posterior from this set alone weights the same members
by this likelihood. Combining it with the other sets causes the loss E_alone(l_k) - E(l_k). If the
likelihoods are normal and the sets agree, the expected loss is 0, and twice the loss plus d is at
most chi-square distributed with d degrees of freedom (the number of parameters). Beyond the 95 %
quantile the set conflicts with the others. Each member has its own boulders, so the standard error
of the loss, from the weighted members, includes the variation between seeds. If the 95 % interval
of the loss contains the limit, the verdict is undecided.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rockfall.studies.back.sampling import effective, normalised
from rockfall.studies.back.smoothing import smoothed

LEVEL = 0.95
SIGMAS = 1.96  # standard errors in half a 95 % interval
FEWEST = 10.0  # minimum effective members from a data set alone, for a verdict
AGREES, CONFLICT, UNDECIDED = "agrees", "conflict", "undecided"


class Contribution(NamedTuple):
    """Weights of the members from a data set alone, its loss in combination with the others, the
    standard error of the loss, and the verdict ("" for a single set)."""

    alone: np.ndarray
    loss: float
    error: float
    verdict: str

    def record(self) -> dict[str, Any]:
        """Columns of the data set in `Back.data`."""
        worth = effective(self.alone)
        return {"loss": self.loss, "loss_error": self.error, "alone_effective": worth,
                "agreement": self.verdict}  # fmt: skip


def contributions(
    points: np.ndarray,
    levels: np.ndarray,
    log_prior_weights: np.ndarray,
    weight: np.ndarray,
    log_likelihood: np.ndarray,
) -> list[Contribution]:
    """Contribution of each data set, from log-likelihoods (sets, members) in which dependent data
    are down-weighted. `points` (members, parameters) and `levels` belong to a `Sampler`;
    `log_prior_weights` are log weights without a likelihood; `weight` are the weights from all
    sets."""
    parameters, contributions = points.shape[1], []
    for data_name in log_likelihood:
        alone = normalised(log_prior_weights + smoothed(points, levels, data_name))
        loss, error = loss_of(data_name, alone, weight)
        verdict = ""
        if len(log_likelihood) > 1:
            verdict = UNDECIDED
            if min(effective(alone), effective(weight)) >= FEWEST:
                verdict = verdict_of(loss, error, parameters)
        contributions.append(Contribution(alone, loss, error, verdict))
    return contributions


def loss_of(values: np.ndarray, alone: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """Mean log-likelihood with weights `alone` minus that with `weight`, and its standard error.

    >>> loss_of(np.array([0.0, -2.0]), np.array([0.5, 0.5]), np.array([0.0, 1.0]))[0]
    1.0
    """
    # infinite log-likelihoods have weight 0
    finite = np.where(np.isfinite(values), values, 0.0)
    first, second = float(alone @ finite), float(weight @ finite)
    error = np.sqrt(((alone * (finite - first) - weight * (finite - second)) ** 2).sum())
    return first - second, float(error)


def verdict_of(loss: float, error: float, parameters: int) -> str:
    """Verdict on the loss of a data set in combination with the others.

    >>> verdict_of(9.0, 1.0, 2), verdict_of(0.1, 0.2, 2), verdict_of(2.0, 1.0, 2)
    ('conflict', 'agrees', 'undecided')
    """
    from scipy.stats import chi2

    limit = (chi2.ppf(LEVEL, parameters) - parameters) / 2
    if loss - SIGMAS * error > limit:
        return CONFLICT
    return AGREES if loss + SIGMAS * error < limit else UNDECIDED
