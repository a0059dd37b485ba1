# SPDX-License-Identifier: BSD-3-Clause
"""The grid mapping of the CF conventions (1.8, appendix F) for a coordinate reference system."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rasterio.crs import CRS

_LATITUDE = ("latitude_of_projection_origin", "lat_0")
_EASTING = ("false_easting", "x_0")
_NORTHING = ("false_northing", "y_0")
_MERIDIAN = ("longitude_of_central_meridian", "lon_0")
_ORIGIN = ("longitude_of_projection_origin", "lon_0")
_SHIFT = (_EASTING, _NORTHING)

#: Name of a projection in PROJ -> its name and parameters in CF.
_PROJECTIONS: dict[str, tuple[str, tuple[tuple[str, str], ...]]] = {
    "tmerc": (
        "transverse_mercator",
        (_LATITUDE, _MERIDIAN, ("scale_factor_at_central_meridian", "k"), *_SHIFT),
    ),
    "lcc": ("lambert_conformal_conic", (_LATITUDE, _MERIDIAN, *_SHIFT)),
    "laea": ("lambert_azimuthal_equal_area", (_LATITUDE, _ORIGIN, *_SHIFT)),
    "aea": ("albers_conical_equal_area", (_LATITUDE, _MERIDIAN, *_SHIFT)),
    "merc": ("mercator", (_ORIGIN, ("scale_factor_at_projection_origin", "k"), *_SHIFT)),
    "stere": (
        "polar_stereographic",
        (
            _LATITUDE,
            ("straight_vertical_longitude_from_pole", "lon_0"),
            ("standard_parallel", "lat_ts"),
            ("scale_factor_at_projection_origin", "k"),
            *_SHIFT,
        ),
    ),
}


def grid_mapping(crs: CRS) -> dict[str, Any]:
    """Attributes of a grid mapping variable; the whole of the CRS is in `crs_wkt`."""
    about = {"crs_wkt": crs.to_wkt(), "spatial_ref": crs.to_wkt()}
    proj = crs.to_dict()
    if proj.get("proj") == "utm":
        south = "south" in proj
        proj |= {"proj": "tmerc", "lat_0": 0.0, "lon_0": 6.0 * proj["zone"] - 183.0, "k": 0.9996}
        proj |= {"x_0": 500000.0, "y_0": 1.0e7 if south else 0.0}
    if proj.get("proj") not in _PROJECTIONS:
        return about
    name, parameters = _PROJECTIONS[proj["proj"]]
    about["grid_mapping_name"] = name
    about |= {cf: float(proj[key]) for cf, key in parameters if key in proj}
    if "lat_1" in proj and name in ("lambert_conformal_conic", "albers_conical_equal_area"):
        about["standard_parallel"] = [float(proj[k]) for k in ("lat_1", "lat_2") if k in proj]
    return about
