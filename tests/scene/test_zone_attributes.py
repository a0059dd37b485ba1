# SPDX-License-Identifier: BSD-3-Clause
"""Polygons with attributes of their ground, from files and GeoDataFrames, give the scene of
polygons with a table."""

import numpy as np
import pytest

import rockfall
from made import make_layer
from programs import find_program, make_full_case, run_program, same_results
from rockfall.html_report.inputs import zone_table
from rockfall.scene.prepare import prepare
from rockfall.scene.read import read_scene
from rockfall.simulation.parts.merge import join
from rockfall.text.preview import preview

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

W, N = 600000.0, 5000000.0
HALVES = [shapely.box(W, N - 400, W + 90, N), shapely.box(W + 90, N - 400, W + 200, N)]
SHAPES = [*HALVES, shapely.box(W + 200, N - 400, W + 300, N)]
GROUND = {"mean_radius": [0.25, 0.4, 0.25], "ground": [None, None, None]}
TABLE = "zone,mean_radius,ground\n1,0.25,\n2,0.4,\n"


@pytest.fixture
def case(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    case = make_full_case(tmp_path, case={"boulders": 5})
    return case.replace(line=case.line[:1])


def polygons(case, shapes=SHAPES, **columns):
    """Case with polygons and attributes as zones, without a table."""
    make_layer("ground.gpkg", shapes, **columns)
    return case.replace(surface={"zones": "ground.gpkg", "table": None})


def refused(message):
    return pytest.raises(rockfall.RockfallError, match=message)


def test_attributes_are_the_rows_of_a_table(case):
    (case.folder / "rows.csv").write_text(TABLE)
    by_itself = polygons(case, **GROUND)
    make_layer("ids.gpkg", SHAPES, zone=[1, 2, 1])
    by_table = case.replace(surface={"zones": "ids.gpkg", "table": "rows.csv"})
    one, other = read_scene(by_itself).rasters, read_scene(by_table).rasters
    assert one.sizes.ravel().tolist() == other.sizes.ravel().tolist() == [0.25, 0.4]
    np.testing.assert_array_equal(one.zone, other.zone)
    one, other = rockfall.run(by_itself), rockfall.run(by_table)
    for name, values in other.data_vars.items():
        np.testing.assert_array_equal(one[name], values)
    assert "zones" in one.attrs["input_checksums"] and "table" not in by_itself.surface


@pytest.mark.all
def test_a_frame_is_read_like_a_layer(case):
    geopandas = pytest.importorskip("geopandas", reason="the test extra is not installed")
    columns = {"Mean_Radius": [0.25, np.nan, 0.3], "ground": [None, "road", "rocky-slope"]}
    frame = geopandas.GeoDataFrame(columns, geometry=SHAPES, crs="EPSG:32632")
    layer = polygons(case, **{key: [*of] for key, of in columns.items()})
    one, other = rockfall.run(layer), rockfall.run(case, zones=frame)
    assert [str(ground) for ground in other["ground"].values] == ["sets.nml", "road", "rocky-slope"]
    for name, values in one.data_vars.items():
        np.testing.assert_array_equal(values, other[name])
    uniform = case.replace(surface={"zones": None, "table": None, "uniform_mean_radius": 0.1})
    again = rockfall.run(uniform, zones=frame)
    np.testing.assert_array_equal(other["stop_x"], again["stop_x"])
    assert "table" not in again.attrs["case"].partition("&surface")[2].partition("/")[0]
    scene = read_scene(case, zones=frame)
    assert "zone 1: R_m 0.25 m" in preview(scene)


def test_own_ids_stay_and_serve_as_default(case):
    about = {"zone": [7, -3], "mean_radius": [0.25, 0.4]}
    scene = read_scene(polygons(case, HALVES, **about).replace(surface={"default_zone": 7}))
    assert scene.rasters.sizes.ravel().tolist() == [0.25, 0.4]
    assert (scene.rasters.zone[:, 40:] == 1).all() and (scene.rasters.zone[:, 18:40] == 2).all()
    text = preview(scene)
    assert "zone 7: R_m 0.25 m" in text and "zone -3: R_m 0.4 m" in text


def test_the_report_lists_them(case):
    columns = {"mean_radius": [0.25, np.inf, 0.25], "name": ["talus", "lake", "talus"]}
    result = rockfall.run(polygons(case, **columns))
    (table,) = zone_table(result)
    assert [tuple(row) for row in table.rows] == [("talus", "1", "0.25"), ("lake", "2", "absorbs")]


@pytest.mark.all
@pytest.mark.skipif(not find_program(), reason="no rockfall-batch")
def test_the_standalone_program_gives_the_same_bits(case):
    zoned = polygons(case, **GROUND)
    prepare(zoned, "ready")
    done = run_program("ready/case.nml", "--quiet", "-o", "a.part1of1", cwd=case.folder)
    assert done.returncode == 0, done.stderr
    same_results(join(["a.part1of1"]).dataset(), rockfall.run(zoned))


@pytest.mark.family(2)
@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (
            {"soil": [1, 2, 3]},
            r"ground.gpkg: attributes are missing: give polygons mean_radius, rg70, rg20, rg10 or ",
        ),
        (
            {"mean_radius": [0.2, np.nan, 0.2]},
            r"ground.gpkg: feature 2: method B requires mean_radius",
        ),
        ({"mean_radius": [0.2, -1.0, 0.2]}, r"feature 2: mean_radius = -1.0: must be > 0"),
        ({"mean_radius": ["0.2", "x", "0.2"]}, r"feature 2: mean_radius = x: must be a number"),
        ({"rg70": [0.2, 0.3, 0.2]}, r"ground.gpkg: feature 1: method B requires mean_radius"),
        ({"ground": ["road", "roat", "road"]}, r"feature 2: ground = .*roat"),
    ],
)
def test_what_polygons_cannot_say_is_refused(case, columns, message):
    with refused(message):
        read_scene(polygons(case, **columns))


def test_a_default_needs_ids_and_a_raster_a_table(case):
    with refused("default_zone = 1: needs an integer attribute zone that distinguishes zones"):
        read_scene(polygons(case, **GROUND).replace(surface={"default_zone": 1}))
    with refused("&surface table is missing: it must give the grounds of the zones"):
        read_scene(case.replace(surface={"table": None}))
