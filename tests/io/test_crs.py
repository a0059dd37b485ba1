# SPDX-License-Identifier: BSD-3-Clause
"""CRS: CF parameters agree with the WKT, different spellings of a system are recognised, and scales
are those on the ground."""

import json
import math
import shlex

import numpy as np
import pyproj
import pytest
from affine import Affine
from rasterio.crs import CRS

from made import every_third, hill, make_layer, make_raster
from rockfall.errors import RockfallError
from rockfall.io.coordinates.crs import (
    crs_name,
    grid_mapping,
    length_scale,
    same_crs,
    transformation,
    vertical_datum,
)
from rockfall.io.rasters.aligned import aligned_blocks
from rockfall.io.rasters.dem import read_dem
from rockfall.io.rasters.grid import Grid
from rockfall.io.vectors.layers import read_points
from rockfall.language import remark, say, speaking
from rockfall.tables.run import _checksums

WKT = "crs_wkt", "spatial_ref"


# EPSG codes, and systems without a code
DESCRIBED = [
    32733, 2154, 31254, 3035, 5070, 3395, 3031, 32661, 31370, 3388, 3408, 3410,
    "+proj=utm +zone=32 +ellps=bessel +towgs84=577,90,464,5,1.5,5.3,2.4",
    "+proj=lcc +lat_1=46 +lat_0=46 +lon_0=7 +k_0=1 +x_0=600000 +y_0=200000 +ellps=GRS80",
    "+proj=laea +lat_0=46 +lon_0=7 +R=6371000", "+proj=sinu +lon_0=9", "+proj=merc +lat_ts=40",
    "+proj=stere +lat_0=46 +lon_0=7 +k_0=0.9996", "+proj=ortho +lat_0=45 +lon_0=9",
    "+proj=nsper +h=35785831 +lat_0=45", "+proj=geos +h=35785831 +lon_0=0",
]  # fmt: skip


@pytest.mark.parametrize("system", every_third(DESCRIBED))
def test_the_parameters_of_a_projection_give_the_coordinates_of_its_wkt(system):
    """The CF parameters without WKT give the coordinates within 1 mm, as in a program that cannot
    read WKT."""
    attributes = grid_mapping(CRS.from_user_input(system))
    assert attributes["grid_mapping_name"]
    alone = {key: value for key, value in attributes.items() if key not in WKT}
    whole, read = pyproj.CRS.from_wkt(attributes["crs_wkt"]), pyproj.CRS.from_cf(alone)
    whole = whole.source_crs if whole.is_bound else whole
    centre = pyproj.Transformer.from_crs(whole, whole.geodetic_crs, always_xy=True)
    area = pyproj.CRS.from_user_input(system).area_of_use
    place = centre.transform([6e5, 6.1e5], [2e5, 2.2e5])
    if area:
        place = [np.linspace(*ends, 5)[1:4] for ends in (area[0:4:2], area[1:4:2])]
    x, y = (
        pyproj.Transformer.from_crs(crs.geodetic_crs, crs, always_xy=True).transform(*place)
        for crs in (whole, read)
    )
    assert np.isfinite(x).all()
    np.testing.assert_allclose(y, x, atol=1e-3)


@pytest.mark.parametrize("code", [27572, 2056, 3375, 3857, 28992, 2062, 5514, 2985, 4087])
def test_a_projection_that_cf_cannot_describe_has_its_wkt_alone(code):
    """CF has no parameters for grads, a scale on a cone, oblique axes, web maps, or an oblique
    stereographic projection."""
    attributes = grid_mapping(CRS.from_epsg(code))
    assert "grid_mapping_name" not in attributes
    assert CRS.from_wkt(attributes["crs_wkt"]) == CRS.from_epsg(code)


@pytest.mark.parametrize("system", ["EPSG:25832+5783", "EPSG:25832+6360", "EPSG:2056+5728", 4979])
def test_maps_have_no_system_of_heights(system):
    """Maps have only the horizontal part of a compound system: a reader might convert counts and
    energies to its unit of height."""
    whole = CRS.from_user_input(system)
    attributes = grid_mapping(whole)
    for key in WKT:
        found = pyproj.CRS.from_wkt(attributes[key])
        assert len(found.axis_info) == 2 and not found.is_compound
    assert attributes["crs_wkt"].startswith(("PROJCRS", "GEODCRS"))  # WKT 2
    assert attributes["vertical_datum"] == vertical_datum(whole)


UTM32_BESSEL = "+proj=utm +zone=32 +ellps=bessel"
GK_WEST = "+proj=tmerc +lat_0=0 +lon_0=10.3333333333 +k=1 +x_0=0 +y_0=-5000000 +ellps=bessel"
SHIFT = " +towgs84=577.326,90.129,463.919,5.137,1.474,5.297,2.4232"
ETRS_UTM = (
    'PROJCS["ETRS89 / UTM 32",GEOGCS["x",DATUM["European_Terrestrial_Reference_System_1989",'
    'SPHEROID["GRS 1980",6378137,298.257222101]],PRIMEM["Greenwich",0],UNIT["degree",'
    '0.0174532925199433]],PROJECTION["Transverse_Mercator"],PARAMETER["latitude_of_origin",0],'
    'PARAMETER["central_meridian",9],PARAMETER["scale_factor",0.9996],'
    'PARAMETER["false_easting",500000],PARAMETER["false_northing",0],UNIT["metre",1]]'
)


@pytest.mark.family(3)
@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        (31254, GK_WEST + SHIFT, True),
        (31254, GK_WEST, True),
        (GK_WEST, GK_WEST + SHIFT, True),
        (GK_WEST + SHIFT, GK_WEST + " +towgs84=1,2,3", True),
        (31254, GK_WEST.replace("-5000000", "-5000001"), False),
        (31254, GK_WEST.replace("bessel", "clrk66"), False),
        (31254, GK_WEST.replace("k=1", "k=1.00001"), False),
        (31254, 31257, False),
        (25832, ETRS_UTM, True),
        (25832, "+proj=utm +zone=32 +ellps=GRS80 +towgs84=0,0,0,0,0,0,0", True),
        (25832, "+proj=utm +zone=33 +ellps=GRS80 +towgs84=0,0,0,0,0,0,0", False),
        (25832, "EPSG:25832+5783", True),
        (UTM32_BESSEL, "+proj=tmerc +lon_0=9 +k=0.9996 +x_0=500000 +ellps=bessel" + SHIFT, True),
        (2056, 21781, False),
        (28404, 3333, False),  # same projection and ellipsoid, two known datums
        (2154, "+proj=lcc +lat_0=46.5 +lon_0=3 +lat_1=49 +lat_2=44 +x_0=700000 +y_0=6600000 "
         "+ellps=GRS80 +towgs84=0,0,0", True),
        (27572, "+proj=lcc +lat_1=46.8 +lat_0=46.8 +lon_0=0 +k_0=0.99987742 +x_0=600000 "
         "+y_0=2200000 +a=6378249.2 +b=6356515 +towgs84=-168,-60,320 +pm=paris", True),
        (27572, "+proj=lcc +lat_1=46.8 +lat_0=46.8 +lon_0=0 +k_0=0.99987742 +x_0=600000 "
         "+y_0=2200000 +a=6378249.2 +b=6356515 +towgs84=-168,-60,320", False),  # Greenwich
        (28992, "+proj=sterea +lat_0=52.1561605555556 +lon_0=5.38763888888889 +k=0.9999079 "
         "+x_0=155000 +y_0=463000 +ellps=bessel +towgs84=565.4,50.3,465.5,-0.4,0.3,-1.9,4.1", True),
        (5514, "+proj=krovak +lat_0=49.5 +lon_0=24.8333333333333 +alpha=30.2881397527778 +k=0.9999 "
         "+x_0=0 +y_0=0 +ellps=bessel +towgs84=589,76,480", True),
        (32632, 4326, False),
    ],
)  # fmt: skip
def test_one_system_in_two_spellings_is_one_system(one, other, same):
    """A shift to WGS 84 is not part of a system: with or without it, a layer or raster stays in
    place."""
    a, b = CRS.from_user_input(one), CRS.from_user_input(other)
    assert same_crs(a, b) is same_crs(b, a) is same


@pytest.mark.family(3)
@pytest.mark.parametrize("form", ["WKT1_GDAL", "WKT1_ESRI", "WKT2_2015", "WKT2_2019"])
@pytest.mark.parametrize("code", [31254, 31467, 2056, 25832, 2154, 27700, 3003, 5514, 3035, 2193])
def test_well_known_text_of_any_dialect_is_the_number(code, form):
    """WKT dialects differ in names of datums and in the order of axes."""
    text = pyproj.CRS.from_epsg(code).to_wkt(form)
    assert same_crs(CRS.from_epsg(code), CRS.from_user_input(text))


@pytest.mark.family(3)
@pytest.mark.parametrize("name", every_third(["blocks.gpkg", "blocks.shp", "blocks.fgb"]))
@pytest.mark.parametrize("system", [GK_WEST + SHIFT, GK_WEST, "EPSG:31254", "EPSG:31254+5778"])
@pytest.mark.parametrize("dem", ["EPSG:31254", GK_WEST + SHIFT.replace("577", "578")])
def test_a_layer_in_another_spelling_is_not_moved(name, system, dem, tmp_path):
    shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
    x, y = np.array([80000.25, 80001.5]), np.array([230000.0, 230000.125])
    make_layer(tmp_path / name, shapely.points(x, y).tolist(), crs=system)
    grid, remarks = Grid(79000.0, 231000.0, 5.0, 400, 400, CRS.from_user_input(dem)), []
    points = read_points(tmp_path / name, grid, remarks)
    np.testing.assert_array_equal(np.sort(points.x), x)  # FlatGeobuf sorts them
    np.testing.assert_array_equal(np.sort(points.y), y)
    assert remarks == []


def test_a_raster_in_another_spelling_is_aligned(tmp_path):
    place = Affine(5.0, 0.0, 79000.0, 0.0, -5.0, 231000.0)
    make_raster(tmp_path / "radii.tif", hill(), place, GK_WEST + SHIFT)
    for system in ("EPSG:31254", "EPSG:31254+5778", GK_WEST):
        make_raster(tmp_path / "dem.tif", hill(), place, system)
        _, grid = read_dem(tmp_path / "dem.tif")
        ((_, block),) = aligned_blocks(tmp_path / "radii.tif", grid, "mean radii", np.float32)
        np.testing.assert_array_equal(block, hill())


def test_the_cure_of_a_layer_without_a_system_names_one_that_can_be_read(tmp_path):
    shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
    path = tmp_path / "blocks.gpkg"
    make_layer(path, shapely.points([80000.0], [230000.0]).tolist(), crs=None)
    system = CRS.from_user_input(GK_WEST.replace("k=1", "k=0.999") + SHIFT)
    with pytest.raises(RockfallError) as caught:
        read_points(path, Grid(79000.0, 231000.0, 5.0, 400, 400, system), [])
    words = shlex.split(str(caught.value).split("DEM: ")[1])
    assert words[:2] == ["ogr2ogr", "-a_srs"] and same_crs(CRS.from_user_input(words[2]), system)


def test_a_system_without_a_name_is_called_by_its_projection():
    assert crs_name(CRS.from_user_input(GK_WEST.replace("k=1", "k=0.999") + SHIFT)).startswith(
        "Transverse Mercator, Bessel 1841"
    )
    assert crs_name(CRS.from_user_input('LOCAL_CS["quarry",UNIT["metre",1]]')) == "quarry"


@pytest.mark.parametrize(
    ("code", "x", "y", "scale"),
    [
        (32632, 500000, 5.0e6, 0.9996),
        (32632, 166021, 0, 0.9996 * (1 + 0.5 * (333979 / 0.9996) ** 2 / (6335439.3 * 6378137))),
        (32661, 2000000, 2000000, 0.994),  # pole
        (3857, 0, 0, math.sqrt(6378137 / 6335439.3)),  # sphere with coordinates of an ellipsoid
        (4326, 9, 47, 1.0),
        (32632, 1e12, 1e12, 1.0),
    ],
)
def test_lengths_of_a_crs_are_those_on_the_ground(code, x, y, scale):
    grid = Grid(x - 10.0, y + 10.0, 1.0, 20, 20, CRS.from_epsg(code))
    assert length_scale(grid) == pytest.approx(scale, abs=2e-5)


@pytest.mark.parametrize(("west", "is_rough"), [(9.0, False), (10.86, True)])
def test_a_shift_of_datum_is_not_left_out_beyond_its_area(west, is_rough):
    """The Swiss system is valid to 10.49 degrees east. Its datum shift is three lengths (X, Y, Z:
    674.374, 15.056, 405.346 m), and is also applied farther east."""
    x, y = pyproj.Transformer.from_crs(4258, 25832, always_xy=True).transform(west, 47.2)
    grid = Grid(x - 50, y + 50, 1.0, 100, 100, CRS.from_epsg(25832))
    by_hand = pyproj.Transformer.from_pipeline(
        "+proj=pipeline +step +inv +proj=utm +zone=32 +ellps=GRS80 +step +proj=cart +ellps=GRS80 "
        "+step +proj=helmert +x=-674.374 +y=-15.056 +z=-405.346 +step +inv +proj=cart "
        "+ellps=bessel +step +proj=somerc +lat_0=46.9524055555556 +lon_0=7.43958333333333 +k_0=1 "
        "+x_0=2600000 +y_0=1200000 +ellps=bessel"
    )
    way = transformation(CRS.from_epsg(2056), grid)
    assert way.transform(*by_hand.transform(x, y)) == pytest.approx((x, y), abs=0.01)
    assert way.is_best is not is_rough


def test_a_datum_that_is_not_known_is_said():
    """The datum of a bare ellipsoid is unknown: `is_best` is False, which a message reports."""
    bare = CRS.from_string("+proj=utm +zone=32 +ellps=GRS80 +type=crs")
    grid = Grid(2.6e6, 1.2e6, 1.0, 100, 100, CRS.from_epsg(2056))
    assert not transformation(bare, grid).is_best


@pytest.mark.parametrize("language", ["en", "de"])
def test_inputs_list_from_which_system_and_how_well(language):
    told = {"crs": "EPSG:2056", "ours": "EPSG:25832"}
    for key in ("", "_roughly"):
        text = str(remark("a.gpkg", f"input.reprojected{key}", **told))
        noted = "12ab" + text.removeprefix("a.gpkg").replace(":", ",", 1)
        attrs = {"input_checksums": json.dumps({"lines": noted})}
        with speaking(language):
            rough = f"; {say('input.no_grid_of_proj')}" if key else ""
            way = say("tables.reprojected", join="EPSG:2056 → EPSG:25832")
            assert [value for _, value in _checksums(attrs)] == [f"lines: 12ab; {way}{rough}"]
