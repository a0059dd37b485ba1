# SPDX-License-Identifier: BSD-3-Clause
"""Hazard: frequencies are fractions of boulders times release frequencies and lie within their
limits, classes follow from the matrix, and boulders that cross the outline of an object hit it."""

import json

import numpy as np
import pytest

import rockfall
import scenes
from made import make_layer, refused
from rockfall.analysis.hazard import combined
from rockfall.analysis.hazard.classes import (
    CLASSES,
    Frequencies,
    Matrix,
    boulders_needed,
    classify,
    hazard_classes,
    intensities,
    unseen,
)
from rockfall.analysis.hazard.model_warnings import messages_of
from rockfall.analysis.validity import ends
from rockfall.analysis.validity.remark import Remark
from rockfall.kernel_rules import fraction_limits
from rockfall.language import say
from rockfall.quantities import percent
from rockfall.result.crossings import at_lines
from rockfall.studies.hazard import read_study
from rockfall.tables.hazard import scenario_table

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

Z = scenes.rough()
GRID = scenes.grid(Z)
ONE = {"name": "one", "frequency": 0.5}
RELEASE = {"x": [120.0, 180.0], "y": [380.0, 385.0], "drop_height": 5.0}
Z2 = 1.959964**2
SWISS = Matrix.of(rockfall.Case(
    case={"boulders": 1}, surface={"uniform_mean_radius": 0.2}, boulder={"volume_mean": 1.0},
    release={"x": 0.0, "y": 0.0},
))  # fmt: skip


def make_case(folder, *scenario, **groups):
    groups = {"release": RELEASE, "case": {"boulders": 100}} | groups
    hazard = {"hazard": groups.pop("hazard", {})}
    case = scenes.make_case(folder, *scenes.sets(2.0), **groups)
    return case.replace(scenario=scenario or [ONE], **hazard)


def hazard(case, **how):
    return rockfall.hazard(case, dem=Z, transform=GRID, **how)


def run(case):
    return rockfall.run(case, dem=Z, transform=GRID)


# ---- frequencies


def test_the_boulders_of_each_scenario_are_in_its_table(tmp_path):
    """The table lists volumes, densities, drop heights and release speeds. One of two source points
    has a density, both have a drop height and a velocity."""
    at = [shapely.Point(x, y) for x, y in zip(RELEASE["x"], RELEASE["y"], strict=True)]
    make_layer(tmp_path / "points.gpkg", at, crs=None, density=[2400.0, None],
               drop_height=[2.0, 6.0], velocity_x=[3.0, 0.0], velocity_y=[4.0, 0.0])  # fmt: skip
    blocks = ONE | {"name": "blocks", "volume": "uniform", "volume_min": 1.5, "volume_max": 5.0}
    case = make_case(tmp_path, ONE, blocks, boulder={"volume_mean": 0.8, "density": 2800.0})
    points = {"points": str(tmp_path / "points.gpkg"), "x": None, "y": None}
    found = hazard(case.replace(release=points))
    assert found["released_volume_mean"].values[0] == 0.8
    volumes = {end: found[f"released_volume_{end}"].values[1] for end in ("min", "mean", "max")}
    assert 1.5 < volumes["min"] < 1.6 and 4.9 < volumes["max"] < 5.0
    assert volumes["mean"] == pytest.approx(3.25, abs=0.25)
    table = scenario_table(found)
    drawn = "{min:.2f} to {max:.2f}, mean {mean:.2f}".format(**volumes)
    for row, volume in zip(table.rows, ("0.800", drawn), strict=True):
        assert row[4:] == (volume, "2,400 to 2,800, mean 2,600", "2.00 to 6.00, mean 4.00",
                           "0 to 5.00, mean 2.50")  # fmt: skip
    assert table.head[4:] == ["volume [m³]", "density [kg/m³]", "drop height [m]",
                              "release speed [m/s]"]  # fmt: skip


def test_rebounds_out_of_range_are_a_fraction_of_each_scenario(tmp_path):
    """Impact sets are valid up to R_b/R_m = 5.5: all boulders of the first scenario have 3.8, all
    of the second 6.0."""
    large = ONE | {"name": "large", "volume_mean": 3.0}
    found = hazard(make_case(tmp_path, ONE, large, surface={"uniform_mean_radius": 0.15}))
    assert found["fraction_out_of_range"].values.tolist() == [0.0, 1.0]


def test_boulders_that_roll_are_reported_at_evaluation_lines(tmp_path, monkeypatch):
    """Outlines of objects are also lines of the run, but have no remark."""

    def rolling(result, _):
        for name in result["line_name"].values:
            attrs = {"line": str(name), "fraction": percent(0.3), "slow": 2.0}
            yield Remark(say("model.rolling", **attrs), True)

    monkeypatch.setattr(combined, "roll_remarks", rolling)
    make_layer(tmp_path / "house.gpkg", [shapely.box(130, 150, 150, 170)], crs=None)
    case = make_case(tmp_path, line=[{"name": "road", "x": [0.0, 300.0], "y": [200.0, 200.0]}])
    texts = messages_of(hazard(case, objects=tmp_path / "house.gpkg"))["one"]
    lines = [text.values["line"] for text in texts if text.key == "model.rolling"]
    assert lines == ["road"]


def test_boulders_lost_before_a_line_are_reported(tmp_path, monkeypatch):
    """All boulders end at unknown cells above the road, if that is not already reported itself."""
    monkeypatch.setattr(ends, "MAX_CUT", 1.0)
    case = make_case(tmp_path, line=[{"name": "road", "x": [0.0, 300.0], "y": [200.0, 200.0]}])
    unknown = Z.copy()
    unknown[len(Z) // 4 : len(Z) // 2 - 2] = np.nan
    found = rockfall.hazard(case, dem=unknown, transform=GRID)
    (text,) = [text for text in messages_of(found)["one"] if text.key == "model.lost"]
    assert text.startswith("few boulders cross road (0, and ")


@pytest.mark.parametrize(("sources", "independent"), [("all", 200), ("sample", 2)])
def test_a_scenario_is_a_run_times_its_frequency(tmp_path, sources, independent):
    """Counts are those of a run, frequencies and limits those of the run times 0.5 per year. With
    two sampled sources, whose boulders may all behave alike, the limits are those of two
    boulders."""
    release = {"release": RELEASE | {"sources": sources}}
    found = hazard(make_case(tmp_path, **release))
    maps = ["passages", "energy_exceeded", "reach_probability"]
    maps += ["reach_probability_low", "reach_probability_high"]
    result = run(make_case(tmp_path, output={"maps": maps}, **release))
    assert int(found.boulders_per_cluster.item()) == 200 // independent
    places = np.unravel_index(result.passages.values.argmax(), Z.shape)
    limits = fraction_limits(result.passages.values[places] / 200, independent)
    for end, limit in zip(("low", "high"), limits, strict=True):
        assert result[f"reach_probability_{end}"].values[places] == np.float32(limit)
    assert (found.scenario_passages.values[0] == result.passages.values).all()
    assert (found.scenario_energy_exceeded.values[0] == result.energy_exceeded.values).all()
    assert (found.reach_probability.values == result.reach_probability.values).all()
    for end in ("", "_low", "_high"):
        expected = np.float32(0.5) * result[f"reach_probability{end}"].values  # exact: one half
        assert (found[f"passage_frequency{end}"].values == expected).all()
    exceeded = 0.5 * result.energy_exceeded.values / 200
    assert (found.exceedance_frequency.values == exceeded.astype("f4")).all()


def test_a_return_period_is_one_over_a_frequency(tmp_path):
    often = hazard(make_case(tmp_path, {"name": "one", "frequency": 0.05}))
    rare = hazard(make_case(tmp_path, {"name": "one", "return_period": 20.0}))
    assert often.equals(rare)


def test_doubts_about_inputs_are_said_and_kept(tmp_path):
    case = make_case(tmp_path, ONE | {"frequency": 100.0}, hazard={"return_periods": [0.5, 1, 3]})
    with pytest.warns(UserWarning) as caught:
        found = hazard(case)
    said = [str(one.message) for one in caught]
    for words in ("100 boulders per year: is the value a return period?", "the value a frequency?"):
        assert sum(words in line for line in said) == 1
    kept = [f"case: {one[0]}: {one[1]}" for one in json.loads(found.attrs["input_warnings"])]
    assert kept == said[: len(kept)]


def test_scenarios_add_up(tmp_path):
    """Scenarios of 0.125 and 0.375 per year give the intervals of one of 0.5 per year."""
    split = [{"name": "a", "frequency": 0.125}, {"name": "b", "frequency": 0.375}]
    two, one = hazard(make_case(tmp_path, *split)), hazard(make_case(tmp_path))
    assert two.sizes["scenario"] == 2
    for name in one.data_vars:
        if "scenario" not in one[name].dims:
            np.testing.assert_allclose(two[name].values, one[name].values, rtol=3e-7, err_msg=name)


def test_the_least_threshold_is_every_passage(tmp_path):
    found = hazard(make_case(tmp_path, hazard={"thresholds": [0.0, 20.0]}))
    assert (found.exceedance_frequency.values[0] == found.passage_frequency.values).all()


def test_frequencies_of_sources_and_of_area_are_those_of_all(tmp_path):
    """Release frequencies are per source, per metre of cliff, or per km2 of plan or true surface
    area."""
    each = {"name": "one", "frequency": 0.25, "frequency_per": "source"}
    assert hazard(make_case(tmp_path, each)).frequency.values == 0.5
    cliff = {"name": "one", "frequency": 0.01, "frequency_per": "m", "cliff_length": 80.0}
    found = read_study(make_case(tmp_path, cliff), dem=Z, transform=GRID)
    assert found.scenarios[0].frequency == 0.8
    cells = np.zeros(Z.shape, "i4")
    cells[5:7, 20:30] = 1
    area = {"name": "one", "frequency": 100.0, "frequency_per": "km2"}
    release = {"cells": "given", "drop_height": 5.0}
    alike = make_case(tmp_path, area, release=release)
    found = read_study(alike, dem=Z, transform=GRID, cells=cells)
    assert found.scenarios[0].frequency == pytest.approx(100 * 20 * 25 / 1e6)
    by_area = make_case(tmp_path, area, release=release | {"by_area": True})
    steep = read_study(by_area, dem=Z, transform=GRID, cells=cells)
    assert steep.scene.area.min() > 1
    surface = 25 * steep.scene.area.sum()
    assert steep.scenarios[0].frequency == pytest.approx(100 * surface / 1e6)


POWER = {"volume": "pareto", "volume_min": 0.1, "volume_max": 20.0, "volume_exponent": 0.5}


def test_activity_gives_the_frequency_of_all_volumes(tmp_path):
    """The frequency above V is 0.05 (V^-0.5 - 20^-0.5) per year, for volumes from 0.1 to 20 m3."""
    one = {"name": "one", "activity": 0.05} | POWER
    found = read_study(make_case(tmp_path, one, case={"boulders": 4000}), dem=Z, transform=GRID)
    assert found.scenarios[0].frequency == pytest.approx(0.1581139 - 0.0111803, rel=1e-6)
    case = found.scenarios[0].case.replace(impact={"impact_limit": 1})
    volume = run(case)["volume"].values
    assert 0.1 <= volume.min() and volume.max() <= 20.0
    above = found.scenarios[0].frequency * (volume[:, None] > [0.2, 1.0, 5.0]).mean(axis=0)
    expected = 0.05 * (np.array([0.2, 1.0, 5.0]) ** -0.5 - 20.0**-0.5)
    np.testing.assert_allclose(above, expected, rtol=0.08)
    one = {"name": "one", "activity": 0.05}  # with the volumes of &boulder
    found = read_study(
        make_case(tmp_path, one, boulder=POWER | {"volume_mean": None}), dem=Z, transform=GRID
    )
    assert found.scenarios[0].frequency == pytest.approx(0.1469336, rel=1e-6)


def test_activity_needs_a_power_distribution(tmp_path):
    with refused("case: &scenario activity = 0.05: is only valid with volume = 'pareto'"):
        make_case(tmp_path, {"name": "one", "activity": 0.05})


@pytest.mark.parametrize("key", ["volume_min", "volume_max", "volume_exponent"])
def test_activity_needs_all_of_its_distribution(tmp_path, key):
    one = {name: value for name, value in POWER.items() if name != key}
    with refused(f"case: &scenario {key} is missing: needed for volume = 'pareto'"):
        make_case(tmp_path, {"name": "one", "activity": 0.05} | one)


def test_a_scenario_changes_boulders(tmp_path):
    """A scenario replaces single keys of &boulder; with its own distribution it replaces all volume
    keys."""
    boulder = {"volume": "normal", "volume_mean": 1.0, "volume_std": 0.2, "density": 2600.0}
    alike = {"block_shape": ["compact"], "mean_radius_sigma": 0.0}
    boulder |= alike
    case = make_case(
        tmp_path,
        ONE | {"name": "as they are"},
        ONE | {"name": "larger", "volume_mean": 3.0},
        ONE | {"name": "another", "volume": "fixed", "volume_mean": 0.5, "density": 2700.0},
        boulder=boulder,
    )
    study = read_study(case, dem=Z, transform=GRID)
    one, two, three = (scenario.case.boulder for scenario in study.scenarios)
    assert one == boulder
    assert two == boulder | {"volume_mean": 3.0}
    assert three == {"volume": "fixed", "volume_mean": 0.5, "density": 2700.0} | alike


def test_a_run_takes_no_notice(tmp_path):
    output = {"maps": ["passages", "energy_exceeded"]}
    without = scenes.make_case(tmp_path, *scenes.sets(2.0), release=RELEASE, output=output)
    with_both = make_case(tmp_path, hazard={"minimum_area": 9.0}, output=output, case={})
    assert run(without).equals(run(with_both))


def test_extremes_are_those_of_all_scenarios(tmp_path):
    small = ONE | {"name": "small", "volume": "fixed", "volume_mean": 0.05}
    both = hazard(make_case(tmp_path, ONE, small))
    one, two = hazard(make_case(tmp_path, ONE)), hazard(make_case(tmp_path, small))
    for name, extreme in ("energy_line_angle_min", np.fmin), ("energy_line_angle_max", np.fmax):
        expected = extreme(one[name].values, two[name].values)
        np.testing.assert_array_equal(both[name].values, expected)


def test_a_wall_takes_the_hazard_behind_it(tmp_path, layer):
    """No boulder passes the wall; above it, more than 99 % of the passages remain."""
    wall = {"name": "w", "x": [0.0, 300.0], "y": [302.0, 302.0], "height": 99.0, "capacity": 1e5}
    bare = hazard(make_case(tmp_path), objects=layer(ROAD))
    case = make_case(tmp_path).replace(barrier=[wall])
    behind = hazard(case, objects=layer(ROAD))
    below, above = bare.y.values < 295, bare.y.values > 305
    assert (bare.passage_frequency.values[below] > 0).any()
    assert (behind.passage_frequency.values[below] == 0).all()
    assert (behind.hazard_class.values[below] == 0).all()
    assert bare.object_frequency.values[0] > 0 == behind.object_frequency.values[0]
    up, without = (one.scenario_passages.values[0, above] for one in (behind, bare))
    assert (up <= without).all() and up.sum() > 0.99 * without.sum()  # few move uphill again


# ---- classes


def classes(*frequencies, passed=True):
    """Swiss hazard class, as a word, for the frequencies of passage, above 30 kJ, and above 300
    kJ."""
    values = np.array(frequencies)[:, None]
    return CLASSES[hazard_classes(values, SWISS, np.array([passed]))[0]]


BELOW = 1 - 1e-15


@pytest.mark.parametrize(
    ("frequencies", "word"),
    [
        ((0, 0, 0), "residual"),
        ((BELOW / 300, 0, 0), "residual"),
        ((1 / 300, 0, 0), "low"),
        ((BELOW / 30, 0, 0), "low"),
        ((1 / 30, 0, 0), "moderate"),
        ((1, BELOW / 300, 0), "moderate"),
        ((1 / 300, 1 / 300, 0), "moderate"),
        ((BELOW / 30, BELOW / 30, 0), "moderate"),
        ((1 / 30, 1 / 30, 0), "high"),
        ((1 / 300, 1 / 300, BELOW / 300), "moderate"),
        ((1 / 300, 1 / 300, 1 / 300), "high"),
        ((1, 1, 1), "high"),
    ],
)
def test_the_swiss_matrix_at_its_borders(frequencies, word):
    assert classes(*frequencies) == word


def test_nothing_where_nothing_came():
    assert classes(0, 0, 0, passed=False) == "none"
    assert classes(BELOW / 300, 0, 0, passed=False) == "none"
    assert classes(1 / 30, 0, 0, passed=False) == "moderate"  # at the upper limit of an interval


def test_intensities_are_what_each_period_brings():
    frequency = np.array([[1 / 20, 1 / 30], [1 / 80, 1 / 30], [1 / 500, 1 / 299]])
    found = intensities(frequency, np.array([30.0, 100.0, 300.0]))
    assert found.tolist() == [[1, 2], [2, 2], [2, 3]]


def test_classes_of_an_interval_enclose_its_own():
    random = np.random.default_rng(3)
    value = -np.sort(-(10 ** random.uniform(-4, 0, (3, 2000))), axis=0)
    low, high = value * random.uniform(0.2, 1, 2000), value * random.uniform(1, 5, 2000)
    found = classify(Frequencies(value, low, high), SWISS)
    assert (found.low <= found.value).all() and (found.value <= found.high).all()
    assert (found.certain == (found.low == found.high)).all()
    assert 0 < found.certain.mean() < 1


def test_few_boulders_cannot_tell_that_none_come(tmp_path):
    """A cell without a passage has an upper limit of Z2/(n + Z2) per boulder. Its class is certain
    only if this is less than once in the longest return period."""
    found = hazard(make_case(tmp_path, {"name": "one", "frequency": 1.0}))
    empty = found.hit_frequency.values == 0
    assert (found.hit_frequency_high.values[empty] == np.float32(Z2 / (200 + Z2))).all()
    assert (found.hazard_class.values[empty] == 0).all()
    assert (found.hazard_class_certain.values[empty] == 0).all()
    rare = hazard(make_case(tmp_path, {"name": "one", "frequency": 0.15}))
    assert (rare.hazard_class_certain.values[empty] == 1).all()


def test_the_boulders_needed_are_enough_and_no_more():
    for yearly, period in ((1.0, 300.0), (0.02, 300.0), (7.7, 30.0)):
        needed = boulders_needed(yearly, period)
        assert unseen([(needed, yearly)]) <= 1 / period
        assert unseen([(max(1, needed - 1), yearly)]) >= 1 / period or needed == 1
    split = [(1000, 0.25), (1000, 0.75)]
    assert unseen(split) == pytest.approx(unseen([(1000, 1.0)]), rel=1e-14)


def test_a_matrix_of_ones_own(tmp_path):
    own = {"thresholds": [250.0], "return_periods": [10.0, 1000.0]}
    own["matrix"] = ["low", "residual", "high", "moderate"]
    found = hazard(make_case(tmp_path, hazard=own))
    passing = found.hit_frequency.values.astype("f8")
    above = found.hit_exceedance_frequency.values[0].astype("f8")
    expected = np.where(passing > 0, 1, 0)
    expected = np.where(passing >= 0.1, 2, expected)
    expected = np.where(above >= 0.001, 3, expected)
    expected = np.where(above >= 0.1, 4, expected)
    assert (found.hazard_class.values == expected).all()
    assert {*np.unique(expected)} == {0, 1, 2, 3, 4}


# ---- objects


@pytest.fixture
def layer(tmp_path):
    def make(*objects, **columns):
        columns = {"name": [f"o{k}" for k in range(len(objects))]} | columns
        return make_layer(tmp_path / "objects.gpkg", list(objects), "EPSG:32632", **columns)

    return make


HOUSE = shapely.box(140, 280, 155, 292)
ROAD = shapely.LineString([(0, 250), (300, 253)])
RING = shapely.Polygon([(100, 300), (200, 300), (200, 360), (100, 360)])


def test_an_object_is_met_by_what_touches_its_line(tmp_path, layer):
    found = hazard(make_case(tmp_path), objects=layer(HOUSE, ROAD))
    lines = [
        {"name": name, "x": list(x), "y": list(y), "object_width": 0.0}
        for name, (x, y) in (("h", HOUSE.exterior.xy), ("r", ROAD.xy))
    ]
    result = run(make_case(tmp_path, line=lines))
    energy = (
        at_lines(result)["line_energy_translational"].values
        + at_lines(result)["line_energy_rotational"].values
    )
    assert found.object_passages.values[0].tolist() == np.isfinite(energy).sum(axis=1).tolist()
    for level, threshold in enumerate((30e3, 300e3)):
        above = (energy > threshold).sum(axis=1)
        assert found.object_energy_exceeded.values[0, level].tolist() == above.tolist()
    assert (found.object_frequency.values == 0.5 * found.object_passages.values[0] / 200).all()
    assert 0 < found.object_frequency.values[0] < found.object_frequency.values[1]


def test_a_boulder_counts_once_at_an_object(tmp_path, layer):
    """A boulder that passes both parts of an object, or a line given twice, counts once. The count
    at an outline is between the maximum and the sum of the counts in the cells inside."""
    low = shapely.LineString([(0, 230), (300, 233)])
    both = shapely.MultiLineString([ROAD, low])
    twice = shapely.MultiLineString([ROAD, ROAD])
    found = hazard(make_case(tmp_path), objects=layer(ROAD, low, both, twice, RING))
    road, lower, together, same, ring = found.object_passages.values[0].tolist()
    assert together == max(road, lower) == road  # boulders at the lower part crossed the upper one
    assert same == road
    passed = found.scenario_passages.values[0]
    rows, columns = (GRID.y < 360) & (GRID.y > 300), (GRID.x > 100) & (GRID.x < 200)
    y, x = found.y.values, found.x.values
    inside = passed[np.isin(y, GRID.y[rows])][:, np.isin(x, GRID.x[columns])]
    assert inside.max() <= ring <= inside.sum()


def test_a_point_is_met_by_what_hits_an_object_in_its_cell(tmp_path, layer):
    found = hazard(make_case(tmp_path))
    row, column = np.unravel_index(
        found.scenario_hits.values[0].argmax(), found.hit_frequency.shape
    )
    at = shapely.Point(found.x.values[column] + 2.4, found.y.values[row] - 2.4)
    far = shapely.Point(2.0, 398.0)
    with_objects = hazard(make_case(tmp_path), objects=layer(at, far))
    counts = with_objects.object_passages.values[0]
    assert counts.tolist() == [found.scenario_hits.values[0, row, column], 0]
    for level in range(2):
        cell = found.scenario_hits_energy_exceeded.values[0, level, row, column]
        assert with_objects.object_energy_exceeded.values[0, level, 0] == cell
    assert with_objects.object_hazard_class.values[0] == found.hazard_class.values[row, column]


def test_objects_change_no_map(tmp_path, layer):
    alone, found = hazard(make_case(tmp_path)), hazard(make_case(tmp_path), objects=layer(HOUSE))
    assert found[list(alone.data_vars)].equals(alone)


def test_risk_is_the_sum_over_intensities(tmp_path, layer):
    vulnerability = np.array([0.1, 0.4, 0.9])
    columns = {f"vulnerability_{k + 1}": [one, 1.0] for k, one in enumerate(vulnerability)}
    path = layer(ROAD, ROAD, **columns, exposure=[0.5, 1.0], value=[200.0, 1.0])
    found = hazard(make_case(tmp_path), objects=path)
    for end in ("", "_low", "_high"):
        passing = found[f"object_frequency{end}"].values[0]
        medium, strong = found[f"object_exceedance_frequency{end}"].values[:, 0]
        by_class = np.array([passing - medium, medium - strong, strong])
        risk = 0.5 * 200 * (by_class * vulnerability).sum()
        assert found[f"object_risk{end}"].values[0] == pytest.approx(risk, rel=1e-12)
        same = found[f"object_risk{end}"].values[1]  # all boulders that arrive destroy it
        assert same == pytest.approx(passing, rel=1e-12)
    alike = hazard(make_case(tmp_path), objects=layer(ROAD, vulnerability=[0.25]))
    assert alike.object_risk.values == pytest.approx(0.25 * alike.object_frequency.values)
    assert "object_risk" not in hazard(make_case(tmp_path), objects=layer(ROAD))


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"vulnerability": [1.5]}, "feature 1: vulnerability = 1.5: must be 0 to 1"),
        ({"exposure": [-0.1]}, "feature 1: exposure = -0.1: must be 0 to 1"),
        ({"value": [-1.0]}, "feature 1: value = -1.0: must be >= 0"),
        ({"value": ["much"]}, "attribute value: must be a number, >= 0"),
        ({"value": [None]}, "feature 1: value = nan: must be >= 0"),
        ({"vulnerability_1": [0.5]},
         "attributes vulnerability_1: must be vulnerability, or vulnerability_1 to "
         "vulnerability_3: one for each intensity"),
        ({"vulnerability_1": [0.5], "vulnerability_2": [0.4], "vulnerability_3": [1.0]},
         "feature 1: vulnerability_2: must not be below vulnerability_1"),
    ],
)  # fmt: skip
def test_values_of_objects_that_cannot_be_are_refused(tmp_path, layer, columns, message):
    path = layer(ROAD, **columns)
    with refused(f"{path}: {message}"):
        hazard(make_case(tmp_path), objects=path)


def test_objects_that_cannot_be_are_refused(tmp_path, layer):
    path = layer(shapely.Point(900.0, 100.0))
    with refused(f"{path}: feature 1: lies outside the terrain"):
        hazard(make_case(tmp_path), objects=path)
    path = tmp_path / "none.gpkg"
    with pytest.raises(rockfall.RockfallError, match="none.gpkg"):
        hazard(make_case(tmp_path), objects=path)


# ---- refusals


@pytest.mark.parametrize(
    ("scenario", "groups", "message"),
    [
        ([{"name": "a"}], {},
         "&scenario frequency, return_period, activity: give one of the three"),
        ([ONE | {"return_period": 3.0}], {},
         "&scenario frequency, return_period, activity: give one of the three"),
        ([ONE | {"frequency": -1.0}], {}, "&scenario frequency = -1.0: must be > 0 [1/year]"),
        ([ONE | {"frequency": 0.0}], {}, "&scenario frequency = 0.0: must be > 0 [1/year]"),
        ([ONE | {"frequency_per": "km2"}], {},
         "&scenario frequency_per = 'km2': is not valid for points, which have no area"),
        ([ONE | {"frequency_per": "m"}], {},
         "&scenario frequency_per, cliff_length: 'm' and cliff_length must be given together"),
        ([ONE | {"cliff_length": 80.0}], {},
         "&scenario frequency_per, cliff_length: 'm' and cliff_length must be given together"),
        ([ONE, ONE], {}, "line 33: &scenario name = 'one': must be unique among scenarios"),
        ([ONE], {"hazard": {"matrix": ["extreme"] * 9}},
         "&hazard matrix (value 1) = 'extreme': must be one of: residual, low, moderate, high"),
        ([ONE], {"hazard": {"thresholds": [50.0]}},
         "&hazard matrix = 'moderate', 'low', 'low', 'high', 'moderate', 'moderate', 'high', "
         "...: must be 2 x 3 classes: 2 intensities, each with 3 return periods"),
        ([ONE], {"hazard": {"matrix": ["low"] * 8 + ["residual"]}},
         "&hazard matrix = 'low', 'low', 'low', 'low', 'low', 'low', 'low', 'low', 'residual': "
         "must not decrease with energy or frequency"),
        ([ONE], {"hazard": {"return_periods": [100.0, 30.0, 300.0]}},
         "&hazard return_periods = 100.0, 30.0, 300.0: must increase"),
    ],
)  # fmt: skip
def test_scenarios_and_matrices_that_make_no_sense_are_refused(tmp_path, scenario, groups, message):
    with pytest.raises(rockfall.RockfallError) as caught:
        make_case(tmp_path, *scenario, **groups)
    assert caught.value.code == 2
    said = str(caught.value)
    assert said.startswith("case: ") and "\n" not in said
    assert said.removeprefix("case: ").split(": ")[-1] == message.split(": ")[-1], said


def test_a_hazard_needs_scenarios_that_agree_with_the_case(tmp_path):
    with refused("case: a hazard needs a &scenario: a class of boulders with its frequency"):
        hazard(scenes.make_case(tmp_path, *scenes.sets(2.0), release=RELEASE))
    odd = ONE | {"volume": "fixed", "volume_mean": 1.0, "volume_std": 0.1}
    with refused(
        "case: &scenario name = 'one': &boulder volume_std = 0.1: is not valid for volume = 'fixed'"
    ):
        hazard(make_case(tmp_path, odd))


def test_a_factor_on_frequencies_widens_their_limits_and_nothing_else(tmp_path, layer):
    """Factors of 0.5 and 3 on frequencies multiply their lower and upper limits, and leave values
    and classes unchanged. Fewer classes are certain."""
    path = layer(ROAD, vulnerability=[0.5], persons=[1.0])
    known = hazard(make_case(tmp_path), objects=path)
    wide = {"frequency_factor": [0.5, 3.0]}
    found = hazard(make_case(tmp_path, hazard=wide), objects=path)
    names = ["hit_frequency", "exceedance_frequency", "object_frequency", "object_risk"]
    for name in [*names, "object_collective_risk", "total_collective_risk"]:
        for end, factor in (("", 1.0), ("_low", 0.5), ("_high", 3.0)):
            one, other = (of[f"{name}{end}"].values for of in (found, known))
            np.testing.assert_allclose(one, factor * other, rtol=1e-6)
    assert (found.hazard_class.values == known.hazard_class.values).all()
    assert (found.hazard_class_lower.values <= known.hazard_class_lower.values).all()
    assert (found.hazard_class_upper.values >= known.hazard_class_upper.values).all()
    assert found.hazard_class_certain.values.sum() < known.hazard_class_certain.values.sum()


@pytest.mark.parametrize(
    ("factor", "rule"),
    [
        ([0.5], "(value 1) = 0.5: must be two factors, the lowest first"),
        ([1.5, 2.0], "must enclose 1"),
        ([0.5, 0.9], "must enclose 1"),
    ],
)
def test_a_factor_must_enclose_one(tmp_path, factor, rule):
    with pytest.raises(rockfall.RockfallError, match="&hazard frequency_factor") as caught:
        make_case(tmp_path, hazard={"frequency_factor": factor})
    assert rule.split(": ")[-1] in str(caught.value)
