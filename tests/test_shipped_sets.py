# SPDX-License-Identifier: BSD-3-Clause
"""The impact sets that are shipped: what their files say of them, and what is known of rebounds."""

from pathlib import Path

import numpy as np
import pytest

from rockfall.lab.case import read_lab_case
from rockfall.lab.fit import case_in, correction_of
from rockfall.lab.scorecard import TARGETS, Site, met, read_sets
from rockfall.scene import shipped_sets

CASES = Path(__file__).parents[1] / "cases"


def test_their_provenance_is_the_case_in_the_repository():
    case = read_lab_case(CASES / "rocky-slope" / "lab.nml")
    assert case_in(shipped_sets()["rocky-slope"]) == case
    plain = case.replace(correction=dict.fromkeys(case.correction, 1.0))
    assert case_in(shipped_sets()["rocky-slope-lab"]) == plain


def test_the_correction_is_a_few_factors_on_the_means_of_all_ratios():
    corrected, plain = read_sets("rocky-slope"), read_sets("rocky-slope-lab")
    factors = correction_of(case_in(shipped_sets()["rocky-slope"]))
    np.testing.assert_allclose(corrected.mean, plain.mean * factors, rtol=1e-10)
    assert (corrected.covariance == plain.covariance).all()
    assert 1 <= (factors != 1).sum() <= 5


@pytest.fixture(scope="module")
def numbers():
    sets = read_sets("rocky-slope")
    return Site(CASES / "vaujany").numbers(sets.mean, sets.covariance)


#: The factors of rocky-slope were found with turns that end at the aspect.
BEFORE = pytest.mark.xfail(strict=True, reason="found with turning = 'to_aspect'")
FITTED = [t for t in TARGETS if not t.check_only]


@pytest.mark.parametrize(
    "target",
    [pytest.param(t, id=t.name, marks=[BEFORE] if t.name == "speed" else []) for t in FITTED],
)
def test_rocky_slope_meets_what_is_known(target, numbers):
    assert met(target, numbers[target.name]), f"{target.label}: {numbers[target.name]:.3f}"
