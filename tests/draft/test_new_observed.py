# SPDX-License-Identifier: BSD-3-Clause
"""`rockfall new`: layers of deposited blocks and of scars become observations of the case."""

import io
from pathlib import Path

import pytest

import scenes
from made import make_layer, make_raster
from rockfall.analysis.observed.compare import site_observations
from rockfall.case import read_case
from rockfall.cli import main
from rockfall.scene.read import read_scene

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

W, N = 600000.0, 5000000.0
POINTS = [shapely.Point(W + 150, N - 250), shapely.Point(W + 160, N - 270)]
ROAD = shapely.LineString([(W, N - 300), (W + 300, N - 300)])
STARTS = {"start_x": [W + 150, W + 155], "start_y": [N - 40, N - 45]}
ANSWER = "Lowest energy-line angle observed at the site"


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture(autouse=True)
def slope(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rockfall.simulation.pilot.PILOT_REBOUNDS", 2000)  # of `check`
    z = scenes.rough(60, 80, 5.0, gradient=0.8, relief=8, dtype="f4")
    make_raster("dem.tif", z, nodata=-9999)


def new(*arguments):
    return main(["new", "dem.tif", *arguments, "-o", "case.nml", "--ground", "talus"])


def observed():
    case = read_case("case.nml")
    return case.observed, site_observations(read_scene(case))


@pytest.mark.family(2)
@pytest.mark.parametrize(("name", "columns", "kind"), [
    ("deposits", {"volume": [0.5, 2.0]}, "stops"),
    ("blocks_at_rest", {}, "stops"),
    ("Ablagerungen", {}, "stops"),
    ("dépôts", {}, "stops"),
    ("surveyed", STARTS, "stops"),
    ("hits", {"impact": ["a", "b"], "dbh": [30.0, 40.0]}, "contacts"),
    ("cicatrices", {"Impact": [1, 2]}, "contacts"),
])  # fmt: skip
def test_layers_are_known_as_observations(name, columns, kind, capsys):
    make_layer(f"{name}.gpkg", POINTS, **columns)
    assert new(f"{name}.gpkg") == 0
    group, seen = observed()
    assert group["files"] == [f"{name}.gpkg"] and "energy_line_angle" not in group
    found = getattr(seen, kind)
    assert len(found) == 2
    if "volume" in columns:
        assert seen.volumes.tolist() == columns["volume"]
    text = Path("case.nml").read_text()
    assert (
        "! energy_line_angle = 31.0" in text
        and "! shadow_angle = 27.5" in text
        and "No observations" not in text
    )
    assert read_case("case.nml").release["steep_cells"]


def test_layers_of_one_file_are_copied(capsys):
    make_layer("site.gpkg", [ROAD], layer="road", name=["road"])
    make_layer("site.gpkg", POINTS, layer="deposits", Volume=[0.5, 2.0], note=["big", None])
    make_layer("site.gpkg", POINTS, layer="scars", impact=["1", "2"], height=[0.5, 1.5])
    assert new("site.gpkg", "--energy-line-angle", "33", "--shadow-angle", "26") == 0
    group, seen = observed()
    assert group["files"] == ["case_blocks.gpkg", "case_scars.gpkg"]
    assert (group["energy_line_angle"], group["shadow_angle"]) == (33.0, 26.0)
    assert seen.stops.tolist() == [[point.x, point.y] for point in POINTS]
    assert seen.volumes.tolist() == [0.5, 2.0] and seen.contacts["height"].tolist() == [0.5, 1.5]
    said = capsys.readouterr().out
    assert "layer deposits: blocks at rest (" in said and "layer scars: scars (" in said
    assert main(["check", "case.nml"]) == 0
    Path("case.nml").unlink()
    assert new("site.gpkg") == 2
    assert "case_blocks.gpkg: already exists" in capsys.readouterr().err


def test_at_a_terminal_the_angle_is_asked_for_if_there_are_observations(monkeypatch, capsys):
    make_layer("deposits.gpkg", POINTS)
    monkeypatch.setattr("sys.stdin", Terminal("flat\n2\n31.5\n\n"))
    assert new("deposits.gpkg") == 0
    group = observed()[0]
    assert group["energy_line_angle"] == 31.5 and "shadow_angle" not in group
    said = capsys.readouterr().err
    assert (
        said.count(ANSWER) == said.count("Lowest shadow angle observed at the site") == 1
        and "must be 5 to 85 degrees" in said
    )
    Path("case.nml").unlink()
    for answers in ("\n\n", ""):
        monkeypatch.setattr("sys.stdin", Terminal(answers))
        assert new("deposits.gpkg") == 0
        assert "energy_line_angle" not in observed()[0]
        Path("case.nml").unlink()
    capsys.readouterr()
    monkeypatch.setattr("sys.stdin", Terminal("33\n"))
    assert new() == 0 and ANSWER not in capsys.readouterr().err  # the short form asks no questions
    assert not read_case("case.nml").observed
    assert "! &observed files = 'blocks.csv', energy_line_angle = 31.0 /" in (
        Path("case.nml").read_text()
    )


@pytest.mark.parametrize(("name", "columns", "options", "fault"), [
    ("deposits", {"volume": [0.5, -1.0]}, [], "deposits.gpkg: feature 2: volume"),
    ("deposits", {}, ["--energy-line-angle", "120"], "must be 5 to 85 degrees"),
    ("deposits", {}, ["--shadow-angle", "4"], "must be 5 to 85 degrees"),
    ("deposits", {}, ["--energy-line-angle", "nan"], "must be 5 to 85 degrees"),
])  # fmt: skip
def test_what_cannot_be_compared_is_refused(name, columns, options, fault, capsys):
    make_layer(f"{name}.gpkg", POINTS, **columns)
    assert new(f"{name}.gpkg", *options) == 2
    assert fault in capsys.readouterr().err and not Path("case.nml").exists()


def test_scars_without_a_name_are_left_out(capsys):
    make_layer("scars.gpkg", POINTS, height=[1.0, 2.0])
    assert new("scars.gpkg") == 0
    assert "left out (scars need an attribute impact, a name or number)" in (
        capsys.readouterr().out
    )


def test_named_trees_stay_trees(capsys):
    make_layer("trees.gpkg", POINTS, impact=[0, 1], dbh=[30.0, 40.0], species=["beech", "spruce"])
    assert new("trees.gpkg") == 0
    assert read_case("case.nml").forest["trees"] == "trees.gpkg"


def test_named_sources_stay_sources(capsys):
    make_layer("source_deposits.gpkg", POINTS, volume=[1.0, 2.0])
    assert new("source_deposits.gpkg") == 0
    assert read_case("case.nml").release["points"] == "source_deposits.gpkg"
