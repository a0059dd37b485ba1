# SPDX-License-Identifier: BSD-3-Clause
"""Grid mappings that define the CRS more than once must be consistent."""

import numpy as np
import pyproj
import pytest
import rasterio
import xarray as xr

from made import PLACE, every_third, hill, refused
from rockfall.errors import RockfallError
from rockfall.io.coordinates.crs import same_crs
from rockfall.io.rasters.arrays import from_array
from rockfall.io.rasters.dem import read_dem

UTM, OTHER, LOCAL = "EPSG:32632", "EPSG:32633", "EPSG:2056"
FEET = "EPSG:32632+6360"  # NAVD88 height (ftUS)


def wkt(system, form="WKT2_2019"):
    return pyproj.CRS.from_user_input(system).to_wkt(form)


def write(**mapping):
    z = hill(20, 30)
    x = PLACE.c + PLACE.a * (np.arange(30) + 0.5)
    y = PLACE.f + PLACE.e * (np.arange(20) + 0.5)
    axes = {name: (name, values, {"axis": name.upper()}) for name, values in (("x", x), ("y", y))}
    data = xr.Dataset({"z": (("y", "x"), z, {"grid_mapping": "crs"})}, axes)
    data["crs"] = xr.Variable((), 0, mapping)
    data.to_netcdf("dem.nc")
    return data["z"].assign_coords(crs=data["crs"])


@pytest.fixture(autouse=True)
def in_tmp_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


DIFFERENT = {
    "zones of UTM": ({"crs_wkt": wkt(UTM), "spatial_ref": wkt(OTHER, "WKT1_GDAL")}, UTM, OTHER),
    "countries": ({"crs_wkt": wkt(LOCAL), "spatial_ref": wkt(UTM, "WKT1_GDAL")}, LOCAL, UTM),
    "datums": ({"crs_wkt": wkt("EPSG:25832"), "spatial_ref": wkt("EPSG:23032", "WKT1_GDAL")},
               "EPSG:25832", "EPSG:23032"),
    "degrees": ({"crs_wkt": wkt(UTM), "spatial_ref": wkt("EPSG:4326", "WKT1_GDAL")}, UTM,
                "EPSG:4326"),
    "a number": ({"crs_wkt": wkt(UTM), "epsg_code": OTHER}, UTM, OTHER),
    "ESRI": ({"spatial_ref": wkt(UTM, "WKT1_GDAL"), "esri_pe_string": wkt(OTHER, "WKT1_ESRI")},
             UTM, OTHER),
}  # fmt: skip


@pytest.mark.parametrize("what", every_third(DIFFERENT))
def test_different_systems_are_refused(what):
    mapping, *names = DIFFERENT[what]
    data = write(**mapping)
    first, other = mapping
    ours = f"{first} is {names[0]}, {other} is"
    for path, read in (("dem.nc", lambda: read_dem("dem.nc")), ("dem", lambda: from_array(data))):
        with pytest.raises(RockfallError, match=ours) as caught:
            read()
        text = str(caught.value)
        assert text.startswith(path) and text.endswith("remove the wrong one") and "\n" not in text


@pytest.mark.parametrize("mapping", every_third([
    {"crs_wkt": wkt(UTM), "spatial_ref": wkt(UTM, "WKT1_GDAL")},
    {"crs_wkt": wkt(UTM), "spatial_ref": wkt(UTM, "WKT1_ESRI")},
    {"crs_wkt": wkt("EPSG:32632+5773"), "spatial_ref": wkt(UTM, "WKT1_GDAL")},  # heights in metres
    {"crs_wkt": wkt(UTM), "proj4": "+proj=utm +zone=32 +datum=WGS84 +units=m +no_defs"},
    {"crs_wkt": wkt(UTM), "epsg_code": UTM, "spatial_ref": wkt(UTM, "WKT1_GDAL")},
    {"crs_wkt": wkt(UTM), "epsg_code": "none", "proj4": ""},
    {"spatial_ref": wkt(UTM, "WKT1_GDAL")}, {"crs_wkt": wkt(UTM)},
]))  # fmt: skip
def test_equal_systems_are_read(mapping):
    data = write(**mapping)
    for z, grid in read_dem("dem.nc"), from_array(data):
        np.testing.assert_array_equal(z, hill(20, 30))
        assert same_crs(grid.crs, rasterio.CRS.from_user_input(UTM))


@pytest.mark.parametrize("mapping", [
    {"crs_wkt": wkt(FEET), "spatial_ref": wkt(UTM, "WKT1_GDAL")},
    {"crs_wkt": wkt(UTM), "spatial_ref": wkt(FEET, "WKT1_GDAL")},
])  # fmt: skip
def test_feet_in_one_of_them_are_refused(mapping):
    """Feet in one of several definitions are refused: GDAL reads spatial_ref first, where they may
    be missing."""
    (name,) = (name for name in mapping if "NAVD88" in mapping[name])
    data = write(**mapping)
    message = f"elevations are in US survey foot ({name}), but must be in metres"
    with refused(f"dem.nc: crs: {message}"):
        read_dem("dem.nc")
    with refused(f"dem: {message}"):
        from_array(data)
