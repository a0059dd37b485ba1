# SPDX-License-Identifier: BSD-3-Clause
"""Rasters are read exactly or refused in one line, and written completely."""

import contextlib
import os
import re
import shlex
import socket
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import rasterio
import xarray as xr
from affine import Affine
from click.testing import CliRunner
from rasterio.rio.main import main_group

from made import PLACE, UTM, hill, make_ascii, make_raster, refused, write_ascii
from rockfall.errors import RockfallError
from rockfall.io.rasters import grid as grid_module
from rockfall.io.rasters.aligned import aligned_blocks
from rockfall.io.rasters.arrays import from_array
from rockfall.io.rasters.dem import read_dem
from rockfall.io.rasters.geotiff import write_geotiff
from rockfall.io.rasters.grid import NO_ID, Grid
from rockfall.result.dataset import read_result

pytestmark = pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")


@pytest.fixture(autouse=True)
def in_tmp_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture(params=["whole", "in blocks of a row"])
def blocks(request, monkeypatch):
    """Run a test also with blocks of one row, because the block size must not change results."""
    if request.param != "whole":
        monkeypatch.setattr(grid_module, "_BLOCK", 1)


def shifted(east):
    return Affine(PLACE.a, PLACE.b, PLACE.c + east, PLACE.d, PLACE.e, PLACE.f)


def read_aligned(path, grid, what, dtype):
    array = np.empty(grid.shape, dtype)
    for rows, block in aligned_blocks(path, grid, what, dtype):
        array[rows] = block
    return array


def run_offered(error, *, after="with: "):
    words = shlex.split(str(error.value).split(after)[1])
    assert words[0] == "rio"
    done = CliRunner().invoke(main_group, words[1:])
    assert done.exit_code == 0, done.output
    return words


def georeferenced(z, nodata=None, dtype="float32"):
    """CF variable on cells of PLACE."""
    x = xr.Variable("x", 600002.5 + 5.0 * np.arange(z.shape[1]), {"axis": "X"})
    y = xr.Variable("y", 4999997.5 - 5.0 * np.arange(z.shape[0]), {"axis": "Y"})
    data = xr.DataArray(z.astype(dtype), dims=("y", "x"), coords={"x": x, "y": y}, name="z")
    data.encoding["_FillValue"] = nodata
    return data


# ---- elevations ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stored", "in_memory"),
    [
        ("float32", "float32"),
        ("float64", "float64"),
        ("int16", "float32"),
        ("int32", "float64"),
    ],
)
def test_dem_keeps_its_precision(stored, in_memory, blocks):
    values = (hill() % 200).astype(stored)
    z, grid = read_dem(make_raster("dem.tif", values, nodata=0))
    assert z.dtype == in_memory
    assert z.flags.c_contiguous
    np.testing.assert_array_equal(z, np.where(values == 0, np.nan, values.astype(in_memory)))
    assert (grid.west, grid.north, grid.cell) == (600000.0, 5000000.0, 5.0)
    assert (grid.nx, grid.ny, grid.shape) == (4, 6, (6, 4))
    assert grid.crs.to_epsg() == 32632


def test_grid_has_the_centres_of_its_cells():
    grid = Grid(600000.0, 5000000.0, 2.5, nx=3, ny=2)
    assert grid.x.tolist() == [600001.25, 600003.75, 600006.25]
    assert grid.y.tolist() == [4999998.75, 4999996.25]
    assert grid.transform == Affine(2.5, 0.0, 600000.0, 0.0, -2.5, 5000000.0)
    assert (grid.east, grid.south) == (600007.5, 4999995.0)


@pytest.mark.parametrize("shift", [{"west": 1e-5}, {"north": 1e-5}, {"cell": 5e-6}, {"nx": 1}])
def test_grids_match_up_to_a_millionth_of_a_cell(shift):
    grid = Grid(600000.0, 5000000.0, 5.0, nx=300, ny=200)

    def moved(part):
        return Grid(**{k: getattr(grid, k) + part * shift.get(k, 0) for k in vars(grid) if k in
                       ("west", "north", "cell", "nx", "ny")})  # fmt: skip

    assert not moved(1).matches(grid)
    assert not grid.matches(moved(1))
    if "nx" not in shift:
        assert moved(1e-3).matches(grid)


@pytest.mark.parametrize("nodata", [-9999.0, np.nan, -3.4028234663852886e38])
def test_nodata_becomes_nan(nodata, blocks):
    z = hill(dtype="float32")
    z[2, 3] = z[0, 0] = nodata
    got, _ = read_dem(make_raster("dem.tif", z, nodata=nodata))
    assert np.argwhere(np.isnan(got)).tolist() == [[0, 0], [2, 3]]


def test_a_mask_becomes_nan(blocks):
    make_raster("dem.tif", hill())
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True), rasterio.open("dem.tif", "r+") as file:
        mask = np.full((6, 4), 255, "uint8")
        mask[1, 2] = 0
        file.write_mask(mask)
    z, _ = read_dem("dem.tif")
    assert np.argwhere(np.isnan(z)).tolist() == [[1, 2]]


def test_scale_and_offset_are_applied(blocks):
    values = np.arange(24, dtype="int16").reshape(6, 4)
    make_raster("dem.tif", values, nodata=7)
    with rasterio.open("dem.tif", "r+") as file:
        file.scales, file.offsets = [0.1], [1000.0]
    z, _ = read_dem("dem.tif")
    assert z.dtype == "float64"
    np.testing.assert_array_equal(z, np.where(values == 7, np.nan, values * 0.1 + 1000.0))


def test_a_south_up_file_is_turned(blocks):
    south_up = Affine(5.0, 0.0, 600000.0, 0.0, 5.0, 4999970.0)
    values = hill(7)
    values[0, 0] = -1
    z, grid = read_dem(make_raster("dem.tif", values, south_up, nodata=-1))
    values[0, 0] = np.nan
    np.testing.assert_array_equal(z, values[::-1])
    assert (grid.north, grid.cell) == (5000005.0, 5.0)


@pytest.mark.parametrize("rising", [False, True])
def test_netcdf_is_north_up_whichever_way_y_runs(rising, blocks):
    data = georeferenced(np.where(hill() == 1001.0, np.nan, hill()), nodata=-1.0)
    (data[::-1] if rising else data).to_netcdf("dem.nc")
    z, grid = read_dem("dem.nc")
    assert z.dtype == "float32"
    np.testing.assert_array_equal(z, data.values)
    assert grid.matches(Grid(600000.0, 5000000.0, 5.0, 4, 6))


def test_a_variable_of_a_netcdf_file_can_be_named():
    xr.Dataset({"z": georeferenced(hill()), "w": georeferenced(2 * hill())}).to_netcdf("dem.nc")
    np.testing.assert_array_equal(read_dem("dem.nc:w")[0], 2 * hill())
    with refused("dem.nc: has several rasters: choose one of dem.nc:z, dem.nc:w"):
        read_dem("dem.nc")


def make_netcdf(stored, about, units=("m", "m", "m")):
    """Write a grid of 2 x 3 cells to dem.nc; `about` has attributes of its variable, and y
    ascends."""
    with netCDF4.Dataset("dem.nc", "w") as file:
        for name, centres, unit in (
            ("x", 600002.5 + 5.0 * np.arange(3), units[0]),
            ("y", [4999992.5, 4999997.5], units[1]),
        ):
            file.createDimension(name, len(centres))
            axis = file.createVariable(name, "f8", (name,))
            axis.setncatts({"axis": name.upper()} | ({"units": unit} if unit else {}))
            axis[:] = centres
        z = file.createVariable("z", stored.dtype, ("y", "x"))
        z.set_auto_maskandscale(False)
        z[:] = stored
        z.setncatts(about | ({"units": units[2]} if units[2] else {}))


BYTES = np.array([[1, 2, 3], [4, 5, -6]], "i1")


@pytest.mark.parametrize(
    ("about", "values"),
    [
        ({}, [[4, 5, -6], [1, 2, 3]]),
        ({"missing_value": np.array([5, 1], "i1")}, [[4, np.nan, -6], [np.nan, 2, 3]]),
        ({"valid_max": np.int8(3)}, [[np.nan, np.nan, -6], [1, 2, 3]]),
        ({"valid_range": np.array([2, 4], "i1")}, [[4, np.nan, np.nan], [np.nan, 2, 3]]),
        ({"_Unsigned": "true", "valid_max": np.int8(-10)}, [[4, 5, np.nan], [1, 2, 3]]),
        ({"scale_factor": 0.1, "add_offset": 100.0, "missing_value": np.int8(1)},
         [[4 * 0.1 + 100.0, 5 * 0.1 + 100.0, -6 * 0.1 + 100.0],
          [np.nan, 2 * 0.1 + 100.0, 3 * 0.1 + 100.0]]),
    ],
)  # fmt: skip
def test_what_netcdf_says_of_its_numbers_is_honoured(about, values, blocks):
    """The rows of the file are read in reverse, because y ascends in it."""
    make_netcdf(BYTES, about)
    np.testing.assert_array_equal(read_dem("dem.nc")[0], values)


def test_packed_floats_are_unpacked_in_double_precision():
    """Values are bit-identical to those of rockfall-batch, which single precision would not
    give."""
    stored = np.array([[0.1, 0.2, 0.3], [1.7, 2.3, 9.9]], "f4")
    make_netcdf(stored, {"scale_factor": np.float32(0.1), "add_offset": 1000.0})
    z, _ = read_dem("dem.nc")
    np.testing.assert_array_equal(z, stored[::-1].astype("f8") * float(np.float32(0.1)) + 1000.0)
    make_raster("dem.tif", stored)
    with rasterio.open("dem.tif", "r+") as file:
        file.scales, file.offsets = [0.1], [1000.0]
    np.testing.assert_array_equal(read_dem("dem.tif")[0], stored.astype("f8") * 0.1 + 1000.0)


@pytest.mark.parametrize("unit", ["km", "degrees_east"])
@pytest.mark.parametrize("which", [0, 1, 2])
def test_netcdf_in_any_unit_but_the_metre_is_refused(which, unit):
    units = ["m", None, "metres"]
    make_netcdf(BYTES, {}, units=units)
    assert read_dem("dem.nc")[0].shape == (2, 3)
    units[which] = unit
    make_netcdf(BYTES, {}, units=units)
    what = ("coordinate x is", "coordinate y is", "elevations are")[which]
    name = {"km": "kilometre"}.get(unit, unit) + " (band unit)" if which == 2 else unit
    with pytest.raises(
        RockfallError, match=re.escape(f"dem.nc: {what} in {name}, but must be in metres")
    ):
        read_dem("dem.nc")


@pytest.mark.parametrize(
    ("about", "message"),
    [
        ({"scale_factor": "0.1"}, "scale_factor = 0.1: must be a number"),
        ({"scale_factor": 0.0}, "scale_factor = 0: must not be 0"),
        ({"missing_value": 0.5}, "missing_value = 0.5: does not fit the type of the variable, "
                                 "int8"),
        ({"valid_range": np.array([3, 1], "i1")}, "valid from 3 to 1: the range is empty"),
        ({"valid_min": 1.0, "scale_factor": 0.1},
         "valid_min = 1.0: does not fit the type of the variable, int8"),
        ],
)  # fmt: skip
def test_what_netcdf_says_against_itself_is_refused(about, message):
    make_netcdf(BYTES, about)
    with refused(f"dem.nc: z: {message}"):
        read_dem("dem.nc")


@pytest.mark.family(2)
@pytest.mark.parametrize(
    "stale",
    [
        "600000 5 0 5000000 0 -5",  # of the complete raster
        "600000 10 0 5000000 0 -10",  # before resampling
        "0 5 0 0 0 -5",
        "600005 5 1 4999990 1 -5",  # rotated
        "600005 5 0 4999970 0 5",  # rows from the south
        "600005 5 0 4999990 0 -5",  # correct
    ],
)
@pytest.mark.parametrize("rising", [False, True])
def test_a_part_of_a_file_lies_where_its_coordinates_are(stale, rising):
    """A part of a dataset is placed by its coordinates, although it keeps the GeoTransform of the
    complete raster, which some versions of GDAL use."""
    about = {"GeoTransform": stale, "crs_wkt": rasterio.CRS.from_epsg(32632).wkt}
    data = georeferenced(hill()).to_dataset()
    data["crs"] = xr.Variable((), 0, about)
    data["z"].attrs["grid_mapping"] = "crs"
    part = data.isel(x=slice(1, 4), y=slice(2, 6))
    (part.isel(y=slice(None, None, -1)) if rising else part).to_netcdf("part.nc")
    z, grid = read_dem("part.nc")
    assert (grid.west, grid.north, grid.cell) == (600005.0, 4999990.0, 5.0)
    np.testing.assert_array_equal(z, hill()[2:, 1:])


# ---- ESRI ASCII ----------------------------------------------------------------------------------


def test_ascii_numbers_are_doubles_and_lines_may_wrap():
    path = make_ascii("dem.asc", "1 0.1\n2.5\r\n-3e-2\t1411.3780517578125 -9999")
    z, grid = read_dem(path)
    assert z.dtype == "float64"
    np.testing.assert_array_equal(z, [[1, 0.1, 2.5], [-0.03, 1411.3780517578125, np.nan]])
    assert (grid.west, grid.north, grid.cell) == (600000.0, 4999980.0, 5.0)


def test_ascii_nodata_is_the_number_of_its_header():
    head = "xllcenter 0\nyllcenter 0\ncellsize 5\nNODATA_value -9999.9\n"
    z, grid = read_dem(make_ascii("dem.asc", "1 2 3 4 -9999.9 -9999", head))
    np.testing.assert_array_equal(z, [[1, 2, 3], [4, np.nan, -9999]])
    assert (grid.west, grid.north) == (-2.5, 7.5)


def test_ascii_does_not_depend_on_where_its_text_is_cut(monkeypatch):
    z = np.random.default_rng(1).normal(scale=1e3, size=(13, 7))
    write_ascii("dem.asc", z, Grid(0.0, 13.0, 1.0, 7, 13))
    for chunk in (1, 2, 7, 64, 1000):
        monkeypatch.setattr("rockfall.io.rasters.ascii_grid._CHUNK", chunk)
        np.testing.assert_array_equal(read_dem("dem.asc")[0], z)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("1 2 3\n4 abc 6", "line 7: 'abc' is not a number"),
        ("1 2 3\n4 1,5 6", "line 7: '1,5' is not a number"),
        ("1 2 3\n4 \0 6", r"line 7: '\x00' is not a number"),
        (
            "1 2 3\n4 5",
            "ends after 5 values, ncols x nrows = 3 x 2 expected: truncated or damaged",
        ),
        ("1 2 3\n4 5 6 7", "more than 6 values, ncols x nrows = 3 x 2 expected"),
        ("1 2 inf\n4 5 6", "row 1, column 3: elevation inf: must be finite or nodata"),
    ],
)
def test_ascii_that_lies_is_refused(body, message):
    make_ascii("dem.asc", body)
    with refused(f"dem.asc: {message}"):
        read_dem("dem.asc")


def test_an_absurd_ascii_header_is_refused_before_memory_is_asked_for():
    make_ascii("dem.asc", "1 2 3", size=(3_000_000, 2_000_000))
    with refused(
        "dem.asc: too short for ncols x nrows = 3000000 x 2000000 values: truncated or damaged"
    ):
        read_dem("dem.asc")


HEAD = "xllcorner 600000\nyllcorner 4999970\ncellsize 5\n"
BOTH = "the header must have xllcorner and yllcorner, or else xllcenter and yllcenter"


@pytest.mark.parametrize(
    ("head", "message"),
    [
        (HEAD.replace("600000", "abc"), "line 3: xllcorner = abc: must be a number, at most 1e12"),
        (HEAD.replace("5\n", "1.000,0\n"),
         "line 5: cellsize = 1.000,0: must be a number, at most 1e12"),
        (HEAD + "NODATA_value none\n", "line 6: NODATA_value = none: must be a number or nan"),
        (HEAD + "ncols 3\n", "line 6: ncols: occurs twice in the header"),
        (HEAD + "nbands 1\n", "line 6: 'nbands' is not a number"),
        (HEAD.replace("yllcorner", "yllcenter"), BOTH),
        (HEAD.replace("cellsize", "dx"), "the header must have cellsize, or else dx and dy"),
        ],
)  # fmt: skip
def test_an_ascii_header_is_read_as_strictly_as_the_numbers(head, message):
    make_ascii("dem.asc", "1 2 3\n4 5 6", head)
    with refused(f"dem.asc: {message}"):
        read_dem("dem.asc")


def test_text_without_end_is_refused(monkeypatch):
    monkeypatch.setattr("rockfall.io.rasters.ascii_grid._CHUNK", 1000)
    make_ascii("dem.asc", "1 2 3 " + "9" * 10_000)
    with refused("dem.asc: is not text with numbers, so it is damaged"):
        read_dem("dem.asc")


# ---- what is refused -----------------------------------------------------------------------------


def test_a_missing_file():
    with refused("dem.tif: no such file"):
        read_dem("dem.tif")


def test_an_empty_file():
    Path("dem.tif").touch()
    with refused("dem.tif: is empty"):
        read_dem("dem.tif")


@pytest.mark.parametrize("content", [b"hello", b"II*\0\x08\0\0\0", b"\x89HDF\r\n"])
def test_a_file_that_is_no_raster(content):
    Path("dem.tif").write_bytes(content)
    with pytest.raises(RockfallError) as caught:
        read_dem("dem.tif")
    start = "dem.tif: cannot be read as a raster (unknown format, truncated or damaged): "
    assert str(caught.value).startswith(start)
    assert "\n" not in str(caught.value)
    assert caught.value.code == 2


def test_several_bands():
    make_raster("dem.tif", np.stack([hill()] * 3))
    with refused("dem.tif: has 3 bands: must have exactly one"):
        read_dem("dem.tif")


def test_infinite_elevations(blocks):
    z = hill()
    z[4, 1] = -np.inf
    with refused("dem.tif: row 5, column 2: elevation -inf: must be finite or nodata"):
        read_dem(make_raster("dem.tif", z))


def test_a_raster_of_nodata(blocks):
    with refused("dem.tif: all cells are nodata"):
        read_dem(make_raster("dem.tif", np.zeros((3, 3)), nodata=0))


def test_too_few_cells():
    with refused("dem.tif: 1 x 6 cells: must be at least 2 x 2"):
        read_dem(make_raster("dem.tif", hill(6, 1)))


def test_more_cells_than_memory():
    profile = {"driver": "GTiff", "width": 10**6, "height": 10**6, "count": 1, "dtype": "uint8"}
    options = {"tiled": True, "sparse_ok": True, "transform": PLACE, "bigtiff": True}
    with rasterio.open("dem.tif", "w", **profile, **options, blockxsize=4096, blockysize=4096):
        pass
    with pytest.raises(RockfallError) as caught:
        read_dem("dem.tif")
    assert re.fullmatch(
        r"dem\.tif: 1000000 x 1000000 cells need 4000 GB of memory, this machine has \d+ GB",
        str(caught.value),
    )


def test_a_raster_that_lies_nowhere():
    with refused("dem.tif: is not georeferenced"):
        read_dem(make_raster("dem.tif", hill(), transform=None))


def test_netcdf_with_unmarked_coordinates_and_the_cure():
    data = georeferenced(hill())
    data.x.attrs, data.y.attrs = {}, {}
    data.to_netcdf("dem.nc")
    with refused(
        "dem.nc: its coordinates are not identified: give x the attribute axis = 'X' and y the "
        "attribute axis = 'Y'"
    ):
        read_dem("dem.nc")


@pytest.mark.parametrize("unit", ["m", "Metre", "meters"])
def test_the_metre_in_any_spelling(unit):
    make_raster("dem.tif", hill())
    with rasterio.open("dem.tif", "r+") as file:
        file.units = [unit]
    assert read_dem("dem.tif")[0][0, 0] == 1000.0


@pytest.mark.parametrize(
    ("crs", "what"),
    [
        ('LOCAL_CS["x",UNIT["foot",0.3048]]', "cells are in foot"),
        ("+proj=tmerc +to_meter=0.3048 +towgs84=1,2,3", "cells are in foot"),
    ],
)
def test_a_system_of_any_kind_is_in_metres(crs, what):
    make_raster("dem.tif", hill(), crs=crs)
    with pytest.raises(RockfallError, match=f"^dem.tif: {what} .*, but must be in metres"):
        read_dem("dem.tif")


def test_degrees_and_the_command_that_mends_them():
    place = Affine(1e-4, 0.0, 11.3, 0.0, -1e-4, 47.2)
    make_raster("dem.tif", hill(60, 40), place, "EPSG:4326")
    with pytest.raises(RockfallError) as caught:
        read_dem("dem.tif")
    assert str(caught.value) == (
        "dem.tif: cells are in degrees (EPSG:4326), but must be in metres: reproject with: rio "
        "warp dem.tif dem_utm.tif --dst-crs EPSG:32632 --resampling bilinear --src-nodata -9999 "
        "--dst-nodata -9999"
    )
    run_offered(caught)
    z, grid = read_dem("dem_utm.tif")
    assert grid.crs.to_epsg() == 32632
    assert np.isnan(z).any()  # areas outside must not become ground at zero metres
    assert np.nanmin(z) > 999.0


@pytest.mark.parametrize(
    ("longitude", "latitude", "epsg"),
    [
        (-70.0, -33.0, 32719),
        (-180.0, 10.0, 32601),
    ],
)
def test_the_utm_zone_is_that_of_the_place(longitude, latitude, epsg):
    place = Affine(1e-4, 0.0, longitude, 0.0, -1e-4, latitude)
    make_raster("dem.tif", hill(), place, "EPSG:4326", nodata=-1)
    with pytest.raises(RockfallError, match=f"--dst-crs EPSG:{epsg} --resampling bilinear$"):
        read_dem("dem.tif")


@pytest.mark.parametrize("crs", [UTM, None])
def test_oblong_cells_and_the_command_that_mends_them(crs):
    make_raster("a dem.tif", hill(50, 40), Affine(2.5, 0, 6e5, 0, -3.0, 5e6), crs, nodata=-1)
    with pytest.raises(RockfallError) as caught:
        read_dem("a dem.tif")
    assert str(caught.value) == (
        "a dem.tif: cells are not square (2.5 x 3 m): resample with: rio warp 'a dem.tif' "
        "'a dem_square.tif' --res 2.5 --resampling bilinear"
    )
    run_offered(caught)
    assert read_dem("a dem_square.tif")[1].shape == (60, 40)


@pytest.mark.parametrize("crs", [UTM, None])
def test_a_rotated_raster_and_the_command_that_mends_it(crs):
    place = Affine(4.0, 3.0, 600000.0, 3.0, -4.0, 5000000.0)
    make_raster("dem.tif", hill(50, 40), place, crs, nodata=-1)
    with pytest.raises(RockfallError) as caught:
        read_dem("dem.tif")
    assert str(caught.value) == (
        "dem.tif: is rotated: resample with: rio warp dem.tif dem_square.tif --res 5 "
        "--resampling bilinear"
    )
    run_offered(caught)
    z, grid = read_dem("dem_square.tif")
    assert grid.cell == 5.0
    assert np.isnan(z).any()


# ---- rasters on the grid of the terrain ----------------------------------------------------------


@pytest.fixture
def dem():
    return read_dem(make_raster("dem.tif", hill(60, 40)))[1]


def test_zones_come_as_integers(dem, blocks):
    ids = np.arange(2400, dtype="int32").reshape(60, 40)
    got = read_aligned(make_raster("zones.tif", ids, nodata=7), dem, "zones", np.int32)
    assert got.dtype == "int32"
    np.testing.assert_array_equal(got, np.where(ids == 7, NO_ID, ids))


def test_zones_may_be_stored_as_whole_reals(dem, blocks):
    ids = np.arange(2400, dtype="float32").reshape(60, 40)
    ids[0, 3] = np.nan
    got = read_aligned(make_raster("zones.tif", ids), dem, "zones", np.int32)
    np.testing.assert_array_equal(got, np.where(np.isnan(ids), NO_ID, ids))


def test_zones_that_are_no_integers(dem, blocks):
    ids = np.ones((60, 40))
    ids[50, 2] = 2.5
    with refused("zones.tif: row 51, column 3: 2.5: zones must be integers"):
        read_aligned(make_raster("zones.tif", ids), dem, "zones", np.int32)


@pytest.mark.family(2)
@pytest.mark.parametrize(("value", "kind"), [
    (np.inf, "f8"), (3e9, "f8"), (-2147483648.0, "f8"), (3.4028234663852886e38, "f4"),
    (-3.4028234663852886e38, "f4"), (1e20, "f4"), (1e30, "f8"), (-1.7976931348623157e308, "f8"),
    (4294967295.0, "u4"), (-2147483648.0, "i4"), (1.70141e38, "f8"),
])  # fmt: skip
def test_undeclared_nodata_is_named_with_its_cure(dem, value, kind, blocks):
    """The command in the message declares the value as nodata; cells with it are then empty."""
    ids = np.ones((60, 40), kind)
    ids[50, 2] = value
    path = make_raster("my zones.tif", ids)
    with pytest.raises(RockfallError) as caught:
        read_aligned(path, dem, "zones", np.int32)
    start, _, command = str(caught.value).partition("declare it as nodata: ")
    assert start == f"{path}: zones cannot be {value:g}: "
    words = shlex.split(command)
    assert words[:3] == ["rio", "edit-info", "--nodata"]
    if tuple(map(int, rasterio.__version__.split(".")[:3])) >= (1, 4, 4):
        assert CliRunner().invoke(main_group, words[1:]).exit_code == 0
    else:  # edit-info fails with the current click
        with rasterio.open(words[4], "r+") as file:
            file.nodata = float(words[3])
    got = read_aligned(path, dem, "zones", np.int32)
    assert got[50, 2] == NO_ID and (got == 1).sum() == 2399


def test_radii_may_be_infinite_or_absent(dem, blocks):
    radii = np.full((60, 40), 0.25)
    radii[0, 0], radii[1, 1] = np.inf, -9999
    make_raster("rm.tif", radii, nodata=-9999)
    got = read_aligned("rm.tif", dem, "mean radii", np.float32)
    assert got.dtype == "float32"
    assert (got[0, 0], got[0, 1]) == (np.inf, 0.25)
    assert np.argwhere(np.isnan(got)).tolist() == [[1, 1]]


@pytest.mark.parametrize("crs", [UTM, None])
@pytest.mark.parametrize(
    ("what", "dtype", "resampling"),
    [("zones", np.int32, "nearest"), ("radii", np.float32, "bilinear")],
)
def test_other_cells_and_the_command_that_mends_them(crs, what, dtype, resampling):
    _, dem = read_dem(make_raster("dem.tif", hill(60, 40), crs=crs))
    finer = Affine(3.0, 0.0, 599990.0, 0.0, -3.0, 5000010.0)
    stored = np.full((80, 120), 2, np.int32 if what == "zones" else dtype)
    stored[60:, :] = 3
    make_raster("zones.tif", stored, finer, crs)
    with pytest.raises(RockfallError) as caught:
        read_aligned("zones.tif", dem, what, dtype)
    assert str(caught.value) == (
        f"zones.tif: {what} (120 x 80 cells of 3, corner 599990, 5000010) are not on the cells of "
        "dem.tif (40 x 60 cells of 5, corner 600000, 5000000): resample with: rio warp zones.tif "
        f"zones_on_dem.tif --like dem.tif --resampling {resampling} "
        "--src-nodata -9999 --dst-nodata -9999"
    )
    run_offered(caught)
    got = read_aligned("zones_on_dem.tif", dem, what, dtype)
    y = dem.y
    assert (got[(y > 4999835.0)] == 2).all()
    assert (got[(y < 4999825.0) & (y > 4999775.0)] == 3).all()
    outside = got[y < 4999765.0]  # the zones end before the terrain
    assert (outside == NO_ID if what == "zones" else np.isnan(outside)).all()


def test_cells_off_by_a_hundredth_are_other_cells(dem):
    make_raster("zones.tif", np.ones((60, 40), "uint8"), shifted(0.05))
    with pytest.raises(RockfallError, match="are not on the cells of dem.tif .* --src-nodata 255"):
        read_aligned("zones.tif", dem, "zones", np.int32)


def test_another_crs_and_the_command_that_mends_it(dem):
    west, north = 10.2687, 45.1466  # the corner of PLACE is at 10.2710, 45.1458
    place = Affine(2e-5, 0.0, west, 0.0, -2e-5, north)
    make_raster("zones.tif", np.full((400, 400), 4, "uint8"), place, "EPSG:4326", nodata=0)
    with pytest.raises(RockfallError) as caught:
        read_aligned("zones.tif", dem, "zones", np.int32)
    assert str(caught.value) == (
        "zones.tif: zones are in EPSG:4326, dem.tif is in EPSG:32632: resample with: rio warp "
        "zones.tif zones_on_dem.tif --like dem.tif --resampling nearest"
    )
    run_offered(caught)
    assert (read_aligned("zones_on_dem.tif", dem, "zones", np.int32) == 4).all()


def test_a_raster_elsewhere_is_not_resampled(dem):
    make_raster("zones.tif", hill(), shifted(1e4))
    with refused(
        "zones.tif: zones (4 x 6 cells of 5, corner 610000, 5000000) lie apart from the cells of "
        "dem.tif (40 x 60 cells of 5, corner 600000, 5000000)"
    ):
        read_aligned("zones.tif", dem, "zones", np.int32)


@pytest.mark.parametrize(
    ("one", "other"), [("EPSG:2056", "EPSG:2056+5728"), (UTM, None), (None, UTM)]
)
def test_the_same_plan_in_other_words_is_the_same(one, other):
    _, dem = read_dem(make_raster("dem.tif", hill(), crs=one))
    make_raster("zones.tif", np.ones((6, 4), "uint8"), crs=other)
    assert (read_aligned("zones.tif", dem, "zones", np.int32) == 1).all()


def test_an_esri_prj_is_the_same_crs_as_its_number():
    _, dem = read_dem(make_raster("dem.tif", hill()))
    write_ascii("zones.asc", np.ones((6, 4), "int32"), dem)
    Path("zones.prj").write_text(dem.crs.to_wkt(version="WKT1_ESRI"))
    assert Path("zones.prj").read_text().startswith('PROJCS["WGS_1984_UTM_Zone_32N"')
    assert (read_aligned("zones.asc", dem, "zones", np.int32) == 1).all()


# ---- what GDAL may open --------------------------------------------------------------------------

MOSAIC = """<VRTDataset rasterXSize="4" rasterYSize="6"><VRTRasterBand dataType="Float64" band="1">
<SimpleSource><SourceFilename>/vsicurl/{0}/a.tif</SourceFilename></SimpleSource>
</VRTRasterBand></VRTDataset>"""


def test_a_mosaic_is_refused_with_the_command_that_converts_it():
    """A VRT is refused, because it may refer to any files, servers and code."""
    Path("dem.vrt").write_text(MOSAIC)
    command = "gdal_translate dem.vrt dem_vrt.tif"
    with refused(f"dem.vrt: is a VRT: convert it to a GeoTIFF: {command}"):
        read_dem("dem.vrt")


@pytest.mark.parametrize("format", ["NETCDF3_CLASSIC", "NETCDF3_64BIT", "NETCDF3_64BIT_DATA"])
def test_classic_netcdf_is_refused_with_the_command_that_converts_it(format):
    """Classic netCDF is refused, because its header may claim more memory than exists, which would
    end the process."""
    netCDF4.Dataset("dem.nc", "w", format=format).close()
    said = "dem.nc: is classic netCDF: convert it to netCDF-4 by nccopy -k nc4 dem.nc dem_nc4.nc"
    for read in read_dem, read_result:
        with refused(said):
            read("dem.nc")


@pytest.fixture
def server():
    """Address of a server, and a function that returns 1 if it had a request since the last call,
    else 0."""
    with socket.create_server(("127.0.0.1", 0)) as waiting:
        waiting.setblocking(False)

        def visits():
            with contextlib.suppress(BlockingIOError):
                waiting.accept()
                return 1
            return 0

        yield f"http://127.0.0.1:{waiting.getsockname()[1]}", visits


ADDRESSES = {
    "service": "<WCS_GDAL><ServiceURL>{0}/?</ServiceURL><CoverageName>a</CoverageName></WCS_GDAL>",
    "mosaic": MOSAIC,
}


@pytest.mark.parametrize("name", ADDRESSES)
def test_no_file_reaches_the_network(server, name):
    address, visits = server
    Path("dem.tif").write_text(ADDRESSES[name].format(address))
    with pytest.raises(RockfallError):
        read_dem("dem.tif")
    assert not visits()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes with a name")
@pytest.mark.parametrize("name", ["dem.tif.msk", "DEM.ovr"])
def test_a_pipe_beside_a_raster_is_not_waited_for(name):
    make_raster("dem.tif", hill())
    os.mkfifo(name)
    with refused(f"{name}: is not a regular file"):
        read_dem("dem.tif")


def test_a_mask_that_is_another_format_is_not_opened():
    make_raster("dem.tif", hill())
    Path("dem.tif.msk").write_text(MOSAIC)
    with refused("dem.tif.msk: must be a GeoTIFF"):
        read_dem("dem.tif")


def test_formats_that_any_bytes_would_be_are_not_read():
    Path("dem.bil").write_bytes(b"0123456789abcdef")
    Path("dem.hdr").write_text("nrows 2\nncols 2\nnbits 32\npixeltype float\n")
    with pytest.raises(RockfallError, match=r"^dem\.bil: is an EHdr grid, which cannot be read"):
        read_dem("dem.bil")


def test_erdas_imagine_with_its_numbers_in_another_file():
    about = {"width": 4, "height": 6, "count": 1, "dtype": "float64", "transform": PLACE}
    for spill in ("NO", "YES"):
        with rasterio.open("dem.img", "w", driver="HFA", USE_SPILL=spill, **about) as file:
            file.write(hill()[None])
        if spill == "NO":
            np.testing.assert_array_equal(read_dem("dem.img")[0], hill())
    with refused("dem.img: its values are in another file: convert it to a GeoTIFF"):
        read_dem("dem.img")


def test_a_folder_is_no_raster():
    Path("dem.tif").mkdir()
    with refused("dem.tif: is a folder: give a file name"):
        read_dem("dem.tif")


def test_a_mark_that_is_no_number():
    """A nodata value that is not a number is refused: GDAL would read it as zero, and omit all
    cells at zero."""
    make_raster("dem.tif", hill(), nodata=-9999)
    content = Path("dem.tif").read_bytes()
    assert content.count(b"-9999\0") == 1
    Path("dem.tif").write_bytes(content.replace(b"-9999\0", b"none\0\0"))
    with refused("dem.tif: nodata = none: must be a number or nan"):
        read_dem("dem.tif")


def test_a_tile_far_larger_than_its_raster_is_refused():
    """A tile far larger than its raster is refused, because reading any cell would unpack it
    completely."""
    tiles = {"tiled": True, "blockxsize": 4112, "blockysize": 4112}
    make_raster("dem.tif", hill(dtype="uint8"), compress="deflate", **tiles)
    with refused("dem.tif: tiles of 4112 x 4112 cells do not fit a raster of 4 x 6: damaged"):
        read_dem("dem.tif")


# ---- arrays in memory ----------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_numpy_arrays_are_not_copied(dtype):
    data = hill(dtype=dtype)
    z, grid = from_array(data, PLACE)
    assert z is data or z.base is data
    assert (grid.west, grid.north, grid.cell) == (600000.0, 5000000.0, 5.0)
    assert from_array(data, grid)[1] is grid


def test_numpy_arrays_of_other_kinds_are_converted():
    up = from_array(hill(), Affine(5.0, 0, 0, 0, 5.0, 0))
    np.testing.assert_array_equal(up[0], hill()[::-1])
    assert up[1].north == 30.0
    assert from_array(hill(dtype="int16"), PLACE)[0].dtype == "float32"
    assert from_array(np.asfortranarray(hill()), PLACE)[0].flags.c_contiguous
    data = hill()
    masked = np.ma.masked_equal(data, 1001.0)
    assert np.argwhere(np.isnan(from_array(masked, PLACE)[0])).tolist() == [[1, 0]]
    assert not np.isnan(data).any()  # the caller's array is not changed


@pytest.mark.parametrize(
    ("data", "transform", "message"),
    [
        (hill(), None, "a NumPy array needs a transform (affine.Affine)"),
        (hill(), Affine(5, 0, 0, 0, -4, 0), "cells are not square (5 x 4 m)"),
        (hill(), Affine(4, 3, 0, 3, -4, 0), "is rotated"),
        (hill(), Grid(0, 0, 1, 5, 5), "array has shape (6, 4), but its grid has (5, 5)"),
        (hill() * np.nan, PLACE, "all cells are nodata"),
        (hill() * 1e5, PLACE, "row 1, column 1: elevation 1e+08: must be within 1e7 m of zero or "
         "nodata"),
        (hill().astype(str), PLACE, "elevations have type <U32: must be real numbers"),
    ],
)  # fmt: skip
def test_numpy_arrays_are_checked_like_files(data, transform, message):
    with refused(f"dem: {message}"):
        from_array(data, transform)


@pytest.mark.parametrize("rising", [False, True])
def test_dataarrays_may_run_either_way(rising):
    data = georeferenced(hill(), dtype="float64")
    z, grid = from_array(data[::-1] if rising else data)
    np.testing.assert_array_equal(z, hill())
    assert np.shares_memory(z, data.values)
    assert grid == Grid(600000.0, 5000000.0, 5.0, 4, 6)


def test_dataarrays_may_have_a_band_and_their_dims_in_any_order():
    data = georeferenced(hill()).expand_dims("band").transpose("x", "band", "y")
    np.testing.assert_array_equal(from_array(data)[0], hill())


def test_a_dataarray_as_rioxarray_makes_it_is_like_its_file():
    place = Affine(0.1, 0.0, 600000.03, 0.0, -0.1, 5000000.07)
    z, grid = read_dem(make_raster("dem.tif", np.where(hill() == 1001, -1, hill()), place, UTM, -1))
    about = {
        "crs_wkt": grid.crs.to_wkt(),
        "GeoTransform": "600000.03 0.1 0.0 5000000.07 0.0 -0.1",
    }
    data = xr.DataArray(
        np.where(np.isnan(z), -1, z),
        dims=("y", "x"),
        coords={"x": grid.x, "y": grid.y, "spatial_ref": ((), 0, about)},
        attrs={"_FillValue": -1.0, "grid_mapping": "spatial_ref"},
    )
    got, same = from_array(data)
    np.testing.assert_array_equal(got, z)
    assert same == grid  # exactly
    assert data.values[1, 0] == -1.0
    part = from_array(data[2:, 1:])[1]  # the GeoTransform now belongs to another corner
    assert part.matches(Grid(600000.13, 4999999.87, 0.1, 3, 4))


def uneven(data):
    return data.assign_coords(x=[0.0, 1.0, 2.0, 4.0])


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda d: d.rename(x="east"), "dims are y, east: must be y, x"),
        (lambda d: d.drop_vars("y"), "has no coordinate y (cell centres [m])"),
        (uneven, "coordinate x is not evenly spaced"),
        (lambda d: d.assign_coords(y=2 * d.y), "cells are not square (5 x 10 m)"),
        (lambda d: d[:, ::-1], "x must increase"),
        (lambda d: d[:1], "4 x 1 cells: must be at least 2 x 2"),
        (
            lambda d: d.assign_attrs(units="ft"),
            "elevations are in foot (units), but must be in metres",
        ),
        (lambda d: d.assign_attrs(crs="nonsense"), "CRS cannot be understood: nonsense"),
    ],
)
def test_dataarrays_are_checked_like_files(spoil, message):
    with refused(f"dem: {message}"):
        from_array(spoil(georeferenced(hill())))


# ---- writing -------------------------------------------------------------------------------------


@pytest.mark.family(2)
@pytest.mark.parametrize("dtype", ["bool", "int64", "float32"])
def test_geotiff_keeps_values_crs_and_tags(dtype, blocks):
    _, grid = read_dem(make_raster("dem.tif", hill(300, 260)))
    values = (np.arange(300 * 260).reshape(300, 260) % 30011).astype(dtype)
    write_geotiff("map.tif", values, grid, nodata=1, units="J", long_name="energy", seed=7)
    with rasterio.open("map.tif") as file:
        np.testing.assert_array_equal(file.read(1), values)
        assert file.crs == grid.crs
        assert file.transform == grid.transform
        assert file.nodata == 1
        assert file.profile["tiled"]
        assert file.compression.name == "deflate"
        assert file.tags()["seed"] == "7"
        assert (file.units, file.descriptions) == (("J",), ("energy",))
    assert sorted(path.name for path in Path().iterdir()) == ["dem.tif", "map.tif"]


def test_a_wrong_shape_is_our_fault():
    with pytest.raises(RockfallError, match="is not of the grid") as caught:
        write_geotiff("map.tif", hill(), Grid(0.0, 30.0, 5.0, 4, 7))
    assert caught.value.code == 1
