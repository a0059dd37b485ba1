# SPDX-License-Identifier: BSD-3-Clause
"""`rockfall export --qgis`: every reference of the project leads to a layer in its own folder, and
sources are areas. tests/qgis opens the project in QGIS."""

import math
import os
import re
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import rockfall
import slope_case
from made import draw_no_hazard, make_layer, write_few_maps
from rockfall.cli import main
from rockfall.language import speaking
from rockfall.qgis_project.layout import MAP_HIGH, MAP_WIDE, bar_unit, paper_extent, scale_of

pyogrio = pytest.importorskip("pyogrio", reason="the vector extra is not installed")
shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
pytest.importorskip("matplotlib", reason="the report extra is not installed")

W, N = 600000.0, 5000000.0
NET = "&barrier name = 'net', x = 600030.0, 600090.0, y = 4999940.0, 4999940.0, height = 3.0, "
DAM = "&dam x = 600020.0, 600100.0, y = 4999890.0, 4999890.0, height = 3.0, allow_coarse = .true. /"
SCENARIO = "&scenario name = 'all', return_period = 10.0 /\n"


def ring(x, y, side):
    hole = shapely.box(x + side / 3, y + side / 3, x + 2 * side / 3, y + 2 * side / 3)
    return shapely.box(x, y, x + side, y + side).difference(hole)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Work in a folder with a case of two faces, its result and a hazard; return the folder."""
    folder = tmp_path_factory.mktemp("site")
    before = Path.cwd()
    os.chdir(folder)
    slope_case.write_slope()
    faces = [ring(W + 30, N - 30, 15), shapely.box(W + 70, N - 25, W + 80, N - 15)]
    make_layer("faces.gpkg", faces, layer="faces", name=["west", "east"])
    text = Path("case.nml").read_text()
    release = "&release polygons = 'faces.gpkg', drop_height = 2.0 /"
    text = re.sub("&release.*", release, text) + f"{NET}capacity = 500.0 /\n{DAM}\n"
    Path("case.nml").write_text(text)
    Path("hazard.nml").write_text(text + SCENARIO)
    assert main(["run", "case.nml", "-o", "out.nc", "--quiet"]) == 0
    with pytest.MonkeyPatch.context() as patch:
        draw_no_hazard(patch)
        write_few_maps(patch)
        assert main(["hazard", "hazard.nml", "--quiet"]) == 0
    yield folder
    os.chdir(before)


@pytest.fixture(scope="module")
def project(site):
    """XML of a German project with a hazard, and the folder of the project."""
    words = [
        "--qgis",
        "--hazard",
        "hazard_hazard/hazard.nc",
        "--language",
        "de",
        "--author",
        "A. B.",
    ]
    assert main(["export", "out.nc", "gis", *words]) == 0
    return read("gis/project.qgz"), site / "gis"


def read(path):
    with zipfile.ZipFile(path) as archive:
        (name,) = archive.namelist()
        assert name == "project.qgs"
        return ElementTree.fromstring(archive.read(name))


def layers_of(root):
    return {one.find("id").text: one for one in root.iter("maplayer")}


def table(path, layer):
    about, _, wkb, values = pyogrio.raw.read(path, layer=layer)
    return shapely.from_wkb(wkb), dict(zip(about["fields"], values, strict=True))


@pytest.mark.all
def test_every_layer_is_a_file_of_the_folder(project):
    root, folder = project
    layers = layers_of(root)
    assert len(layers) == len(list(root.iter("maplayer"))) > 15  # each id is unique
    shown = set()
    for layer in layers.values():
        source = layer.find("datasource").text
        assert source.startswith("./")
        path, _, name = source.partition("|layername=")
        shown.add(path)
        assert (folder / path).is_file()
        if name:
            assert name in pyogrio.list_layers(folder / path)[:, 0]
        assert layer.find("provider").text == ("ogr" if name else "gdal")
    files = {f"./{one.name}" for one in folder.iterdir() if one.suffix in (".tif", ".gpkg")}
    assert shown == files
    paths = root.find("properties/Paths/Absolute")
    assert paths.text == "false"


@pytest.mark.all
def test_every_reference_is_to_a_layer_and_every_layer_is_in_the_tree(project):
    root, _ = project
    layers = layers_of(root)
    tree = [one.get("id") for one in root.find("layer-tree-group").iter("layer-tree-layer")]
    assert sorted(tree) == sorted(layers)
    named = [one.get("id") for one in root.iter("layer-tree-layer")]
    named += [one.get("id") for one in root.find("layerorder")]
    named += [one.get("id") for one in root.find("visibility-presets").iter("layer")]
    assert {*named} <= {*layers}
    themes = [one.get("name") for one in root.iter("visibility-preset")]
    layouts = [one.get("name") for one in root.iter("Layout")]
    assert len({*themes}) == len(themes) > 3 and layouts == themes
    for one in root.iter("Layout"):
        items = {item.get("id"): item for item in one.iter("LayoutItem")}
        assert {"map", "legend", "north", "scale bar", "head 0"} <= items.keys()
        assert items["map"].get("followPresetName") == one.get("name")
        for item, key in (("legend", "map_uuid"), ("north", "mapUuid"), ("scale bar", "mapUuid")):
            assert items[item].get(key) == items["map"].get("uuid")


def test_groups_lie_as_on_a_map_and_trajectories_are_visible_on_top(project):
    root, _ = project
    groups = root.find("layer-tree-group")
    names = [one.get("name") for one in groups]
    assert names == ["Sturzbahnen", "Auswertelinien", "Schutz", "Ablösestellen", "Gefahrenzonen",
                     "Karten", "Gelände"]  # fmt: skip
    first = groups[0][0]
    assert first.get("checked") == "Qt::Checked" and "trajectories" in first.get("source")
    maps = [one.get("checked") for one in groups[5]]
    assert maps.count("Qt::Checked") == 1
    renderers = [
        layers_of(root)[one.get("id")].find("pipe/rasterrenderer").get("type") for one in groups[6]
    ]
    assert renderers == ["contour", "hillshade"]


def test_a_layer_looks_as_its_style_says(project):
    root, folder = project
    for layer in layers_of(root).values():
        source = layer.find("datasource").text
        if source.endswith(".tif") and "elevation" not in source:
            style = ElementTree.parse((folder / source).with_suffix(".qml"))
            for what in ("item", "paletteEntry"):
                colours = [[one.get("color") for one in of.iter(what)] for of in (style, layer)]
                assert colours[0] == colours[1]
        elif not source.endswith(".tif"):
            assert layer.find("renderer-v2/symbols/symbol") is not None, source


def test_legends_are_in_the_language_and_without_rows_of_bands(project):
    root, _ = project
    labels = [one.get("label") for one in root.iter("item")]
    assert "≤ 10 kJ" in labels and "10 – 30 kJ" in labels and "> 10\u202f000 kJ" in labels
    texts = [one.get("labelText") for one in root.iter("LayoutItem") if one.get("labelText")]
    assert "Slope" in texts and "Verfasser: A. B." in texts
    assert any("EPSG:32632" in text for text in texts)
    assert any("Aufprallmodell von Bourrier et al. (2009)" in text for text in texts)
    assert any("dem.tif" in text for text in texts) and not any(
        "sets.nml" in text for text in texts
    )
    for one in root.iter("layer-tree-layer"):
        layer = layers_of(root)[one.get("id")]
        rows = len(list(layer.iter("item"))) + len(list(layer.iter("paletteEntry")))
        order = one.find("customproperties/Option/Option[@name='legend/node-order']")
        assert (order is None) == (rows == 0)
        if rows:
            assert order.get("value") == ",".join(map(str, range(1, rows + 1)))


@pytest.mark.all
def test_the_same_result_is_the_same_project(site):
    for name in ("one", "two"):
        assert main(["export", "out.nc", name, "--qgis"]) == 0
    one, two = (Path(name, "project.qgz").read_bytes() for name in ("one", "two"))
    assert one == two


def test_the_extent_holds_all_and_lies_on_paper_at_a_round_scale():
    extent = 0.0, 345.0, 1000.0, 1467.0
    scale = scale_of(extent)
    assert scale == 2000  # 467 m on 277 mm is 1:1686
    west, east, south, north = paper_extent(extent)
    assert west < 0 and east > 345 and south < 1000 and north > 1467
    assert math.isclose((east - west) / (1e-3 * MAP_WIDE), scale)
    assert math.isclose((north - south) / (1e-3 * MAP_HIGH), scale)
    assert [bar_unit(one) for one in (2000, 5000, 10_000, 25_000)] == [20, 50, 100, 200]


@pytest.mark.parametrize("scale", np.geomspace(60, 5e6, 40))
def test_the_scale_bar_fits(scale):
    unit = bar_unit(scale)
    assert re.fullmatch("[125]0*", f"{unit:.0f}")
    assert 2 * unit <= 1e-3 * scale * 35 or unit == 1


def test_without_terrain_there_is_no_relief_and_it_is_said(site, capsys):
    Path("dem.tif").rename("gone.tif")
    try:
        assert main(["export", "out.nc", "flat", "--qgis"]) == 0
    finally:
        Path("gone.tif").rename("dem.tif")
    assert "dem.tif: cannot be read" in capsys.readouterr().err
    root = read("flat/project.qgz")
    assert [one.get("name") for one in root.find("layer-tree-group")][-1] == "Maps"
    assert not Path("flat/elevation_m.tif").exists()


@pytest.mark.all
def test_a_refused_project_leaves_nothing(project, capsys):
    assert main(["export", "out.nc", "new", "--hazard", "hazard_hazard/hazard.nc"]) == 2
    assert capsys.readouterr().err == "rockfall: --hazard requires --qgis\n"
    assert main(["export", "out.nc", "new", "--qgis", "--hazard", "out.nc"]) == 2
    assert "is not a hazard file" in capsys.readouterr().err
    assert main(["export", "out.nc", "new", "--qgis", "--language", "xx"]) == 2
    assert not Path("new").exists()
    assert main(["export", "out.nc", "gis", "--qgis"]) == 2
    assert "not overwritten" in capsys.readouterr().err


def test_sources_are_one_area_a_face(site):
    rockfall.export("out.nc", "areas")
    shapes, fields = table("areas/rockfall.gpkg", "source_areas")
    assert fields["name"].tolist() == ["west", "east"]
    assert fields["sources"].tolist() == [8, 4]  # 3 x 3 cells without the centre, and 2 x 2 cells
    assert fields["boulders"].tolist() == [160, 80]
    assert fields["area_m2"].tolist() == [200.0, 100.0]
    west, east = shapes
    assert west.equals(ring(W + 30, N - 30, 15)) and east.equals(
        shapely.box(W + 70, N - 25, W + 80, N - 15)
    )
    assert shapely.get_num_coordinates(east) == 5  # no vertices between cells
    points, _ = table("areas/rockfall.gpkg", "sources")
    assert len(points) == 12 and all(shapes[0].covers(points) | shapes[1].covers(points))
    furthest = rockfall.read_result("out.nc")["plan_distance"].values
    assert math.isclose(fields["plan_distance_max_m"].max(), furthest.max())


def test_barriers_and_dams_are_lines_with_what_they_can(site):
    rockfall.export("out.nc", "areas")
    shapes, fields = table("areas/rockfall.gpkg", "barriers")
    assert fields["name"].tolist() == ["net"] and fields["capacity_kJ"].tolist() == [500.0]
    assert fields["height_m"].tolist() == [3.0] and shapes[0].length == 60.0
    shapes, fields = table("areas/rockfall.gpkg", "dams")
    assert fields["height_m"].tolist() == [3.0] and fields["slope_deg"].tolist() == [45.0]


def test_points_stay_points(place):
    rockfall.export(rockfall.run(rockfall.read_case("case.nml")), "gis")
    names = pyogrio.list_layers("gis/rockfall.gpkg")[:, 0]
    assert "sources" in names and not {"source_areas", "barriers", "dams"} & {*names}


@pytest.mark.all
@pytest.mark.parametrize("language", ["de", "fr", "it"])
def test_all_titles_and_labels_have_a_text(site, language):
    with speaking("en"):
        for one in ("en", language):
            with pytest.warns(UserWarning, match="fractions of the run to &boulder"):
                rockfall.export_project(
                    "out.nc", f"in_{one}", hazard="hazard_hazard/hazard.nc", language=one
                )
    root, english = read(f"in_{language}/project.qgz"), read("in_en/project.qgz")
    titles, others = (
        {one.get("name") for one in of.iter("layer-tree-layer")} for of in (root, english)
    )
    assert titles & others <= {"Relief"}
