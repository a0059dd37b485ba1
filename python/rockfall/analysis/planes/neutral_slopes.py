# SPDX-License-Identifier: BSD-3-Clause
"""Neutral slopes of a scene, compared with the slopes of its ground. On ground steeper than the
neutral slope boulders accelerate without limit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.planes.plane_bounce import mixed_rebound, neutral_slope, set_rebound
from rockfall.case import FROM_ARRAY
from rockfall.case.zones import case_zones
from rockfall.scene.rebounds.coefficients import set_weights, size_weights
from rockfall.scene.surface import radius_over_rg

if TYPE_CHECKING:
    from rockfall.scene.scene import Scene

BOULDERS = 400  # boulders on a plane: gives the slope within about 0.3 degrees
FIFTHS = {"smallest fifth": (0.0, 0.2), "middle": (0.2, 0.8), "largest fifth": (0.8, 1.0)}


@dataclass(frozen=True)
class Rocks:
    """Rocks on a kind of ground: name ("" for all ground), R_m (1,) or for method A sizes (3,) [m],
    and slope tangents of evenly sampled cells."""

    name: str
    radii: np.ndarray
    tangents: np.ndarray

    def steeper(self, slope: float) -> float:
        """Fraction of the cells steeper than a slope [degree]; NaN if no slope is known."""
        if not self.tangents.size:
            return np.nan
        return float((self.tangents > np.tan(np.radians(slope))).mean())


def rocks_of(scene: Scene) -> Iterator[Rocks]:
    """Rocks of each zone with cells, in table order. For raster sizes: median rocks of the smallest
    fifth, the middle, and the largest fifth of the cells by R_m or Rg70. Absorbing cells, and
    ground without the case's impact sets, are omitted."""
    surface, ground = scene.case.surface, scene.ground
    scale = radius_over_rg(scene.case) if surface["method"] == "A" else 1.0
    usual = _follows_sets(scene)
    tangents = np.concatenate(ground.slopes)[usual]
    if ground.rocks:
        yield from _by_size(scale * np.concatenate(ground.rocks)[usual], tangents)
        return
    names = [""]
    if "zones" in surface:
        names = _zone_names(scene)
    material = np.concatenate(ground.materials)[usual]
    for k in sorted(ground.used):
        if not usual.all() and not (material == k).any():
            continue
        yield Rocks(names[k], scale * ground.sizes[k], tangents[material == k])


def _zone_names(scene: Scene) -> list[str]:
    """Zone names in row order; numbers if a GeoDataFrame gave the zones."""
    surface = scene.case.surface
    if "table" not in surface and surface["zones"] == FROM_ARRAY:
        return [f"zone {k}" for k in range(1, len(scene.ground.sizes) + 1)]
    return [f"zone {zone}" for zone in case_zones(scene.case)]


def _follows_sets(scene: Scene) -> np.ndarray:
    """Mask of the sampled cells whose rebounds follow the case's impact sets."""
    numbers = np.concatenate(scene.ground.numbers)
    if not scene.grounds:
        return np.ones(numbers.size, bool)
    usual = [k for k, ground in enumerate(scene.grounds, start=1) if ground.has_case_sets]
    return np.isin(numbers, usual)


def _by_size(radii: np.ndarray, tangents: np.ndarray) -> Iterator[Rocks]:
    rocks = np.isfinite(radii).all(axis=1)
    radii, tangents = radii[rocks].astype(float), tangents[rocks]
    order = np.argsort(radii[:, 0], kind="stable")
    for name, part in FIFTHS.items():
        first, last = (round(end * order.size) for end in part)
        if last > first:
            members = order[first:last]
            yield Rocks(name, np.median(radii[members], axis=0), tangents[members])


@lru_cache
def _neutral_slope(means: bytes, covariances: bytes, weights: tuple[float, ...]) -> float:
    """Neutral slope of sets (5, 9) and (5, 9, 9) given as bytes, cached for variants."""
    sets = np.frombuffer(means).reshape(-1, 9), np.frombuffer(covariances).reshape(-1, 9, 9)
    rebounds = [set_rebound(mean, c) for mean, c in zip(*sets, strict=True)]
    return neutral_slope(mixed_rebound(rebounds, np.array(weights)), BOULDERS)


class NeutralSlopes:
    """Neutral slopes for the impact sets of a scene, computed on first use."""

    def __init__(self, scene: Scene) -> None:
        sets = scene.coefficients.mean.T, scene.coefficients.covariance.T
        self._means, self._covariances = (values.tobytes() for values in sets)
        self._between = scene.case.impact["ratio"] == "between"

    def weights(self, radius: float, radii: np.ndarray) -> np.ndarray:
        """Weights (5,) of the sets for a boulder with this radius [m], without absorbing sizes."""
        sizes = size_weights() if radii.size > 1 else np.ones(1)
        sets = [weight * set_weights(radius / r, self._between)
                for weight, r in zip(sizes, radii, strict=True) if np.isfinite(r)]  # fmt: skip
        return np.sum(sets, axis=0) / np.sum(sets)

    def classes(self, radius: float, radii: np.ndarray) -> list[int]:
        """Ratio class of the nearest set for each rock radius [m]."""
        return [int(np.argmax(set_weights(radius / r, False))) + 1 for r in radii]

    def of(self, radius: float, radii: np.ndarray) -> float:
        """Neutral slope, 5 to 75 [degree], for this boulder radius and these rock sizes [m]."""
        weights = tuple(self.weights(radius, radii).tolist())
        return _neutral_slope(self._means, self._covariances, weights)
