# SPDX-License-Identifier: BSD-3-Clause
"""`rockfall new`: each zone of a first case has a ground, named by a term of the field."""

import io
from pathlib import Path

import pytest

import rockfall
import scenes
from made import every_third, make_layer, make_raster
from rockfall.analysis.validity.remarks import model_warnings
from rockfall.case import read_case
from rockfall.cli import main
from rockfall.draft.grounds import GROUNDS, recognised
from rockfall.grounds import table_names

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

W, N = 600000.0, 5000000.0
THIRDS = [shapely.box(W, N - y - 133, W + 300, N - y) for y in (0, 133, 266)]


@pytest.fixture(autouse=True)
def slope(tmp_path, monkeypatch):
    """Write dem.tif to an empty current folder, and make `check` simulate few boulders."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rockfall.simulation.pilot.PILOT_REBOUNDS", 2000)
    z = scenes.rough(60, 80, 5.0, gradient=0.8, relief=8, dtype="f4")
    make_raster("dem.tif", z, nodata=-9999)


def new(*arguments):
    return main(["new", "dem.tif", *arguments, "-o", "case.nml"])


def zones():
    """Ground of each zone, by the name of the zone, from case_zones.csv."""
    rows = [line.split(",") for line in Path("case_zones.csv").read_text().splitlines()]
    ground, name = rows[0].index("ground"), rows[0].index("name")
    return {row[name]: row[ground] for row in rows[1:]}


@pytest.mark.parametrize(
    ("ground", "names"),
    [
        ("rock", ("rock", "Bedrock, bare", "Felswand", "falaise nord", "parete")),
        ("rocky-slope", ("rocky slope", "Blockfeld")),
        ("talus", ("coarse scree", "Hangschutt 2", "Éboulis", "detriti grossi")),
        ("compact", ("road", "Strasse", "chemin", "strada provinciale")),
        ("meadow", ("pasture, wet", "Wiese", "pré", "prato")),
        ("vegetated-soil", ("forest floor", "Wald", "forêt", "bosco")),
        ("soft-soil", ("soft ground", "Moor", "marais", "palude")),
        ("", ("", "plot 7", "forest road", "pasture with debris", "zone 3")),
    ],
)
def test_terms_of_the_field_are_known_in_four_languages(ground, names):
    assert [recognised(name) for name in names] == [ground] * len(names)


def test_terms_are_tables_of_impacts():
    assert GROUNDS.keys() == {*table_names()}


def test_a_zone_follows_what_is_given_for_it_its_attribute_its_name_then_the_usual(capsys):
    make_layer(
        "ground.gpkg", [*THIRDS, shapely.box(W, N - 400, W + 300, N - 399)],
        mean_radius=[0.1, 0.2, 0.3, 0.4], name=["scree", "pasture", "road", "plot"],
        ground=["rock", None, "soil_7", None],
    )  # fmt: skip
    assert new("ground.gpkg", "--ground", "soft-soil", "--ground", "road=compact") == 0
    assert zones() == {
        "scree": "rock", "pasture": "meadow", "road": "compact", "plot": "soft-soil"
    }  # fmt: skip
    said = capsys.readouterr().out
    for line in (
        "zone pasture: ground meadow (by name)",
        "zone road: ground compact (as given)",
        "zone plot: ground soft-soil (as given)",
    ):
        assert line in said.splitlines() and f"! - {line}" in Path("case.nml").read_text()
    assert main(["check", "case.nml"]) == 0


def test_a_zone_is_given_by_its_id_where_it_has_no_name():
    make_layer("ground.gpkg", THIRDS, zone=[4, 7, 9], mean_radius=[0.1, 0.2, 0.3])
    assert new("ground.gpkg", "--ground", "7=meadow", "--ground", "talus") == 0
    table = Path("case_zones.csv").read_text().splitlines()
    assert table == ["zone,mean_radius,ground", "4,0.1,talus", "7,0.2,meadow", "9,0.3,talus"]


@pytest.mark.family(2)
@pytest.mark.parametrize(
    "ground", every_third([*GROUNDS, "soil_4", "constant_meadow", "laboratory-spheres"])
)
def test_a_case_without_zones_follows_the_ground_given(ground):
    assert new("--ground", ground) == 0
    case = read_case("case.nml").replace(case={"boulders_total": 200})
    result = rockfall.run(case)
    followed = dict(zip(result["ground"].values, result["rebounds_by_ground"].values, strict=True))
    assert followed[ground] == sum(followed.values()) > 200


def test_a_draft_does_not_warn_of_the_default_set():
    make_layer("ground.gpkg", THIRDS, mean_radius=[0.1] * 3, name=["rock", "scree", "meadow"])
    assert new("ground.gpkg") == 0
    case = read_case("case.nml").replace(case={"boulders_total": 200})
    warnings = " ".join(map(str, model_warnings(rockfall.run(case), case)))
    assert "talus" in warnings and "vaujany-observed" not in warnings


CHOICES = "rock, rocky-slope, talus, compact, meadow, vegetated-soil, soft-soil"


@pytest.mark.family(2)
@pytest.mark.parametrize(
    ("options", "said"),
    [
        ([], f"dem.tif: ground is missing: give --ground GROUND, of {CHOICES}"),
        (["g.gpkg"], "g.gpkg: zone plot 7: ground is missing: give --ground 'plot 7=GROUND', of "
                     "rock"),
        (["h.gpkg"], f"h.gpkg: feature 1: ground is missing: give --ground GROUND, of {CHOICES}"),
        (["--ground", "gravel"], f"--ground: no ground 'gravel': must be {CHOICES}, or another"),
        (["--ground", "talus-ensemble"], "--ground: no ground 'talus-ensemble': must be"),
        (["--ground", ""], f"dem.tif: ground is missing: give --ground GROUND, of {CHOICES}"),
        (["g.gpkg", "--ground", "plot 7=x"], "--ground plot 7=x: no ground 'x': must be"),
        (["--ground", "a=rock", "--ground", "rock"], "--ground a=rock: give a layer of zones"),
        (["g.gpkg", "--ground", "plot=rock", "--ground", "talus"],
         "--ground plot=rock: not in g.gpkg, which has plot 7, scree"),
        (["--ground", "rock", "--ground", "talus"], "--ground talus: given twice"),
        (["--ground", "a=rock", "--ground", "a=talus"], "--ground a=talus: given twice"),
    ],
)  # fmt: skip
def test_a_draft_without_a_ground_is_refused_with_the_choices(options, said, capsys):
    make_layer("g.gpkg", THIRDS[:2], mean_radius=[0.1, 0.2], name=["plot 7", "scree"])
    make_layer("h.gpkg", THIRDS[:2], mean_radius=[0.1, 0.2])
    assert new(*options) == 2
    line = capsys.readouterr().err
    assert line.startswith(f"rockfall: {said}") and line.count("\n") == 1
    assert len(line.split()) <= 25
    assert not Path("case.nml").exists() and not Path("case_zones.csv").exists()


class Terminal(io.StringIO):
    """Input that claims to be a terminal."""

    def isatty(self):
        return True


def test_at_a_terminal_grounds_are_asked_for_once_each(monkeypatch, capsys):
    make_layer(
        "g.gpkg", THIRDS, mean_radius=[0.1, 0.2, 0.2], name=["plot 7", "field", "field"]
    )  # fmt: skip
    monkeypatch.setattr("sys.stdin", Terminal("9\nmud\n3\nmeadow\n"))
    assert new("g.gpkg") == 0
    assert zones() == {"plot 7": "talus", "field": "meadow"}
    said = capsys.readouterr().err
    assert said.count("Ground of zone") == 2 and "zone plot 7, mean_radius 0.1 m" in said


def test_a_terminal_that_answers_nothing_is_refused(monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", Terminal(""))
    assert new() == 2
    assert f"ground is missing: give --ground GROUND, of {CHOICES}" in capsys.readouterr().err
    assert not Path("case.nml").exists()


def test_a_strength_and_relief_of_a_zone_go_into_the_table():
    pair = {"ground_strength": [3e5, None, 8e5], "ground_relief": [12.5, 14.0, None]}
    make_layer("ground.gpkg", THIRDS, name=["scree", "upper", "lower"], **pair)
    assert new("ground.gpkg", "--ground", "meadow") == 0
    lines = Path("case_zones.csv").read_text().splitlines()
    assert lines[0] == "zone,ground,ground_strength,ground_relief,name"
    assert [line.split(",")[1:4] for line in lines[1:]] == [
        ["talus", "300000.0", "12.5"], ["meadow", "", "14.0"], ["meadow", "800000.0", ""],
    ]  # fmt: skip
