# SPDX-License-Identifier: BSD-3-Clause
"""Frequencies with intervals from boulder counts, and hazard classes from frequencies."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from rockfall.case import Case, keys_of
from rockfall.kernel_rules import count_limits

#: Class labels by number; the first means that no boulder passes.
CLASSES = ("none", *keys_of("hazard")["matrix"].allowed.split(", "))
RESIDUAL = 1
Each: TypeAlias = float | np.ndarray  # one value, or one per place


class Frequencies(NamedTuple):
    """Annual frequencies [1/year] with 95 % limits: arrays of equal shape."""

    value: np.ndarray  # [1/year]
    low: np.ndarray
    high: np.ndarray


class Matrix(NamedTuple):
    """Hazard classes by intensity and return period."""

    periods: np.ndarray  # [year], ascending
    classes: np.ndarray  # (intensities + 1, periods); the first row is for no intensity

    @classmethod
    def of(cls, case: Case) -> Matrix:
        periods = np.array(case.hazard["return_periods"])
        numbers = [CLASSES.index(word) for word in case.hazard["matrix"]]
        rows = np.array(numbers, "i1").reshape(-1, periods.size)
        return cls(periods, np.vstack([np.zeros_like(rows[:1]), rows]))


def frequencies(
    parts: Iterable[tuple[np.ndarray, int | np.ndarray, Each, Each]],
    factor: Sequence[float] = (1.0, 1.0),
) -> Frequencies:
    """Sum the frequencies of scenarios. Each scenario has: boulder counts (..., places), number of
    boulders, number of boulders that count as one observation, and annual frequency of releases
    [1/year]; all but the counts are scalars or arrays (places,).

    The limits are sums of the scenarios' Wilson limits: scenarios share random numbers, so their
    errors may have the same sign and do not cancel. `factor` multiplies the lower and upper limits,
    for uncertain annual frequencies.
    """
    value = low = high = np.zeros(())
    for counts, boulders, per_cluster, yearly in parts:
        lower, upper = count_limits(counts, boulders, per_cluster)
        value = value + yearly * (counts / boulders)
        low, high = low + yearly * lower, high + yearly * upper
    return Frequencies(value, factor[0] * low, factor[1] * high)


def intensities(frequency: np.ndarray, periods: np.ndarray) -> np.ndarray:
    """Strongest intensity reached at least once in each period (periods, ...): 0 is none, 1 the
    weakest. `frequency` (intensities, ...) [1/year] counts each intensity and all stronger ones."""
    return np.stack([np.count_nonzero(frequency >= 1 / period, axis=0) for period in periods])


def hazard_classes(frequency: np.ndarray, matrix: Matrix, passed: np.ndarray) -> np.ndarray:
    """Highest class (...) over all intensities and periods, from frequencies (intensities, ...)
    [1/year]; `RESIDUAL` where boulders pass (`passed`), but too rarely for a higher class."""
    highest = np.zeros(frequency.shape[1:], "i1")
    for column, intensity in enumerate(intensities(frequency, matrix.periods)):
        np.maximum(highest, matrix.classes[intensity, column], out=highest)
    return np.where(highest <= RESIDUAL, np.where(passed, RESIDUAL, 0), highest).astype("i1")


class Classes(NamedTuple):
    """Hazard classes from the estimated frequencies and from their lower and upper limits, which
    bound the class because it never decreases with frequency."""

    value: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @property
    def certain(self) -> np.ndarray:
        """True where the intervals allow only one class."""
        return self.low == self.high


def classify(rates: Frequencies, matrix: Matrix) -> Classes:
    """Hazard classes from frequencies (intensities, ...); the first row counts all passages."""
    passed = rates.value[0] > 0
    value, low, high = (hazard_classes(rate, matrix, passed) for rate in rates)
    return Classes(value, low, high)


def intensity_words(case: Case) -> list[str]:
    """Names of the intensities by number, from the thresholds of the case."""
    ends = [f"{threshold:.10g}" for threshold in case.hazard["thresholds"]]
    between = [f"{low}_to_{high}_kJ" for low, high in zip(ends[:-1], ends[1:], strict=True)]
    return ["none", f"up_to_{ends[0]}_kJ", *between, f"above_{ends[-1]}_kJ"]


def unseen(parts: Iterable[tuple[int, float]], factor: Sequence[float] = (1.0, 1.0)) -> float:
    """Upper limit of the annual frequency [1/year] of an event that never occurred. `parts` has the
    number of boulders and the annual frequency of each scenario; `factor` is as in `frequencies`.
    """
    none = np.zeros(1, "i4")
    parts_known = ((none, boulders, 1, yearly) for boulders, yearly in parts)
    return float(frequencies(parts_known, factor).high[0])


def boulders_needed(yearly: float, period: float) -> int:
    """Boulders per scenario needed to show that an event that never occurs in the simulation is
    rarer than once per `period` [year]: after 0 events in n, the upper limit is z2/(n + z2)."""
    upper = unseen([(1, 1.0)])  # z2/(1 + z2)
    z2 = upper / (1 - upper)
    return max(1, int(np.ceil(z2 * (yearly * period - 1))))
