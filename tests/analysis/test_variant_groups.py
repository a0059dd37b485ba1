# SPDX-License-Identifier: BSD-3-Clause
"""&variant groups: the resulting cases, their runs in both programs, refusals."""

import html
import re

import pandas as pd
import pytest

import rockfall
from programs import (  # fmt: skip
    everything,
    find_program,
    make_full_case,
    refused_in_one_line,
    refuses,
    run_program,
    same_results,
)
from rockfall.case.variants import variants
from rockfall.cli import main
from rockfall.result.crossings import at_lines
from rockfall.simulation.parts.merge import join
from rockfall.simulation.simulate import run_scene

pytestmark = pytest.mark.filterwarnings("ignore:.*lies entirely outside the terrain")
WEST, NORTH = 600000.0, 5000000.0
NET = {"name": "net", "x": [WEST, WEST + 300.0], "y": [NORTH - 90.0] * 2, "height": 4.0, "class": 2}
WALL = NET | {"name": "wall", "y": [NORTH - 60.0] * 2, "height": 2.0}
DAM = {"name": "dam", "x": [WEST + 10.0, WEST + 290.0], "y": [NORTH - 110.0] * 2, "height": 6.0}
FOREST = {"uniform_stems": 200.0, "uniform_dbh_mean": 30.0, "uniform_dbh_std": 8.0}
FOREST |= {"uniform_conifers": 70.0}
GROUPS = [
    {"name": "today", "without": ["barrier", "dam", "forest"]},
    {"name": "net", "without": ["dam", "forest"], "barriers": ["net"], "cost": 90000.0},
    {"name": "Räumung 1", "without": ["barrier", "dam"], "forest_density_factor": 0.5},
]


def refused(message):
    """Check that the block raises a RockfallError with one line that contains `message`."""
    return pytest.raises(rockfall.RockfallError, match=f"^.*{re.escape(message)}.*$")


def site(folder, groups=(), **others):
    """Case with two barriers, a dam, a forest and the given variants; also writes its file."""
    case = make_full_case(folder)
    case = case.replace(
        barrier=[NET, WALL], dam=[DAM | {"allow_coarse": True}], forest=FOREST,
        variant=list(groups), output={"trajectories": 0, "rebounds": False},
        case={"seed": 7, "boulders": 30}, **others,
    )  # fmt: skip
    (folder / "case.nml").write_text(case.text(), encoding="utf-8")
    return case


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_variant_is_the_case_with_what_it_names(tmp_path):
    case = site(tmp_path, GROUPS)
    bare, net, cleared = variants(case).values()
    assert (bare.barrier, bare.dam, bare.has_forest) == ([], [], False)
    assert [one["name"] for one in net.barrier] == ["net"] and not net.dam
    assert cleared.forest == case.forest | {"density_factor": 0.5} and not cleared.barrier
    assert [one.case["title"] for one in (bare, net)] == [
        "Über 'alles': today",
        "Über 'alles': net",
    ]
    for one in (bare, net, cleared):
        assert one.variant == [] and one.case["seed"] == 7
        same = ("terrain", "surface", "impact", "boulder", "release", "line", "output")
        assert all(getattr(one, group) == getattr(case, group) for group in same)


def test_keys_of_a_group_that_is_left_out_are_gone(tmp_path):
    group = {"name": "a", "without": "surface", "surface_uniform_mean_radius": 0.3}
    one = variants(site(tmp_path, [group]))["a"]
    assert one.surface["uniform_mean_radius"] == 0.3 and "zones" not in one.surface


def test_a_barrier_from_a_layer_is_known_by_its_file(tmp_path):
    line = '{"type":"LineString","coordinates":[[600000.0,4999910.0],[600300.0,4999910.0]]}'
    feature = f'{{"type":"Feature","properties":{{"height":4.0,"class":2}},"geometry":{line}}}'
    head = '"crs":{"type":"name","properties":{"name":"urn:ogc:def:crs:EPSG::32632"}}'
    text = f'{{"type":"FeatureCollection",{head},"features":[{feature}]}}'
    (tmp_path / "nets.geojson").write_text(text)
    case = site(tmp_path, [{"name": "a", "barriers": "nets"}, {"name": "b", "barriers": "wall"}])
    case = case.replace(barrier=[WALL, {"file": "nets.geojson"}], dam=[])
    first, second = variants(case).values()
    assert first.barrier == [{"file": "nets.geojson"}]
    assert [one["name"] for one in second.barrier] == ["wall"]


def test_a_dam_is_known_by_its_name(tmp_path):
    case = site(tmp_path, [{"name": "a", "dams": "dam", "without": ["forest", "barrier"]}])
    assert [one["name"] for one in variants(case)["a"].dam] == ["dam"]


def test_runs_are_those_of_the_cases_by_hand(tmp_path):
    case = site(tmp_path, GROUPS)
    by_hand = {
        "today": case.replace(variant=[], barrier=[], dam=[], forest=dict.fromkeys(case.forest)),
        "net": case.replace(
            variant=[], barrier=[NET], dam=[], forest=dict.fromkeys(case.forest)
        ),
        "Räumung 1": case.replace(variant=[], barrier=[], dam=[], forest={"density_factor": 0.5}),
    }  # fmt: skip
    found = rockfall.run_variants(case)
    assert list(found) == list(by_hand)
    for name, one in by_hand.items():
        same_results(found[name].assign_attrs(title=""), rockfall.run(one).assign_attrs(title=""))
    stopped = (at_lines(found["net"])["barrier_outcome"] == 2).sum()
    assert stopped > 0 and found["today"]["start_x"].equals(found["net"]["start_x"])


@pytest.mark.all
def test_one_command_makes_results_comparison_and_page(here, capsys, blank_figures):
    pytest.importorskip("jinja2", reason="the report extra is not installed")
    case = site(here, GROUPS)
    words = ["variants", "case.nml", "-o", "out", "--report"]
    assert main([*words, "--quiet"]) == 0
    made = {path.name for path in (here / "out").iterdir()}
    results = {"today.nc", "net.nc", "Räumung 1.nc"}
    assert results | {"differences.csv", "variants.html", "net_passing.tif"} <= made
    assert not {*here.glob("*.checkpoint"), *here.glob("*.lock")}
    page = (here / "out" / "variants.html").read_text(encoding="utf-8")
    assert re.search("<h1>(.*?)</h1>", page)[1] == "Über &#39;alles&#39;"
    rows = dict(re.findall(r"<tr><th scope=.row.[^>]*>(.*?)</th>(.*?)</tr>", page, re.S))
    cells = {label: re.findall("<td>(.*?)</td>", row, re.S) for label, row in rows.items()}
    assert cells["cost"] == ["-", "90,000", "-"] and cells["forest"] == ["-", "-", "200/ha\n× 0.5"]
    found = rockfall.read_result(here / "out" / "net.nc")
    same_results(found, rockfall.run(variants(case)["net"]))
    assert main(["run", "case.nml", "--variant", "net", "--quiet"]) == 0
    same_results(rockfall.read_result(here / "case_net.nc"), found)
    capsys.readouterr()
    refuses(words, "out/today.nc: already exists; not overwritten .*", capsys)


SCENARIOS = [
    {"name": "often", "frequency": 2.0},
    {"name": "large", "return_period": 50.0, "volume": "fixed", "volume_mean": 4.0},
]


def test_scenarios_give_the_frequencies_of_variants(here, capsys, blank_figures):
    pytest.importorskip("jinja2", reason="the report extra is not installed")
    case = site(here, GROUPS[:2], scenario=SCENARIOS)
    words = ["variants", "case.nml", "-o", "out", "--report"]
    assert main(words) == 0
    said = capsys.readouterr().out
    table = pd.read_csv("out/frequencies.csv")
    expected = rockfall.yearly_variants(case).table
    assert table["value"].to_numpy() == pytest.approx(expected["value"].to_numpy(), rel=1e-6)
    assert {*zip(table["quantity"], table["unit"], strict=True)} == {
        ("frequency", "year-1"), ("frequency_behind", "year-1"), ("energy_by_period", "J")
    }  # fmt: skip
    page = (here / "out" / "variants.html").read_text(encoding="utf-8")
    for text in (said, page):
        assert "arriving boulders per year" in text and "energy once in 100 years" in text
        assert "to the &scenario groups" in html.unescape(text)
    assert not {*here.glob("*.checkpoint")}


@pytest.mark.all
def test_scenarios_of_stopped_variants_go_on(here, capsys, monkeypatch):
    site(here, GROUPS[:2], scenario=SCENARIOS)
    calls = iter(range(4))

    def four(*scene, **how):
        if next(calls, None) is None:
            raise KeyboardInterrupt
        return run_scene(*scene, **how)

    words = ["variants", "case.nml", "-o", "out", "--quiet"]
    monkeypatch.setattr("rockfall.studies.study.run_scene", four)
    assert main(words) == 130
    runs = ["today", "net", "today.scenario1", "today.scenario2"]
    assert {path.name for path in here.glob("*.checkpoint")} == {
        f"out.{run}.checkpoint" for run in runs
    }
    monkeypatch.setattr("rockfall.studies.study.run_scene", run_scene)
    assert main([*words, "--resume"]) == 0
    assert not {*here.glob("*.checkpoint")}
    assert main([*words[:2], "-o", "again", "--quiet"]) == 0
    assert (here / "out/frequencies.csv").read_text() == (
        here / "again/frequencies.csv"
    ).read_text()


@pytest.mark.all
@pytest.mark.skipif(not find_program(), reason="no rockfall-batch")
def test_the_standalone_program_runs_a_variant_that_is_prepared(here):
    case = site(here, GROUPS)
    has = (
        "&variant: has variants today, net, Räumung 1: choose one with `rockfall prepare "
        "CASE DIR --variant "
    )
    refused_in_one_line(run_program("case.nml", cwd=here), f"case.nml: {has}NAME`")
    for name, one in variants(case).items():
        assert main(["prepare", "case.nml", name, "--variant", name]) == 0
        done = run_program(f"{name}/case.nml", "--quiet", "-o", "a.part1of1", cwd=here)
        assert done.returncode == 0, done.stderr
        same_results(join([here / "a.part1of1"]).dataset(), rockfall.run(one))
        (here / "a.part1of1").unlink()


@pytest.mark.all
def test_check_lists_every_variant(here, capsys):
    site(here, GROUPS)
    assert main(["check", "case.nml"]) == 0
    said = capsys.readouterr().out
    assert re.findall("^variant (.*)$", said, re.M) == [one["name"] for one in GROUPS]
    assert said.count("stems on") == 1
    assert main(["check", "case.nml", "--variant", "net"]) == 0
    assert "variant" not in capsys.readouterr().out


@pytest.mark.all
def test_a_stopped_run_goes_on(here, capsys, monkeypatch):
    case = site(here, GROUPS[:2])
    calls = iter(range(1))

    def once(*scene, **how):
        if next(calls, None) is None:
            raise KeyboardInterrupt
        return run_scene(*scene, **how)

    monkeypatch.setattr("rockfall.studies.study.run_scene", once)
    assert main(["variants", "case.nml", "-o", "out", "--quiet"]) == 130
    assert not (here / "out").exists() and (here / "out.today.checkpoint").exists()
    monkeypatch.setattr("rockfall.studies.study.run_scene", run_scene)
    file = f"{here.as_posix()}/out.today.checkpoint"
    stopped = f"{file}: contains 120 boulders of a variant: .*"
    refuses(["variants", "case.nml", "-o", "out"], stopped, capsys)
    assert main(["variants", "case.nml", "-o", "out", "--quiet", "--resume"]) == 0
    same_results(rockfall.read_result("out/today.nc"), rockfall.run(variants(case)["today"]))
    assert not {*here.glob("*.checkpoint")}


@pytest.mark.parametrize(
    ("group", "message"),
    [
        ({"name": "a/b"}, "&variant name = 'a/b': is also a file name"),
        ({"name": ".a"}, "&variant name = '.a': is also a file name"),
        ({"name": "x" * 61}, "must be at most 60 bytes"),
        ({"without": "forest"}, "&variant name is missing: text"),
        ({"name": "a", "without": "line"}, "&variant without = 'line': must be one of: barrier"),
        ({"name": "a", "barriers": "net", "without": "barrier"}, "barriers = 'net': is not valid"),
        ({"name": "a", "dams": "dam", "without": "dam"}, "dams = 'dam': is not valid together"),
        ({"name": "a", "forest_density_factor": 2.0}, "density_factor = 2.0: must be 0.001 to 1"),
        ({"name": "a", "forest_seed": 0.5}, "&variant forest_seed = 0.5"),
        ({"name": "a", "case_seed": 2}, "&variant case_seed: unknown key"),
        ({"name": "a", "cost": -1.0}, "&variant cost = -1.0: must be >= 0"),
        ({"name": "base"}, "&variant name = 'base': is reserved for the case without its variants"),
        ({"name": "BASE"}, "&variant name = 'BASE': is reserved for the case without its variants"),
    ],
)  # fmt: skip
def test_a_group_is_checked_with_the_case(tmp_path, group, message):
    case = make_full_case(tmp_path)
    with refused(message):
        case.replace(variant=[group])


def test_names_must_be_unique_for_every_file_system(tmp_path):
    case = make_full_case(tmp_path)
    with refused("&variant name = 'Net': must be unique among variants, in lower case, too"):
        case.replace(variant=[{"name": "net"}, {"name": "Net"}])


@pytest.mark.parametrize(
    ("group", "message"),
    [
        ({"barriers": ["net", "nett"]}, "unknown &barrier 'nett' (names: net, wall)"),
        ({"dams": "dam 2"}, "dams: unknown &dam 'dam 2' (names: dam)"),
        ({"release_steep_cells": True}, "&release steep_cells = .true.: is not valid for points"),
        ({"forest_polygons": "a.gpkg"}, "&forest: give only one of polygons, trees and stems"),
        ({"without": "surface"}, "&surface: give a ground, or one of"),
    ],
)  # fmt: skip
def test_a_variant_that_makes_no_case_is_named(tmp_path, group, message):
    case = site(tmp_path, [{"name": "a"} | group])
    with refused("case.nml: &variant name = 'a'") as caught:
        variants(case)
    assert message in str(caught.value)


@pytest.mark.parametrize("group", ["barrier", "dam", "forest", "impact"])
def test_what_is_not_there_cannot_be_left_out(tmp_path, group):
    case = make_full_case(tmp_path, impact={"sets": None})
    with refused(f"&variant name = 'a' without = '{group}': the case has no &{group}"):
        variants(case.replace(variant=[{"name": "a", "without": [group]}]))


def test_a_forest_variant_needs_a_forest(tmp_path):
    case = make_full_case(tmp_path).replace(variant=[{"name": "a", "forest_density_factor": 0.5}])
    with refused("name = 'a': &forest density_factor = 0.5: is only valid with trees, polygons or"):
        variants(case)


@pytest.mark.parametrize(
    ("one", "two"),
    [
        ({}, {}),
        ({}, {"cost": 5.0}),
        ({}, {"boulder_volume_mean": 0.8}),
        ({}, {"barriers": ["net", "wall"]}),
        ({"without": ["barrier"]}, {"without": ["barrier"], "dams": ["dam"]}),
        ({"release_drop_height": 2.0}, {"release_drop_height": 2}),
    ],
)
def test_equal_variants_are_refused(tmp_path, one, two):
    """Different keys can make variants equal."""
    case = site(tmp_path, [{"name": "a"} | one, {"name": "b"} | two])
    with refused("&variant name = 'b': equals variant 'a': change a key, or omit one of the"):
        variants(case)
    assert [*variants(case.replace(variant=case.variant[1:]))] == ["b"]


@pytest.mark.parametrize(
    ("group", "message"),
    [
        (
            {"release_x": [WEST + 121.0], "release_y": [NORTH - 20.0]},
            "its sources differ from those of 'a'",
        ),
        ({"boulder_volume_mean": 1.0}, "its volumes differ from those of 'a'"),
    ],
)
def test_what_cannot_be_compared_is_refused_before_a_run(tmp_path, group, message):
    case = site(tmp_path, [{"name": "a"}, {"name": "b"} | group])
    with refused(f"case.nml: &variant name = 'b': {message}"):
        rockfall.run_variants(case)


def test_a_comparison_needs_two_variants_and_all_boulders(tmp_path):
    case = site(tmp_path, GROUPS[:1])
    with refused("&variant: has 1 variants: a comparison requires two or more"):
        rockfall.run_variants(case)
    for kept, shown in ("none", "'none'"), (50, "50"):
        needs = f"&output kept = {shown}: a comparison of variants needs the rows of all boulders"
        with refused(f"{needs}: kept = 'all'"):
            rockfall.run_variants(case.replace(variant=GROUPS, output={"kept": kept}))


def test_a_quote_in_a_name_is_written_as_in_a_case(tmp_path):
    case = site(tmp_path, [{"name": "Paul's"}, {"name": "Ann's"}])
    with refused("&variant name = 'Ann''s': equals variant 'Paul''s': change a key, or omit"):
        variants(case)
    with refused(
        """&variant name = 'a "b"': is also a file name: must not begin or end with a dot"""
    ):
        case.replace(variant=[{"name": 'a "b"'}])


def test_other_heights_of_release_can_be_compared(tmp_path):
    case = site(tmp_path, [{"name": "low"}, {"name": "high", "release_drop_height": 9.0}])
    low, high = rockfall.run_variants(case).values()
    assert low["start_x"].equals(high["start_x"]) and not low["stop_x"].equals(high["stop_x"])


def test_a_case_with_variants_needs_a_choice(here, capsys):
    case = site(here, GROUPS)
    rule = "has variants today, net, Räumung 1: run all with `rockfall variants`, .*"
    with refused(f"&variant: {rule.removesuffix('.*')}"):
        rockfall.run(case)
    for words in (["run", "case.nml"], ["prepare", "case.nml", "a"], ["ensemble", "case.nml"],
                  ["slurm", "case.nml", "a", "--shards", "2"], ["hazard", "case.nml"],
                  ["convergence", "case.nml"], ["models", "case.nml"]):  # fmt: skip
        refuses(words, f"case.nml: &variant: {rule}", capsys)
    known = "unknown \\(variants: today, net, Räumung 1, base\\)"
    refuses(["run", "case.nml", "--variant", "wall"], f"case.nml: --variant wall: {known}", capsys)
    before = everything(here)
    assert main(["slurm", "case.nml", "jobs", "--shards", "2", "--variant", "Räumung 1"]) == 0
    assert " --variant 'Räumung 1' --quiet " in (here / "jobs/run.sh").read_text()
    assert before.items() <= everything(here).items()
