# SPDX-License-Identifier: BSD-3-Clause
"""Lines, barriers and dams from vector layers: bit-identical to those typed in the case, or refused
in one line."""

import os
import sys

import numpy as np
import pytest

import rockfall
from made import every_third, make_layer
from programs import (
    find_program,
    make_full_case,
    refused_in_one_line,
    refuses,
    run_program,
    same_results,
)
from rockfall.case import case_in, read_case
from rockfall.case.files import files_behind, input_files
from rockfall.result.crossings import line_names
from rockfall.scene.prepare import prepare
from rockfall.scene.read import read_scene

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

W, N = 600000.0, 5000000.0
ROAD = np.array([[W, N - 130.1], [W + 137.7, N - 131.3], [W + 300, N - 130]])
NET = ROAD - (0, 60.25)
CREST = np.array([[W + 50, N - 100], [W + 230, N - 100]])
FORMATS = ("site.gpkg", "site.geojson", "site.shp", "site.fgb")


def typed(xy, **values):
    return {"x": xy[:, 0].tolist(), "y": xy[:, 1].tolist(), **values}


def line(*xy):
    return shapely.LineString(np.concatenate(xy))


@pytest.fixture
def case(tmp_path, monkeypatch):
    """Case without lines, with its files in the current folder."""
    monkeypatch.chdir(tmp_path)
    made = make_full_case(tmp_path, case={"boulders": 20})
    return made.replace(line=[])


def lines(case, **groups):
    """Case with changed groups, after its layers are read."""
    return read_scene(case.replace(**groups)).case


def calls(function):
    """Number of function calls, in Python and in C, while `function` runs."""
    counted = [0]

    def count(frame, event, argument):
        counted[0] += event in ("call", "c_call")

    sys.setprofile(count)
    try:
        function()
    finally:
        sys.setprofile(None)
    return counted[0]


def test_lines_of_a_layer_cost_linear_time(case):
    """Reading and writing 400 lines needs at most 4.4 times as many function calls as 100 lines."""
    cost = {}
    for n in (100, 400):
        y = N - 5 - 0.2 * np.arange(n)
        several = [shapely.LineString([(W, north), (W + 300, north)]) for north in y]
        make_layer(f"{n}.gpkg", several, name=[f"line {k}" for k in range(n)])
        named = case.replace(line=[{"file": f"{n}.gpkg"}])
        read_scene(named)  # warm-up of imports
        cost[n] = calls(lambda named=named: read_scene(named).case.text())
    assert cost[400] < 4.4 * cost[100]
    scene = read_scene(named)
    assert case_in({"case": scene.case.text(), "case_file": "case.nml"}).line == scene.case.line
    assert len(scene.case.line) == 400
    twice = [*scene.case.line, {**scene.case.line[-1], "name": "line 7"}]
    with pytest.raises(rockfall.RockfallError, match="name = 'line 7': must be unique"):
        case.replace(line=twice)


@pytest.mark.family(2)
@pytest.mark.parametrize("name", every_third(FORMATS))
def test_layers_give_the_bits_of_typed_coordinates(case, name):
    make_layer(f"road{name[4:]}", [line(ROAD)], name=["B 12"])
    make_layer(f"net{name[4:]}", [line(NET)], name=["net"], height=[4.0], capacity=[300.0])
    make_layer(
        f"dam{name[4:]}",
        [line(CREST)],
        height=[2],
        crest_width=[1.5],
        slope=[60],
        allow_coarse=[True],
    )
    by_hand = case.replace(
        line=[typed(ROAD, name="B 12")],
        barrier=[typed(NET, name="net", height=4.0, capacity=300.0)],
        dam=[typed(CREST, height=2.0, crest_width=1.5, slope=60.0, allow_coarse=True)],
    )
    of_layers = case.replace(
        line=[{"file": f"road{name[4:]}"}], barrier=[{"file": f"net{name[4:]}"}],
        dam=[{"file": f"dam{name[4:]}"}],
    )  # fmt: skip
    one, other = rockfall.run(by_hand), rockfall.run(of_layers)
    assert one.attrs["case"] == other.attrs["case"]
    keep = {"input_checksums": ""}
    same_results(one.assign_attrs(keep), other.assign_attrs(keep))
    assert f"barrier net{name[4:]}" in other.attrs["input_checksums"]
    assert (case.folder / f"dam{name[4:]}") in set(files_behind(other))


@pytest.mark.all
def test_standalone_program_takes_what_was_prepared(case):
    if not find_program():
        pytest.skip("no rockfall-batch")
    make_layer("site.gpkg", [line(ROAD), line(NET)], layer="lines", name=["road", "path"])
    make_layer("site.gpkg", [line(NET + 1.0)], layer="nets", height=[4.0], **{"class": [1]})
    make_layer("site.gpkg", [line(CREST)], layer="dams", height=[2.0])
    case = case.replace(
        line=[{"file": "site.gpkg", "layer": "lines"}],
        barrier=[{"file": "site.gpkg", "layer": "nets"}],
        dam=[{"file": "site.gpkg", "layer": "dams", "allow_coarse": True}],
    )
    prepare(case, "ready")
    done = run_program("ready/case.nml", "--output", "part.nc", "--quiet", cwd=".")
    assert done.returncode == 0, done.stderr
    same_results(rockfall.merge(["part.nc"]), found := rockfall.run(case))
    for of in ("line site.gpkg, layer lines", "barrier site.gpkg, layer nets"):
        assert of in found.attrs["input_checksums"]

    text = read_case("ready/case.nml").replace(line=[{"file": "../site.gpkg"}]).text()
    (case.folder / "ready/case.nml").write_text(text)
    done = run_program("ready/case.nml", "--output", "new.nc", cwd=".")
    refused_in_one_line(
        done,
        "ready/case.nml: &line file = '../site.gpkg': is a layer, which cannot be read here: run "
        "`rockfall prepare` first",
    )


def test_names(case):
    shapes = [line(ROAD + k) for k in range(4)]
    make_layer("a.gpkg", shapes, Name=["road", None, "road", "path"], number=[3, 2, 1, 7])
    make_layer("b.gpkg", shapes[:1])

    def names(**group):
        return [one["name"] for one in lines(case, line=[group]).line]

    assert names(file="a.gpkg") == ["road 1", "a", "road 2", "path"]
    assert names(file="a.gpkg", field="number") == ["3", "2", "1", "7"]
    assert names(file="a.gpkg", name="L") == ["L 1", "L 2", "L 3", "L 4"]
    assert names(file="b.gpkg") == ["b"]
    assert names(file="b.gpkg", layer="b", name="other") == ["other"]


def test_parts_that_join_are_one_line(case):
    parts = [ROAD[:2], ROAD[1:]]
    apart = [ROAD, NET]
    make_layer("a.gpkg", [shapely.MultiLineString(one) for one in (parts, apart)], name=["a", "b"])
    found = lines(case, line=[{"file": "a.gpkg"}]).line
    assert [one["name"] for one in found] == ["a", "b 1", "b 2"]
    for one, xy in zip(found, (ROAD, *apart), strict=True):
        assert {"x": one["x"], "y": one["y"]} == typed(xy)


def test_attributes_give_what_the_group_does_not(case):
    make_layer(
        "n.gpkg", [line(NET), line(NET + 9)], HEIGHT=[3.0, 5.0], Capacity=[None, 250.0],
        Class=[4.0, None],
    )  # fmt: skip

    def nets(**group):
        return lines(case, barrier=[{"file": "n.gpkg", **group}]).barrier

    both = nets()
    assert [one["height"] for one in both] == [3.0, 5.0]
    assert [one.get("class") for one in both] == [4, None]
    assert [one.get("capacity") for one in both] == [None, 250.0]
    both = nets(height=7.0, capacity=100.0)
    assert {(one["height"], one["capacity"], "class" in one) for one in both} == {(7, 100, False)}

    make_layer("d.gpkg", [line(CREST), line(CREST)], Crest_Width=[2.0, None], height=[1.0, 2.0])
    dams = lines(case, dam=[{"file": "d.gpkg", "slope": 50.0, "allow_coarse": True}]).dam
    assert [(one["height"], one["crest_width"], one["slope"]) for one in dams] == [
        (1.0, 2.0, 50.0), (2.0, 0.0, 50.0),
    ]  # fmt: skip


def test_what_commands_that_count_lines_see(case):
    make_layer("a.gpkg", [line(ROAD), line(NET)], name=["road", "path"])
    of_layer = case.replace(
        line=[{"file": "a.gpkg"}], case={"boulders": 400},
        impact={"stop_speed": 1.0}, boulder={"volume": "fixed", "volume_std": None},
    )  # fmt: skip
    result = rockfall.run_until(of_layer, "fraction@path < 99 %", cap=50)
    assert line_names(result) == ["road", "path"]
    assert (case.folder / "a.gpkg-wal") in set(input_files(of_layer))


def test_zones_and_sources_name_a_layer(case, capsys):
    fields = {"zone": [4]}
    make_layer("site.gpkg", [shapely.box(W, N - 400, W + 300, N)], layer="ground", **fields)
    make_layer("site.gpkg", [shapely.box(W + 50, N - 40, W + 80, N - 20)], layer="cliff")
    make_layer("site.gpkg", [line(ROAD)], layer="road")
    of_site = case.replace(
        surface={"zones": "site.gpkg", "zones_layer": "ground"},
        release={"x": None, "y": None, "polygons": "site.gpkg", "polygons_layer": "cliff"},
    )
    scene = read_scene(of_site)
    assert (scene.x.size, set(scene.rasters.zone.ravel().tolist())) == (24, {1})
    for group, key, layer, message in (
        ("surface", "zones_layer", None, r"site.gpkg: has 3 .*: choose one with zones_layer"),
        (
            "surface",
            "zones_layer",
            "road",
            r"site.gpkg: attribute zone is missing \(attributes: none\)",
        ),
        (
            "release",
            "polygons_layer",
            "none",
            r"site.gpkg: no layer none \(layers: ground, cliff, road\)",
        ),
    ):
        changed = of_site.replace(**{group: {key: layer}})
        (case.folder / "case.nml").write_text(changed.text())
        refuses(["run", "case.nml", "--output", "new.nc"], message, capsys)
    for group, key in (("surface", "zones_layer"), ("release", "polygons_layer")):
        with pytest.raises(rockfall.RockfallError, match=f"&{group} {key}.*is (only|not) valid"):
            read_scene(case.replace(**{group: {key: "ground"}}))


def refused_cases():
    other = shapely.LineString([(600000.0, 5e6), (600010.0, 5e6)])
    make_layer("road.gpkg", [line(ROAD)])
    make_layer("two.gpkg", [line(ROAD)], layer="road")
    make_layer("two.gpkg", [line(NET)], layer="net")
    make_layer("point.gpkg", [shapely.Point(W, N)])
    make_layer("far.gpkg", [other], "EPSG:4326")
    make_layer("text.gpkg", [line(NET)], height=["high"], capacity=[1.0])
    make_layer("class.gpkg", [line(NET)], height=[2.0], **{"class": [2.5]})
    road, net = {"file": "road.gpkg"}, {"height": 2.0, "capacity": 9.0}
    two = {"file": "two.gpkg"}
    either = "give one of the two"
    case = "case.nml: "
    yield "line", two, r"two.gpkg: has 2 layers \(road, net\): choose one with layer"
    yield (
        "line",
        {"file": "two.gpkg", "layer": "ground"},
        r"two.gpkg: no layer ground \(layers: road, net\)",
    )
    yield "line", {"file": "point.gpkg"}, "point.gpkg: feature 1: is a Point, but lines are .*"
    yield "line", {"file": "none.gpkg"}, "case.nml: &line file = 'none.gpkg': no such file"
    yield "line", road | {"field": "id"}, r"road.gpkg: attribute id is missing \(attributes: none\)"
    yield "line", {"file": "far.gpkg"}, "far.gpkg: feature 1: EPSG:4326: position cannot be .*"
    yield "line", road | typed(ROAD), f"{case}&line x, y: give both, or a layer of lines as file"
    yield "line", {"name": "a"}, f"{case}&line x, y: give both, or a layer of lines as file"
    yield "line", typed(ROAD), f"{case}&line name is missing: .*"
    yield (
        "line",
        typed(ROAD, name="a", layer="b"),
        f"{case}&line layer .*: is (only|not) valid .*",
    )
    yield "line", road | {"name": "x" * 61}, ".*&line name = .*: must be at most 60 characters"
    yield "barrier", road, "road.gpkg: feature 1: .*&barrier height is missing: needed here or .*"
    yield (
        "barrier",
        road | {"height": 2.0},
        f"road.gpkg: feature 1: .*class: {either}",
    )
    yield "barrier", {"file": "text.gpkg"}, "text.gpkg: feature 1: .*&barrier height = 'high': .*"
    make_layer("cm.gpkg", [line(NET)], height=[400.0], capacity=[500.0])
    yield "barrier", {"file": "cm.gpkg"}, "cm.gpkg: feature 1: &barrier height = 400.0: must be .*"
    make_layer("joule.gpkg", [line(NET)], height=[4.0], capacity=[5e5])
    yield "barrier", {"file": "joule.gpkg"}, "joule.gpkg: feature 1: &barrier capacity = 5.*"
    make_layer("ratio.gpkg", [line(CREST)], height=[4.0], slope=[1.5])
    yield "dam", {"file": "ratio.gpkg"}, "ratio.gpkg: feature 1: &dam slope = 1.5: must be 5 to .*"
    yield "barrier", {"file": "class.gpkg"}, "class.gpkg: feature 1: .*&barrier class = 2.5: .*"
    yield (
        "barrier",
        road | net | {"class": 1},
        f"{case}&barrier capacity, class: {either}",
    )
    yield "barrier", typed(NET, name="n", capacity=1.0), f"{case}&barrier height is missing: .*"
    yield "dam", road, "road.gpkg: feature 1: .*&dam height is missing: needed here or .*"
    yield "dam", typed(CREST), f"{case}&dam height is missing: .*"


def test_what_cannot_be_is_refused_in_one_line(case, capsys, subtests):
    text = case.text()
    for group, values, message in refused_cases():
        extra = "".join(f" {key} = {namelist(value)}\n" for key, value in values.items())
        (case.folder / "case.nml").write_text(f"{text}\n&{group}\n{extra}/\n")
        with subtests.test(group=group, values=values):
            refuses(["run", "case.nml", "--output", "new.nc"], message, capsys)


def namelist(value):
    return ", ".join(map(repr, value)) if isinstance(value, list) else repr(value)


def test_no_output_over_a_layer(case, capsys):
    make_layer("road.gpkg", [line(ROAD)])
    (case.folder / "case.nml").write_text(case.replace(line=[{"file": "road.gpkg"}]).text())
    os.link("road.gpkg", "result.nc")
    refuses(["run", "case.nml", "--output", "result.nc"], "result.nc: .*", capsys)
