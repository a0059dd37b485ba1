# SPDX-License-Identifier: BSD-3-Clause
"""Block volume exceeded once per return period, from a block survey (De Biagi et al. 2017).

Dated blocks give the annual frequency of blocks above a threshold; a generalised Pareto
distribution (GPD) of volumes is fitted to all deposited blocks. Intervals come from the joint
profile likelihood of the volumes and the number of dated blocks: with few blocks, it is more
accurate than resampling.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from rockfall.analysis.generalised_pareto import Fit, best_of, fit_gpd, lowest_valid
from rockfall.analysis.line_statistics import with_limits
from rockfall.analysis.observed.block_survey import Survey, Volumes, read_survey, survey_remarks
from rockfall.analysis.return_levels import BARTLETT, MAX_PERIOD, MAX_SHAPE, THRESHOLDS
from rockfall.case import broken_rule, key_table
from rockfall.errors import RockfallError
from rockfall.kernel_rules import Z
from rockfall.quantities import number

PERIODS = (10.0, 30.0, 100.0, 300.0)  # [year] listed in each table
MIN_BLOCKS = 20  # minimum deposited blocks above the threshold
MIN_DATED = 3  # minimum dated blocks above the threshold
HEAVIEST = 4.0  # upper limit of the GPD shape; shapes of rockfall volumes reach 1/0.4
MAX_PLACE = 6.0  # upper end of the search variable of `fit_gpd`, larger than in `return_levels`
REJECTED = 0.05  # p-value below which a distribution or comparison is reported as doubtful
WIDE = 10  # ratio of upper limit to block volume that triggers a warning
BEYOND = 10  # default volume_max is the block of this many return periods
FARTHEST = 1e6  # search limit of interval ends, as a ratio to the estimated excess
_PLACES = np.arange(-1.0, MAX_PLACE, 0.005)  # grid for the profile likelihood
_LEVELS = ["return_period", *with_limits("volume"), "power_law", "extrapolated", "refused"]


class Rate(NamedTuple):
    """Annual number of blocks above the threshold, its 95 % interval, and the number of `dated`
    blocks behind it. `dispersion` is above 1 if blocks fall in clusters."""

    value: float
    low: float
    high: float
    dated: int
    dispersion: float = 1.0


class PowerLaw(NamedTuple):
    """Annual number of blocks larger than V [m3]: activity * V**-exponent. `low` and `high` are the
    95 % limits of the exponent; `p_value` is from a test against the GPD."""

    exponent: float
    low: float
    high: float
    activity: float
    p_value: float

    def volume(self, period: float) -> float:
        return float((self.activity * period) ** (1 / self.exponent))

    def period(self, volume: float) -> float:
        return float(volume**self.exponent / self.activity)


@dataclass(frozen=True)
class DesignBlock:
    """Design block [m3] for a return period [year], its 95 % interval, and the fits behind it.

    `levels` has a row for each return period, with the columns `volume` [m3] and its limits (NaN
    if `refused` gives a reason), `power_law`, the volume from the power law, and `extrapolated`:
    larger than all surveyed blocks. `scenario` has the values of the `&scenario` keys; None if
    one is out of range.
    """

    survey: Survey
    return_period: float
    volume: float
    volume_low: float
    volume_high: float
    rate: Rate
    fit: Fit
    power_law: PowerLaw
    levels: pd.DataFrame
    scenario: dict[str, Any] | None
    warnings: tuple[str, ...]

    @property
    def shape_limits(self) -> tuple[float, float]:
        """95 % confidence interval of the shape (Smith 1985)."""
        error = Z * (1 + self.fit.shape) / math.sqrt(self.fit.exceedances)
        return self.fit.shape - error, self.fit.shape + error


def design_block(
    blocks: Volumes,
    return_period: float = 100.0,
    *,
    years: float | None = None,
    events: Volumes | None = None,
    threshold: float | None = None,
    volume_max: float | None = None,
) -> DesignBlock:
    """Design block for a return period [year], from a block survey.

    `blocks` is a table of deposited blocks with `volume` [m3] or the axes `a`, `b`, `c` [m]. Rows
    with a `year` or `date` are blocks that fell in the observation period of `years` (required);
    alternatively, `events` is a table of these blocks. Both may also be lists of volumes. Only
    blocks larger than `threshold` [m3] count (default: the lowest threshold with an acceptable fit
    of the generalised Pareto distribution). `volume_max` [m3] is the largest block of the scenario
    (default: the larger of the largest surveyed block and the power-law block of 10 return
    periods). Invalid inputs and surveys with too few blocks raise a RockfallError.

    >>> import rockfall
    >>> found = rockfall.design_block("survey.csv", 100.0, years=40.0)
    >>> found.volume_low < found.volume < found.volume_high
    True
    """
    _check(return_period, threshold, volume_max)
    survey = read_survey(blocks, events, years)
    fit = _fit(survey, threshold)
    rate = _rate(survey, fit.threshold)
    law = _power_law(survey, fit, rate)
    periods = sorted({*PERIODS, return_period})
    levels = _levels(survey, fit, rate, law, periods)
    asked = levels[periods.index(return_period)]
    if asked["refused"]:
        raise RockfallError(f"return_period = {return_period:g}: {asked['refused']}")
    if volume_max is not None:
        _check_largest(survey, asked, volume_max)
    scenario, remarks = _scenario(survey, fit, law, return_period, volume_max)
    warnings = [*survey_remarks(survey), *_warnings(survey, fit, rate, asked), *remarks]
    return DesignBlock(
        survey,
        return_period,
        volume=asked["volume"],
        volume_low=asked["volume_low"],
        volume_high=asked["volume_high"],
        rate=rate,
        fit=fit,
        power_law=law,
        levels=pd.DataFrame(levels, columns=_LEVELS),
        scenario=scenario,
        warnings=tuple(warnings),
    )


def _check(return_period: float, threshold: float | None, volume_max: float | None) -> None:
    for name, value, unit in (
        ("return_period", return_period, "years"),
        ("threshold", threshold, "m3"),
        ("volume_max", volume_max, "m3"),
    ):
        if value is not None and not 0 < value < math.inf:
            raise RockfallError(f"{name} = {value:g}: must be > 0 {unit}")


def _check_largest(survey: Survey, asked: dict[str, Any], volume_max: float) -> None:
    """Raise a RockfallError if `volume_max` is below the largest surveyed block or the design
    block."""
    for volume, what in (
        (float(survey.volumes.max()), "the largest surveyed block"),
        (asked["volume"], f"the block of {asked['return_period']:g} years"),
    ):
        if volume_max < volume:
            raise RockfallError(
                f"volume_max = {volume_max:g}: must be >= {number(volume, up=True)} m3, {what}"
            )


def _fit(survey: Survey, threshold: float | None) -> Fit:
    """Fit a GPD above the threshold (default: the lowest threshold with an acceptable fit). Raises
    a RockfallError if the fit is not usable."""
    if threshold is not None:
        _check_numbers(survey, threshold)
        fit = _fit_above(survey.volumes, threshold)
    else:
        _check_numbers(survey, 0.0)
        tried = list(_tried(survey))
        lowest = lowest_valid(tried)
        if lowest is None:
            best = max(fit.p_value for fit in tried) if tried else 0.0
            raise RockfallError(
                f"{survey.name}: no threshold gives an acceptable generalised Pareto fit no "
                f"threshold (p = {best:.2g}): choose a threshold"
            )
        fit = lowest
    if not -MAX_SHAPE < fit.shape < HEAVIEST:
        how = "end too sharply" if fit.shape < 0 else "have too heavy a tail"
        raise RockfallError(
            f"{survey.name}: volumes above {fit.threshold:g} m3 {how} for this method (shape "
            f"{fit.shape:.2f})"
        )
    return fit


def _check_numbers(survey: Survey, threshold: float) -> None:
    for what, volumes, needed in (
        ("surveyed", survey.volumes, MIN_BLOCKS),
        ("dated", survey.dated, MIN_DATED),
    ):
        if (above := int((volumes > threshold).sum())) < needed:
            limit = f" are larger than {threshold:g} m3" if threshold else ""
            raise RockfallError(
                f"{survey.name}: {above} {what} blocks{limit}, {needed} needed for a design block"
            )


def _fit_above(ordered: np.ndarray, threshold: float) -> Fit:
    above = ordered[ordered > threshold]
    return fit_gpd(above - threshold, threshold, max_place=MAX_PLACE)


def _tried(survey: Survey) -> Iterator[Fit]:
    """Fits above increasing thresholds, starting at the smallest dated block, because the fall rate
    of smaller blocks is unknown."""
    ordered = survey.volumes
    most = min(int((ordered > survey.dated.min()).sum()), ordered.size - 1)
    numbers = np.geomspace(max(most, MIN_BLOCKS), MIN_BLOCKS, THRESHOLDS).round().astype(int)
    places = ordered.size - 1 - numbers
    for threshold in np.unique(ordered[places[places >= 0]]):
        is_enough = (survey.dated > threshold).sum() >= MIN_DATED
        if is_enough and (ordered > threshold).sum() >= MIN_BLOCKS:
            yield _fit_above(ordered, float(threshold))


def _rate(survey: Survey, threshold: float) -> Rate:
    """Annual frequency of blocks above the threshold, with the exact interval of a Poisson number
    (Garwood 1936). Clustering reduces the number of independent blocks."""
    from scipy.stats import chi2

    above = survey.dated > threshold
    dated, years = int(above.sum()), survey.years
    dispersion = _dispersion(survey.dates[above], years)
    independent = dated / dispersion
    low = chi2.ppf(0.025, 2 * independent) / 2 * dispersion / years
    high = chi2.ppf(0.975, 2 * independent + 2) / 2 * dispersion / years
    return Rate(dated / years, float(low), float(high), dated, dispersion)


def _dispersion(dates: np.ndarray, years: float) -> float:
    """Variance-to-mean ratio of the yearly numbers; 1 if unknown, or if a Poisson process fits."""
    from scipy.stats import chi2

    free = math.ceil(years) - 1
    if np.isnan(dates).any() or free < 1:
        return 1.0
    numbers = np.unique(np.floor(dates), return_counts=True)[1]
    mean = dates.size / (free + 1)
    index = float((numbers**2).sum() / mean - dates.size)
    return index / free if chi2.sf(index, free) < REJECTED else 1.0


def _power_law(survey: Survey, fit: Fit, rate: Rate) -> PowerLaw:
    """Maximum-likelihood power law above the threshold (Hill 1975), which is the GPD with scale =
    shape x threshold, and its p-value in a likelihood-ratio test against the general GPD."""
    from scipy.stats import chi2

    u, n = fit.threshold, fit.exceedances
    excess = survey.volumes[survey.volumes > u] - u
    inverse, _, cost = best_of(1 / u, excess)
    loss = 2 * n * (cost - best_of(fit.shape / fit.scale, excess)[2])
    exponent = float(1 / inverse)
    low, high = (exponent * chi2.ppf(p, 2 * n) / (2 * n) for p in (0.025, 0.975))
    activity = rate.value * u**exponent
    return PowerLaw(exponent, float(low), float(high), activity, float(chi2.sf(loss, 1)))


def _levels(
    survey: Survey, fit: Fit, rate: Rate, law: PowerLaw, periods: list[float]
) -> list[dict[str, Any]]:
    likelihood = _Likelihood(survey, fit, rate)
    rows = []
    for period in periods:
        row: dict[str, Any] = dict.fromkeys(_LEVELS, math.nan)
        row |= {"return_period": period, "extrapolated": False, "refused": ""}
        expected = rate.value * period  # expected number of blocks above the threshold
        if expected <= 1:
            row["refused"] = (
                f"blocks larger than {fit.threshold:g} m3 fall every {number(1 / rate.value)} "
                "years: the block of this period is below the threshold"
            )
        elif expected > MAX_PERIOD * fit.exceedances:
            longest = number(MAX_PERIOD * fit.exceedances / rate.value)
            row["refused"] = (
                f"{fit.exceedances} blocks above {fit.threshold:g} m3 support return periods "
                f"of up to {longest} years"
            )
        else:
            excess = fit.scale * math.expm1(fit.shape * math.log(expected)) / fit.shape
            low, high = likelihood.limits(excess, period)
            row |= zip(
                with_limits("volume"), (fit.threshold + value for value in (excess, low, high)),
                strict=True,
            )  # fmt: skip
            row["power_law"] = law.volume(period)
            row["extrapolated"] = bool(row["volume"] > survey.volumes.max())
        rows.append(row)
    return rows


class _Likelihood:
    """Profile likelihood of the block volume for a return period (Coles 2001, section 4.3.3), from
    the GPD of n volumes and the Poisson number of dated blocks, weighted by 1/dispersion."""

    def __init__(self, survey: Survey, fit: Fit, rate: Rate) -> None:
        excess = survey.volumes[survey.volumes > fit.threshold] - fit.threshold
        self.n = n = fit.exceedances
        self.dated = rate.dated / rate.dispersion
        self.years = survey.years / rate.dispersion
        theta = np.expm1(_PLACES * math.log(n))
        # theta = 0, the exponential distribution, would divide 0 by 0
        self.theta = np.where(np.abs(theta) < 1e-9, 1e-9, theta) / excess[-1]
        self.total = np.array([np.log1p(theta * excess).sum() for theta in self.theta])
        self.least = n * (best_of(fit.shape / fit.scale, excess)[2] + 1)
        self.least += self.dated * (1 - math.log(rate.value))

    def loss(self, excess: float, period: float) -> float:
        """Twice the drop of the profile log-likelihood from its maximum, if the block of this
        return period exceeds the threshold by `excess` [m3].

        For each theta = shape / scale the cost is convex in z = log(1 + theta excess) / shape, the
        logarithm of the number of blocks above the threshold in a period; Newton steps from above
        converge to the minimum.
        """
        inside = self.theta * excess > -1
        theta, total = self.theta[inside], self.total[inside]
        growth = np.abs(np.log1p(theta * excess))
        slope = np.abs(total) / growth - self.dated
        yearly = self.years / period
        z = np.maximum(1.0, np.log((self.n + np.maximum(-slope, 0)) / yearly))
        for _ in range(200):
            expected = yearly * np.exp(z)
            step = (z * (slope + expected) - self.n) / (slope + expected * (1 + z))
            z -= step
            if (np.abs(step) < 1e-9 * z).all():
                break
        cost = total + z * slope + yearly * np.exp(z) - self.n * np.log(z * np.abs(theta) / growth)
        return 2 * float(cost.min() + self.dated * math.log(period) - self.least)

    def limits(self, excess: float, period: float) -> tuple[float, float]:
        """95 % limits of the excess [m3] over the threshold: the lower limit is 0 if the interval
        reaches the threshold, the upper limit is infinite if the interval is unbounded."""
        allowed = Z**2 * (1 + BARTLETT / self.n)

        def surplus(place: float) -> float:
            return self.loss(excess * math.exp(place), period) - allowed

        bottom, top = math.log(1e-6), math.log(FARTHEST)
        from scipy.optimize import brentq

        low = math.exp(brentq(surplus, bottom, 0.0)) if surplus(bottom) > 0 else 0.0
        high = math.exp(brentq(surplus, 0.0, top)) if surplus(top) > 0 else math.inf
        return excess * low, excess * high


def _scenario(
    survey: Survey, fit: Fit, law: PowerLaw, period: float, volume_max: float | None
) -> tuple[dict[str, Any] | None, list[str]]:
    """Values of the `&scenario` keys from the power law (None if outside their ranges), and
    notes."""
    largest = float(survey.volumes.max())
    top = volume_max or max(largest, law.volume(BEYOND * period))
    scenario = {
        "name": "blocks",
        "activity": law.activity,
        "volume": "pareto",
        "volume_min": fit.threshold,
        "volume_max": top,
        "volume_exponent": law.exponent,
    }
    if reason := _beyond_keys(scenario):
        return None, [f"no power-law scenario: {reason}"]
    scenario |= {key: _rounded(value) for key, value in scenario.items() if key != "name"}
    remarks = []
    if law.p_value < REJECTED:
        remarks.append(
            f"the power law of the scenario does not fit (p = {law.p_value:.2g}): once in "
            f"{period:g} years it gives {law.volume(period):.3g} m3"
        )
    if top > WIDE * largest:
        remarks.append(
            f"volume_max is {top / largest:.0f} times the largest surveyed block: check it "
            "(--volume-max)"
        )
    return scenario, remarks


def _rounded(value: Any) -> Any:
    return float(f"{value:.5g}") if isinstance(value, float) else value


def _beyond_keys(scenario: dict[str, Any]) -> str | None:
    """Error message for the first value outside the range of its key; None if all are valid."""
    for key in key_table():
        if key.group == "scenario" and isinstance(value := scenario.get(key.name), float):
            if rule := broken_rule(key.group, key.name, value):
                return f"{key.name} = {value:.3g}: {rule}"
    return None


def _warnings(survey: Survey, fit: Fit, rate: Rate, asked: dict[str, Any]) -> Iterator[str]:
    if fit.p_value < REJECTED:
        yield (
            f"the generalised Pareto distribution does not fit above {fit.threshold:g} m3 (p = "
            f"{fit.p_value:.2g})"
        )
    if (p := _same_volumes(survey, fit.threshold)) < REJECTED:
        yield (
            f"volumes of dated and undated blocks differ (p = {p:.2g}), so one of the lists is "
            "incomplete: try a higher threshold"
        )
    if rate.dispersion > 1:
        yield (
            "dated blocks came in clusters (variance/mean of yearly counts "
            f"{rate.dispersion:.2g}): intervals are widened"
        )
    if np.isnan(survey.dates).any():
        yield "clusters in time are not checked: some blocks have no date"
    if asked["extrapolated"]:
        yield f"larger than any surveyed block ({survey.volumes.max():.3g} m3): extrapolated"
    if asked["volume_high"] > WIDE * asked["volume"]:
        yield f"the upper limit is more than {WIDE} times the block: the survey is too small for it"


def _same_volumes(survey: Survey, threshold: float) -> float:
    """p-value of a test for equal distributions of dated and undated blocks above the threshold;
    NaN if either has too few."""
    from scipy.stats import ks_2samp

    dated, undated = (volumes[volumes > threshold] for volumes in (survey.dated, survey.undated))
    if min(dated.size, undated.size) < MIN_DATED:
        return math.nan
    return float(ks_2samp(dated, undated).pvalue)
