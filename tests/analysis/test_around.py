# SPDX-License-Identifier: BSD-3-Clause
"""Boulders that reach a line past the ends of a net: how many, and what page 1 says of them."""

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
    """Boulders that reach the road without the net before, from the table of crossings."""
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
    assert not [*dossier.around_ends(hazard.drop_vars("line_around"))]  # an older file


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
