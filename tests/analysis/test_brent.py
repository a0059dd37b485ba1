# SPDX-License-Identifier: BSD-3-Clause
"""Minima, roots and quantiles of our own are those of SciPy and NumPy."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

from rockfall.analysis.precision.brent import minimum, root
from rockfall.analysis.precision.samples import quantiles

SEEDS = range(40)


def counted(function):
    places = []

    def counting(x):
        places.append(x)
        return function(x)

    return counting, places


@pytest.mark.parametrize("seed", SEEDS)
def test_a_minimum_is_sought_at_the_same_places(seed):
    rng = np.random.default_rng(seed)
    a, b, c, wide = rng.normal(size=4)
    function = lambda x: math.cosh(wide * (x - a)) + b * math.sin(3 * x + c)  # noqa: E731
    low, high = sorted(3 * rng.normal(size=2))
    ours, our_places = counted(function)
    theirs, their_places = counted(function)
    place, value = minimum(ours, low, high, xatol=1e-6)
    found = minimize_scalar(theirs, bounds=(low, high), method="bounded", options={"xatol": 1e-6})
    assert (place, value) == (found.x, found.fun) and our_places == their_places


@pytest.mark.parametrize("seed", SEEDS)
def test_a_root_is_sought_at_the_same_places(seed):
    rng = np.random.default_rng(seed)
    a, b, c = rng.normal(size=3)
    function = lambda x: abs(b) * x**3 + a * x + c + math.sin(x)  # noqa: E731
    ours, our_places = counted(function)
    theirs, their_places = counted(function)
    at = root(ours, -30.0, 30.0 + c, rtol=1e-9)
    assert at == brentq(theirs, -30.0, 30.0 + c, rtol=1e-9) and our_places == their_places


def test_roots_at_an_end_and_without_a_change_of_sign():
    assert root(lambda x: x, 0.0, 1.0) == 0.0
    assert root(lambda x: x - 1, 0.0, 1.0) == 1.0
    with pytest.raises(ValueError, match="no change of sign"):
        root(lambda x: x + 1, 0.0, 1.0)


@pytest.mark.parametrize("n", [1, 2, 7, 100, 4321])
def test_quantiles_of_ordered_values_have_the_bits_of_numpy(n):
    rng = np.random.default_rng(n)
    ordered, levels = np.sort(rng.lognormal(size=n)), [0.0, 0.5, 1.0, *rng.random(20)]
    assert (quantiles(ordered, levels) == np.quantile(ordered, levels)).all()
