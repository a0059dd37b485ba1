# SPDX-License-Identifier: BSD-3-Clause
"""Pages have only statements that apply to their run: on kinds of boulders and on rebound
models."""

import pytest

import rockfall
from made import every_third, leave_pictures_blank
from rockfall.case import case_of
from scenes import grid, make_case, rough, sets

pytest.importorskip("matplotlib", reason="the report extra is not installed")
from rockfall.analysis.return_levels import return_levels  # noqa: E402
from rockfall.html_report.inputs import zone_table  # noqa: E402
from rockfall.html_report.page import ReportInputs, report  # noqa: E402
from rockfall.html_report.validity import cautions  # noqa: E402
from rockfall.language import LANGUAGES, say, speaking  # noqa: E402
from rockfall.plots.figures import figures  # noqa: E402
from rockfall.plots.rebound_figures import beside_paper  # noqa: E402
from rockfall.tables.lines import rows_of  # noqa: E402

SPHERES, BLOCKS = (
    "Boulders are spheres.",
    "With impact tables, boulders rebound like the simulated blocks",
)
STILL, SLIDES = (
    "Boulders do not slide",
    "Boulders slide along the ground with impact tables only.",
)
WHOLE, SHAPES = "Boulders do not break.", "Boulders have the volume and mean moment of inertia"
AT_RELEASE = "Boulders break at their release only."
AT_IMPACT = "Boulders break at impacts only."
STATEMENTS = {SPHERES, BLOCKS, STILL, SLIDES, WHOLE, SHAPES, AT_RELEASE, AT_IMPACT}

TABLE = {"surface": {"ground": "talus", "uniform_mean_radius": 0.0}}
ROCKS = {"impact": {"form": "table", "table": "rocky-slope", "sets": None}}
CLASSICAL = {"surface": {"ground": "soil_4", "uniform_rg": [0.1, 0.2, 0.3], "method": "A"}}
RUNS = {  # groups of the case, statements on its page
    "matrix": ({}, {SPHERES, STILL, WHOLE}),
    "table of blocks": (TABLE, {BLOCKS, WHOLE}),
    "table of spheres": (ROCKS, {SPHERES, WHOLE}),
    "classical": (CLASSICAL, {SPHERES, STILL, WHOLE}),
    "broken at impact": ({"breakage": {"at": "impact"}}, {SPHERES, STILL, AT_IMPACT}),
    "broken at release": (
        {"breakage": {"at": "release", "release_fall": 10.0}}, {SPHERES, STILL, AT_RELEASE},
    ),
    "broken at both": (
        {"breakage": {"at": "both", "release_fall": 10.0}}, {SPHERES, STILL},
    ),
    "broken by a table": (TABLE | {"breakage": {"at": "impact"}}, {BLOCKS, AT_IMPACT}),
}  # fmt: skip


def run(folder, **groups):
    groups = {
        "case": {"boulders": 40},
        "release": {"x": 150.0, "y": 380.0},
        "line": [{"name": "road", "x": [0.0, 300.0], "y": [330.0, 330.0]}],
        "output": {"rebounds": True, "trajectories": 3},
        "terrain": {},
    } | groups
    impact = groups.pop("impact", {})
    case = make_case(folder, *sets(), **groups).replace(impact=impact)
    return rockfall.run(case, dem=rough(), transform=grid(rough()))


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    return {
        name: run(tmp_path_factory.mktemp("case"), **groups) for name, (groups, _) in RUNS.items()
    }


def stated(result):
    text = "\n".join(cautions(result, rows_of(result), return_levels(result)))
    return {statement for statement in STATEMENTS if statement in text}


@pytest.mark.parametrize("name", every_third(RUNS))
def test_a_page_states_of_boulders_what_they_were(results, name):
    assert stated(results[name]) == RUNS[name][1]


def test_where_a_table_is_one_of_two_grounds_boulders_slide_by_it_only(results):
    by_table = results["table of blocks"].isel(ground=[0, 0])
    models = ("ground", ["impact_table", "impact_sets"])
    mixed = by_table.assign(ground_model=models, rebounds_by_ground=("ground", [10, 10]))
    assert stated(mixed) == {BLOCKS, SLIDES, WHOLE}


def test_shapes_of_sources_are_not_called_spheres(results):
    boulder = {"volume": "source", "volume_mean": None, "d1": "1.tif", "d2": "2.tif", "d3": "3.tif"}
    case = case_of(results["matrix"]).replace(boulder=boulder)
    assert stated(results["matrix"].assign_attrs(case=case.text())) == {SHAPES, STILL, WHOLE}


@pytest.mark.all
@pytest.mark.parametrize("name", RUNS)
def test_only_runs_by_sets_have_the_appendix_of_sets(results, name, monkeypatch):
    """Only runs by impact sets are compared with the paper."""
    leave_pictures_blank(monkeypatch)
    monkeypatch.setattr("rockfall.html_report.page._convergence", lambda *_: iter(()))
    by_sets = name in ("matrix", "broken at impact", "broken at release", "broken at both")
    result = results[name]
    assert beside_paper(result) == by_sets
    named = {figure.name: figure.caption for figure in figures(result)}
    assert ("impact_set" in named) <= by_sets
    assert any("paper" in caption for caption in named.values()) == by_sets
    monkeypatch.setattr("rockfall.html_report.page.ground_figure", lambda *_: None)
    assert ('id="appendix"' in report(ReportInputs(result))) == by_sets


@pytest.mark.parametrize("name", ["table of blocks", "table of spheres", "classical", "matrix"])
def test_a_named_ground_has_no_radius_of_rocks_unless_it_was_given(results, name):
    (table,) = zone_table(results[name])
    head, cells = [*table.head], [*table.rows[0]]
    shown = {
        "table of blocks": (["", "ground"], ["everywhere", "talus"]),
        "table of spheres": (["", "R_m [m]"], ["everywhere", "0.250"]),
        "classical": (
            ["", "ground", "Rg70 [m]", "Rg20 [m]", "Rg10 [m]"],
            ["everywhere", "soil_4", "0.100", "0.200", "0.300"],
        ),
        "matrix": (["", "R_m [m]"], ["everywhere", "0.250"]),
    }
    assert (head, cells) == shown[name]


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_statements_exist_in_the_language(language):
    with speaking(language):
        texts = {say(f"validity.{key}") for key in ("spheres", "whole", "no_sliding", "alone")}
    assert len(texts) == 4 and all(text.endswith(".") for text in texts)
