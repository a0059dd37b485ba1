# SPDX-License-Identifier: BSD-3-Clause
"""Causes of the variance of a result: the finite number of boulders, and the uncertain inputs.

A run gives Y = f(X) + e: f is the result for infinitely many boulders with the inputs X, and e is
the error due to their finite number. The variance of e is the Monte Carlo variance; the variance
of f is the epistemic variance.

Each block of runs has its own inputs and boulders. Within a block the same boulders are simulated
with A and B, two independent draws of all inputs, and with A_i, which has input i from B and all
other inputs from A. Equal boulders behave similarly but not identically, so the errors of two runs
P and Q in a block are correlated. Hence

    E (Y_P - Y_Q)^2     = E (f_P - f_Q)^2 + Var e_P + Var e_Q - 2 Cov(e_P, e_Q)
    E Y_B (Y_Ai - Y_A)  = E f_B (f_Ai - f_A) + Cov(e_B, e_Ai) - Cov(e_B, e_A)

These covariances are known from the boulders of the two runs (see `deviations`). After subtracting
them, the estimators of Saltelli et al. (2010) and Jansen (1999) are unbiased for f, for any number
of boulders.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rockfall.analysis.precision.intervals import Sources
from rockfall.kernel_rules import Z

MIN_CROSSED = 20  # minimum boulders at a line for their mean
MIN_ABOVE = 5  # minimum boulders above a quantile
RESAMPLES = 500  # resamples of the blocks, for standard errors
RESOLVED = 0.25  # maximum half-width of the 95 % interval of a resolved index


def deviations(values: np.ndarray, name: str, row: dict[str, float], source: Sources) -> np.ndarray:
    """Deviations (boulders,) that give the error of a result: their scalar product with the
    deviations in another run of the same boulders is the covariance of the errors, their sum of
    squares the variance. NaN if too few boulders crossed.

    `values` are the boulders' values at a line (NaN if they did not cross), `row` their
    `line_numbers`; `name` is fraction, mean, or a quantile such as q95.

    To first order, a result deviates by the mean influence of its boulders (Hampel 1974). Each
    source is a stratum, because other samples would have the same sources.
    """
    crossed = ~np.isnan(values)
    if name == "fraction":
        influence = crossed - row["fraction"]
    else:
        fraction = row["fraction"] or np.nan
        influence = np.where(crossed, _conditional(values, name, row), 0.0) / fraction
    return _apart(influence, source)


def _conditional(values: np.ndarray, name: str, row: dict[str, float]) -> np.ndarray | float:
    """Influence of each crossing boulder on a mean or quantile.

    The influence on a quantile depends on the density there, estimated from boulders within one
    standard error of its rank (Siddiqui 1960). With 500 to 2000 boulders its variance is
    overestimated by up to a third.
    """
    if name == "mean":
        return values - row["mean"] if row["n"] >= MIN_CROSSED else np.nan
    level = float(name[1:]) / 100
    if row["n"] * (1 - level) < MIN_ABOVE:
        return np.nan
    error = np.sqrt(level * (1 - level) / row["n"])
    low, high = np.nanquantile(values, [level - error, level + error])
    return (level - (values <= row[name])) * (high - low) / (2 * error)


def _apart(numbers: np.ndarray, source: Sources) -> np.ndarray:
    """Values minus the mean of their stratum, scaled so that the sum of their squares is the
    variance of the overall mean; NaN for a stratum with a single boulder."""
    n = source.released
    mean = np.bincount(source.stratum, numbers, n.size) / np.maximum(n, 1)
    few = np.where(n > 1, np.sqrt(n / np.maximum(n - 1, 1)), np.nan)
    return (numbers - mean[source.stratum]) * few[source.stratum] / numbers.size


class Parts(NamedTuple):
    """Parts of the variance, each of shape (..., results)."""

    monte_carlo: np.ndarray  # due to the boulders in a run
    epistemic: np.ndarray
    first: np.ndarray  # (inputs, results): epistemic variance that knowing the input would remove
    total: np.ndarray  # (inputs, results): epistemic variance left if all other inputs were known


def parts(y: np.ndarray, covariance: np.ndarray) -> Parts:
    """Unbiased parts of the variance, from results (blocks, 2 + inputs, results) of the runs A, B,
    A_1, A_2 ..., and error covariances (blocks, 2 + inputs, 2 + inputs, results).

    The epistemic variance is the variance over all A and B minus the Monte Carlo variance. The
    errors within a block are correlated; this affects one of the (2 blocks - 1) pairs to which a
    run belongs. In the first-order part (Saltelli et al. 2010) the mean of the other blocks is
    subtracted from Y_B, which reduces the variance without changing the expectation. The total part
    follows Jansen (1999).
    """
    a, b, mixed = y[:, 0], y[:, 1], y[:, 2:]
    pairs, two = 2 * len(y), y[:, :2].reshape(2 * len(y), -1)
    own = np.einsum("brrq->brq", covariance)
    monte_carlo = own[:, :2].mean(axis=(0, 1))
    shared = covariance[:, 0, 1].mean(axis=0)
    epistemic = two.var(axis=0, ddof=1) - monte_carlo + shared / (pairs - 1)
    change = mixed - a[:, None]
    others = (two.sum(axis=0) - a - b) / (pairs - 2)
    first = (b - others)[:, None] * change - covariance[:, 1, 2:] + covariance[:, 1, :1]
    total = change**2 - own[:, 2:] - own[:, :1] + 2 * covariance[:, 0, 2:]
    return Parts(monte_carlo, epistemic, first.mean(axis=0), total.mean(axis=0) / 2)


class Indices(NamedTuple):
    """Parts, Sobol' indices and standard errors; NaN without a significant variance."""

    parts: Parts
    epistemic_error: np.ndarray  # standard error of the epistemic variance
    first: np.ndarray
    first_error: np.ndarray
    total: np.ndarray
    total_error: np.ndarray


def indices(y: np.ndarray, covariance: np.ndarray) -> Indices:
    """First-order and total Sobol' indices: parts as fractions of the epistemic variance.

    Standard errors come from resampled blocks (Efron 1979); for indices, the ratio is linearised.
    Blocks are assumed independent, so the errors of an evenly distributed design are smaller. An
    index is given if the epistemic variance is significantly above zero (95 %).
    """
    estimate = parts(y, covariance)
    random = np.random.default_rng(0)
    picks = random.integers(len(y), size=(RESAMPLES, len(y)))
    again = [parts(y[pick], covariance[pick]) for pick in picks]
    epistemic = np.array([parts.epistemic for parts in again])
    error = epistemic.std(axis=0)
    significant = np.where(estimate.epistemic > Z * error, estimate.epistemic, np.nan)
    both = []
    for name in ("first", "total"):
        index = getattr(estimate, name) / significant
        part = np.array([getattr(resampled, name) for resampled in again])
        both += [index, (part - index * epistemic[:, None]).std(axis=0) / significant]
    return Indices(estimate, error, *both)


def limits(value: float, error: float) -> tuple[float, float, float]:
    """An index and its 95 % interval, clipped to the range 0 to 1; NaN (undecided) if the interval
    is longer than 0.5."""
    half = Z * error
    if not half <= RESOLVED:
        return np.nan, np.nan, np.nan
    value = min(max(value, 0.0), 1.0)
    return value, max(value - half, 0.0), min(value + half, 1.0)


def runs_needed(error: np.ndarray, runs: int) -> int:
    """Number of draws needed to resolve the least certain index, from standard errors after `runs`
    draws."""
    return int(np.ceil(runs * (Z * np.nanmax(error) / RESOLVED) ** 2))
