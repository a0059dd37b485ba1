# SPDX-License-Identifier: BSD-3-Clause
"""Larger boulders reach a road more often, and `ratio = 'between'` gives no step at any volume."""

from functools import cache

import numpy as np
import pytest

pytest.importorskip("matplotlib", reason="the report extra is not installed")

from benchmarks.accuracy import volumes  # noqa: E402 - draws

VOLUMES, BOULDERS = 200, 40_000


@cache
def reaching(**impact):
    """Number of boulders, and fraction that reaches the road, in classes of volume from 0.1 to 4
    m3. Rocks of 0.2 m give R_b/R_m of 1.4 to 4.9."""
    return volumes.reaching(BOULDERS, VOLUMES, seed=5, **impact)


def rising(number, fraction):
    """Nearest non-decreasing fractions: neighbours that decrease get their common mean."""
    blocks = []
    for block in zip(fraction, number, np.ones(fraction.size, int), strict=True):
        blocks.append(block)
        while len(blocks) > 1 and blocks[-2][0] > blocks[-1][0]:
            (p, n, k), (q, m, j) = blocks[-2:]
            blocks[-2:] = [((p * n + q * m) / (n + m), n + m, k + j)]
    return np.concatenate([np.full(k, p) for p, _, k in blocks])


def misfit(**impact):
    """Chi-square per class of the fractions, compared with non-decreasing fractions."""
    number, fraction = reaching(**impact)
    near = rising(number, fraction)
    variance = np.maximum(near * (1 - near), 1 / number) / number
    return ((fraction - near) ** 2 / variance).mean()


@pytest.mark.all
def test_reach_rises_with_the_volume_within_noise():
    assert misfit() < 1 + 5 * np.sqrt(2 / VOLUMES)


def test_sets_that_are_not_smooth_are_told():
    """With the sphere sets and `nearest`, reach falls where the set for ratio 5 begins: the misfit
    is above 10."""
    assert misfit(sets="laboratory-spheres", ratio="nearest") > 10


@pytest.mark.all
@pytest.mark.parametrize("ratio", ["nearest", "between"])
def test_a_step_of_the_volume_is_a_step_of_the_reach_by_the_nearest_set_only(ratio):
    """The reach falls near R_b/R_m = 4.5, where sphere sets 4 and 5 differ most, only with
    `nearest`."""
    number, fraction = reaching(sets="laboratory-spheres", ratio=ratio)
    edges = np.linspace(volumes.SMALLEST, volumes.LARGEST, VOLUMES + 1)
    at = np.searchsorted(edges, 4 / 3 * np.pi * (4.5 * volumes.ROCKS) ** 3)
    below, above = slice(at - 11, at - 1), slice(at, at + 10)
    step = fraction[below].mean() - fraction[above].mean()
    error = np.sqrt(0.5 / number[below].sum())
    assert (step > 10 * error) == (ratio == "nearest"), step
