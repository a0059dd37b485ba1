# SPDX-License-Identifier: BSD-3-Clause
"""`rockfall new`: layers are recognised, and the case runs as written."""

import ntpath
import os
import re
from pathlib import Path

import numpy as np
import pytest

import rockfall
import scenes
from made import every_third, make_layer, make_raster
from rockfall.case import read_case
from rockfall.cli import main
from rockfall.scene.read import read_scene

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

W, N = 600000.0, 5000000.0
BOX = shapely.box


def across(y, x=0.0):
    return shapely.LineString([(W + x, N - y), (W + 300 - x, N - y)])


CLIFF = BOX(W + 100, N - 60, W + 200, N - 30)
HALVES = [BOX(W, N - 200, W + 300, N), BOX(W, N - 390, W + 300, N - 200)]
TREES = [shapely.Point(W + 150, N - 150), shapely.Point(W + 160, N - 170)]


@pytest.fixture(autouse=True)
def slope(tmp_path, monkeypatch):
    """Write dem.tif to an empty current folder, and make `check` simulate few boulders."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rockfall.simulation.pilot.PILOT_REBOUNDS", 2000)
    z = scenes.rough(60, 80, 5.0, gradient=0.8, relief=8, dtype="f4")
    make_raster("dem.tif", z, nodata=-9999)


def new(*arguments, ground=("--ground", "talus")):
    return main(["new", "dem.tif", *map(str, arguments), *ground])


def test_a_site_of_every_layer_runs_from_new_to_lines(capsys):
    make_layer("site.gpkg", HALVES, layer="ground", mean_radius=[0.3, 0.1], ground=[None, "soil_4"])
    make_layer("site.gpkg", [CLIFF], layer="Felswand", id=[1])
    make_layer("site.gpkg", [across(300)], layer="road", Name=["B12"])
    make_layer("site.gpkg", [across(150)], layer="nets", height=[4.0], capacity=[500.0])
    make_layer("site.gpkg", [across(280, 50)], layer="dam", height=[2.0], allow_coarse=[True])
    make_layer("site.gpkg", [BOX(W, N - 320, W + 9, N - 310)], layer="houses", value=[1.0])
    make_layer("trees.geojson", TREES, dbh=[30.0, 40.0], species=["spruce", "beech"])
    assert new("site.gpkg", "trees.geojson", "-o", "out/case.nml") == 0
    said = capsys.readouterr().out
    kinds = dict(re.findall(r"(?:layer )?(\S+): (\w+) \(", said))
    assert kinds == {
        "ground": "zones", "Felswand": "sources", "road": "lines", "nets": "barriers",
        "dam": "dams", "houses": "objects", "trees.geojson": "trees",
    }  # fmt: skip
    text = Path("out/case.nml").read_text()
    assert all(f"! - ../{line}" in text or f"! - {line}" in text for line in said.splitlines()[:7])
    assert main(["check", "out/case.nml"]) == 0
    scene = read_scene(case := read_case("out/case.nml"))
    assert [one["name"] for one in scene.case.lines] == ["B12", "nets"]
    assert len(scene.case.dam) == 1 and len(scene.trees.x) == 2
    rows = ((N - scene.y) / 5).astype(int)
    assert rows.min() == 6 and rows.max() == 11 and scene.x.size == 120
    assert case.case["boulders_total"] == 100_000
    assert scene.rasters.sizes[:, 0].tolist() == [0.3, 0.1]
    assert "default_zone = 1" in text and "120 cells are in no polygon" in text
    result = rockfall.run(case.replace(case={"boulders_total": 360}))
    assert result.sizes["boulder"] == 360


def test_a_terrain_alone_has_steep_sources(capsys):
    assert new("-o", "case.nml") == 0
    case = read_case("case.nml")
    assert case.release["steep_cells"] and main(["check", "case.nml"]) == 0
    off = re.findall(r"^    ! (\w+) = (\S+)", Path("case.nml").read_text(), re.MULTILINE)
    threshold = dict(off)["slope_threshold"]
    assert float(threshold) == pytest.approx(55 * 5**-0.075, abs=0.005)
    # disabled lines next to enabled lines can be enabled
    text = Path("case.nml").read_text()
    for key in ("slope_threshold", "uniform_mean_radius", "question"):
        text = re.sub(f"^    ! {key} =", f"    {key} =", text, flags=re.MULTILINE)
    text = re.sub(r"^! (&scenario .* /)$", r"\1", text, flags=re.MULTILINE)
    Path("all.nml").write_text(text)
    assert main(["check", "all.nml"]) == 0
    assert [one["return_period"] for one in read_case("all.nml").scenario] == [10.0]
    capsys.readouterr()
    make_raster("dem.tif", np.full((20, 20), 5.0))
    assert new("-o", "flat.nml") == 2
    assert "no cell is as steep as 48.7 degrees" in capsys.readouterr().err
    assert not Path("flat.nml").exists()


def test_ids_of_polygons_are_kept_where_they_tell_them_apart():
    make_layer("zones.shp", HALVES, zone=[7, 3], rg70=[0.1, 0.2], rg20=[0.2, 0.3], rg10=[0.3, 0.4])
    points = [shapely.Point(W + 150, N - 42), shapely.Point(W + 190, N - 42)]
    make_layer("cliff.gpkg", points, volume_mean=[0.5, 2.0])
    assert new("zones.shp", "cliff.gpkg", "-o", "case.nml") == 0
    table = Path("case_zones.csv").read_text()
    assert table == "zone,rg70,rg20,rg10,ground\n3,0.2,0.3,0.4,talus\n7,0.1,0.2,0.3,talus\n"
    assert not Path("case_zones.gpkg").exists()
    case = read_case("case.nml")
    assert case.surface["method"] == "A" and case.surface["zones"] == "zones.shp"
    assert read_scene(case).x.tolist() == [W + 150, W + 190]
    assert case.release["points"] == "cliff.gpkg" and case.boulder["volume"] == "source"
    # a zone with two materials must become two zones
    make_layer("other.gpkg", HALVES, zone=[7, 7], mean_radius=[0.1, 0.2])
    assert new("other.gpkg", "-o", "other.nml") == 0
    assert (
        Path("other_zones.csv").read_text() == "zone,mean_radius,ground\n1,0.1,talus\n2,0.2,talus\n"
    )
    assert sorted(read_scene(read_case("other.nml")).rasters.sizes[:, 0]) == [0.1, 0.2]


def test_the_table_of_zones_says_what_they_are_called():
    named = {"name": ["=scree", "pasture, wet"], "mean_radius": [0.3, 0.1]}
    make_layer("site.gpkg", HALVES, layer="ground", **named)
    assert new("site.gpkg", "-o", "case.nml") == 0
    table = Path("case_zones.csv").read_text()
    assert table == (
        'zone,mean_radius,ground,name\n1,0.3,talus,\'=scree\n2,0.1,meadow,"pasture, wet"\n'
    )
    assert read_scene(read_case("case.nml")).rasters.sizes[:, 0].tolist() == [0.3, 0.1]
    make_layer("one.gpkg", HALVES, mean_radius=[0.3, 0.3], name=["scree", "talus"])
    assert new("one.gpkg", "-o", "one.nml") == 0  # one zone with two names
    assert Path("one_zones.csv").read_text() == "zone,mean_radius,ground\n1,0.3,talus\n"


def test_the_command_for_objects_names_their_layer(capsys):
    house = BOX(W + 90, N - 320, W + 120, N - 300)
    make_layer("site.gpkg", [CLIFF], layer="cliff", id=[1])
    make_layer("site.gpkg", [house], layer="houses", id=[1])
    make_layer("casa.gpkg", [house], id=[1])
    assert new("site.gpkg", "casa.gpkg", "-o", "case.nml") == 0
    said = capsys.readouterr().out
    assert "`rockfall hazard --objects site.gpkg --objects-layer houses`" in said
    assert "`rockfall hazard --objects casa.gpkg`" in said


def test_a_terrain_on_another_drive_is_named_in_full(monkeypatch):
    """No relative path leads to another drive on Windows: the case has the absolute path."""
    relpath = ntpath.relpath  # os.path on Windows
    monkeypatch.setattr(os.path, "relpath", lambda *_: relpath("D:/dem.tif", "C:/out"))
    assert new("-o", "case.nml") == 0
    assert read_case("case.nml").terrain["dem"] == Path("dem.tif").absolute().as_posix()


def test_what_is_not_known_is_left_out_and_said(capsys):
    make_layer("plots.gpkg", [CLIFF], owner=["me"])
    make_layer("fence.gpkg", [across(300)], height=[3.0])
    make_layer("points.gpkg", TREES, of=[1, 2])
    make_layer("cliff.gpkg", [CLIFF])
    make_layer("cliff_2.gpkg", [CLIFF])
    files = ("plots.gpkg", "fence.gpkg", "points.gpkg", "cliff.gpkg", "cliff_2.gpkg")
    assert new(*files, "-o", "case.nml") == 0
    said = capsys.readouterr().out
    for line in (
        "plots.gpkg: left out (polygons with mean_radius",
        "fence.gpkg: lines (used as lines: barriers need attributes height [m], and capacity",
        "points.gpkg: left out (points with dbh are trees",
        "cliff_2.gpkg: left out (sources are already given by cliff.gpkg)",
    ):
        assert line in said and line in Path("case.nml").read_text()


@pytest.mark.family(2)
@pytest.mark.parametrize("name", ["haeuser", "Häuser", "bâtiments", "case"])
def test_houses_are_for_the_commands_of_hazard(name, capsys):
    make_layer(f"{name}.gpkg", [CLIFF], name=["1"])
    make_layer("cliff.gpkg", [CLIFF])
    assert new(f"{name}.gpkg", "cliff.gpkg", "-o", "site.nml") == 0
    said = capsys.readouterr().out
    assert f"{name}.gpkg: objects (for `rockfall hazard --objects {name}.gpkg`" in said


def shifted(shapes):
    """Shapes in the coordinates of the neighbouring UTM zone."""
    pyproj = pytest.importorskip("pyproj", reason="the vector extra is not installed")
    way = pyproj.Transformer.from_crs("EPSG:32632", "EPSG:25833", always_xy=True)
    return [*shapely.transform(np.array(shapes), lambda xy: np.column_stack(way.transform(*xy.T)))]


def test_remarks_appear_once_and_name_the_files_that_were_given(tmp_path, capsys, monkeypatch):
    Path("maps").mkdir()
    make_layer("maps/cliff.gpkg", shifted([CLIFF, BOX(W + 1, N - 60, W + 2, N - 30)]), "EPSG:25833")
    make_layer("soil.shp", shifted(HALVES), "EPSG:25833", mean_radius=[0.3, 0.1])
    Path("work").mkdir()
    monkeypatch.chdir("work")
    layers = [Path("../maps/cliff.gpkg"), tmp_path / "soil.shp"]
    assert (
        main(["new", "../dem.tif", *map(str, layers), "-o", "../out/case.nml", "--ground=talus"])
        == 0
    )
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == len(set(lines)) and not [line for line in lines if ".rockfall" in line]
    places = [line.removeprefix("rockfall: warning: ") for line in lines]
    for layer in layers:
        (line,) = [place for place in places if "reprojected from EPSG:25833" in place and (
            f"{layer}:" in place or f"{layer}, layer" in place
        )]  # fmt: skip
        assert line.count("/") == str(layer).count("/") + line.count("../out/case.nml") * 2
    assert len([place for place in places if "1 of 2" in place]) == 1, places


POINTS = [shapely.Point(W + 150, N - 42), shapely.Point(W + 190, N - 42)]
SOURCE_LAYERS = {  # file name, shapes, attributes: the number of sources
    "relAlr.shp": ([CLIFF], {"thickness": [1.0]}, 120),  # as named in AvaFrame
    "REL_2.gpkg": ([CLIFF], {}, 120),
    "start.geojson": ([shapely.MultiPoint(POINTS)], {}, 2),
    "quelle.fgb": ([shapely.MultiPoint(POINTS[:1]), shapely.MultiPoint(POINTS[1:])], {}, 2),
    "Abbruchstellen.shp": ([shapely.MultiPolygon([CLIFF])], {}, 120),
    "Départ.gpkg": ([CLIFF], {}, 120),
    "zone_innesco.gpkg": ([CLIFF], {}, 120),
    "a.gpkg": ([CLIFF], {"volume_mean": [2.0]}, 120),
    "b.gpkg": (POINTS, {"frequency": [0.1, 0.2]}, 2),
    "shapes.gpkg": (POINTS, {"block_shape": ["platy", "compact"]}, 2),
    "c.gpkg": ([shapely.force_3d(CLIFF, 5.0)], {"drop_height": [2.0]}, 120),
    "d.shp": (POINTS, {"Volume": [0.5, 1.0]}, 2),
}


@pytest.mark.family(2)
@pytest.mark.parametrize("name", every_third(SOURCE_LAYERS))
def test_layers_of_sources_are_taken_for_sources(name):
    shapes, columns, sources = SOURCE_LAYERS[name]
    make_layer(name, shapes, **columns)
    assert new(name, "-o", "case.nml") == 0
    case = read_case("case.nml")
    assert not case.release["steep_cells"] and read_scene(case).x.size == sources


def test_a_hatch_with_a_hole_is_a_layer_of_sources():
    ezdxf = pytest.importorskip("ezdxf", reason="the cad extra is not installed")
    drawing = ezdxf.new("R2010")
    hatch = drawing.modelspace().add_hatch(dxfattribs={"layer": "Fels"})
    hatch.paths.add_polyline_path(list(CLIFF.exterior.coords)[:-1], flags=1)
    hole = BOX(W + 120, N - 50, W + 160, N - 40)
    hatch.paths.add_polyline_path(list(hole.exterior.coords)[:-1], flags=16)
    drawing.saveas("plan.dxf")
    assert new("plan.dxf", "-o", "case.nml") == 0
    assert read_scene(read_case("case.nml")).x.size == 120 - 16


UNUSABLE = {
    "cliff.gpkg": ([across(50)], {}, "is named as a source layer: sources must be all points"),
    "fels.gpkg": ([CLIFF, *POINTS], {}, "is named as a source layer: sources must be all points"),
    "relX.gpkg": ([CLIFF, across(50)], {}, "is named as a source layer: sources must be all "
                                           "points"),
    "plots.gpkg": ([CLIFF], {"a": [1]}, "its use is unknown and there are no sources: rename it"),
    "places.shp": (POINTS, {"a": [1, 2]}, "its use is unknown and there are no sources: rename"),
    "nets.gpkg": (
        [across(150), across(200)], {"height": [4.0, None], "capacity": [500.0, 500.0]},
        "feature 2: height is empty: all features must have a number",
    ),
    "netze.shp": (
        [across(150), across(200)], {"Height": ["4", "3"], "capacity": [500.0, 500.0]},
        "feature 1: Height = '4' is not a number: all features must have a number",
    ),
    "mur.gpkg": (
        [across(150), across(200)], {"height": ["4,5", None], "class": [3, 3]},
        "feature 1: height = '4,5' is not a number: all features must have a number",
    ),
    "e.gpkg": (
        [across(150), across(200)], {"height": [4.0, 4.0], "capacity": [500.0, None]},
        "feature 2: a barrier needs a number for capacity [kJ] or class",
    ),
    "filet.gpkg": (
        [across(150), across(200)], {"height": [4.0, 4.0], "class": ["3", "EN 5"]},
        "feature 1: a barrier needs a number for capacity [kJ] or class",
    ),
    "g.gpkg": ([across(150)], {"capacity": [500.0]}, "lines with capacity are barriers: they need"),
    "dam.gpkg": (
        [across(150), across(200)], {"height": [None, 2.0]},
        "feature 1: height is empty: all features must have a number",
    ),
    "logs.gpkg": (
        [across(150), across(200)], {"diameter": [40.0, None]},
        "feature 2: diameter is empty: all features must have a number",
    ),
    "start.gpkg": (
        [*POINTS, shapely.Point(W + 5000, N - 42)], {},
        "1 of 3 points lie outside the DEM or on cells without an elevation, such as 605000, "
        "4999958: move",
    ),
    "trees.gpkg": (TREES, {"dbh": [None, 30.0]}, "feature 1: dbh is empty: all features must"),
    "baum.gpkg": (TREES, {"dbh": ["30", "40 cm"]}, "feature 1: dbh = '30' is not a number: all"),
}  # fmt: skip


@pytest.mark.family(2)
@pytest.mark.parametrize("name", UNUSABLE)
def test_a_layer_that_would_be_taken_for_something_else_is_refused(name, capsys):
    shapes, columns, said = UNUSABLE[name]
    make_layer(name, shapes, **columns)
    assert new(name, "-o", "case.nml") == 2
    line = capsys.readouterr().err
    assert line.startswith(f"rockfall: {name}: {said}") and line.count("\n") == 1
    assert not Path("case.nml").exists()


def test_a_road_with_a_class_in_words_stays_a_line():
    make_layer("road.gpkg", [across(150)], **{"class": ["A"], "height": [3.0]})
    assert new("road.gpkg", "-o", "case.nml") == 0
    assert not read_case("case.nml").barrier


def test_barriers_may_have_capacity_or_class_each():
    columns = {"height": [4.0, 3.0], "capacity": [500.0, None], "class": [None, 3.0]}
    make_layer("nets.gpkg", [across(150), across(200)], **columns)
    assert new("nets.gpkg", "-o", "case.nml") == 0
    assert len(read_scene(read_case("case.nml")).case.barrier) == 2


def test_steep_cells_by_a_file_with_other_layers_are_said(capsys):
    make_layer("site.gpkg", [CLIFF], layer="plots", a=[1])
    make_layer("site.gpkg", [across(300)], layer="road", a=[1])
    assert new("site.gpkg", "-o", "case.nml") == 0
    assert (
        "site.gpkg: no layer contains sources, so steep cells are used: otherwise rename one of "
        "plots to source" in capsys.readouterr().err
    )


def test_names_stay_in_their_comments_and_quotes():
    name = "it's\n&case boulders = 7 /"
    make_layer("site.gpkg", [CLIFF], layer="other", a=[1])
    make_layer("site.gpkg", [across(300)], layer=name, a=[1])
    assert new("site.gpkg", "-o", "case.nml") == 2  # a namelist cannot contain it
    assert not Path("case.nml").exists()
    make_layer("quoted.gpkg", [across(300)], layer="it's &case boulders = 7 /", a=[1])
    make_layer("quoted.gpkg", [CLIFF], layer="other", a=[1])
    assert new("quoted.gpkg", "-o", "quoted.nml") == 0
    assert read_case("quoted.nml").line[0]["layer"] == "it's &case boulders = 7 /"


@pytest.mark.parametrize(
    ("make", "arguments", "said"),
    [
        (None, ["none.gpkg", "-o", "case.nml"], "none.gpkg: "),
        (None, ["dem.tif", "-o", "case.nml"], "dem.tif: is not a layer: its name must end in"),
        (None, ["-o", "case.txt"], "case.txt: output name must end in .nml"),
        (None, ["-o", "there.nml"], "there.nml: already exists; not overwritten"),
        (
            lambda: make_layer("a.gpkg", HALVES, mean_radius=[0.1, None]),
            ["a.gpkg", "-o", "case.nml"],
            "a.gpkg: feature 2: must have mean_radius",
        ),
        (
            lambda: make_layer("a.gpkg", HALVES, ground=["soil_0", "gravel"]),
            ["a.gpkg", "-o", "case.nml"],
            "ground = 'gravel'",
        ),
        (
            lambda: make_layer("cliff.gpkg", [shapely.box(0, 0, 1, 1)]),
            ["cliff.gpkg", "-o", "case.nml"],
            "cliff.gpkg: no polygon contains a cell centre",
        ),
        (
            lambda: make_layer("a.gpkg", [shapely.box(0, 0, 1, 1)], mean_radius=[0.3]),
            ["a.gpkg", "-o", "case.nml"],
            "a.gpkg: no polygon contains a cell centre",
        ),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(make, arguments, said, tmp_path, capsys):
    Path("there.nml").write_text("mine")
    if make:
        make()
    before = sorted(path.name for path in tmp_path.iterdir())
    assert new(*arguments) == 2
    line = capsys.readouterr().err
    assert said in line and line.count("\n") == 1 and "new/" not in line
    assert sorted(path.name for path in tmp_path.iterdir()) == before
    assert Path("there.nml").read_text() == "mine"


def test_a_table_of_zones_is_not_overwritten():
    make_layer("zones.gpkg", HALVES, R_m=[0.1, 0.2])  # symbol of the mean radius
    assert new("zones.gpkg", "-o", "case.nml") == 0
    table = Path("case_zones.csv")
    assert table.read_text() == "zone,mean_radius,ground\n1,0.1,talus\n2,0.2,talus\n"
    Path("case.nml").unlink()
    table.write_text("zone,mean_radius\n1,0.15\n2,0.2\n")
    assert new("zones.gpkg", "-o", "case.nml") == 2
    assert table.read_text() == "zone,mean_radius\n1,0.15\n2,0.2\n"
    assert not Path("case.nml").exists()


def test_cells_in_no_polygon_and_their_zone_are_reported(capsys):
    """`new` and `check` report how many of the 4,800 cells are in no polygon: 600 or 120."""
    low = BOX(W, N - 350, W + 300, N - 200)
    make_layer("some.gpkg", [HALVES[0], low], ground=["talus", "meadow"])
    make_layer("most.gpkg", HALVES, ground=["talus", "meadow"])
    make_layer("cliff.gpkg", [CLIFF])
    for name, outside in (("some", 600), ("most", 120)):
        assert new(f"{name}.gpkg", "cliff.gpkg", "-o", f"{name}.nml", ground=()) == 0
        notes = [line for line in capsys.readouterr().out.splitlines() if "default_zone" in line]
        said = f"default_zone = 1, the most frequent zone, for {outside} cells in no polygon: check"
        assert [line[: len(said)] for line in notes] == [said]
        assert main(["check", f"{name}.nml"]) == 0
        share = f", {outside} cells ({outside / 48:.1f} %) in no polygon get default_zone = 1"
        assert share in capsys.readouterr().out


def test_all_layers_are_checked_before_one_is_refused(capsys):
    """Two of three layers are GeoJSON in metres without a CRS: both are refused, in a line each."""
    make_layer("road.geojson", [across(300)], crs=None)
    make_layer("cliff.geojson", [CLIFF], crs=None)
    make_layer("house.gpkg", [BOX(W, N - 320, W + 9, N - 310)])
    assert new("road.geojson", "house.gpkg", "cliff.geojson", "-o", "case.nml") == 2
    lines = capsys.readouterr().err.splitlines()
    starts = [f"rockfall: {name}.geojson: has no CRS" for name in ("road", "cliff")]
    assert [line[: len(start)] for line, start in zip(lines, starts, strict=True)] == starts
    assert not Path("case.nml").exists()
