# SPDX-License-Identifier: BSD-3-Clause
"""Return levels: the value that one in N passing boulders exceeds, also beyond the sample.

Levels come from a generalised Pareto distribution (GPD) of the values above a high threshold
(Pickands 1975; Coles 2001, chapter 4). A tail that the data do not support is refused. Boulders
from common sources count as their effective number of independent boulders.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.analysis.generalised_pareto import (
    MAX_PLACE,
    Fit,
    best_of,
    fit_gpd,
    lowest_valid,
    root_of,
    theta_at,
)
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
UPPER = 0.05  # fraction of values above the lowest threshold; 0.1 and 0.25 give biased levels
#: Minimum and maximum number of independent boulders above a threshold.
MIN_ABOVE, MAX_ABOVE = 50, 2000
THRESHOLDS = 12  # number of thresholds tried
ENOUGH = 25  # minimum independent boulders above a level that comes from the sample
MAX_PERIOD = 10  # maximum period divided by the number of independent boulders
MAX_SHAPE = 0.5  # limit of |shape|: the fit theory ends at -0.5, the variance at +0.5
BARTLETT = 12  # Bartlett's factor is 1 + this / number above the threshold (see `_profiled`)
#: Grid of theta, and polynomial degree of the scale: levels are accurate to 1e-5.
POINTS, DEGREE = 64, 16
TINY = 1e-14
MAX_HIGH = 3  # maximum ratio of upper limit to level


class Level(NamedTuple):
    """Value that one in N boulders exceeds, with its 95 % interval; NaN if `refused`."""

    value: float = np.nan
    low: float = np.nan
    high: float = np.nan
    refused: str | None = None


@dataclass(frozen=True)
class Tail:
    """Upper tail of a sample: GPD above the chosen threshold, and level for each N.

    `tried` has the fits above all thresholds, lowest first. If `refused` gives a reason, levels
    are given only within the sample, and `fit` may be None.
    """

    n: int
    independent: float
    tried: tuple[Fit, ...]
    fit: Fit | None
    refused: str | None
    levels: dict[int, Level]
    #: Upper end point and its upper limit; infinite if unbounded.
    end: tuple[float, float] = (np.inf, np.inf)

    @property
    def shape_limits(self) -> tuple[float, float]:
        """95 % confidence interval of the shape (Smith 1985)."""
        assert self.fit is not None
        error = (1 + self.fit.shape) / np.sqrt(self.fit.exceedances * self.independent / self.n)
        return self.fit.shape - Z * error, self.fit.shape + Z * error


def return_levels(
    result: xr.Dataset, levels: Sequence[int] = LEVELS, lines: Sequence[str | int] | None = None
) -> pd.DataFrame:
    """Table with a row for each line (or each of `lines`, by name or index) and quantity, in the
    units of the result: n, max, and `level_N`, the value that one in N passing boulders exceeds,
    with its 95 % limits. Further columns describe the GPD: threshold, number of boulders above it,
    shape with its limits, scale, p-value of the fit, upper end point of the tail and its upper
    limit. Refused values are NaN; `refused` gives the reason, else it is empty.

    Levels that at least 25 independent boulders exceed are quantiles of the sample. Raises
    RockfallError for levels that are not integers above 1.

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
    # Text in every row, because pandas versions differ on missing texts.
    row["refused"] = tail.refused or "; ".join(alone)
    return row


def tail(values: np.ndarray, source: Sources | None = None, levels: Sequence[int] = LEVELS) -> Tail:
    """Upper tail of boulder values (>= 0); `source` gives the source of each, as from
    `rockfall.analysis.precision.intervals.sources` (None: a single source)."""
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
    far = [N for N in levels if independent < ENOUGH * N <= ENOUGH * MAX_PERIOD * independent]
    beyond = {}
    if far and fit and not refused:
        beyond = _beyond(far, sample, independent, fit, tried[-1])
    made = _rising({N: _level(N, sample, independent, beyond, refused) for N in levels})
    end = (np.inf, np.inf)
    if fit and not refused:
        end = _end(sample.largest(fit.exceedances) - fit.threshold, fit, independent / n)
    return Tail(n, independent, tried, fit, refused, made, end)


def _tried(sample: Sample, independent: float) -> Iterator[Fit]:
    """Fits above increasing thresholds, with decreasing numbers of exceedances. A sample with few
    independent boulders may lack the values above the lowest thresholds."""
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
        loss = float(best_of(other, excess)[2] - lowest)
        return loss * excess.size * weight - Z**2 / 2

    nothing = -1e-9 / excess.max()
    if theta >= nothing or excess_cost(nothing) < 0:
        return np.inf, np.inf
    last = root_of(excess_cost, theta, nothing)
    return fit.threshold - 1 / theta, fit.threshold - 1 / last


def _refusal(tried: Sequence[Fit], fit: Fit | None, independent: float) -> str | None:
    """Reason to refuse a tail; None if it is valid."""
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
    """Levels raised where necessary, with their limits, so that they never decrease with N; they
    might, because some come from the sample, others from its tail."""
    least: tuple[float, ...] = (-np.inf,) * 3
    rising = dict(levels)
    for N in sorted(levels):
        if not levels[N].refused:
            least = tuple(map(float, np.fmax(levels[N][:3], least)))
            rising[N] = Level(*np.where(np.isnan(levels[N][:3]), np.nan, least).tolist())
    return rising


def _level(
    N: int, sample: Sample, independent: float, beyond: dict[int, Level], refused: str | None
) -> Level:
    """Level exceeded by one in N, from the sample if enough values exceed it, else the tail."""
    below = 1 - 1 / N
    if independent >= ENOUGH * N:
        return Level(sample.quantile([below])[0], *sample.between(below, independent))
    return beyond.get(N, Level(refused=refused or say("level.too_long", times=MAX_PERIOD)))


def _beyond(
    levels: Sequence[int], sample: Sample, independent: float, fit: Fit, highest: Fit
) -> dict[int, Level]:
    """Levels from the tail. The interval includes the intervals of the fits above the chosen and
    the highest threshold, because an undetected misfit of few values may shift the level (heights
    of cases/vaujany: coverage 93 %, but 89 % with the chosen threshold alone)."""
    made = _profiled(levels, sample, independent, fit)
    if highest.shape > -MAX_SHAPE and highest is not fit:
        for N, other in _profiled(levels, sample, independent, highest).items():
            value, low, high, _ = made[N]
            made[N] = Level(value, min(low, other.low), max(high, other.high))
    too_wide = Level(refused=say("level.too_wide", times=MAX_HIGH))
    return {
        N: level if level.high <= MAX_HIGH * level.value else too_wide for N, level in made.items()
    }


def _profiled(
    levels: Sequence[int], sample: Sample, independent: float, fit: Fit
) -> dict[int, Level]:
    """GPD levels with their 95 % profile-likelihood intervals (Coles 2001, section 4.3.3),
    including the binomial uncertainty of the fraction above the threshold. The likelihood is scaled
    to the independent boulders (Chandler and Bate 2007). Bartlett's factor, measured on GPD
    samples, corrects for few values: without it intervals from 50 values cover 92 to 94 %.

    A limit is the extreme level over all parameters with a log-likelihood within `allowed` of the
    maximum. For each theta = shape / scale, Lagrange's condition gives the logarithm of the
    fraction above the threshold, by Newton's method. The grid is dense at its ends, where limits
    change fast.
    """
    n, k = sample.n, fit.exceedances
    excess = sample.largest(k) - fit.threshold
    allowed = Z**2 / 2 * (1 + BARTLETT * n / (k * independent)) * n / (k * independent)
    allowed += best_of(fit.shape / fit.scale, excess)[2]

    def spare(place: float) -> float:
        return float(allowed - best_of(theta_at(place, excess), excess)[2])

    best = math.log1p(fit.shape / fit.scale * excess[-1]) / math.log(k)
    west, east = (end if spare(end) > 0 else root_of(spare, end, best) for end in (-1.0, MAX_PLACE))

    def scales(places: np.ndarray) -> np.ndarray:
        """Maximum-likelihood scale for each theta (places,), as a smooth function."""
        return np.array([best_of(theta, excess)[1] for theta in theta_at(places, excess)])

    places = (west + east - (east - west) * np.cos(np.linspace(0, np.pi, POINTS))) / 2
    theta = theta_at(places, excess)
    scale = np.polynomial.Chebyshev.interpolate(scales, DEGREE, [west, east])(places)
    # Remaining allowance for each theta.
    left = np.maximum(allowed - np.log(scale) - theta * scale, TINY)
    log_n = np.log(levels)[:, None]
    start, others = math.log(k / n), n / k - 1
    further = log_n + start  # log of N times the fraction above the threshold
    bend = 1 / (1 - k / n)
    move = np.sqrt(2 * left / (1 + 1 / (further**2 * bend))) / (further * bend)
    # Log fraction; (2, levels, grid points).
    fraction = start + np.array([-1, 1])[:, None, None] * move
    for _ in range(6):
        odds = 1 / np.expm1(-fraction)
        slope = others * odds - 1
        # Best shape for this theta, divided by the shape at the limit.
        inverse = 1 - (fraction + log_n) * slope
        cost = inverse - 1 - np.log(inverse) + start - fraction
        cost -= others * np.log(-np.expm1(fraction) / (1 - k / n))
        change = slope + (fraction + log_n) * others * odds * (1 + odds)
        root = np.sqrt(np.maximum(cost, TINY))  # nearly linear, for Newton's method
        fraction -= 2 * root * (root - np.sqrt(left)) / (slope - (1 - 1 / inverse) * change)
    inverse = 1 - (fraction + log_n) * (others / np.expm1(-fraction) - 1)
    above = np.expm1(theta * scale * (fraction + log_n) / inverse) / theta
    values = fit.threshold + fit.scale * np.expm1(fit.shape * further[:, 0]) / fit.shape
    made = {}
    for N, value, low, high in zip(levels, values.tolist(), *above, strict=True):
        upper = fit.threshold + _peak(high)
        limits = fit.threshold - _peak(-low), upper if upper <= MAX_HIGH * value else np.inf
        made[N] = Level(value, *limits)
    return made


def _peak(values: np.ndarray) -> float:
    """Maximum of a smooth function, from a parabola through its highest values."""
    k = int(np.argmax(values))
    if not 0 < k < values.size - 1:
        return float(values[k])
    before, highest, after = values[k - 1 : k + 2].tolist()
    return highest + (after - before) ** 2 / (8 * (2 * highest - before - after))


def _check(levels: Sequence[int]) -> None:
    for N in levels:
        if not (isinstance(N, int | np.integer) and N > 1):
            raise RockfallError(f"levels: {N}: must be integers > 1")
