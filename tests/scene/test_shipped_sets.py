# SPDX-License-Identifier: BSD-3-Clause
"""Shipped impact sets."""

import numpy as np
import pytest

from made import every_third
from rockfall.analysis.planes.plane_bounce import neutral_slope, set_rebound
from rockfall.grounds.impact_sets import shipped_sets
from rockfall.scene.rebounds.coefficients import covariance_root
from rockfall.scene.rebounds.sets import read_sets


@pytest.mark.parametrize("name", every_third(shipped_sets()))
def test_shipped_sets_are_read_and_have_a_neutral_slope(name):
    draws = read_sets(name)
    for sets in draws:
        for covariance in sets.covariance:
            root = covariance_root(covariance) / np.sqrt(np.diag(covariance))[:, None]
            scale = np.sqrt(np.outer(*[np.diag(covariance)] * 2))
            np.testing.assert_allclose(root @ root.T, covariance / scale, atol=1e-11)
    for mean, covariance in zip(draws[-1].mean, draws[-1].covariance, strict=True):
        assert 15 < neutral_slope(set_rebound(mean, covariance), 100) < 60
