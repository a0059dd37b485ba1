# SPDX-License-Identifier: BSD-3-Clause
"""Boulders that reach a line past the ends of a net: their number, and the remark on page 1."""

import numpy as np
import pytest

import rockfall
import scenes
from rockfall.analysis.lines.around import around_by_line, barriers_above
from rockfall.html_report.summary import around_ends
from rockfall.language import LANGUAGES, speaking
from rockfall.quantities import percent
from rockfall.studies.hazard import read_study
from rockfall.tables import dossier
from rockfall.terrain.polyline import sides

Z = scenes.rough()
PLACE = {"dem": Z, "transform": scenes.grid(Z)}
LINES = [
    {"name": "above", "x": [0.0, 300.0], "y": [340.0, 340.0]},
    {"name": "road", "x": [0.0, 300.0], "y": [200.0, 200.0]},
]
SHORT = {"name": "net", "x": [100.0, 150.0], "y": [300.0, 300.0], "height": 3.0, "capacity": 100e3}
LONG = SHORT | {"x": [0.0, 300.0]}
LOW = SHORT | {"name": "low", "x": [0.0, 300.0], "y": [120.0, 120.0]}


def case_with(folder, *nets):
    release = {"x": [90.0, 125.0, 200.0], "y": [380.0] * 3, "drop_height": 5.0}
    made = {"release": release, "case": {"boulders": 150}, "line": LINES}
    return scenes.make_case(folder, *scenes.sets(2.0), **made).replace(barrier=[*nets])


def past(result):
    """Number of boulders that reached the road without meeting the net first, by the table of
    crossings."""
    at = rockfall.crossings(result)
    road, net = (at[at["line"] == name].set_index("boulder")["time"] for name in ("road", "net"))
    return int((~(net.reindex(road.index) <= road)).sum())


def test_who_passes_the_ends_is_counted_at_the_line_below(tmp_path):
    result = rockfall.run(case_with(tmp_path, SHORT, LOW), **PLACE)
    names = result["line_name"].values.tolist()
    assert barriers_above(result, names.index("above")) == []
    assert barriers_above(result, names.index("road")) == [names.index("net")]
    ((line, nets, around),) = around_by_line(result, [0, 1])
    assert (names[line], [names[k] for k in nets]) == ("road", ["net"])
    assert around.sum() == past(result) > 50
    (said,) = around_ends(result, dict.fromkeys(names))
    part = f"{around.sum()} of 450 boulders ({percent(around.sum() / 450)})"
    cure = "Lengthen it, or add another barrier."
    assert said == f"road: {part} pass around the ends of net. {cure}"


def test_a_net_across_the_slope_has_no_sentence(tmp_path):
    result = rockfall.run(case_with(tmp_path, LONG), **PLACE)
    assert past(result) == 0 and not [*around_by_line(result, [0, 1])]
    assert not [*around_ends(result, dict.fromkeys(["above", "road"]))]


def test_a_hazard_gives_their_frequency(tmp_path):
    scenarios = [
        {"name": "often", "frequency": 8.0},
        {"name": "large", "frequency": 0.5, "volume_mean": 6.0},
    ]
    case = case_with(tmp_path, SHORT, LOW).replace(scenario=scenarios)
    hazard, frequency = rockfall.hazard(case, **PLACE), 0.0
    for scenario in read_study(case, **PLACE).scenarios:
        result = rockfall.run(scenario.case, **PLACE)
        frequency += scenario.frequency * past(result) / result.sizes["boulder"]
    (said,) = dossier.around_ends(hazard)
    words = dict(said.values)
    assert words["line"] == "road" and words["nets"] == ["net"]
    assert float(words["part"].values["n"]) == pytest.approx(frequency, rel=0.05)
    counts = hazard["line_around"].sel(line="road").values
    assert (hazard["frequency"].values / 450) @ counts == pytest.approx(frequency, rel=1e-12)
    for language in LANGUAGES:
        with speaking(language):
            (text,) = dossier.around_ends(hazard)
        assert len(text.split()) <= 25 and "{" not in text


def test_a_scenario_that_misses_the_net_goes_around_it(tmp_path):
    volumes = np.geomspace(0.02, 5.0, 8).tolist()
    scenarios = [
        {"name": f"{volume:.2f}", "frequency": 1.0, "volume_mean": volume} for volume in volumes
    ]
    net = SHORT | {"x": [180.0, 220.0]}
    made = case_with(tmp_path, net).replace(case={"boulders": 1}, scenario=scenarios)
    hazard = rockfall.hazard(made, **PLACE).sel(line="road")
    expected, met = [], []
    for scenario in read_study(made, **PLACE).scenarios:
        result = rockfall.run(scenario.case, **PLACE)
        expected.append(past(result))
        met.append((rockfall.crossings(result)["line"] == "net").any())
    assert any(met) and any(n > 0 for n, here in zip(expected, met, strict=True) if not here)
    assert hazard["line_around"].values.tolist() == expected


SIDE = 300.0  # [m] of the square terrain that is turned
NETS = {  # ends in plan, and whether the net is above a road from (100, 150) to (200, 150)
    "above": (((100, 240), (150, 240)), True),
    "above, beside an end": (((210, 175), (290, 160)), True),
    "below": (((100, 60), (200, 60)), False),
    "below, beyond both ends": (((0, 60), (300, 60)), False),
    "below, beside an end": (((210, 140), (290, 125)), False),
    "below, rising towards the level of the road": (((60, 40), (290, 145)), False),
    "across": (((110, 200), (190, 90)), True),
}


def turned(points, turns, mirrored):
    """Points of the square, mirrored west to east if requested, then turned anticlockwise."""
    z = np.array([complex(*point) for point in points]) - SIDE * (1 + 1j) / 2
    z = (-z.conj() if mirrored else z) * 1j**turns + SIDE * (1 + 1j) / 2
    return {"x": z.real.tolist(), "y": z.imag.tolist()}


@pytest.mark.parametrize(
    ("turns", "mirrored", "capacity"),
    [(0, False, 1e5)]
    + [pytest.param(*how, marks=pytest.mark.all) for how in ((0, True, 1.0), (1, False, 1e5),
                                                             (2, True, 1e5), (3, True, 1.0))],
)  # fmt: skip
def test_a_net_is_above_a_line_on_the_side_that_boulders_come_from(
    tmp_path, turns, mirrored, capacity
):
    """`barriers_above` gives only nets on the side of the road from which boulders come, whether
    they stop all boulders or none. `past` counts the boulders of the remark independently of the
    terrain."""
    z = np.rot90(scenes.rough(60, 60)[:, :: -1 if mirrored else 1], turns)
    starts = turned([(x, 280.0) for x in range(20, 290, 10)], turns, mirrored)
    road = {"name": "road"} | turned([(100, 150), (200, 150)], turns, mirrored)
    made = {"release": starts | {"drop_height": 5.0}, "case": {"boulders": 15}, "line": [road]}
    case, found = scenes.make_case(tmp_path, *scenes.sets(2.0), **made), {}
    for name, (ends, _) in NETS.items():
        net = SHORT | turned(ends, turns, mirrored) | {"capacity": capacity}
        result = rockfall.run(case.replace(barrier=[net]), dem=z, transform=scenes.grid(z))
        counts = rockfall.crossings(result)["line"].value_counts()
        assert counts["net"] > 9 and counts["road"] > 20
        found[name] = barriers_above(result, 0) == [1]
        texts = [*around_ends(result, {"road": None})]
        assert len(texts) == found[name]
        if texts:
            assert texts[0].startswith(f"road: {past(result)} of ")
    assert found == {name: above for name, (_, above) in NETS.items()}


def test_a_net_on_one_side_of_a_valley_is_above_its_road(tmp_path):
    z = np.tile(1000 + 0.8 * abs(np.arange(60) * 5.0 - 147.5), (60, 1))
    road = {"name": "road", "x": [147.5, 147.5], "y": [20.0, 280.0]}
    release = {"x": [30.0] * 5 + [270.0] * 5, "y": [50.0, 100.0, 150.0, 200.0, 250.0] * 2}
    made = {"release": release, "case": {"boulders": 40}, "line": [road]}
    case = scenes.make_case(tmp_path, *scenes.sets(2.0), **made)
    for west in (90.0, 205.0):
        net = SHORT | {"x": [west, west], "y": [0.0, 300.0], "capacity": 1e5, "height": 9.0}
        result = rockfall.run(case.replace(barrier=[net]), dem=z, transform=scenes.grid(z))
        assert barriers_above(result, 0) == [1] and past(result) > 100


def test_sides_of_a_bent_line():
    line = np.array([0, 10, 10, 10 + 5j, 5j])  # east, north, then back west; a vertex twice
    left = np.array([5 + 1j, 9 + 2j, 1 + 4.9j, -50 + 0.1j, -9 + 4.9j])
    right = np.array([5 - 1j, 11 - 1j, 11 + 7j, 5 + 6j, 12 + 3j, -50 - 1j, -9 + 9j])
    assert (sides(left, line) == 1).all() and (sides(right, line) == -1).all()
    assert (sides(left, line[::-1]) == -1).all() and (sides(right, line[::-1]) == 1).all()
    acute = np.array([0, 10, 9 + 3j])  # turns back to the left
    assert sides(np.array([12 - 1j, 12 + 1j, 9 + 1j]), acute).tolist() == [-1, -1, 1]
