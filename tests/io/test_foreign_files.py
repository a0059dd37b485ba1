# SPDX-License-Identifier: BSD-3-Clause
"""Files as other programs write them: read with their correct values, or refused."""

import gzip
import io
import shlex
import struct
import zipfile
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import rasterio.shutil
from rasterio.io import MemoryFile
from rasterio.rio.main import main_group

from made import PLACE, UTM, hill, make_ascii, make_layer, refused
from rockfall.draft.dem import dem_of_points
from rockfall.errors import RockfallError
from rockfall.io.rasters.dem import read_dem
from rockfall.io.rasters.raster_file import open_raster
from rockfall.io.tables import read_columns

pytestmark = pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")


@pytest.fixture(autouse=True)
def in_tmp_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


HEAD = "xllcorner 600000\nyllcorner 4999990\ncellsize 5\n"


@pytest.mark.parametrize(
    ("nodata", "number"),
    [
        ("-9999", "-9999.0"),
        ("-9999.9", "-9999.900390625"),
        ("-9999.9", "-9999.9004"),
        ("-9999.900390625", "-9999.9"),
        ("-99999.99", "-99999.992188"),
        ("-3.4028234663852886e+38", "-3.40282347e+38"),
        ("-3.4028234663852886e+38", "-3.402823e+38"),
        ("-3.40282e+38", "-3.4028234663852886e+38"),
        ("-3.4028235e+38", "-340282346638528859811704183484516925440"),
        ("1.70141e+38", "1.701410009187828e+38"),
        ("1.70141183460469e+038", "1.7014118e38"),
        ("-1.797693134862316e+308", "-1.7976931348623157e+308"),
    ],
)
def test_nodata_may_be_rounded_to_single_precision(nodata, number):
    z, _ = read_dem(make_ascii("dem.asc", f"1 2 {number} 4 5 6", f"{HEAD}NODATA_value {nodata}\n"))
    np.testing.assert_array_equal(z, [[1, 2, np.nan], [4, 5, 6]])


@pytest.mark.parametrize(("nodata", "number"), [("-9999", "-9999.01"), ("0", "1e-7"), ("9", "9.5")])
def test_other_numbers_are_not_nodata(nodata, number):
    z, _ = read_dem(make_ascii("dem.asc", f"1 2 {number} 4 5 6", f"{HEAD}NODATA_value {nodata}\n"))
    assert z[0, 2] == float(number)


def marked(name):
    path = Path(make_ascii(name, "1 2 3 4 5 6", HEAD))
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    return path


def test_a_byte_order_mark_is_skipped():
    marked("dem.asc")
    Path("dem.csv").write_text("of the same name, and no matter")
    z, grid = read_dem("dem.asc")
    np.testing.assert_array_equal(z, [[1, 2, 3], [4, 5, 6]])
    assert (grid.west, grid.north, grid.cell) == (600000.0, 5000000.0, 5.0)
    Path("dem.prj").write_text(rasterio.crs.CRS.from_epsg(32632).to_wkt())
    with refused(
        "dem.asc: begins with a byte-order mark, so that dem.prj cannot be read: save it as UTF-8 "
        "without this mark"
    ):
        read_dem("dem.asc")


def zipped():
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("dem.asc", "ncols 2")
    return file.getvalue()


DEM = "rockfall dem {name} -o {stem}_dem.tif"
FOREIGN = {
    "a.asc": ("ncols 2\n".encode("utf-16"), "text in UTF-16", "save it as UTF-8"),
    "b.asc": (b"\xfe\xff\0n", "text in UTF-16", "save it as UTF-8"),
    "c.asc": (b"x;y;z\n1;2;3\n", "points in rows", f"create a DEM from them: {DEM}"),
    "d.asc": (b"600000.5;5000000.5;812\n", "points in rows", f"create a DEM from them: {DEM}"),
    "e.tif": (b"600000 5000000 812\n", "points in rows", f"create a DEM from them: {DEM}"),
    "f.grd": (b"DSAA\r\n2 2\n", "a Surfer text grid", "convert it to a GeoTIFF: rio convert"),
    "g.sgrd": (b"NAME\t= a\n", "a SAGA grid", "convert it to a GeoTIFF: rio convert g.sdat g_sdat"),
    "h.hgt": (b"\x01\x02" * 9, "an SRTM tile whose name gives no position", "name it such as"),
    "i.asc": (b"north: 5000000\nsouth: 1\n", "a GRASS text grid", "convert it in GRASS: r.in"),
    "j.tif": (zipped(), "a ZIP archive", "unpack it"),
    "k.asc": (gzip.compress(b"ncols 2", mtime=0), "compressed (gzip)", "unpack it"),
    "l.tif": (b"<!DOCTYPE html>\n<html>", "a web page", "the download failed"),
    "m.tif": (b"\x89PNG\r\n\x1a\n", "a picture (PNG)", "give a GeoTIFF with elevations"),
    "n.tif": (b"\xff\xd8\xff\xe0", "a picture (JPEG)", "give a GeoTIFF with elevations"),
    "o.asc": (b"LASF\0\0", "a point cloud", "create a DEM from it with rockfall dem"),
    "q.asc": (b"ncols: 3\nnrows: 2\n", "an ESRI ASCII grid with another header", "its first line"),
    "r.asc": (b"# made\nncols 3\n", "an ESRI ASCII grid with another header", "its first line"),
    "s.tif": (b"PK\x03\x04" + bytes(22) + b"\0\0\0\0doc.kml", "zipped KML", "unpack it"),
    "p.tif": (b'{"type": "FeatureCollection"', "JSON", "give a raster"),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_other_files_are_refused_as_what_they_are(name):
    content, what, cure = FOREIGN[name]
    Path(name).write_bytes(content)
    with pytest.raises(RockfallError) as caught:
        read_dem(name)
    cure = cure.format(name=name, stem=Path(name).stem)
    said = str(caught.value)
    assert said.startswith(f"{name}: is {what}, which cannot be read as a raster: {cure}")
    assert len(said.split(": ", 1)[1].split()) <= 25


def test_layers_are_named():
    shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
    make_layer("a.gpkg", [shapely.Point(1, 2)])
    with refused(
        "a.gpkg: is a GeoPackage, which cannot be read as a raster: convert it to a GeoTIFF: rio "
        "convert a.gpkg a_gpkg.tif"
    ):
        read_dem("a.gpkg")


def converted(driver, name, z):
    """Write a raster with a driver of GDAL, without companion files."""
    about = {"width": z.shape[1], "height": z.shape[0], "count": 1, "dtype": "f4"}
    with MemoryFile() as memory:
        with memory.open(driver="GTiff", transform=PLACE, crs=UTM, nodata=-9999, **about) as file:
            file.write(z, 1)
        with memory.open() as file:
            rasterio.shutil.copy(file, name, driver=driver)
    for companion in Path().glob("*.aux.xml"):  # written only by GDAL
        companion.unlink()


SCALED = {
    "a.sdat": (".sgrd", "Z_FACTOR\t= 0.010000\n", "Z_FACTOR = 0.010000"),
    "a.sgrd": (".sgrd", "Z_FACTOR\t= 1.000000\nZ_OFFSET\t= 300\n", "Z_OFFSET = 300"),
    "b.sdat": (".sgrd", "UNIT\t= ft\nZ_FACTOR\t= 1.0\n", "UNIT = ft"),
    "c.img": (".hdr", "ENVI\ndata gain values = {0.01}\n", "data gain values = 0.01"),
    "d.img": (".hdr", "ENVI\ndata offset values = { 5 }\n", "data offset values = 5"),
    "e.rst": (".rdc", "value units : feet\n", "value units = feet"),
    "f.sdat": (".sgrd", "UNIT\t= m\nZ_FACTOR\t= 1.0\nZ_OFFSET\t= 0.0\n", ""),
    "g.rst": (".rdc", "value units : unspecified\n", ""),
    "h.img": (".hdr", "ENVI\ndata gain values = {1.0}\n", ""),
}


@pytest.mark.parametrize("name", SCALED)
def test_no_command_is_suggested_that_loses_the_scale_of_the_heights(name):
    suffix, header, lost = SCALED[name]
    Path(name).write_bytes(bytes(8))
    Path(name).with_suffix(suffix).write_text(header)
    with pytest.raises(RockfallError) as caught:
        read_dem(name)
    said = str(caught.value)
    assert ("to a GeoTIFF: rio convert" in said) == (not lost)
    assert said.endswith(f"`rio convert` loses {lost}") == bool(lost)
    assert len(said.split(": ", 1)[1].split()) <= 25


@pytest.mark.parametrize(
    ("driver", "name"),
    [("SAGA", "a.sdat"), ("GSAG", "a.grd"), ("EHdr", "a.bil"), ("ENVI", "a.img"), ("RST", "a.rst")],
)
def test_the_command_that_converts_is_right(driver, name):
    z = hill(6, 5).astype("f4")
    converted(driver, name, z)
    with pytest.raises(RockfallError) as caught:
        read_dem(name)
    rio, *words = shlex.split(str(caught.value).split("to a GeoTIFF: ")[1])
    assert rio == "rio"
    main_group.main(words, standalone_mode=False)
    found, grid = read_dem(words[-1])
    np.testing.assert_allclose(found, z, rtol=1e-6)
    assert (grid.west, grid.north, grid.cell) == (PLACE.c, PLACE.f, PLACE.a)


def surfer_7(name, z):
    """Write a Surfer 7 binary grid from its description: GDAL 3.12 only writes squares."""
    place = PLACE.c + PLACE.a / 2, PLACE.f + PLACE.e * (z.shape[0] - 0.5), PLACE.a, PLACE.a
    head = struct.pack("<ii8d", *z.shape, *place, z.min(), z.max(), 0.0, -9999.0)
    tags = (
        (b"DSRB", struct.pack("<i", 1)),
        (b"GRID", head),
        (b"DATA", z[::-1].astype("<f8").tobytes()),
    )
    Path(name).write_bytes(
        b"".join(tag + struct.pack("<i", len(text)) + text for tag, text in tags)
    )


@pytest.mark.parametrize("write", [partial(converted, "GSBG"), surfer_7])
def test_surfer_binary_grids_are_read(write):
    z = hill(6, 5).astype("f4")
    z[2, 3] = -9999
    write("a.grd", z)
    found, grid = read_dem("a.grd")
    z[2, 3] = np.nan
    np.testing.assert_allclose(found, z, rtol=1e-6)
    assert (grid.west, grid.north, grid.cell) == (PLACE.c, PLACE.f, PLACE.a)


def test_an_srtm_tile_is_read_and_is_in_degrees():
    z = np.arange(1201 * 1201, dtype=">i2").reshape(1201, 1201) % 4000
    z[7, 9] = -32768
    Path("N46E007.hgt").write_bytes(z.astype(">i2").tobytes())
    with open_raster("N46E007.hgt") as raster:
        blocks = [np.where(valid, values, -1) for _, values, valid in raster.blocks()]
        np.testing.assert_array_equal(np.concatenate(blocks), np.where(z == -32768, -1, z))
        assert raster.grid.x[0] == pytest.approx(7.0) and raster.grid.y[0] == pytest.approx(47.0)
    with pytest.raises(RockfallError, match="cells are in degrees .* rio warp N46E007.hgt"):
        read_dem("N46E007.hgt")


# ---- CSV that begins with its separator


@pytest.mark.parametrize("head", ["sep=;", "SEP=;", '"sep=;"', "\ufeffsep=;"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_the_separator_of_a_spreadsheet_is_no_header(head, end):
    rows = [head, "zone;a,b", "1;2", "", "3;4"]
    Path("a.csv").write_text(end.join(rows), encoding="utf-8", newline="")
    where, columns = read_columns("a.csv", ["zone"])
    assert where == ["a.csv: line 3", "a.csv: line 5"]
    assert columns["zone"].tolist() == ["1", "3"] and columns["a,b"].tolist() == ["2", "4"]


@pytest.mark.parametrize("mark", [",", ";", "\t", "|"])
def test_any_separator_may_be_named(mark):
    Path("a.csv").write_text(f"sep={mark}\nx{mark}y\n1{mark}2\n")
    assert read_columns("a.csv", ["x", "y"])[1]["y"].tolist() == ["2"]


@pytest.mark.parametrize("name", ["a.csv", "a.xyz"])
def test_points_may_begin_with_their_separator(name):
    rows = [f"{600000 + i};{5000000 - j};{800 + i + j}" for j in range(3) for i in range(4)]
    Path(name).write_text("\n".join(["sep=;", "x;y;z", *rows]))
    dem, _ = dem_of_points(name)
    np.testing.assert_array_equal(dem.z, 800 + np.add.outer(np.arange(3), np.arange(4)))


KML = '<?xml version="1.0"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"><Document/></kml>'


def zipped(*names):
    store = io.BytesIO()
    with zipfile.ZipFile(store, "w") as file:
        for name in names:
            file.writestr(name, "x")
    return store.getvalue()


@pytest.mark.parametrize(("name", "start", "message"), [
    ("a.kml", KML, "is KML, not a CSV table: save it as a GeoPackage"),
    ("a.kml", "\ufeff" + KML.partition("\n")[2], "is KML"),
    ("a.kmz", zipped("doc.kml"), "is zipped KML, not a CSV table: save it as a GeoPackage"),
    ("a.gpx", KML.replace("kml", "gpx"), "is GPX"),
    ("a.gml", '<?xml version="1.0"?><wfs:FeatureCollection/>', "is XML"),
    ("a.rts", bytes(8 * 56), "trajectories are not read: give samples and stops as CSV"),
    ("a.PTS", "x,y\n1,2\n", "trajectories are not read: give samples and stops as CSV"),
    ("a.txt", '{"type": "FeatureCollection", "features": []}', "is JSON, not a CSV table: if it"),
    ("a.csv", "<!DOCTYPE html><html>", "is a web page, not a CSV table: the download failed"),
    ("a.xlsx", zipped("[Content_Types].xml"), "is a spreadsheet (.xlsx), not a CSV table: "),
    ("a.xls", b"\xd0\xcf\x11\xe0\xa1\xb1", "is an Excel 97 spreadsheet"),
    ("a.csv", "x,y\n1,2\n".encode("utf-16"), "is text in UTF-16, not a CSV table: save it as"),
    ("a.csv.gz", gzip.compress(b"x,y\n1,2\n", mtime=0),
        "is compressed (gzip), not a CSV table: unpack it"),
    ("a.db", b"SQLite format 3\x00", "is a GeoPackage, not a CSV table: name it .gpkg"),
    ("a.dat", b"\x00\x00\x27\x0a", "is a shapefile, not a CSV table: name it .shp"),
    ("a.pdf", b"%PDF-1.7", "is a PDF, not a CSV table: save the table as CSV"),
    ("a.zip", zipped("a.csv"), "is a ZIP archive, not a CSV table: unpack it"),
    ("a.7z", b"7z\xbc\xaf\x27\x1c", "is a 7z archive, not a CSV table: unpack it"),
    ("a.png", b"\x89PNG\r\n", "is a picture (PNG), not a CSV table: save the table as CSV"),
])  # fmt: skip
def test_tables_that_are_none_are_named(name, start, message):
    Path(name).write_bytes(start if isinstance(start, bytes) else start.encode())
    with pytest.raises(RockfallError) as caught:
        read_columns(name, ["x", "y"])
    assert str(caught.value).startswith(f"{name}: {message}") and "\n" not in str(caught.value)
