# SPDX-License-Identifier: BSD-3-Clause
"""Return levels: the value exceeded by one in N boulders, extrapolated beyond the sample.

The largest of n values grows with n. This module estimates the level that one in N of the passing
boulders exceeds, from a generalised Pareto distribution (GPD) of the values above a high threshold
(Pickands 1975; Coles 2001, chapter 4). It is refused where the data do not support it. Boulders of
common sources count as their effective number of independent ones.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.analysis.generalised_pareto import Fit, best_of, fit_gpd, lowest_valid
from rockfall.analysis.line_statistics import with_limits
from rockfall.analysis.lines.samples import LineSamples
from rockfall.analysis.precision.intervals import Sources
from rockfall.analysis.precision.samples import Sample, Values
from rockfall.errors import RockfallError
from rockfall.kernel_rules import Z
from rockfall.language import say
from rockfall.result.crossings import chosen_lines
from rockfall.simulation.progress import stepped

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

LEVELS = (1000, 10_000, 100_000)
QUANTITIES = (
    "speed",
    "jump_height",
    "passing_height",
    "energy_translational",
    "energy_rotational",
    "energy_total",
)
UPPER = 0.05  # fraction above the lowest threshold; with 0.1 and 0.25 levels are biased
MIN_ABOVE, MAX_ABOVE = 50, 2000  # independent boulders above a threshold
THRESHOLDS = 12  # tried
ENOUGH = 25  # independent boulders beyond a level that make a tail unnecessary
MAX_PERIOD = 10  # maximum period over the number of independent boulders
MAX_SHAPE = 0.5  # absolute value: theory of the fit (-0.5) and variance (+0.5) end there
BARTLETT = 12  # over the number above the threshold: see _profiled
MAX_HIGH = 3  # maximum ratio of the upper limit to the level


class Level(NamedTuple):
    """Value exceeded by one in N boulders, with its 95 % interval; NaN if `refused`."""

    value: float = np.nan
    low: float = np.nan
    high: float = np.nan
    refused: str | None = None


@dataclass(frozen=True)
class Tail:
    """Upper tail of a sample: the GPD above the chosen threshold and the levels of each N.

    `tried` holds the fits above all thresholds, from the lowest. If `refused` gives a reason,
    levels are only those within the sample, and `fit` may be None.
    """

    n: int
    independent: float
    tried: tuple[Fit, ...]
    fit: Fit | None
    refused: str | None
    levels: dict[int, Level]
    end: tuple[float, float] = (np.inf, np.inf)  # end point and its upper limit; no value is beyond

    @property
    def shape_limits(self) -> tuple[float, float]:
        """95 % confidence interval of the shape (Smith 1985)."""
        assert self.fit is not None
        error = (1 + self.fit.shape) / np.sqrt(self.fit.exceedances * self.independent / self.n)
        return self.fit.shape - Z * error, self.fit.shape + Z * error


def return_levels(
    result: xr.Dataset,
    levels: Sequence[int] = LEVELS,
    lines: Sequence[str | int] | None = None,
) -> pd.DataFrame:
    """One row for each line (or each of the `lines`, given by name or index) and quantity, in the
    units of the result: n, max and `level_N`, the
    value exceeded by one in N of the boulders that pass, with the limits of its 95 % interval; the
    GPD behind it (threshold, boulders above it, shape with its limits, scale, p of the fit, the
    upper end point of the tail and its upper limit); NaN if refused, for the reason in `refused`,
    else empty.

    Levels that at least 25 boulders exceed are quantiles of the sample.

    >>> import rockfall
    >>> result = rockfall.run(rockfall.read_case("case.nml"))
    >>> table = rockfall.return_levels(result, levels=[10, 100])
    """
    import pandas as pd

    _check(levels)
    samples = LineSamples(result)
    rows = []
    for k, line in stepped(chosen_lines(result, lines)):
        for quantity in QUANTITIES:
            row = _row(*tail_at(samples, k, quantity, levels))
            rows.append({"line": line, "quantity": quantity, **row})
    limits = [name for N in levels for name in with_limits(f"level_{N}")]
    return pd.DataFrame(rows, columns=["line", "quantity", "n", "max", *limits, *_FIT, "refused"])


_FIT = ["threshold", "exceedances", *with_limits("shape"), "scale", "p_value", "end", "end_high"]


def _row(sample: Sample, tail: Tail) -> dict[str, float | str]:
    """A row of `return_levels`."""
    row: dict[str, float | str] = {"n": tail.n}
    row["max"] = sample.max() if tail.n else np.nan
    for N, level in tail.levels.items():
        row |= zip(with_limits(f"level_{N}"), level[:3], strict=True)
    if tail.fit:
        row |= tail.fit._asdict()
        row["shape_low"], row["shape_high"] = tail.shape_limits
        row["end"], row["end_high"] = tail.end
    alone = [
        say("level.alone", N=N, reason=level.refused)
        for N, level in tail.levels.items()
        if level.refused
    ]
    # a text in every row: pandas versions differ on missing texts
    row["refused"] = tail.refused or "; ".join(alone)
    return row


def tail(values: np.ndarray, source: Sources | None = None, levels: Sequence[int] = LEVELS) -> Tail:
    """Upper tail of the values (>= 0) of boulders; `source` is that of each, as from
    `rockfall.analysis.precision.intervals.sources`, None = one source."""
    return tail_of(Values(values, Sources.alone(values.size) if source is None else source), levels)


def tail_at(
    samples: LineSamples, line: int, quantity: str, levels: Sequence[int] = LEVELS
) -> tuple[Sample, Tail]:
    """Sample of a quantity at the line with this index, and its cached upper tail."""
    sample = samples.sample(line, quantity)
    kept = samples.kept(line)
    key = quantity, tuple(levels)
    if key not in kept:
        kept[key] = tail_of(sample, levels)
    return sample, kept[key]


def tail_of(sample: Sample, levels: Sequence[int] = LEVELS) -> Tail:
    """Upper tail of a sample; see `tail`."""
    _check(levels)
    n, independent = sample.n, 0.0
    if n:
        upper = sample.quantile([1 - UPPER])[0]
        independent = min(n, sample.effective_below(upper))
    tried = tuple(_tried(sample, independent))
    fit = lowest_valid(tried)
    refused = _refusal(tried, fit, independent)
    made = _rising({N: _level(N, sample, independent, tried, fit, refused) for N in levels})
    end = (np.inf, np.inf)
    if fit and not refused:
        end = _end(sample.largest(fit.exceedances) - fit.threshold, fit, independent / n)
    return Tail(n, independent, tried, fit, refused, made, end)


def _tried(sample: Sample, independent: float) -> Iterator[Fit]:
    """Fits above increasing thresholds, with decreasing numbers of exceedances; a sample of few
    independent boulders may lack the values above the lowest thresholds.
    """
    n, available = sample.n, UPPER * independent
    if available < MIN_ABOVE:
        return
    numbers = np.geomspace(min(available, MAX_ABOVE), MIN_ABOVE, THRESHOLDS) * n / independent
    places = np.round(numbers).astype(int)
    ordered = sample.largest(int(places[0]) + 1)
    for threshold in np.unique(ordered[ordered.size - 1 - places[places < ordered.size]]):
        excess = ordered[ordered > threshold] - threshold
        if excess.size * independent >= MIN_ABOVE * n * 0.99:
            yield fit_gpd(excess, threshold, independent / n)


def _end(excess: np.ndarray, fit: Fit, weight: float) -> tuple[float, float]:
    """Upper end point with its upper 95 % limit (profile likelihood); both may be infinite."""
    theta = fit.shape / fit.scale
    lowest = best_of(theta, excess)[2]

    def excess_cost(other: float) -> float:
        loss = best_of(other, excess)[2] - lowest
        return loss * excess.size * weight - Z**2 / 2

    nothing = -1e-9 / excess.max()
    if theta >= nothing or excess_cost(nothing) < 0:
        return np.inf, np.inf
    from scipy.optimize import brentq

    last = brentq(excess_cost, theta, nothing, xtol=1e-12 / excess.max())
    return fit.threshold - 1 / theta, fit.threshold - 1 / last


def _refusal(tried: Sequence[Fit], fit: Fit | None, independent: float) -> str | None:
    """Reason for refusing a tail; None if valid."""
    if not tried and UPPER * independent >= MIN_ABOVE:
        return say("level.ties", needed=MIN_ABOVE)
    if not tried:
        return say("level.too_few", known=UPPER * independent, needed=MIN_ABOVE)
    if fit is None:
        return say("level.no_threshold")
    if fit.shape >= MAX_SHAPE:
        return say("level.too_heavy", shape=fit.shape)
    if fit.shape <= -MAX_SHAPE:
        return say("level.too_sharp", shape=fit.shape)
    return None


def _rising(levels: dict[int, Level]) -> dict[int, Level]:
    """Levels that rise with N: some come from the sample, others from its tail."""
    least: tuple[float, ...] = (-np.inf,) * 3
    rising = dict(levels)
    for N in sorted(levels):
        if not levels[N].refused:
            least = tuple(map(float, np.fmax(levels[N][:3], least)))
            rising[N] = Level(*np.where(np.isnan(levels[N][:3]), np.nan, least).tolist())
    return rising


def _level(
    N: int,
    sample: Sample,
    independent: float,
    tried: Sequence[Fit],
    fit: Fit | None,
    refused: str | None,
) -> Level:
    """Level exceeded by one in N: from the sample if enough values lie beyond, else from the tail.
    The interval covers those above the chosen and the highest threshold, because a misfit
    undetected in few values may still shift the level (heights of cases/vaujany: 89 % coverage
    without, 93 % with)."""
    below = 1 - 1 / N
    if independent >= ENOUGH * N:
        return Level(sample.quantile([below])[0], *sample.between(below, independent))
    if refused:
        return Level(refused=refused)
    if N > MAX_PERIOD * independent:
        return Level(refused=say("level.too_long", times=MAX_PERIOD))
    assert fit is not None  # or it would be refused
    level = _profiled(N, sample, independent, fit)
    if tried[-1].shape > -MAX_SHAPE and tried[-1] is not fit:
        other = _profiled(N, sample, independent, tried[-1])
        level = Level(level.value, min(level.low, other.low), max(level.high, other.high))
    if level.high > MAX_HIGH * level.value:
        return Level(refused=say("level.too_wide", times=MAX_HIGH))
    return level


def _profiled(N: int, sample: Sample, independent: float, fit: Fit) -> Level:
    """Level of a GPD with its 95 % profile-likelihood interval (Coles 2001, section 4.3.3),
    including the binomial uncertainty of the fraction above the threshold. The likelihood is scaled
    to the independent boulders (Chandler and Bate 2007). Bartlett's factor, measured on GPD
    samples, corrects for few values: without it intervals from 50 cover 92 to 94 %."""
    n, k = sample.n, fit.exceedances
    excess = sample.largest(k) - fit.threshold
    further = np.log(N * k / n)  # log distance above the level for 1 in N
    value = fit.threshold + fit.scale * np.expm1(fit.shape * further) / fit.shape
    log_n, top, reach = math.log(N), float(excess[-1]), math.log(k)
    sums: dict[float, float] = {}

    def best_of(theta: float, above: float) -> float:
        """Negative log-likelihood, minimised over the shape, for a level at a given height above
        the threshold and theta = shape / scale: log((1 + theta above)) / shape is the logarithm of
        the fraction above the threshold over 1/N. Convex in 1 / shape: by Newton."""
        if theta not in sums:
            sums[theta] = float(np.log1p(theta * excess).sum())
        sign = math.copysign(1.0, theta)
        grown, total = sign * math.log1p(theta * above), sign * sums[theta]
        most = log_n / grown  # 1 / shape at which every boulder lies above the threshold
        slope = total - k * grown
        inverse = min(further / grown, 0.99 * most)
        for _ in range(50):
            odds = 1 / math.expm1(log_n - inverse * grown)
            first = -k / inverse + slope + (n - k) * grown * odds
            second = k / inverse**2 + (n - k) * grown**2 * odds * (1 + odds)
            step = first / second
            inverse = min(max(inverse - step, 0.1 * inverse), 0.5 * (inverse + most))
            if abs(step) < 1e-6 * inverse:
                break
        beyond = math.log(-math.expm1(inverse * grown - log_n))
        scale = -math.log(inverse * abs(theta))
        return k * (scale + log_n) + slope * inverse + sign * total - (n - k) * beyond

    def theta_at(place: float) -> float:
        """Transform the search variable as in `fit_gpd`."""
        theta = math.expm1(place * reach)
        return (theta if abs(theta) > 1e-9 else 1e-9) / top

    from scipy.optimize import brentq, minimize_scalar

    lowest = best_of(fit.shape / fit.scale, value - fit.threshold)
    allowed = Z**2 / 2 * (1 + BARTLETT * n / (k * independent))

    @cache  # the ends of brackets are needed twice
    def excess_cost(level: float) -> float:
        above = level - fit.threshold  # the tail may not end before the level
        end = max(-1.0, math.log1p(-top / max(above, (1 + 1e-9) * top)) / reach)
        optimum = minimize_scalar(
            lambda place: best_of(theta_at(place), above), bounds=(end, 2), method="bounded",
            options={"xatol": 1e-5},
        )  # fmt: skip
        return (optimum.fun - lowest) * independent / n - allowed

    low = brentq(excess_cost, fit.threshold + 1e-3 * (value - fit.threshold), value, rtol=1e-5)
    if excess_cost(MAX_HIGH * value) < 0:
        return Level(value, low, np.inf)
    return Level(value, low, brentq(excess_cost, value, MAX_HIGH * value, rtol=1e-5))


def _check(levels: Sequence[int]) -> None:
    for N in levels:
        if not (isinstance(N, int | np.integer) and N > 1):
            raise RockfallError(f"levels: {N}: must be integers > 1")
