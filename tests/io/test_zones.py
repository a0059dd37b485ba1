# SPDX-License-Identifier: BSD-3-Clause
"""Zones: every cell of the terrain has a row in the table, or a one-line error gives the reason."""

import json
import math
import re
import socket
import sqlite3
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from made import every_third, make_layer, refused
from rockfall.analysis.objects.object_layers import File
from rockfall.analysis.objects.objects import read_objects
from rockfall.errors import RockfallError
from rockfall.io.rasters import grid as grid_module
from rockfall.io.rasters.grid import NO_ID, Grid, row_blocks
from rockfall.io.vectors.layers import (
    burn_polygons,
    numbered_polygons,
    read_attributes,
    read_features,
    read_points,
)
from rockfall.io.zone_table import index_blocks, read_zone_table


@pytest.fixture(autouse=True)
def in_tmp_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


# ---- the table -----------------------------------------------------------------------------------


def table(text, encoding="utf-8"):
    """Write a table of zones; return the obstacle sizes of each zone."""
    Path("zones.csv").write_bytes(text.encode(encoding))
    return {zone: row.sizes for zone, row in read_zone_table("zones.csv").items()}


def same(a, b):
    return all(x == y or (math.isnan(x) and math.isnan(y)) for x, y in zip(a, b, strict=True))


@pytest.mark.parametrize(
    "text",
    [
        "zone,rg70,rg20,rg10,mean_radius\n1,0.2,0.15,0.07,0.1\n2,Inf,Inf,Inf,inf\n",
        "mean_radius;zone;rg10;rg20;rg70\r\n0.1;1;0.07;0.15;0.2\r\nInf;2;Inf;Inf;Inf\r\n",
        '\ufeffzone,rg70,rg20,rg10,Mean_Radius,note\n\n1,.2,15e-2,7d-2,+0.1,"a, ""b"""\n , ,,,,\n'
        "2, Infinity ,inf,INF,inf,\u00e9",
    ],
)
def test_a_table_in_any_dress(text):
    assert table(text) == {1: (0.1, 0.2, 0.15, 0.07), 2: (math.inf,) * 4}


def test_a_zone_with_a_ground_of_its_own_may_have_no_rocks():
    table("zone,mean_radius,ground\n1,0.1,\n2,,road\n3,0,soil_3\n4,inf,\n")
    rows = read_zone_table("zones.csv")
    assert [row.ground for row in rows.values()] == ["", "road", "soil_3", ""]
    assert [rows[k].sizes[0] for k in (1, 3, 4)] == [0.1, 0.0, math.inf]
    assert math.isnan(rows[2].sizes[0])
    assert same(table("zone,ground\n7,road\n")[7], [math.nan] * 4)
    with refused("zones.csv: line 2: mean_radius = -1: must be > 0 (Inf absorbs)"):
        table("zone,mean_radius,ground\n1,-1,road\n")


def test_columns_that_are_absent_or_empty_are_nan():
    zones = table("zone,mean_radius\n-3,0.1\n7,0.25\n")
    assert list(zones) == [-3, 7]
    assert same(zones[-3], (0.1, math.nan, math.nan, math.nan))
    assert same(table("zone,mean_radius,ground\n1,,\n")[1], [math.nan] * 4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("\n\n", "is empty"),
        ("zone,mean_radius\n", "no rows below the header"),
        ("id,mean_radius\n1,0.1", "line 1: column zone is missing (columns: id, mean_radius)"),
        ("zone,radius\n1,0.1",
         "line 1: must have at least one of the columns mean_radius, rg70, rg20, rg10"),
        ("zone,zone,rg70\n1,1,2", "line 1: column zone occurs twice"),
        ("zone,mean_radius\n\n1,0.1\n2,-0.1", "line 4: mean_radius = -0.1: must be > 0 (Inf "
         "absorbs)"),
        ("zone,rg70\n1,nan", "line 2: rg70 = nan: must be > 0 (Inf absorbs)"),
        ("zone,rg70\n1,wide", "line 2: rg70 = wide: must be a number"),
        ("zone,rg70\n1.5,1", "line 2: zone = 1.5: must be an integer"),
        ("zone,rg70\n3000000000,1", "line 2: zone = 3000000000: must fit in 32 bits"),
        ("zone,rg70\n1,1\n2,1\n1,2", "line 4: zone 1: occurs twice in the table"),
        ("zone,rg70\n1,1,2", "line 2: has 3 columns, but the header has 2"),
        ("zone,rg70,note\n1,1,2\n2,1,\"open", "line 3: unexpected end of data"),
    ],
)  # fmt: skip
def test_a_table_with_a_fault(text, message):
    with refused(f"zones.csv: {message}"):
        table(text)


def test_no_table():
    with refused("zones.csv: no such file or directory"):
        read_zone_table("zones.csv")
    Path("zones.csv").mkdir()
    with refused("zones.csv: is a directory"):
        read_zone_table("zones.csv")
    with refused("t.csv: is not text in UTF-8"):
        Path("t.csv").write_bytes(b"zone,rg70,note\n1,2,\xff\n")
        read_zone_table("t.csv")


# ---- the row of each cell ------------------------------------------------------------------------


@pytest.fixture(params=["whole", "in blocks of a row"])
def blocks(request, monkeypatch):
    """Run a test also with blocks of one row, because the block size must not change results."""
    if request.param != "whole":
        monkeypatch.setattr(grid_module, "_BLOCK", 1)


def material_index(ids, *arguments, **more):
    parts = ((rows, ids[rows]) for rows in row_blocks(ids.shape))
    return index_blocks(parts, ids.shape, *arguments, **more)


IDS = np.array([[7, 7, 3], [NO_ID, 3, -5], [900, 7, NO_ID]], "int32")


def test_every_cell_gets_its_row(blocks):
    index = material_index(IDS[:1], [3, 7])
    assert index.dtype == "int8"
    assert index.tolist() == [[2, 2, 1]]
    assert material_index(IDS, [900, 3, -5, 7], default_zone=3).tolist() == [
        [4, 4, 2],
        [2, 2, 3],
        [1, 4, 2],
    ]


@pytest.mark.parametrize("as_elevations", [False, True])
def test_cells_without_terrain_need_no_zone(as_elevations, blocks):
    valid = np.array([[1, 1, 0], [0, 1, 1], [0, 1, 0]], bool)
    mask = np.where(valid, 12.5, np.nan) if as_elevations else valid
    before = IDS.copy(), mask.copy()
    assert material_index(IDS, [3, -5, 7], valid=mask).tolist() == [[3, 3, 0], [0, 1, 2], [0, 3, 0]]
    assert (IDS == before[0]).all()
    assert np.array_equal(mask, before[1], equal_nan=as_elevations)


def test_zones_without_a_row_are_named(blocks):
    with refused("zones.tif: zone 7 (3 cells) has no row in zones.csv"):
        material_index(IDS, [3, -5, 900], 3, path="zones.tif", table="zones.csv")
    with refused("zones.tif: zone -5 (1 cells), zone 900 (1 cells) have no row in zones.csv"):
        material_index(IDS, [3, 7], 3, path="zones.tif", table="zones.csv")
    many = np.arange(2000, dtype="int32").reshape(20, 100)
    with pytest.raises(RockfallError, match=r"zone 10 \(1 cells\), 1989 more have no row in t$"):
        material_index(many, [0], path="z", table="t")


def test_cells_without_a_zone_are_counted(blocks):
    with refused(
        "zones.tif: 2 cells of the terrain have no zone: give them one, or set &surface "
        "default_zone"
    ):
        material_index(IDS, [3, 7, -5, 900], path="zones.tif")


def test_a_default_zone_without_a_row():
    with refused("&surface default_zone = 4: has no row in zones.csv"):
        material_index(IDS, [3, 7], 4, table="zones.csv")


def test_more_zones_than_a_cell_can_number():
    with refused("zones.csv: 32768 zones: must be at most 32767"):
        material_index(IDS, list(range(32768)), table="zones.csv")


# ---- polygons ------------------------------------------------------------------------------------

GRID = Grid(600000.0, 5000000.0, 10.0, nx=6, ny=4)


def box(west, south, east, north):
    """Rectangle in metres from the south-western corner of GRID."""
    shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
    return shapely.box(600000 + west, 4999960 + south, 600000 + east, 4999960 + north)


def utm_grid():
    from dataclasses import replace

    from rasterio.crs import CRS

    return replace(GRID, crs=CRS.from_epsg(32632))


@pytest.mark.parametrize("path", ["zones.gpkg", "zones.shp", "zones.geojson"])
def test_a_cell_belongs_to_the_polygon_over_its_centre(path):
    shapes = [box(0, 0, 24.9, 40), box(25.1, 0, 44, 40), box(40, 0, 50, 14)]
    make_layer(path, shapes, zone=[4, 9, -2])
    row = [4, 4, NO_ID, 9, NO_ID, NO_ID]  # the centre of the third column is at 25
    low = [4, 4, NO_ID, 9, -2, NO_ID]
    cells = burn_polygons(path, utm_grid(), "zone")
    assert cells.dtype == "int32"
    assert cells.tolist() == [row, row, row, low]
    numbers, owner, columns = numbered_polygons(path, utm_grid(), [])
    assert owner.tolist() == [0, 1, 2, 3]
    assert numbers.dtype == "uint8" and columns["zone"].tolist() == [4, 9, -2]
    assert np.array_equal(np.array([NO_ID, 4, 9, -2])[numbers], cells)


def test_attributes_keep_the_order_of_the_layer(monkeypatch):
    import pyogrio

    read = pyogrio.raw.read

    def read_sorted(*args, **options):  # as in pyogrio 0.11
        about, ids, shapes, values = read(*args, **options)
        order = np.argsort(about["fields"])
        return about | {"fields": about["fields"][order]}, ids, shapes, [values[k] for k in order]

    monkeypatch.setattr(pyogrio.raw, "read", read_sorted)
    make_layer("zones.gpkg", [box(0, 0, 10, 10)], zone=[4], BHD=[30.0], name=["wood"])
    attributes = read_attributes("zones.gpkg", "zones")
    assert {key: values[0] for key, values in attributes.items()} == {
        "zone": 4, "BHD": 30.0, "name": "wood",
    }  # fmt: skip
    assert list(attributes) == ["zone", "BHD", "name"]


def test_the_later_polygon_wins_and_holes_are_holes():
    import shapely

    ring = shapely.difference(box(0, 0, 60, 40), box(20, 10, 40, 30))
    make_layer("z.gpkg", [ring, box(0, 0, 10, 10)], zone=[1.0, 2.0])
    assert burn_polygons("z.gpkg", utm_grid(), "zone").tolist() == [
        [1, 1, 1, 1, 1, 1],
        [1, 1, NO_ID, NO_ID, 1, 1],
        [1, 1, NO_ID, NO_ID, 1, 1],
        [2, 1, 1, 1, 1, 1],
    ]


def inside(path, grid):
    return numbered_polygons(path, grid, [])[0] > 0


def plain_geojson(x0=600000, y0=4999960, size=20):
    """Write a square as GeoJSON without a CRS."""
    x, y = x0 + size, y0 + size
    ring = f"[[{x0},{y0}],[{x},{y0}],[{x},{y}],[{x0},{y}],[{x0},{y0}]]"
    Path("a.geojson").write_text(
        '{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {"zone": 5},'
        f' "geometry": {{"type": "Polygon", "coordinates": [{ring}]}}}}]}}'
    )
    return "a.geojson"


def test_a_geopackage_that_another_program_writes_to():
    make_layer("a.gpkg", [box(0, 0, 20, 20)], zone=[5])
    Path("a.gpkg-wal").touch()  # left by QGIS when it only reads
    burn_polygons("a.gpkg", utm_grid(), "zone")
    Path("a.gpkg-wal").write_bytes(b"x")
    with refused("a.gpkg: another program is writing to it (a.gpkg-wal): close it there"):
        burn_polygons("a.gpkg", utm_grid(), "zone")


@pytest.mark.parametrize("name", ["a.gpkg", "a.shp"])
@pytest.mark.parametrize(
    "text",
    [
        "<OGRWFSDataSource><URL>http://127.0.0.1:{0}</URL></OGRWFSDataSource>",
        "<OGRVRTDataSource><OGRVRTLayer name='a'><SrcDataSource>/vsicurl/http://127.0.0.1:{0}/a.shp"
        "</SrcDataSource></OGRVRTLayer></OGRVRTDataSource>",
    ],
)
def test_no_layer_reaches_the_network(name, text):
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setblocking(False)
        Path(name).write_text(text.format(server.getsockname()[1]))
        with refused(
            f"{name}: cannot be read as a vector layer (GeoPackage, GeoJSON, shapefile or "
            "FlatGeobuf)"
        ):
            inside(name, utm_grid())
        with pytest.raises(BlockingIOError):
            server.accept()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"features"', '"crs": {"type": "link", "properties": {"href": "http://127.0.0.1:9/a"}}, '
         '"features"', "crs = .*: must have a name such as EPSG:32632"),
        ('"FeatureCollection"', '"gdal_streamed_alg"', "type = gdal_streamed_alg: must be "),
        ("600020,", "1e999,", "Out of range float values are not JSON compliant"),
    ],
)  # fmt: skip
def test_geojson_says_only_where_polygons_lie(old, new, said):
    path = Path(plain_geojson())
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(
        RockfallError, match=rf"^a\.geojson: cannot be read as a vector layer \({said}"
    ):
        burn_polygons(path, utm_grid(), "zone")


def test_multipoints_are_points_but_no_object():
    """A multipoint with a single point is often an export of points; one with several points is no
    object."""
    import shapely

    places = [(600005, 4999990), (600015, 4999990), (600025, 4999990)]
    single, double = shapely.MultiPoint(places[:1]), shapely.MultiPoint(places[1:])
    make_layer("points.gpkg", [single, double], crs=None, name=["a", "b"])
    shapes, _ = read_features("points.gpkg", GRID, [])
    assert [shape.geom_type for shape in shapes] == ["Point", "MultiPoint"]
    x, _, columns, feature = read_points("points.gpkg", GRID, [])
    assert x.tolist() == [600005, 600015, 600025] and feature.tolist() == [1, 2, 2]
    assert columns["name"].tolist() == ["a", "b", "b"]
    make_layer("house.gpkg", [single], crs=None)
    thresholds = np.array([30e3, 300e3])
    objects = read_objects([File("house.gpkg", None, "house")], GRID, thresholds, [])
    assert objects.places.tolist() == [[600005, 4999990]]
    with refused("points.gpkg: feature 2: has several points: split it into one object per point"):
        read_objects([File("points.gpkg", None, "points")], GRID, thresholds, [])
    Path("one.geojson").write_text('{"type": "MultiPoint", "coordinates": [[1, 39], [2, 39]]}')
    assert read_points("one.geojson", Grid(0.0, 40.0, 10.0, nx=6, ny=4), []).x.tolist() == [1, 2]


def test_geojson_of_one_feature_or_shape():
    path = Path(plain_geojson())
    feature = json.loads(path.read_text())["features"][0]
    path.write_text(json.dumps(feature))
    local = Grid(600000.0, 5000000.0, 10.0, nx=6, ny=4)
    assert (burn_polygons(path, local, "zone") == 5).sum() == 4
    path.write_text(json.dumps(feature["geometry"]))
    assert inside(path, local).sum() == 4


def test_geojson_without_a_crs_is_in_degrees_or_refused():
    """Without a CRS of the terrain, coordinates are not checked."""
    with pytest.raises(RockfallError) as caught:
        inside(plain_geojson(), utm_grid())
    assert str(caught.value) == (
        "a.geojson: has no CRS, and its coordinates are not degrees: "
        "x 600000 to 600020, y 4999960 to 4999980. If they are in the CRS of the DEM: "
        "ogr2ogr -a_srs EPSG:32632 a_with_crs.gpkg a.geojson"
    )
    assert inside(plain_geojson(), GRID).sum() == 4
    local = Grid(0.0, 40.0, 10.0, nx=6, ny=4)  # small numbers, which could be degrees
    assert inside(plain_geojson(0, 0), local).sum() == 4


@pytest.mark.parametrize(
    "crs", every_third(["EPSG:4326", "EPSG:25833", "EPSG:3857", "EPSG:32632+5773"])
)
def test_reprojected_polygons_are_those_of_the_terrain(crs):
    """One remark reports a change of horizontal CRS; a CRS of heights gives none."""
    import pyproj
    import shapely

    way = pyproj.Transformer.from_crs("EPSG:32632", crs.partition("+5773")[0], always_xy=True)
    shapes = [box(4, 4, 24.9, 37), box(25.1, 0, 44, 40)]
    there = shapely.transform(np.array(shapes), lambda xy: np.column_stack(way.transform(*xy.T)))
    make_layer("own.gpkg", shapes, zone=[4, 9])
    make_layer("other.gpkg", list(there), crs, zone=[4, 9])
    remarks = []
    for _ in range(2):
        cells = burn_polygons("other.gpkg", utm_grid(), "zone", remarks)
    assert np.array_equal(cells, burn_polygons("own.gpkg", utm_grid(), "zone"))
    said = [f"other.gpkg: reprojected from {crs} to EPSG:32632"] * ("+" not in crs)
    assert [one.partition(";")[0] for one in remarks] == said


def test_coordinates_that_are_nowhere_in_the_crs_of_the_dem():
    make_layer("a.gpkg", [box(0, 0, 9, 9)], "EPSG:4326", zone=[3])
    with pytest.raises(RockfallError, match=r"^a.gpkg: feature 1: EPSG:4326: position cannot be "):
        inside("a.gpkg", utm_grid())


def test_a_layer_without_a_crs_is_refused():
    with pytest.warns(UserWarning, match="crs"):
        make_layer("my zones.gpkg", [box(0, 0, 9, 9)], None, zone=[3])
    with refused(
        "my zones.gpkg: has no CRS. If it has the CRS of the DEM: "
        "ogr2ogr -a_srs EPSG:32632 'my zones_with_crs.gpkg' 'my zones.gpkg'"
    ):
        inside("my zones.gpkg", utm_grid())
    assert inside("my zones.gpkg", GRID).sum() == 1


@pytest.mark.parametrize("number", [0, -1])
def test_an_undefined_crs_of_a_geopackage_is_none(number):
    make_layer("a.gpkg", [box(0, 0, 9, 9)], zone=[3])
    with closing(sqlite3.connect("a.gpkg")) as database, database:
        for table in "gpkg_contents", "gpkg_geometry_columns":
            database.execute(f"update {table} set srs_id = {number}")
    with pytest.raises(RockfallError, match=r"^a.gpkg: has no CRS. If "):
        inside("a.gpkg", utm_grid())


def lines_and_points():
    import shapely

    return [
        ([shapely.Point(600010, 4999970)], "feature 1: is a Point, but polygons are required"),
        (
            [box(0, 0, 9, 9), shapely.LineString([(600000, 4999960), (600010, 4999970)])],
            "feature 2: is a LineString, but polygons are required",
        ),
        ([box(0, 0, 9, 9), None], "feature 2: has no geometry"),
        ([shapely.Polygon()], "feature 1: has no geometry"),
        (
            [shapely.Polygon([(600000, 4999960), (600010, 4999970), (600010, 4999960),
                              (600000, 4999970)])],
            "feature 1: invalid polygon: Self-intersection[600005 4999965]",
        ),
        ([], "the layer is empty: must contain polygons"),
    ]  # fmt: skip


@pytest.mark.parametrize("case", range(6))
def test_what_is_no_polygon(case):
    pytest.importorskip("shapely", reason="the vector extra is not installed")
    shapes, message = lines_and_points()[case]
    make_layer("a.geojson", shapes, zone=list(range(len(shapes))))
    with refused(f"a.geojson: {message}"):
        burn_polygons("a.geojson", utm_grid(), "zone")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([1.0, 2.5], "feature 2: zone = 2.5: must be a 32-bit integer"),
        ([1, 3_000_000_000], "feature 2: zone = 3000000000: must be a 32-bit integer"),
        ([None, 1.0], "feature 1: zone is empty"),
        (["rock", "soil"], "attribute zone is not a number: zone ids must be integers"),
    ],
)
def test_attributes_that_are_no_zone_ids(values, message):
    make_layer("a.gpkg", [box(0, 0, 9, 9), box(20, 0, 29, 9)], zone=values)
    with refused(f"a.gpkg: {message}"):
        burn_polygons("a.gpkg", utm_grid(), "zone")


def test_a_missing_attribute():
    make_layer("a.gpkg", [box(0, 0, 9, 9)], klass=[1], height=[2.0])
    with refused("a.gpkg: attribute zone is missing (attributes: klass, height)"):
        burn_polygons("a.gpkg", utm_grid(), "zone")


def test_several_layers():
    make_layer("a.gpkg", [box(0, 0, 9, 9)], layer="zones", zone=[1])
    with closing(sqlite3.connect("a.gpkg")) as file, file:  # QGIS stores its styles here
        file.execute("CREATE TABLE layer_styles (id INTEGER PRIMARY KEY, qml TEXT)")
        columns = "gpkg_contents (table_name, data_type)"
        file.execute(f"INSERT INTO {columns} VALUES ('layer_styles', 'attributes')")
    assert inside("a.gpkg", utm_grid()).sum() == 1
    make_layer("a.gpkg", [box(0, 0, 9, 9)], layer="roads", zone=[1])
    with refused("a.gpkg: has 2 layers (zones, roads): keep one layer in the file"):
        inside("a.gpkg", utm_grid())


def test_polygons_elsewhere():
    make_layer("a.gpkg", [box(1000, 0, 1010, 10)])
    with refused(
        "a.gpkg: no polygon contains a cell centre: x 601000 to 601010, y 4999960 to 4999970; "
        "the terrain: x 600000 to 600060, y 4999960 to 5000000"
    ):
        inside("a.gpkg", utm_grid())


def test_a_file_that_is_no_layer():
    with refused("a.gpkg: no such file"):
        inside("a.gpkg", GRID)
    Path("a.gpkg").write_bytes(b"hello")
    with pytest.raises(RockfallError) as caught:
        inside("a.gpkg", GRID)
    assert re.fullmatch(r"a\.gpkg: cannot be read as a vector layer \(.*\)", str(caught.value))
    assert caught.value.code == 2


def test_without_the_vector_extra_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyogrio", None)
    with refused("polygons need the vector extra: pip install 'rockfall[vector]'"):
        inside("a.gpkg", GRID)
