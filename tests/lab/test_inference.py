# SPDX-License-Identifier: BSD-3-Clause
"""Sets inferred from what the paper prints: what their headers state is found again."""

import re

import numpy as np
import pytest

from cases.vaujany import infer
from rockfall.impact_sets import shipped_sets
from rockfall.lab.sets import read_sets

NAME = "vaujany-observed"
ROW = re.compile(r"!   (\S+): (?:at \w+ )?(\S+) \+- (\S+), (\S+?)(?: \+- (\S+))?(?: NOT MET)?$")
SLOPES, BOULDERS = 4, 1000


@pytest.fixture(scope="module")
def header():
    """Number and standard error of each item, by name."""
    lines = shipped_sets()[NAME].read_text().splitlines()
    rows = [match for line in lines if (match := ROW.match(line))]
    return {row[1]: (float(row[4]), float(row[5] or 0)) for row in rows}


def test_the_header_has_every_printed_number(header):
    assert list(header) == [item.name for item in infer.items(NAME)]
    met = sum(abs(item.residual(header[item.name][0])) <= 1 for item in infer.items(NAME))
    assert f"{met} of {len(header)} numbers" in shipped_sets()[NAME].read_text()


def test_a_short_rerun_has_the_numbers_of_the_header(header):
    (sets,) = read_sets(NAME)
    on = infer.slopes(infer.JUDGED_SEED, infer.JUDGED_SLOPES)[:: infer.JUDGED_SLOPES // SLOPES]
    found = infer.numbers(sets, NAME, on, BOULDERS)
    for name, (stated, error) in header.items():
        # of fewer slopes and boulders; R_n of 4,000 draws
        few = 0.01 if name.startswith("rn_") else 4 * np.sqrt(infer.JUDGED_SLOPES / SLOPES) * error
        assert found[name] == pytest.approx(stated, abs=5e-4 * stated + few), name


@pytest.mark.parametrize("name", [NAME, f"{NAME}-ensemble"])
def test_coefficients_are_linear_and_their_scatter_is_geometric_in_the_ratio(name):
    draws = read_sets(name)
    assert len(draws) == (24 if name.endswith("ensemble") else 1)
    for sets in draws:
        np.testing.assert_allclose(np.diff(sets.mean, 2, axis=0), 0, atol=1e-10)
        deviation = np.sqrt(np.diagonal(sets.covariance, axis1=1, axis2=2))
        np.testing.assert_allclose(np.diff(np.log(deviation), 2, axis=0), 0, atol=1e-9)


def test_a_short_search_lowers_the_score(monkeypatch):
    from concurrent.futures import ThreadPoolExecutor

    for name, few in ("AROUND", 40), ("SLOPES", 2), ("FIT_BOULDERS", 150):
        monkeypatch.setattr(infer, name, few)
    start = infer.START[NAME].copy()
    start[0] -= 0.02  # a1: two degrees of terrain
    with ThreadPoolExecutor(1) as pool:
        search = infer.Search(NAME, pool, start, 901)
        (before,) = (search.residuals([start]) ** 2).sum(axis=1)
        search.iterate()
    assert search.score < 0.8 * before
