# SPDX-License-Identifier: BSD-3-Clause
"""Energies and heights by return period agree with counts of boulders, for one or several
scenarios."""

import numpy as np
import pytest

import rockfall
import scenes
from made import make_layer
from rockfall.analysis.hazard.exceedance import levels_by_period
from rockfall.analysis.hazard.variables import EXCEEDED, PERIODS
from rockfall.result.crossings import line_values
from rockfall.tables.hazard import period_tables
from rockfall.text.hazard import hazard_summary

pytest.importorskip("shapely", reason="the vector extra is not installed")
import shapely

Z = scenes.rough()
GRID = scenes.grid(Z)
RELEASE = {"x": [120.0, 180.0], "y": [380.0, 385.0], "drop_height": 5.0}
LINE = {"name": "road", "x": [0.0, 300.0], "y": [200.0, 200.0]}


def run(yearly, boulders=1000, per_cluster=1):
    return boulders, per_cluster, yearly


def levels(*samples, yearly, **how):
    return levels_by_period(samples, [run(each, **how) for each in yearly])


def test_a_level_is_the_value_that_is_as_frequent():
    """The k-th largest of 1,000 boulders, ten per year, is exceeded k/100 times per year."""
    sample = np.random.default_rng(1).permutation(np.arange(1.0, 501.0))
    value, low, high = levels(sample, yearly=[10.0])
    assert value.tolist() == [491, 497, 500, 500, 500]
    assert (low <= value).all() and (value <= high).all()
    assert np.isfinite(high).tolist() == [True, False, False, False, False]  # 10 x 3.84/1003.84
    assert levels(sample[:5], yearly=[10.0])[0].tolist()[0] == 0  # 0.05 per year is less than 0.1


def test_no_boulder_leaves_the_upper_limit_open():
    value, low, high = levels(np.zeros(0), yearly=[1.0], boulders=10**5)
    assert not value.any() and not low.any()
    unseen = 3.8414588 / (10**5 + 3.8414588)
    assert (high == np.where(unseen >= 1 / np.array(PERIODS), np.inf, 0)).all()


def test_scenarios_add_up_and_their_order_does_not_matter():
    random = np.random.default_rng(2)
    first, other = random.exponential(1e5, 300), random.exponential(3e5, 80)
    both = levels(first, other, yearly=[2.0, 0.4])
    assert (both == levels(other, first, yearly=[0.4, 2.0])).all()
    halves = levels(first, first, yearly=[1.0, 1.0])
    assert (halves[0] == levels(first, yearly=[2.0])[0]).all()
    alone = levels(first, yearly=[2.0])
    assert (both[0] >= alone[0]).all()
    nothing = levels(first, other, yearly=[2.0, 0.0])
    assert (nothing == alone).all()


def test_the_factor_on_frequencies_shifts_the_limits():
    sample = np.random.default_rng(3).exponential(1e5, 500)
    wide = levels_by_period([sample], [run(5.0)], (0.5, 2.0))
    plain = levels_by_period([sample], [run(5.0)])
    assert (wide[0] == plain[0]).all()
    assert (wide[1] <= plain[1]).all() and (wide[2] >= plain[2]).all()
    assert wide[1, 0] < plain[1, 0] and wide[2, 0] > plain[2, 0]


def test_intervals_hold_the_level_of_the_distribution():
    """A fifth of 4 boulders per year pass, with exponential energies: E is exceeded 0.8 exp(-E)
    times per year. Intervals include the true level in 92 to 99 % of 400 runs."""
    random, held, runs = np.random.default_rng(4), 0, 400
    true = np.log(0.2 * 4.0 * np.array(PERIODS[:2]))
    for _ in range(runs):
        passed = random.exponential(1.0, random.binomial(2000, 0.2))
        _, low, high = levels(passed, yearly=[4.0], boulders=2000)[:, :2]
        held += (low <= true) & (true <= high)
    assert (held / runs >= 0.92).all() and (held / runs <= 0.99).all()


# ---- a hazard


SCENARIOS = (
    {"name": "often", "frequency": 8.0},
    {"name": "large", "frequency": 0.5, "volume_mean": 6.0},
)


def make_case(folder, *scenarios, **groups):
    groups = {"release": RELEASE, "case": {"boulders": 100}, "line": [LINE]} | groups
    case = scenes.make_case(folder, *scenes.sets(2.0), **groups)
    return case.replace(scenario=scenarios or SCENARIOS)


def hazard(case, **how):
    return rockfall.hazard(case, dem=Z, transform=GRID, **how)


def test_a_line_is_crossed_as_often_as_boulders_of_the_runs_cross_it(tmp_path):
    case = make_case(tmp_path)
    found = hazard(case)
    assert found["line"].values.tolist() == ["road"]
    expected, energies, weights = 0.0, [], []
    for scenario in SCENARIOS:
        volume = {key: scenario[key] for key in ("volume_mean",) if key in scenario}
        result = rockfall.run(case.replace(boulder=volume, scenario=[]), dem=Z, transform=GRID)
        energy = line_values(result, "energy_total", 0)
        energy = energy[np.isfinite(energy)]
        weight = scenario["frequency"] / result.sizes["boulder"]
        expected += weight * energy.size
        energies.append(energy)
        weights.append(np.full(energy.size, weight))
    assert float(found["line_frequency"][0]) == pytest.approx(expected, rel=1e-12)
    energies, weights = np.concatenate(energies), np.concatenate(weights)
    order = np.argsort(-energies)
    reached = np.cumsum(weights[order])
    for period, level in zip(PERIODS, found["line_energy_by_period"].values[0], strict=True):
        assert level == energies[order][np.argmax(reached >= 1 / period)]
    above = found["line_energy_counts"].values[:, 0]
    assert above[:, 0].max() <= found["line_passages"].values.max()
    assert (np.diff(above, axis=1) <= 0).all()


def test_lines_of_a_layer_are_those_that_are_typed(tmp_path):
    shape = shapely.LineString(np.transpose([LINE["x"], LINE["y"]]))
    make_layer(tmp_path / "lines.gpkg", [shape], name=["road"])
    typed = hazard(make_case(tmp_path))
    drawn = hazard(make_case(tmp_path, line=[{"file": "lines.gpkg"}]))
    assert drawn.equals(typed)
    assert drawn.attrs["case"] == typed.attrs["case"]


def test_what_hits_an_object_and_a_segment_has_the_levels_of_its_line(tmp_path):
    """A line of the case is also an object and a segment without width."""
    shape = shapely.LineString(np.transpose([LINE["x"], LINE["y"]]))
    layer, road = tmp_path / "objects.gpkg", tmp_path / "road.gpkg"
    make_layer(layer, [shape], name=["wall"], width=[4.0])
    make_layer(road, [shape], name=["road"], width=[4.0])
    found = hazard(make_case(tmp_path), objects=layer, segments=road)
    for name in ("frequency", "energy_by_period", "height_by_period", "energy_by_period_high"):
        of_object, of_segment = (found[f"{place}_{name}"].values for place in ("object", "segment"))
        assert np.array_equal(of_object, of_segment), name
    assert float(found["object_frequency"][0]) >= float(found["line_frequency"][0])
    thresholds = found["threshold"].values
    counts = found["object_energy_counts"].sel(exceeded_energy=thresholds)
    assert (counts.transpose("scenario", "exceeded_energy", "object").values
            == found["object_energy_exceeded"].values).all()  # fmt: skip


def test_a_point_without_a_width_has_no_levels(tmp_path):
    layer = tmp_path / "objects.gpkg"
    make_layer(layer, [shapely.Point(150, 200)], name=["pole"])
    found = hazard(make_case(tmp_path, line=[]), objects=layer)
    assert np.isnan(found["object_energy_by_period"].values).all()
    assert "line" not in found.dims
    with pytest.raises(rockfall.RockfallError, match="pole: at a point without a width"):
        rockfall.return_period(found, "pole", energy=30e3)


def test_levels_of_counts_are_thresholds_too():
    assert {30e3, 300e3} <= {*EXCEEDED["energy"].tolist()}
    assert all((np.diff(levels) > 0).all() for levels in EXCEEDED.values())


# ---- answers for a place


def test_a_curve_and_its_return_periods_are_the_counts(tmp_path):
    found = hazard(make_case(tmp_path))
    curve = rockfall.exceedance(found, "road")
    weights = found["frequency"].values / found["boulders"].values
    assert curve["frequency"][0] == pytest.approx(float(found["line_frequency"][0]), rel=1e-12)
    above = found["line_energy_counts"].values[:, 0]
    assert curve["frequency"][1:].to_numpy() == pytest.approx(weights @ above, rel=1e-12)
    assert (curve["low"] <= curve["frequency"]).all() and (
        curve["frequency"] <= curve["high"]
    ).all()
    for level, frequency in zip(curve["energy"][:20], curve["frequency"], strict=False):
        assert rockfall.return_period(found, "road", energy=level).value == 1 / frequency
    assert rockfall.return_period(found, "road").value == 1 / curve["frequency"][0]
    heights = rockfall.exceedance(found, "road", "height")
    assert heights["frequency"][0] == curve["frequency"][0]


def test_between_two_levels_a_return_period_lies_between_theirs(tmp_path):
    found = hazard(make_case(tmp_path))
    curve = rockfall.exceedance(found, "road")
    falls = np.flatnonzero(np.diff(curve["frequency"]) < 0)
    first = int(falls[(falls > 0) & (curve["frequency"][falls + 1] > 0)][0])
    levels = curve["energy"][first : first + 2].tolist()
    ends = [rockfall.return_period(found, "road", energy=level) for level in levels]
    middle = rockfall.return_period(found, "road", energy=sum(levels) / 2)
    assert ends[0].value < middle.value < ends[1].value
    assert middle.low == ends[0].low and middle.high == ends[1].high


def test_the_level_of_a_period_comes_about_as_often(tmp_path):
    found = hazard(make_case(tmp_path))
    for period, energy in zip(PERIODS, found["line_energy_by_period"].values[0], strict=True):
        if 0 < energy < EXCEEDED["energy"][-1]:
            low, high = (EXCEEDED["energy"][EXCEEDED["energy"] < energy][-1:],
                         EXCEEDED["energy"][EXCEEDED["energy"] >= energy][:1])  # fmt: skip
            assert rockfall.return_period(found, "road", energy=float(low[0])).value <= period
            assert rockfall.return_period(found, "road", energy=float(high[0])).value >= period


@pytest.mark.parametrize(
    ("place", "how", "message"),
    [
        ("rood", {}, "rood: no line or object or segment (names: road)"),
        ("road", {"energy": 1.0, "height": 2.0}, "return_period: give energy or height, not both"),
        ("road", {"energy": -1.0}, "return_period: -1 J: must be 0 to 7e+08"),
        ("road", {"height": 51.0}, "return_period: 51 m: must be 0 to 50"),
    ],
)
def test_what_has_no_answer_is_refused(tmp_path, place, how, message):
    with pytest.raises(rockfall.RockfallError) as error:
        rockfall.return_period(hazard(make_case(tmp_path)), place, **how)
    assert str(error.value) == message


def test_the_file_has_the_levels_of_every_place(tmp_path):
    found = hazard(make_case(tmp_path))
    rockfall.write_hazard(found, tmp_path / "out")
    lines = (tmp_path / "out/return_periods.csv").read_text().splitlines()
    assert lines[0].startswith("place,name,return_period,energy,energy_low,energy_high,height")
    assert len(lines) == 1 + len(PERIODS)
    assert float(lines[1].split(",")[3]) == pytest.approx(
        float(found["line_energy_by_period"][0, 0]) / 1e3, rel=1e-6
    )


def test_the_tables_show_lines_first_and_leave_out_what_is_not_known(tmp_path):
    layer = tmp_path / "objects.gpkg"
    wall = shapely.LineString([(0, 200), (300, 200)])
    make_layer(layer, [shapely.Point(150, 200), wall], name=["pole", "wall"], width=[np.nan, 4.0])
    found = hazard(make_case(tmp_path), objects=layer)
    energies, heights = period_tables(found)
    assert [row[0] for row in energies.rows] == [row[0] for row in heights.rows] == ["road", "wall"]
    level = float(found["line_energy_by_period"][0, 0]) / 1e3
    assert energies.rows[0][1].value == level and len(energies.rows[0]) == 1 + len(PERIODS)
    assert f"{energies.rows[0][1].number}" in hazard_summary(found)


def test_page_1_has_the_energy_once_in_a_hundred_years(tmp_path):
    pytest.importorskip("jinja2", reason="the report extra is not installed")
    from rockfall.html_report.summary import yearly_answers

    found = hazard(make_case(tmp_path))
    level = next(period_tables(found)).rows[0][1 + PERIODS.index(100.0)]
    text = f"road: once in 100 years a boulder arrives with {level.number} kJ or more"
    assert [*yearly_answers(found)] == [f"{text} {level.interval}."]
    rare = make_case(tmp_path, {"name": "never", "frequency": 1e-9})
    assert [*yearly_answers(hazard(rare))] == ["road: boulders arrive less than once in 100 years."]
    unsure = make_case(tmp_path, {"name": "seldom", "frequency": 0.008})
    unsure = unsure.replace(hazard={"frequency_factor": [0.5, 2.0]})
    assert [*yearly_answers(hazard(unsure))] == [
        "road: boulders arrive less than once in 100 years, but the interval does not exclude a "
        "higher frequency."
    ]
    assert not [*yearly_answers(None)]
