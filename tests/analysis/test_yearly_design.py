# SPDX-License-Identifier: BSD-3-Clause
"""Barriers by the frequency of passing boulders: counts follow the kernel's rule, and an advised
barrier, when built, lets as few boulders pass as predicted."""

import numpy as np
import pytest

import rockfall
import scenes
from made import refused
from rockfall.analysis.hazard.exceedance import Passing, class_behind
from rockfall.analysis.hazard.variables import CLASS_ENERGY, EXCEEDED
from rockfall.kernel_rules import barrier_outcomes
from rockfall.result.variables import OUTCOME
from rockfall.table import Estimate
from rockfall.tables.design import design_text
from rockfall.tables.yearly_design import (
    advice,
    choice_tables,
    demands,
    times_more,
    verdicts,
    yearly_design_text,
)

Z, GRID = scenes.cut_below(scenes.rough(gradient=0.6, relief=0.3), 180.0)
PLACE = {"dem": Z, "transform": GRID}
LINE = {"name": "road", "x": [0.0, 300.0], "y": [200.0, 200.0]}
SCENARIOS = [
    {"name": "often", "frequency": 0.3},
    {"name": "large", "frequency": 0.02, "volume_mean": 1.2},
]


def make_case(folder, **groups):
    groups = {
        "release": {"x": [120.0, 180.0], "y": [380.0, 385.0], "drop_height": 2.0},
        "case": {"boulders": 1000},
        "line": [LINE],
    } | groups
    return scenes.make_case(folder, *scenes.sets(2.0), **groups).replace(scenario=SCENARIOS)


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return make_case(tmp_path_factory.mktemp("case"))


@pytest.fixture(scope="module")
def hazard(case):
    return rockfall.hazard(case, **PLACE)


@pytest.mark.parametrize("seed", range(3))
def test_what_passes_a_barrier_is_what_the_kernel_lets_pass(seed):
    random = np.random.default_rng(seed)
    n = random.integers(0, 300)
    heights = random.choice([0.5, 1.0, 2.25, 7.0, 60.0], n)  # some equal the top of a barrier
    at = Passing(random.choice([9e4, 1e5, 1.1e5, 4.6e6], n), heights)
    counts = class_behind(at)
    for k, capacity in enumerate(CLASS_ENERGY):
        for j, height in enumerate(EXCEEDED["height"][:8]):
            outcomes = (
                barrier_outcomes(height, capacity, at.height, at.energy) if n else np.zeros(0)
            )
            assert counts[k, j] == np.count_nonzero(outcomes != OUTCOME["stopped"])


def test_higher_and_stronger_barriers_let_no_more_pass_and_scenarios_add_up(case, hazard):
    behind = hazard["line_class_behind"].values
    assert (np.diff(behind, axis=-1) <= 0).all() and (np.diff(behind, axis=-2) <= 0).all()
    assert (behind[..., 0, 0] <= hazard["line_passages"].values).all()
    for k, scenario in enumerate(SCENARIOS):
        alone = rockfall.hazard(case.replace(scenario=[scenario]), **PLACE)
        assert (alone["line_class_behind"].values[0] == behind[k]).all()


def test_the_advised_barrier_is_the_cheapest_that_holds_and_holds_when_it_is_built(case, hazard):
    sheet = rockfall.yearly_design(hazard, 100.0)
    rows = sheet.choices[sheet.choices["line"] == "road"]
    (chosen,) = rows[rows["advised"]].to_dict("records")
    enough = rows[rows["height"].notna()]
    assert (enough["behind_high"] <= 1 / 100).all()
    assert chosen["cost"] == enough["cost"].min()
    weaker = rows[rows["height"].isna()]
    assert len(weaker) and (weaker["through_high"] > 1 / 100).all()
    barrier = LINE | {
        "name": "net",
        "height": chosen["height"],
        "capacity": chosen["capacity"] / 1e3,
    }
    built = rockfall.hazard(case.replace(line=[], barrier=[barrier]), **PLACE)
    (check,) = rockfall.yearly_design(built, 100.0).checks.to_dict("records")
    assert check["holds"] and check["certain"]
    assert check["behind"] == pytest.approx(chosen["behind"], rel=0.02)
    assert (built["line_passages"].values == hazard["line_passages"].values).all()
    (text,) = verdicts(rockfall.yearly_design(built, 100.0))
    assert "at most one in 100 years" in text


def test_a_barrier_that_is_too_low_fails(case):
    net = LINE | {"name": "net", "height": 0.6, "capacity": 5000.0}
    sheet = rockfall.yearly_design(rockfall.hazard(case.replace(barrier=[net]), **PLACE), 1000.0)
    assert sheet.checks["holds"].tolist() == [False] and sheet.checks["certain"].all()
    assert "more than one in 1000 years" in yearly_design_text(sheet)


def test_where_boulders_come_rarely_no_barrier_is_advised(case, hazard):
    far = case.replace(line=[LINE | {"name": "far", "y": [398.0, 398.0]}])  # above the sources
    sheet = rockfall.yearly_design(rockfall.hazard(far, **PLACE), 10.0)
    assert not sheet.choices["advised"].any()
    assert "no barrier is needed" in next(advice(sheet))
    for period, advised in ((10.0, 0), (100.0, 1)):
        sheet = rockfall.yearly_design(hazard, period)
        assert (float(hazard["line_frequency"][0]) > 1 / period) == advised
        assert sheet.choices["advised"].sum() == advised


def test_other_periods_and_hazards_without_lines_are_refused(case, hazard):
    with refused("return_period = 50: must be one of 10, 30, 100, 300, 1000"):
        rockfall.yearly_design(hazard, 50.0)
    with refused("design: the hazard has no lines: give the case a &line and run it again"):
        rockfall.yearly_design(rockfall.hazard(case.replace(line=[]), **PLACE))


@pytest.mark.parametrize(
    ("rate", "low", "high", "expected"),
    [
        (0.012, 0.008, 0.018, "4"),  # 0.004 to be halved
        (0.009, 0.005, 0.014, "30"),  # 0.005 to be reduced to a fifth: 25, rounded up
        (0.0099999, 0.009, 0.011, "over 1,000"),
        (0.01, 0.009, 0.011, "over 1,000"),
    ],
)
def test_how_many_more_boulders_decide_on_a_barrier(rate, low, high, expected):
    assert times_more(Estimate(rate, low, high), 0.01) == expected


def test_each_design_names_the_criterion_of_the_other(case, hazard):
    other = "in the design of a single run by the fraction of arriving boulders that pass"
    assert other in yearly_design_text(rockfall.yearly_design(hazard))
    result = rockfall.run(case.replace(scenario=[]), **PLACE)
    text = " ".join(design_text(rockfall.design(result)).split())
    assert "`design` of a hazard, judge them by boulders that pass per year" in text


def test_the_strongest_barrier_comes_first(tmp_path):
    lower = {"name": "lower", "x": [0.0, 300.0], "y": [190.0, 190.0]}
    case = make_case(tmp_path, line=[LINE, lower])
    sheet = rockfall.yearly_design(rockfall.hazard(case, **PLACE))
    levels = {line: demand.levels for line, demand in demands(sheet).items()}
    assert [*levels] == ["road", "lower"] and levels["lower"] > levels["road"]
    assert "Net on lower" in next(advice(sheet))
    assert next(choice_tables(sheet)).caption.startswith("lower")
