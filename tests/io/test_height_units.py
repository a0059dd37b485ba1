# SPDX-License-Identifier: BSD-3-Clause
"""A slope of 20 degrees is read as 20 degrees, or refused, for any unit of elevations and any
declaration of it. Commands printed in refusals also give 20 degrees."""

import math
import re
import shlex
import struct
import subprocess
import sys

import numpy as np
import pyproj
import pytest
import rasterio
import xarray as xr
from affine import Affine
from click.testing import CliRunner
from rasterio.rio.main import main_group

from made import every_third
from rockfall.draft.dem import dem_of_points
from rockfall.errors import RockfallError
from rockfall.io.coordinates.length_units import unit_in_words, unit_of
from rockfall.io.rasters.aligned import aligned_blocks
from rockfall.io.rasters.arrays import from_array
from rockfall.io.rasters.dem import read_dem
from rockfall.io.rasters.grid import Grid

pytestmark = pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
FEET = 0.3048
SURVEY = 1200 / 3937
UTM, CELL, N = "EPSG:32632", 5.0, 40
PLACE = Affine(CELL, 0.0, 600000.0, 0.0, -CELL, 5000000.0)


@pytest.fixture(autouse=True)
def in_tmp_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def plane(unit=1.0, cell=CELL):
    """Elevations of a slope of 20 degrees, in a unit of `unit` m, with a cell size in m."""
    fall = np.arange(N) * cell * math.tan(math.radians(20))
    return np.tile((1000 + fall) / unit, (N, 1))


def slope(z, grid):
    """Median slope in degrees."""
    return math.degrees(math.atan(np.nanmedian(np.hypot(*np.gradient(z, grid.cell)))))


def tiff(z, crs=UTM, place=PLACE, unit=None, description=None, tags=None, packing=None, nodata=-1):
    profile = {"driver": "GTiff", "width": N, "height": N, "count": 1, "dtype": z.dtype}
    with rasterio.open("dem.tif", "w", **profile, crs=crs, transform=place, nodata=nodata) as file:
        if packing:  # first, because GDAL loses it later if there is a vertical CRS
            file.scales, file.offsets = [packing[0]], [packing[1]]
        file.write(z, 1)
        if unit:
            file.units = [unit]
        if description:
            file.set_band_description(1, description)
        file.update_tags(**(tags or {}))
        file.update_tags(1, **(tags or {}))
    return "dem.tif"


def directory(keys, text):
    """GeoKey directory of {id: value} in 16-bit numbers; key 4097 refers to `text`."""
    rows = []
    for key, value in sorted(keys.items()):
        rows += [key, 34737, len(text), 0] if key == 4097 else [key, 0, 1, value]
    return struct.pack(f"<{4 + len(rows)}H", 1, 1, 0, len(rows) // 4, *rows)


def keyed(z, keys, text=b""):
    """Write dem.tif as a GeoTIFF with the given GeoKeys, without a library."""
    raw = z.astype("<f8").tobytes()
    scale, tie = struct.pack("<3d", CELL, CELL, 0), struct.pack("<6d", 0, 0, 0, 6e5, 5e6, 0)
    tags = [
        (256, 3, [N]), (257, 3, [N]), (258, 3, [64]), (259, 3, [1]), (262, 3, [1]), (273, 4, [8]),
        (277, 3, [1]), (278, 3, [N]), (279, 4, [len(raw)]), (339, 3, [3]), (33550, 12, scale),
        (33922, 12, tie), (34735, 3, directory(keys, text)), (42113, 2, b"-9999\0"),
    ]  # fmt: skip
    if text:
        tags.insert(-1, (34737, 2, text))
    sizes, start = {2: 1, 3: 2, 4: 4, 12: 8}, 8 + len(raw)
    far, entries = start + 2 + 12 * len(tags) + 4, b""
    behind = b""
    for tag, kind, value in tags:
        if isinstance(value, list):
            entries += struct.pack("<HHII", tag, kind, 1, value[0])
        else:
            entries += struct.pack("<HHII", tag, kind, len(value) // sizes[kind], far + len(behind))
            behind += value + b"\0" * (len(value) % 2)
    with open("dem.tif", "wb") as file:
        file.write(struct.pack("<2sHI", b"II", 42, start) + raw)
        file.write(struct.pack("<H", len(tags)) + entries + struct.pack("<I", 0) + behind)
    return "dem.tif"


def ascii_grid(z, projection):
    with open("dem.asc", "w") as file:
        file.write(f"ncols {N}\nnrows {N}\nxllcorner 600000\nyllcorner 5000000\ncellsize {CELL}\n")
        file.write("NODATA_value -9999\n")
        np.savetxt(file, z, "%.17g")
    if projection:
        with open("dem.prj", "w") as file:
            file.write(projection)
    return "dem.asc"


def netcdf(z, crs=None, **attributes):
    x = xr.Variable("x", 600002.5 + CELL * np.arange(N), {"axis": "X", "units": "m"})
    y = xr.Variable("y", 4999997.5 - CELL * np.arange(N), {"axis": "Y", "units": "m"})
    data = xr.DataArray(z, dims=("y", "x"), coords={"x": x, "y": y}, name="z", attrs=attributes)
    if crs:
        data.attrs["grid_mapping"] = "crs"
        data = data.to_dataset()
        data["crs"] = xr.Variable((), 0, {"crs_wkt": pyproj.CRS.from_user_input(crs).to_wkt()})
    data.to_netcdf("dem.nc")
    return "dem.nc"


def companion(z, name, text, crs=UTM):
    path = tiff(z, crs)
    with open(name, "w") as file:
        file.write(text)
    return path


def wkt(system, form):
    return pyproj.CRS.from_user_input(system).to_wkt(form)


OLD = (
    "Projection    UTM\nZone          32\nDatum         WGS84\nUnits         METERS\nZunits        "
)
PAM = "<PAMDataset><PAMRasterBand band='1'><UnitType>{}</UnitType></PAMRasterBand></PAMDataset>"
FT = f"{UTM}+8228"  # NAVD88 height (ft)
US_FT = f"{UTM}+6360"  # NAVD88 height (ftUS)
M = f"{UTM}+5703"  # NAVD88 height
ESRI_TWO = wkt(UTM, "WKT1_ESRI") + "\n" + wkt("EPSG:6360", "WKT1_ESRI")

PLAN_KEYS = {1024: 1, 1025: 1, 3072: 32632}

# Name -> (unit in metres, function that writes elevations in this unit).
RASTERS = {
    "band unit ft": (FEET, lambda z: tiff(z, unit="ft")),
    "band unit in words": (SURVEY, lambda z: tiff(z, unit="US survey foot")),
    "band unit us-ft": (SURVEY, lambda z: tiff(z, unit="us-ft")),
    "band unit ftUS": (SURVEY, lambda z: tiff(z, unit="ftUS")),
    "band unit cm": (0.01, lambda z: tiff(z, unit="cm")),
    "integers in dm": (0.1, lambda z: tiff(np.rint(z).astype("i4"), unit="dm")),
    "no nodata": (FEET, lambda z: tiff(z, unit="ft", nodata=None)),
    "NaN as nodata": (FEET, lambda z: tiff(z, unit="ft", nodata=math.nan)),
    "packed in feet": (FEET, lambda z: tiff((z - 100) / 0.5, unit="ft", packing=(0.5, 100.0))),
    "compound CRS in ft": (FEET, lambda z: tiff(z, FT)),
    "compound CRS in US ft": (SURVEY, lambda z: tiff(z, US_FT)),
    "compound CRS without a number": (
        SURVEY,
        lambda z: tiff(z, pyproj.crs.CompoundCRS(
            "x", [pyproj.CRS("+proj=tmerc +lon_0=10 +x_0=600000 +y_0=3 +ellps=bessel"),
                  "EPSG:6360"]).to_wkt("WKT2_2019")),
    ),
    "description in brackets": (FEET, lambda z: tiff(z, description="Elevation [ft]")),
    "description": (FEET, lambda z: tiff(z, description="Height above sea level in feet")),
    "description US": (SURVEY, lambda z: tiff(z, description="NAVD88 U.S. survey feet")),
    "description German": (FEET, lambda z: tiff(z, description="Höhe (Fuss)")),
    "description cm": (0.01, lambda z: tiff(z, description="elevation in cm")),
    "tag of the vertical unit": (FEET, lambda z: tiff(z, tags={"VERTICAL_UNITS": "feet"})),
    "tag z_unit": (SURVEY, lambda z: tiff(z, tags={"z_unit": "US survey foot"})),
    "tag ELEVATION": (FEET, lambda z: tiff(z, tags={"ELEVATION": "ft"})),
    "tag of an image": (FEET, lambda z: tiff(z, tags={"TIFFTAG_IMAGEDESCRIPTION": "DEM, feet"})),
    "tag long_name": (FEET, lambda z: tiff(z, tags={"long_name": "elevation (feet)"})),
    "companion .aux.xml": (FEET, lambda z: companion(z, "dem.tif.aux.xml", PAM.format("ft"))),
    "companion of the FGDC": (
        FEET,
        lambda z: companion(z, "dem.tif.xml", "<metadata><altunits>feet</altunits></metadata>"),
    ),
    "key of the unit alone": (SURVEY, lambda z: keyed(z, PLAN_KEYS | {4099: 9003})),
    "key of the unit in ft": (FEET, lambda z: keyed(z, PLAN_KEYS | {4099: 9002})),
    "system of the user, unit in US ft": (
        SURVEY,
        lambda z: keyed(z, PLAN_KEYS | {4096: 32767, 4098: 5103, 4099: 9003}),
    ),
    "key of the citation": (
        SURVEY,
        lambda z: keyed(z, PLAN_KEYS | {4097: 0}, b"NAVD88 height (ftUS)|\0"),
    ),
    "system in US ft without a unit": (SURVEY, lambda z: keyed(z, PLAN_KEYS | {4096: 6360})),
    "system and unit in ft": (FEET, lambda z: keyed(z, PLAN_KEYS | {4096: 8228, 4099: 9002})),
    "prj: Zunits FEET": (FEET, lambda z: ascii_grid(z, OLD + "FEET\n")),
    "prj: Zunits in numbers": (FEET, lambda z: ascii_grid(z, OLD + f"{1 / FEET!r}\n")),
    "prj: Zunits CM": (0.01, lambda z: ascii_grid(z, OLD.lower() + "cm\n")),
    "prj: compound WKT 2": (SURVEY, lambda z: ascii_grid(z, wkt(US_FT, "WKT2_2019"))),
    "prj: compound WKT 2 of 2015": (FEET, lambda z: ascii_grid(z, wkt(FT, "WKT2_2015"))),
    "prj: compound WKT 1": (SURVEY, lambda z: ascii_grid(z, wkt(US_FT, "WKT1_GDAL"))),
    "prj: two systems": (SURVEY, lambda z: ascii_grid(z, ESRI_TWO)),
    "prj: two systems in a line": (SURVEY, lambda z: ascii_grid(z, ESRI_TWO.replace("\n", ","))),
    "netCDF: units": (FEET, lambda z: netcdf(z, units="feet")),
    "netCDF: long name": (FEET, lambda z: netcdf(z, long_name="surface elevation in feet")),
    "netCDF: long name US": (SURVEY, lambda z: netcdf(z, long_name="height (US survey feet)")),
    "netCDF: vertical units": (FEET, lambda z: netcdf(z, vertical_units="foot")),
    "netCDF: compound CRS": (SURVEY, lambda z: netcdf(z, US_FT)),
    "netCDF: fathoms": (1.8288, lambda z: netcdf(z, units="fathoms")),
}  # fmt: skip


def run_offered(command):
    for one in command.split(" && "):
        words = shlex.split(one)
        assert words[0] == "rio"
        if words[1] == "edit-info" and rasterio.__version__ < "1.4.4":
            pytest.skip("edit-info of this rasterio fails with click 8.3, whatever its options")
        done = CliRunner().invoke(main_group, words[1:])
        assert done.exit_code == 0, (one, done.output, done.exception)
    return words[-3] if words[1] == "edit-info" else words[-1]


def made_file(command):
    found = re.findall(r"dem_(?:utm|m)\.tif", command)
    return found[-1]


@pytest.mark.family(2)
@pytest.mark.parametrize("way", every_third(RASTERS))
def test_heights_in_another_unit_are_refused_and_the_command_mends_them(way):
    unit, write = RASTERS[way]
    path = write(plane(unit))
    with pytest.raises(RockfallError) as caught:
        read_dem(path)
    said = str(caught.value)
    assert said.startswith(f"{path}: elevations are in ") and caught.value.code == 2
    assert len(said.split(": convert with: ")[0].split()) <= 25
    command = said.split(": convert with: ")[1]
    run_offered(command)
    z, grid = read_dem(made_file(command))
    np.testing.assert_allclose(z, plane(), rtol=0, atol=0.06 if "integers" in way else 5e-3)
    assert slope(z, grid) == pytest.approx(20.0, abs=0.5 if "integers" in way else 0.01)


STATE_PLANE = Affine(10.0, 0.0, 980000.0, 0.0, -10.0, 200000.0)  # EPSG:2263, Long Island [US ft]
DEGREES = Affine(1e-4, 0.0, 9.3, 0.0, -1e-4, 0.3)  # cells of 11.1 m at the equator
IN_PLAN = {
    "all in US ft": (SURVEY, "EPSG:2263+6360", STATE_PLANE, None),
    "band unit": (SURVEY, "EPSG:2263", STATE_PLANE, "US survey foot"),
    "heights in ft": (FEET, "EPSG:2263+8228", STATE_PLANE, None),
    "heights in m": (1.0, "EPSG:2263+5703", STATE_PLANE, None),
    "heights in m by the band": (1.0, "EPSG:2263", STATE_PLANE, "m"),
    "degrees, heights in ft": (FEET, "EPSG:4326", DEGREES, "ft"),
    "degrees, compound": (SURVEY, "EPSG:4326+6360", DEGREES, None),
    "degrees, heights unstated": (1.0, "EPSG:4326", DEGREES, None),
    "degrees, three axes": (1.0, "EPSG:4979", DEGREES, None),
}


@pytest.mark.family(2)
@pytest.mark.parametrize("way", every_third(IN_PLAN))
@pytest.mark.parametrize("packing", [None, (0.5, 100.0)])
def test_plan_in_another_unit_and_the_command_that_mends_both(way, packing):
    unit, crs, place, band_unit = IN_PLAN[way]
    z = plane(unit, 10 * SURVEY if place is STATE_PLANE else 11.132)
    if packing:
        z = (z - packing[1]) / packing[0]
    tiff(z, crs, place, unit=band_unit, packing=packing)
    with pytest.raises(
        RockfallError, match="dem.tif: cells are in (degrees|US survey foot)"
    ) as caught:
        read_dem("dem.tif")
    command = str(caught.value).split(" with: ")[1]
    run_offered(command)
    z, grid = read_dem(made_file(command))
    assert slope(z, grid) == pytest.approx(20.0, abs=0.15)  # UTM lengths differ slightly
    assert (
        abs(np.nanmedian(z) - np.median(plane(1.0, 3.048 if place is STATE_PLANE else 11.132))) < 2
    )


@pytest.mark.parametrize(("unit", "number"), [(SURVEY, 0), (1.0, 1)])
def test_a_plan_in_feet_with_heights_of_no_stated_unit_has_two_cures(unit, number):
    tiff(plane(unit, 10 * SURVEY), "EPSG:2263", STATE_PLANE)
    with pytest.raises(
        RockfallError, match="elevations are also in US survey foot, run: rio"
    ) as caught:
        read_dem("dem.tif")
    commands = re.split(r"\. If [^:]*, run: ", str(caught.value))[1:]
    assert len(commands) == 2
    run_offered(commands[number])
    assert slope(*read_dem("dem_utm.tif")) == pytest.approx(20.0, abs=0.15)


GOOD = {
    "no unit": lambda z: tiff(z),
    "band unit": lambda z: tiff(z, unit="metre"),
    "compound CRS": lambda z: tiff(z, M),
    "metres by both": lambda z: tiff(z, M, unit="m"),
    "size of cells in feet": lambda z: tiff(z, description="DEM, 10 ft cells"),
    "converted": lambda z: tiff(z, description="elevation in metres, converted from feet"),
    "foot of a slope": lambda z: tiff(z, description="Foot of the north face"),
    "Fuss": lambda z: tiff(z, description="Gelände am Fuss des Hangs"),
    "resolution of a print": lambda z: tiff(
        z, tags={"TIFFTAG_RESOLUTIONUNIT": "2", "XY_UNITS": "ft"}
    ),
    "other tags": lambda z: tiff(z, tags={"history": "gdal_translate dem_ft.tif", "n": "yards"[0]}),
    "metadata in metres": lambda z: companion(z, "dem.xml", "<altunits>meters</altunits>"),
    "keys": lambda z: keyed(z, PLAN_KEYS | {4096: 5703, 4099: 9001}),
    "keys of a plan": lambda z: keyed(z, PLAN_KEYS | {3076: 9001}),
    "citation": lambda z: keyed(z, PLAN_KEYS | {4097: 0}, b"NAVD88 height|\0"),
    "prj: Zunits NO": lambda z: ascii_grid(z, OLD + "NO\n"),
    "prj: Zunits METERS": lambda z: ascii_grid(z, OLD + "METERS\n"),
    "prj: WKT 2": lambda z: ascii_grid(z, wkt(M, "WKT2_2019")),
    "prj: ESRI": lambda z: ascii_grid(z, wkt(UTM, "WKT1_ESRI")),
    "no prj": lambda z: ascii_grid(z, ""),
    "netCDF": lambda z: netcdf(z, units="m", long_name="elevation"),
    "netCDF: compound CRS": lambda z: netcdf(z, M),
}


@pytest.mark.family(3)
@pytest.mark.parametrize("way", GOOD)
def test_heights_in_metres_are_read(way):
    z, grid = read_dem(GOOD[way](plane()))
    np.testing.assert_array_equal(z, plane())
    if way == "prj: WKT 2":
        assert grid.crs is not None
    assert slope(z, grid) == pytest.approx(20.0, abs=1e-9)


CONTRADICTIONS = {
    "unit and description": (
        lambda z: tiff(z, unit="m", description="elevation (ft)"),
        "band desc",
    ),
    "CRS and unit": (lambda z: tiff(z, M, unit="ft"), "band unit"),
    "CRS and tag": (lambda z: tiff(z, M, tags={"VERT_UNITS": "feet"}), "VERT_UNITS"),
    "CRS in feet, unit of metres": (lambda z: tiff(z, US_FT, unit="m"), "band unit"),
    "netCDF": (lambda z: netcdf(z, units="m", long_name="height in feet"), "long_name"),
    "keys": (lambda z: keyed(z, PLAN_KEYS | {4096: 5703, 4099: 9003}), "GeoKey 4099"),
    "old code of a system": (
        lambda z: keyed(z, PLAN_KEYS | {4096: 5030, 4099: 9003}),
        "GeoKey 4099",
    ),
    "keys, the other way": (
        lambda z: keyed(z, PLAN_KEYS | {4096: 6360, 4099: 9001}),
        "GeoKey 4099",
    ),
}


@pytest.mark.parametrize("way", CONTRADICTIONS)
def test_units_that_contradict_each_other_are_refused(way):
    write, where = CONTRADICTIONS[way]
    path = write(plane())
    with pytest.raises(
        RockfallError, match=f"{path}: elevations are in .* and in .*: correct one"
    ) as e:
        read_dem(path)
    assert where in str(e.value)


OTHERS = {
    "no CRS, a prj with Zunits": (
        lambda z: companion(z, "dem.prj", OLD + "FEET\n", None),
        r"elevations are in foot \(dem.prj\)",
    ),
    "a unit of the user": (
        lambda z: keyed(z, PLAN_KEYS | {4099: 32767}), "unit 32767 .GeoKey 4099",
    ),
    "depths by the CRS": (lambda z: tiff(z, f"{UTM}+5831"), "has depths"),
    "depths in netCDF": (lambda z: netcdf(z, units="m", positive="down"), "has depths"),
    "unknown unit": (lambda z: tiff(z, unit="rod"), "elevations are in rod"),
    "a prj that is none": (lambda z: ascii_grid(z, "UTM 32"), "dem.prj: contains no readable CRS"),
    "plan keys: metre, feet": (
        lambda z: keyed(z, PLAN_KEYS | {3076: 9003}), "EPSG:32632 is in metre|cells are in US",
    ),
    "plan keys: feet, metre": (
        lambda z: keyed(z, {1024: 1, 3072: 2263, 3076: 9001}),
        "EPSG:2263 is in US survey foot, GeoKey 3076 gives metre: correct one",
    ),
}  # fmt: skip


@pytest.mark.parametrize("way", OTHERS)
def test_what_cannot_be_elevations_in_metres_is_refused(way):
    write, message = OTHERS[way]
    with pytest.raises(RockfallError, match=message) as caught:
        read_dem(write(plane()))
    assert caught.value.code == 2 and "\n" not in str(caught.value)


def test_other_rasters_in_feet_are_refused():
    _, grid = read_dem(tiff(plane()))
    for unit, description in (("ft", None), (None, "obstacle height in feet")):
        path = tiff(plane(), unit=unit, description=description)
        with pytest.raises(RockfallError, match="mean radii are in foot"):
            list(aligned_blocks(path, grid, "mean radii", np.float32))


@pytest.mark.parametrize(
    "attributes",
    [
        {"units": "ft"}, {"long_name": "elevation (feet)"}, {"vertical_units": "us-ft"},
        {"description": "height in cm"}, {"crs": US_FT},
    ],
)  # fmt: skip
def test_an_array_in_another_unit_is_refused(attributes):
    grid = Grid(600000.0, 5000000.0, CELL, N, N)
    data = xr.DataArray(plane(), dims=("y", "x"), coords={"x": grid.x, "y": grid.y})
    assert slope(*from_array(data.assign_attrs(units="m"))) == pytest.approx(20.0)
    with pytest.raises(RockfallError, match="^dem: elevations are in "):
        from_array(data.assign_attrs(attributes))


# ---- point clouds --------------------------------------------------------------------------------


def key_records(laspy, keys, text=b""):
    records = [laspy.VLR("LASF_Projection", 34735, "keys", directory(keys, text))]
    return records + ([laspy.VLR("LASF_Projection", 34737, "texts", text)] if text else [])


def laser(unit, version="1.2", keys=None, text=b"", systems=(), extended=(), area=None, other=None):
    laspy = pytest.importorskip("laspy", reason="the points extra is not installed")
    header = laspy.LasHeader(point_format=6 if version == "1.4" else 1, version=version)
    header.scales, header.offsets = [0.001] * 3, [6e5, 5e6, 0]
    if keys:
        header.vlrs.extend(key_records(laspy, keys, text))
    for system in systems:
        content = pyproj.CRS.from_user_input(system).to_wkt("WKT1_GDAL").encode() + b"\0"
        header.vlrs.append(laspy.VLR("LASF_Projection", 2112, "wkt", content))
    if other:
        header.vlrs.append(laspy.VLR("liblas", 2112, "wkt", wkt(other, "WKT1_GDAL").encode()))
    if area:
        header.vlrs.append(laspy.VLR("LASF_Spec", 3, "text", area))
    las = laspy.LasData(header)
    column, row = (axis.ravel() for axis in np.meshgrid(np.arange(N), np.arange(N)))
    las.x, las.y = 600002.5 + CELL * column, 4999997.5 - CELL * row
    las.z = plane(unit).ravel()
    las.classification = np.full(N * N, 2)
    if extended:
        las.evlrs = laspy.vlrs.vlrlist.VLRList()
        for system in extended:
            content = pyproj.CRS.from_user_input(system).to_wkt("WKT1_GDAL").encode() + b"\0"
            las.evlrs.append(laspy.VLR("LASF_Projection", 2112, "wkt", content))
    las.write("dem.las")
    return "dem.las"


CLOUDS = {
    "1.2: 4099": (lambda: laser(SURVEY, keys=PLAN_KEYS | {4099: 9003}), "survey foot .GeoKey 4099"),
    "1.3: 4099": (lambda: laser(FEET, "1.3", PLAN_KEYS | {4099: 9002}), "foot .GeoKey 4099"),
    "1.2: 4096": (lambda: laser(SURVEY, keys=PLAN_KEYS | {4096: 6360}), "survey foot .GeoKey 4096"),
    "1.2: 4096 and 4099": (
        lambda: laser(SURVEY, keys=PLAN_KEYS | {4096: 5703, 4099: 9003}), "GeoKey 4099",
    ),
    "1.2: 4097": (
        lambda: laser(SURVEY, keys=PLAN_KEYS | {4097: 0}, text=b"NAVD88 (ftUS)|"), "GeoKey 4097",
    ),
    "1.2: 3076": (
        lambda: laser(SURVEY, keys=PLAN_KEYS | {3076: 9003}), "GeoKey 3076 gives US survey foot",
    ),
    "1.4: keys": (lambda: laser(SURVEY, "1.4", PLAN_KEYS | {4099: 9003}), "GeoKey 4099"),
    "1.4: compound": (lambda: laser(SURVEY, "1.4", systems=[US_FT]), "US survey foot"),
    "1.4: plan, heights": (
        lambda: laser(SURVEY, "1.4", systems=[UTM, "EPSG:6360"]), "has 2 different WKT records",
    ),
    "1.4: heights, plan": (
        lambda: laser(SURVEY, "1.4", systems=["EPSG:6360", UTM]), "has 2 different WKT records",
    ),
    "1.4: heights alone": (lambda: laser(SURVEY, "1.4", systems=["EPSG:6360"]), "only vertical"),
    "1.4: an extended record": (
        lambda: laser(SURVEY, "1.4", systems=[UTM], extended=[US_FT]), "2 different WKT records",
    ),
    "1.4: WKT and keys": (
        lambda: laser(SURVEY, "1.4", PLAN_KEYS | {4099: 9003}, systems=[UTM]), "GeoKey 4099",
    ),
    "1.4: WKT and keys of another plan": (
        lambda: laser(1.0, "1.4", {1024: 1, 3072: 25833}, systems=[UTM]), "correct one",
    ),
    "1.2: a unit of the user": (
        lambda: laser(SURVEY, keys=PLAN_KEYS | {4099: 32767}), "z is in unit 32767",
    ),
    "1.2: libLAS": (lambda: laser(SURVEY, other=US_FT), "survey foot .its libLAS record"),
    "1.2: words": (lambda: laser(FEET, keys=PLAN_KEYS, area=b"Heights in feet"), "its text area"),
}  # fmt: skip


@pytest.mark.all
@pytest.mark.parametrize("way", CLOUDS)
def test_a_point_cloud_in_feet_is_refused(way):
    write, message = CLOUDS[way]
    with pytest.raises(RockfallError, match=f"dem.las: .*{message}") as caught:
        dem_of_points(write(), cell=CELL)
    problem, _, command = str(caught.value).partition(": convert with: ")
    assert len(problem.split()) <= 25
    if command:
        has_20_degrees(command, "dem_m.las")


def has_20_degrees(command, made):
    """Check that a command printed in a refusal writes points with a slope of 20 degrees; LAS files
    keep the class of ground."""
    place = shlex.join([sys.executable, *shlex.split(command)[1:]])
    subprocess.run(place if command.startswith("python") else command, shell=True, check=True)
    classes = [2] if made.endswith(".las") else None
    dem, _ = dem_of_points(made, cell=CELL, crs=UTM, classes=classes)
    assert slope(dem.z[5:-5, 5:-5], dem.grid) == pytest.approx(20.0, abs=0.1)


@pytest.mark.family(2)
@pytest.mark.parametrize(
    "keys",
    [
        {"keys": PLAN_KEYS}, {"keys": PLAN_KEYS | {4096: 5703, 4099: 9001, 3076: 9001}},
        {"version": "1.4", "systems": [M]}, {"version": "1.4", "systems": [UTM, UTM]},
        {"version": "1.4", "systems": [UTM], "keys": PLAN_KEYS}, {},
    ],
)  # fmt: skip
def test_a_point_cloud_in_metres_has_its_slope(keys):
    dem, _ = dem_of_points(laser(1.0, **keys), cell=CELL)
    assert slope(dem.z[5:-5, 5:-5], dem.grid) == pytest.approx(20.0, abs=0.1)


@pytest.mark.family(2)
@pytest.mark.parametrize(
    ("head", "projection"),
    [
        ("x;y;z_ft\n", ""), ("id,x,y,z (feet)\n", ""),
        ("x y z feet\n", ""), ("# x y z ft\n", ""), ("# heights in feet\n", ""),
        ("", OLD + "FEET\n"), ("", wkt(US_FT, "WKT2_2019")), ("", ESRI_TWO),
    ],
)  # fmt: skip
def test_text_with_points_in_feet_is_refused(head, projection):
    def write(head, projection, unit=1.0):
        column, row = (axis.ravel() for axis in np.meshgrid(np.arange(N), np.arange(N)))
        with open("dem.xyz", "w") as file:
            file.write(head)
            x, y = 600002.5 + CELL * column, 4999997.5 - CELL * row
            mark = next((mark for mark in ";," if mark in head), " ")
            columns = [x, y, plane(unit).ravel()]
            if head.startswith("id"):
                columns.insert(0, column)
            np.savetxt(file, np.column_stack(columns), "%.4f", mark)
        with open("dem.prj", "w") as file:
            file.write(projection)

    write("", wkt(UTM, "WKT1_ESRI"))
    dem, _ = dem_of_points("dem.xyz", cell=CELL)
    assert slope(dem.z[5:-5, 5:-5], dem.grid) == pytest.approx(20.0, abs=0.1)
    write(head, projection, FEET)
    with pytest.raises(
        RockfallError, match="dem.xyz: z is in .*foot .*must be in metres"
    ) as caught:
        dem_of_points("dem.xyz", cell=CELL)
    has_20_degrees(str(caught.value).partition(": convert with: ")[2], "dem_m.xyz")


@pytest.mark.parametrize(
    ("text", "factor"),
    [
        ("elevation (ft)", FEET), ("Elevation, feet", FEET), ("elev_ft", FEET), ("pieds", FEET),
        ("US feet", SURVEY), ("us_survey_feet", SURVEY), ("height [ftUS]", SURVEY),
        ("in yards", 0.9144), ("depth in fathoms", 1.8288), ("centimeters", 0.01), ("z (dm)", 0.1),
        ("elevation in metres", None), ("30 ft grid", None), ("foot of slope", None),
        ("loft of the aft craft", None), ("Dmitri", None), ("elevation", None), ("", None),
        ("feet to metres", None), ("left", None), ("Hangfuss", None), ("cm3", None),
    ],
)  # fmt: skip
def test_words_for_units(text, factor):
    unit = unit_in_words(text)
    assert (unit and unit.factor) == factor


def test_a_unit_is_known_by_its_spellings():
    assert unit_of(" Metre ").is_metre and unit_of("").is_metre
    assert unit_of("FEET").factor == FEET and unit_of("US Survey Foot").factor == SURVEY
    assert math.isnan(unit_of("furlong").factor)
