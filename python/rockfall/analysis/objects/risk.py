# SPDX-License-Identifier: BSD-3-Clause
"""Annual damage and deaths, for each object and in total, with limits."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import xarray as xr

from rockfall.analysis.hazard.classes import Frequencies
from rockfall.analysis.objects.exposure import QUANTITIES, Exposure, Harm
from rockfall.analysis.precision.clusters import Clusters
from rockfall.kernel_rules import count_limits
from rockfall.result.variables import ENDS

#: Class limits of individual risk [1/year]; a limit belongs to the class above, 0 to "none".
CLASS_ENDS = (1e-6, 1e-5, 1e-4)
CLASSES = ("none", "below_1e-6", "1e-6_to_1e-5", "1e-5_to_1e-4", "above_1e-4")
SUMMED = ("damage", "collective_risk")  # individual risk is not summed over objects


def layered(
    heights: np.ndarray, counts: np.ndarray, boulders: int, per_cluster: float
) -> Frequencies:
    """Mean of a bounded quantity over the boulders, with its 95 % limits. The range of the quantity
    is divided into layers by ascending heights, from 0; `counts` boulders reach the top of each
    layer. The mean is the sum of thickness x fraction; its limits use the Wilson limits of the
    fractions.

    Layer errors are at most fully correlated, so the limits are never too narrow. The limits of a
    sum of quantities lie within the sums of their limits, because Wilson's upper limit is concave
    in the fraction, and the lower limit convex.
    """
    thickness = np.diff(heights, prepend=0.0)
    low, high = count_limits(counts.astype("i4"), boulders, per_cluster)
    return Frequencies(thickness @ counts / boulders, thickness @ low, thickness @ high)


def mean_of(values: np.ndarray, top: float, clusters: Clusters) -> Frequencies:
    """Mean over all boulders of values from 0 to `top`, with limits; the upper limit allows for
    values above the simulated maximum."""
    boulders = np.flatnonzero(values > 0)
    per_cluster = clusters.at(boulders, values[boulders])
    rising = np.sort(values[boulders])
    heights = np.append(rising, max(top, rising[-1] if rising.size else 0.0))
    return layered(heights, np.arange(rising.size, -1, -1), values.size, per_cluster)


def mean_of_counts(
    harm: Harm, counts: np.ndarray, thresholds: np.ndarray, boulders: int, per_cluster: int
) -> Frequencies:
    """Mean harm from the numbers of boulders that hit and that exceed each threshold [J]. Value and
    upper limit assume the highest energy of each intensity, the lower limit the lowest."""
    ends = np.append(thresholds, np.inf)
    above = np.nextafter(np.append(0.0, thresholds), np.inf)
    upper, lower = (harm.scale * harm.curve.fraction(count) for count in (ends, above))
    mean = layered(upper, counts, boulders, per_cluster)
    return mean._replace(low=layered(lower, counts, boulders, per_cluster).low)


class RunRisk:
    """Mean harm per boulder in a run, with limits: (3, objects), and (3,) for the total."""

    def __init__(
        self,
        exposure: Exposure,
        energies: Iterable[tuple[int, np.ndarray]],
        diameter: np.ndarray,
        points: Points,
        clusters: Clusters,
    ) -> None:
        """`energies` are the boulder energies [J] at objects with lines, with the object number."""
        self.objects = {
            name: np.full((3, len(harms)), np.nan) for name, harms in exposure.harms.items()
        }
        joint = {name: np.zeros(diameter.size) for name in SUMMED}
        tops = dict.fromkeys(SUMMED, 0.0)
        largest = float(diameter.max(initial=0.0))
        for number, energy in energies:
            for name in QUANTITIES:
                if harm := exposure.harms[name][number]:
                    values, top = harm.by(energy, diameter), harm.most(largest)
                    self.objects[name][:, number] = mean_of(values, top, clusters)
                    if name in SUMMED:
                        joint[name] += values
                        tops[name] += top
        self.total = {name: np.array(mean_of(joint[name], tops[name], clusters)) for name in SUMMED}
        for number, counts in points:
            for name in QUANTITIES:
                if harm := exposure.harms[name][number]:
                    sizes = points.thresholds, diameter.size, clusters.most
                    mean = np.array(mean_of_counts(harm, counts, *sizes))
                    self.objects[name][:, number] = mean
                    if name in SUMMED:
                        self.total[name] += mean


class Points:
    """Objects for which only the counts (intensities, objects) above `thresholds` [J] are known;
    yields the number and counts of each."""

    def __init__(self, numbers: np.ndarray, counts: np.ndarray, thresholds: np.ndarray) -> None:
        self.numbers, self.counts, self.thresholds = numbers, counts, thresholds

    def __iter__(self) -> Any:
        return ((int(number), self.counts[:, number]) for number in self.numbers)


def diameters(result: xr.Dataset) -> np.ndarray:
    """Diameter [m] of a sphere with the volume of each boulder."""
    return np.cbrt(6 * result["volume"].values.astype(float) / np.pi)


def annual(
    runs: Iterable[tuple[RunRisk, float]], factor: Sequence[float] = (1.0, 1.0)
) -> dict[str, np.ndarray]:
    """Annual risk from runs and their annual frequencies, by name in the hazard table. The limits
    include the lowest and highest `factor` on the frequencies."""
    risks: dict[str, Any] = {}
    for run, yearly in runs:
        parts = {f"object_{name}": values for name, values in run.objects.items()}
        parts |= {f"total_{name}": values for name, values in run.total.items()}
        for name, values in parts.items():
            risks[name] = risks.get(name, 0.0) + yearly * values
    values = {
        f"{name}{end}": value * times
        for name, three in risks.items()
        for end, value, times in zip(ENDS, three, (1.0, *factor), strict=True)
    }
    for end, suffix in (("", ""), ("_lower", "_low"), ("_upper", "_high")):
        values[f"object_risk_class{end}"] = risk_classes(values[f"object_individual_risk{suffix}"])
    return values


def risk_classes(individual: np.ndarray) -> np.ndarray:
    """Class number of individual risks [1/year]; 0 for no risk, and for NaN."""
    numbers = 1 + np.searchsorted(CLASS_ENDS, individual, side="right")
    return np.where(individual > 0, numbers, 0).astype("i1")
