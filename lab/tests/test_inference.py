# SPDX-License-Identifier: BSD-3-Clause
"""Sets inferred from the paper: the statements in their headers are reproduced."""

import re

import numpy as np
import pandas as pd
import pytest

from cases.vaujany import infer
from rockfall.grounds.impact_sets import shipped_sets
from rockfall.scene.rebounds.sets import read_sets

NAMES = "bourrier2009", "vaujany-observed"
ROW = re.compile(r"!   (\S+): (?:at \w+ )?(\S+) \+- (\S+), (\S+?)(?: \+- (\S+))?(?: NOT MET)?$")
SLOPES, BOULDERS = 4, 1000


@pytest.fixture(scope="module", params=NAMES)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def header(name):
    """Value and standard error of each item in the header, by name."""
    lines = shipped_sets()[name].read_text().splitlines()
    rows = [match for line in lines if (match := ROW.match(line))]
    return {row[1]: (float(row[4]), float(row[5] or 0)) for row in rows}


def test_the_header_has_every_printed_number(name, header):
    assert list(header) == [item.name for item in infer.items(name)]
    met = sum(abs(item.residual(header[item.name][0])) <= 1 for item in infer.items(name))
    assert f"{met} of {len(header)} numbers" in shipped_sets()[name].read_text()


def test_a_judgement_marks_what_is_beyond_its_tolerance(name, header):
    means = {"header": pd.Series({item: stated for item, (stated, _) in header.items()})}
    head, _, met, *rows = infer.judgement(name, means).splitlines()
    assert head == "|  | printed | header |" and len(rows) == len(header)
    assert f"| {met.split('|')[3].strip()} numbers" in shipped_sets()[name].read_text().replace(
        "slopes that no fit used, ", "| "
    )
    missed = sum("NOT MET" in line for line in shipped_sets()[name].read_text().splitlines())
    assert sum("**" in row for row in rows) == missed


def test_a_short_rerun_has_the_numbers_of_the_header(name, header):
    (sets,) = read_sets(name)
    on = infer.slopes(infer.JUDGED_SEED, infer.JUDGED_SLOPES)[:: infer.JUDGED_SLOPES // SLOPES]
    found = infer.numbers(sets, name, on, BOULDERS)
    for item, (stated, error) in header.items():
        # errors of fewer slopes and boulders; R_n is from 4,000 draws
        few = 0.01 if item.startswith("rn_") else 4 * np.sqrt(infer.JUDGED_SLOPES / SLOPES) * error
        assert found[item] == pytest.approx(stated, abs=5e-4 * stated + few), item


def test_a_rerun_has_the_ranges_of_the_set(name):
    (sets,) = read_sets(name)
    found = infer.ranges(sets, name)
    for draws in name, f"{name}-ensemble":
        text = shipped_sets()[draws].read_text()
        for key, ends in found.items():
            stated = re.findall(rf"{key} = (\S+), (\S+)", text)
            assert len(stated) % 5 == 0 and {*stated} == {tuple(f"{end:g}" for end in ends)}


def test_the_larger_a_boulder_the_gentler_is_its_neutral_slope(name):
    (sets,) = read_sets(name)
    each = zip(sets.mean, sets.covariance, strict=True)
    slopes = [infer.neutral_slope(infer.set_rebound(*at)) for at in each]
    assert (np.diff(slopes) < 0).all()


@pytest.mark.parametrize("many", [False, True])
def test_coefficients_are_linear_and_their_scatter_is_geometric_in_the_ratio(name, many):
    draws = read_sets(f"{name}-ensemble" if many else name)
    assert len(draws) == (24 if many else 1)
    for sets in draws:
        np.testing.assert_allclose(np.diff(sets.mean, 2, axis=0), 0, atol=1e-10)
        deviation = np.sqrt(np.diagonal(sets.covariance, axis1=1, axis2=2))
        np.testing.assert_allclose(np.diff(np.log(deviation), 2, axis=0), 0, atol=1e-9)


def test_a_short_search_lowers_the_score(monkeypatch):
    from concurrent.futures import ThreadPoolExecutor

    for name, few in ("AROUND", 40), ("SLOPES", 2), ("FIT_BOULDERS", 150):
        monkeypatch.setattr(infer, name, few)
    start = infer.START["vaujany-observed"].copy()
    start[0] -= 0.02  # shift a1 by the equivalent of two degrees of slope
    with ThreadPoolExecutor(1) as pool:
        search = infer.Search("vaujany-observed", pool, start, 901)
        (before,) = (search.residuals([start]) ** 2).sum(axis=1)
        search.iterate()
    assert search.score < 0.8 * before
