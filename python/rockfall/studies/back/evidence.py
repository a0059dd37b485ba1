# SPDX-License-Identifier: BSD-3-Clause
"""Likelihood of observations given the boulders of a run, and a test of whether a run explains
them.

Quantiles of the observed boulders define bins. Bin k contains s_k of the S simulated boulders and
c_k observed boulders. Bin frequencies are known only from the simulated boulders, so with
Jeffreys' prior (1/2 for each bin) the observed counts have the Dirichlet-multinomial probability

    p(c | s) ~ B(c + s + 1/2) / B(s + 1/2),    B(a) = prod Gamma(a_k) / Gamma(sum a_k)

which includes the Monte Carlo noise of the run: with few boulders it is flat. For a published mean
and standard deviation, the probabilities are normal, with the sampling errors of both values.

Inputs that are drawn for each member but are not parameters, such as terrain errors, add
differences between runs with the same parameters. Replicates measure these differences as an
equivalent smaller number of boulders, S'. The member and the field each have such a deviation, so
the s_k count as 1/(2/S' - 1/S) boulders.

Dependent data sets, such as speed and energy, are divided by the sum of squared rank correlations
with all sets (including the set itself) among the simulated boulders. Blocks at rest without a
known release, and marks, come from other boulders and count fully.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from rockfall.analysis.observed.compare import check_lines
from rockfall.analysis.observed.deposits import MIN_FITTED, at_rest, witnesses
from rockfall.analysis.observed.marks import Mark
from rockfall.analysis.observed.observations import Observed
from rockfall.analysis.observed.run_out import (
    Frame,
    cell_of,
    compared,
    frames,
    observed_boulders,
    way_of,
)
from rockfall.errors import RockfallError
from rockfall.result.crossings import line_names, line_values
from rockfall.studies.back.deposited import Deposited
from rockfall.studies.back.marked import Marked
from rockfall.studies.back.witnesses import worth_of

#: Values of the boulders in a result; NaN if a boulder has none.
Take = Callable[[xr.Dataset], np.ndarray]

MIN_CROSSED = 20  # minimum simulated boulders for a run to explain observed boulders
PRIOR = 0.5  # Jeffreys' prior for each bin
MAX_BINS = 6
REPLICATES = 1000
MIN_PRINTED = 2  # minimum boulders behind a published mean


@dataclass
class Counted:
    """Observed boulder values, as counts in bins.

    Methods: `kept` returns the data to keep from a run, `counted` the counts of its values,
    `log_likelihood` a value for each row of kept data (runs, kept), and `remarks` notes on the
    data and the weighted runs. `discrepancy` returns the distance from the weighted prediction of
    all runs, for the data and for an equal number of boulders from selected runs.
    """

    name: str
    values: np.ndarray
    take: Take
    edges: np.ndarray = field(init=False)
    counts: np.ndarray = field(init=False)
    worth: float = 1.0  # weight of a simulated boulder; < 1 if runs with equal inputs differ

    def __post_init__(self) -> None:
        bins = int(np.clip(round(2 * self.n**0.4), 2, MAX_BINS))
        levels = np.arange(1, bins) / bins
        self.edges = np.unique(np.quantile(self.values, levels, method="hazen"))
        self.counts = self._in_bins(self.values)

    @property
    def n(self) -> int:
        return self.values.size

    def _in_bins(self, values: np.ndarray) -> np.ndarray:
        """Number of boulders in each bin; a boulder on an edge counts half in both bins."""
        sides = [np.searchsorted(self.edges, values, side) for side in ("left", "right")]
        both = [np.bincount(side, minlength=self.edges.size + 1) for side in sides]
        return (both[0] + both[1]) / 2

    def kept(self, result: xr.Dataset) -> np.ndarray:
        return self.counted(self.take(result))

    def remarks(self, runs: np.ndarray, weight: np.ndarray) -> list[str]:
        return []

    def counted(self, values: np.ndarray) -> np.ndarray:
        return self._in_bins(values[~np.isnan(values)])

    def log_likelihood(self, runs: np.ndarray) -> np.ndarray:
        from scipy.special import gammaln

        alpha = self.worth * runs + PRIOR
        likelihood = (gammaln(alpha + self.counts) - gammaln(alpha)).sum(axis=1)
        total = alpha.sum(axis=1)
        likelihood -= gammaln(total + self.counts.sum()) - gammaln(total)
        return np.where(runs.sum(axis=1) >= MIN_CROSSED, likelihood, -np.inf)

    def learn_noise(self, runs: np.ndarray) -> None:
        """Set the weight of a simulated boulder, from repeated runs with equal inputs."""
        size = runs.sum(axis=1).mean()
        if not size:
            return
        part = runs / runs.sum(axis=1, keepdims=True)
        mean = part.mean(axis=0)
        # variance relative to a binomial distribution
        times = size * part.var(axis=0, ddof=1).sum() / (mean * (1 - mean)).sum()
        self.worth = worth_of(times)

    def noise(self, boulders: float) -> float:
        """Variance of the log-likelihood due to the number of boulders in a run, to first order."""
        return (self.counts.size - 1) * self.n / (self.worth * boulders + self.n)

    def discrepancy(
        self, runs: np.ndarray, picked: np.ndarray, weight: np.ndarray, random: np.random.Generator
    ) -> tuple[float, np.ndarray]:
        alpha = self.worth * runs + PRIOR
        expected = self.n * (weight @ (alpha / alpha.sum(axis=1, keepdims=True)))
        again = [random.multinomial(self.n, random.dirichlet(row)) for row in alpha[picked]]
        far = ((np.array([self.counts, *again]) - expected) ** 2 / expected).sum(axis=1)
        return far[0], far[1:]


class Passing(Counted):
    """Observed fractions that travel at least each distance, and the number of boulders behind
    them; see `Counted`."""

    def __init__(self, name: str, distance: np.ndarray, fraction: np.ndarray, n: int, take: Take):
        self.name, self.take, self.edges, self.worth = name, take, distance, 1.0
        self.counts = -np.diff(np.array([1.0, *fraction, 0.0])) * n
        self.values = np.full(n, np.nan)


@dataclass
class Printed:
    """Published mean, and standard deviation if known, with the number of boulders; see
    `Counted`."""

    name: str
    mean: float
    std: float
    n: int
    take: Take
    worth: float = 1.0

    def kept(self, result: xr.Dataset) -> np.ndarray:
        return self.counted(self.take(result))

    def remarks(self, runs: np.ndarray, weight: np.ndarray) -> list[str]:
        return []

    def counted(self, values: np.ndarray) -> np.ndarray:
        values = values[~np.isnan(values)]
        if values.size < MIN_CROSSED or not np.ptp(values):
            return np.array([values.size, np.nan, np.nan, np.nan])
        apart = values - values.mean()
        std = values.std(ddof=1)
        return np.array([values.size, values.mean(), std, (apart**4).mean() / std**4])

    def learn_noise(self, runs: np.ndarray) -> None:
        """Set the weight of a simulated boulder, from repeated runs with equal inputs."""
        size, mean, std, _ = runs.T
        times = mean.var(ddof=1) / (std**2 / size).mean()
        self.worth = worth_of(times) if np.isfinite(times) else 1.0

    def noise(self, boulders: float) -> float:
        """Variance of the log-likelihood due to the number of boulders in a run, to first order."""
        return 2 * self.n / (self.worth * boulders + self.n)

    def _standing(self, runs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Expected mean and log standard deviation (runs, 1 or 2), and the joint sampling errors of
        observed and simulated values (Bonett 2006, to first order)."""
        size, mean, std, kurtosis = runs.T
        fewer = 1 / self.n + 1 / (self.worth * np.maximum(size, 1))
        expected = np.stack([mean, np.log(std)], axis=1)
        error = np.stack([std * np.sqrt(fewer), np.sqrt((kurtosis - 1) / 4 * fewer)], axis=1)
        n_known = 2 if self.std > 0 and self.n > MIN_PRINTED else 1
        return expected[:, :n_known], error[:, :n_known]

    def _observed(self, n_known: int) -> np.ndarray:
        return np.array([self.mean, np.log(self.std) if n_known > 1 else 0.0])[:n_known]

    def log_likelihood(self, runs: np.ndarray) -> np.ndarray:
        expected, error = self._standing(runs)
        apart = (self._observed(expected.shape[1]) - expected) / error
        return np.nan_to_num(-(apart**2 / 2 + np.log(error)).sum(axis=1), nan=-np.inf)

    def discrepancy(
        self, runs: np.ndarray, picked: np.ndarray, weight: np.ndarray, random: np.random.Generator
    ) -> tuple[float, np.ndarray]:
        expected, error = self._standing(runs)
        is_weighted = weight > 0
        centre = weight[is_weighted] @ expected[is_weighted]
        scale = np.sqrt(
            weight[is_weighted] @ (error[is_weighted] ** 2 + (expected[is_weighted] - centre) ** 2)
        )
        again = random.normal(expected[picked], error[picked])
        observed = self._observed(expected.shape[1])
        far = (((np.array([observed, *again]) - centre) / scale) ** 2).sum(axis=1)
        return far[0], far[1:]


Evidence = Counted | Printed | Deposited | Marked


def evidence(
    result: xr.Dataset, seen: Observed, marks: list[Mark]
) -> tuple[list[Evidence], list[str]]:
    """Data sets for a back-analysis, and notes on unusable data; `result` is a run of the case with
    a line at each mark. Raises a RockfallError without usable data, or if too few boulders come
    to rest for the density at the blocks."""
    notes: list[str] = []
    data = [
        *_of_stops(result, seen, notes),
        *_of_witnesses(result, seen, notes),
        *_of_lines(result, seen, notes),
    ]
    if marks:
        data.append(Marked.of_run(marks, result))
    if seen.contacts is not None and len(marks) < len(seen.contacts):
        which = f"{len(seen.contacts) - len(marks)} of {len(seen.contacts)} impacts are"
        notes.append(
            f"{which if marks else 'Impacts are'} not used: they lack a height above the ground, "
            "and unseen impacts are unknown."
        )
    if not data:
        raise RockfallError(
            " ".join(["the observations contain nothing that a back-analysis can use.", *notes])
        )
    return data, notes


def _of_stops(result: xr.Dataset, seen: Observed, notes: list[str]) -> Iterator[Evidence]:
    if seen.stops is not None and (difference := compared(result, seen)[1]):
        notes.append(difference)
    stops, several = observed_boulders(result, seen), len(frames(result, seen)) > 1
    if stops is not None and not frames(result, seen):
        yield Counted("stopping distance", stops.values[:, 0], _distance)
    elif stops is not None:
        for source, frame in frames(result, seen).items():
            own = stops.of(source).values
            name = f", source {frame.name}" if several else ""
            for column, label in enumerate(("stopping distance", "lateral offset")):
                yield Counted(f"{label}{name}", own[:, column], _way(frame, source, column))
    if seen.passing is not None and stops is None:
        if np.isnan(seen.passing_n):
            notes.append(
                "Passing fractions are not used: column n with the number of boulders is missing."
            )
        else:
            table = seen.passing[seen.passing["distance"] > 0]
            distance, fraction = (table[name].to_numpy(float) for name in ("distance", "fraction"))
            yield Passing("run-out", distance, fraction, int(seen.passing_n), _distance)


def _of_witnesses(result: xr.Dataset, seen: Observed, notes: list[str]) -> Iterator[Evidence]:
    """Data from blocks at rest without a known release; refuses runs in which too few boulders come
    to rest."""
    sets = witnesses(result, seen)
    for blocks in sets:
        if (n := len(at_rest(result, blocks).place)) < MIN_FITTED:
            place = f" of source {blocks.source}" if blocks.source else ""
            raise RockfallError(
                f"{n} boulders{place} of a run come to rest on the terrain: at least {MIN_FITTED} "
                "are required: give more --boulders, or a larger terrain"
            )
    if sets:
        deposited = Deposited.of_run(sets, result, cell_of(result))
        if seen.volumes is not None and all(
            np.isinf(kernel.of_volume) for kernel in deposited.kernels
        ):
            notes.append(
                "Volumes of the blocks are not used: all boulders of the case have the same volume."
            )
        if seen.shapes is not None and not any(kernel.by_shape for kernel in deposited.kernels):
            notes.append(
                "Shapes of the blocks are not used: all boulders of the case have the same shape."
            )
        yield deposited


def _distance(result: xr.Dataset) -> np.ndarray:
    return result["plan_distance"].values


def _way(frame: Frame, source: int, column: int) -> Take:
    return lambda result: way_of(result, frame, source, column)


def _of_lines(result: xr.Dataset, seen: Observed, notes: list[str]) -> Iterator[Evidence]:
    names = line_names(result)
    check_lines(seen, names, "case")
    for (line, quantity), values in seen.samples.items():
        yield Counted(f"{quantity} at {line}", values, _at_line(names.index(line), quantity))
    for row in seen.summaries[seen.summaries["method"] == "observed"].to_dict("records"):
        name = f"{row['quantity']} at {row['line']}"
        if (row["line"], row["quantity"]) in seen.samples:
            continue
        if not (row["n"] >= MIN_PRINTED and np.isfinite(row["mean"])):
            notes.append(f"The published {name} is not used: mean and n are required.")
            continue
        take = _at_line(names.index(row["line"]), row["quantity"])
        yield Printed(name, row["mean"], row["std"], int(row["n"]), take)


def _at_line(line: int, quantity: str) -> Take:
    return lambda result: line_values(result, quantity, line)


def shares(data: list[Evidence], result: xr.Dataset) -> np.ndarray:
    """Weight of each data set (data,): 1 / (sum of its squared rank correlations with all sets,
    itself included)."""
    from scipy.stats import spearmanr

    values = [item.take(result) if isinstance(item, Counted | Printed) else None for item in data]
    squares = np.eye(len(data))
    for i, a in enumerate(values):
        for j, b in enumerate(values[:i]):
            if a is None or b is None:
                continue
            both = ~(np.isnan(a) | np.isnan(b))
            if both.sum() >= MIN_CROSSED and np.ptp(a[both]) and np.ptp(b[both]):
                squares[i, j] = squares[j, i] = spearmanr(a[both], b[both]).statistic ** 2
    return 1 / squares.sum(axis=1)


def predictive_p(
    data: Evidence, runs: np.ndarray, weight: np.ndarray, random: np.random.Generator
) -> float:
    """Posterior predictive probability that simulated boulders, as many as observed, deviate from
    the prediction at least as much as the observed boulders (Gelman, Meng and Stern 1996); NaN if
    all deviations are equal."""
    picked = random.choice(weight.size, REPLICATES, p=weight)
    observed, again = data.discrepancy(runs, picked, weight, random)
    if np.array_equal(observed, again):  # nothing to compare
        return np.nan
    return (1 + int(np.count_nonzero(again >= observed))) / (1 + REPLICATES)


def as_record(data: Evidence, share: float, p: float) -> dict[str, Any]:
    """Row of a data set in the evidence table."""
    return {"data": data.name, "n": data.n, "counts": share, "predictive_p": p}
