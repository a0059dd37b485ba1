# SPDX-License-Identifier: BSD-3-Clause
"""Coordinate reference systems: names, equality, requirements of the model, and their description
in CF (1.8, appendix F)."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rockfall.errors import RockfallError

if TYPE_CHECKING:
    import pyproj
    from rasterio.crs import CRS

    from rockfall.io.grid import Grid

_METRES = {"", "m", "metre", "metres", "meter", "meters"}


def crs_name(crs: CRS) -> str:
    """Short name: EPSG:25832, or the title of a system without a number."""
    code = crs.to_epsg()
    return f"EPSG:{code}" if code else _pyproj(crs).name


def same_crs(a: CRS | None, b: CRS | None) -> bool:
    """Return True if plan coordinates are equivalent; an unknown system equals any other."""
    if a is None or b is None:
        return True
    a, b = _in_plan(a), _in_plan(b)
    return a == b or (a.to_epsg() is not None and a.to_epsg() == b.to_epsg())


class Transformation(NamedTuple):
    """A transformation between two systems."""

    transform: Callable[..., tuple[Any, Any]]  # x and y to x and y, infinite where undefined
    is_best: bool  # of those known to PROJ; False if one needs a grid that is not installed


def transformation(crs: CRS, grid: Grid) -> Transformation:
    """Transformation from a system to that of a raster, in plan."""
    assert grid.crs is not None
    return _best_way(_pyproj(_in_plan(crs)), _pyproj(_in_plan(grid.crs)), grid.crs, grid)


def degrees_way(crs: CRS, bounds: Bounds) -> Transformation:
    """Transformation from a system to longitude and latitude (WGS 84), best within `bounds`."""
    import pyproj

    return _best_way(_pyproj(_in_plan(crs)), pyproj.CRS.from_user_input("OGC:CRS84"), crs, bounds)


def vertical_datum(crs: CRS) -> str:
    """Name of the system of heights; "not stated" if the system has none."""
    system = _pyproj(crs)
    names = [part.name for part in system.sub_crs_list if part.is_vertical]
    if not names and len(system.axis_info) == 3:
        names = ["ellipsoid"]
    return names[0] if names else "not stated"


class Bounds(NamedTuple):
    """Extent in plan [m]."""

    west: float
    south: float
    east: float
    north: float


def _best_way(
    source: pyproj.CRS, target: pyproj.CRS, crs: CRS, bounds: Bounds | Grid
) -> Transformation:
    """Best transformation between systems within bounds, which are in `crs`."""
    import pyproj

    corners = _degrees(crs, [bounds.west, bounds.east], [bounds.south, bounds.north])
    area = None
    if np.isfinite(corners).all():
        (west, east), (south, north) = corners
        area = pyproj.transformer.AreaOfInterest(west, south, east, north)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # PROJ's warning about a missing grid
        ways = pyproj.transformer.TransformerGroup(source, target, True, area)
    if not ways.transformers:
        raise RockfallError(f"no way is known from {source.name} to {target.name}")
    return Transformation(ways.transformers[0].transform, ways.best_available)


def is_metre(unit: str | None) -> bool:
    """Return True if a unit as spelled in files is the metre, or missing."""
    return (unit or "").strip().lower() in _METRES


def check_metres(grid: Grid, path: str, warp: Callable[[str, str], str] | None = None) -> None:
    """Refuse units other than the metre; `warp(suffix, options)` gives the command that fixes it.

    The unit of heights is checked if the system has a vertical datum.
    """
    crs = grid.crs
    if crs is None:
        return
    if _pyproj(crs).is_geocentric:
        raise RockfallError(
            f"{path}: coordinates are geocentric ({crs_name(crs)}), from the centre of the Earth: "
            "a projected CRS in metres is needed"
        )
    plan, heights = _units(_pyproj(crs))
    if plan == heights == "metre":
        return
    if plan == "metre":
        raise RockfallError(
            f"{path}: elevations are in {heights} ({crs_name(crs)}), metres are needed"
        )
    problem = f"{path}: cells are in {plan} ({crs_name(crs)}), metres are needed"
    if (utm := _utm(grid)) is None:
        raise RockfallError(problem)
    cure = f"reproject to {utm}"
    if warp is not None:
        cure = f"reproject with: {warp('utm', f'--dst-crs {utm} --resampling bilinear')}"
    raise RockfallError(f"{problem}; {cure}")


def _units(crs: pyproj.CRS) -> tuple[str, str]:
    """Units of a system in plan and of its heights; metre where undefined."""
    plan = heights = "metre"
    for axis in crs.axis_info:
        unit = "degrees" if axis.unit_name == "degree" else axis.unit_name
        if abs(axis.unit_conversion_factor - 1.0) <= 1e-9 and unit not in ("radian", "unity"):
            continue
        if axis.direction in ("up", "down"):
            heights = unit
        else:
            plan = unit
    return plan, heights


def _in_plan(crs: CRS) -> CRS:
    """Horizontal part of a compound system."""
    from rasterio.crs import CRS

    description = crs.to_dict(projjson=True)
    if description.get("type") != "CompoundCRS":
        return crs
    return CRS.from_user_input(json.dumps(description["components"][0]))


def _utm(grid: Grid) -> str | None:
    """UTM zone of the centre of a raster; None where it is not on the earth.

    `pyproj.database.query_utm_crs_info` takes 0.1 s, and gives two zones or none near the poles.
    """
    (longitude,), (latitude,) = _degrees(grid.crs, *([c] for c in _middle(grid)))
    if not (abs(longitude) <= 360.0 and abs(latitude) <= 90.0):
        return None
    zone = int((longitude + 180.0) // 6.0) % 60 + 1
    return f"EPSG:{(32600 if latitude >= 0 else 32700) + zone}"


def length_scale(grid: Grid) -> float:
    """Coordinate metres per metre on the ground at the centre of a raster: the geometric mean of
    east and north; 1 where the CRS does not define it.

    `pyproj.Proj.get_factors` is 0.2 % off in the Mercator projection of web maps.
    """
    if grid.crs is None or not grid.crs.is_projected:
        return 1.0
    import pyproj

    x, y = _middle(grid)
    step = 100.0  # [m]: long compared with the rounding of degrees, short compared with the Earth
    longitude, latitude = _degrees(grid.crs, [x, x + step, x], [y, y, y + step])
    start = [longitude[0]] * 2, [latitude[0]] * 2
    *_, ground = pyproj.Geod(ellps="WGS84").inv(*start, longitude[1:], latitude[1:])
    if not (all(map(math.isfinite, ground)) and min(ground) > 0):
        return 1.0
    return step / math.sqrt(ground[0] * ground[1])


def grid_mapping(crs: CRS) -> dict[str, Any]:
    """Attributes of a CF grid mapping variable. The complete CRS is in `crs_wkt`; CF parameters are
    added where they are equivalent."""
    return _parameters(_pyproj(crs)) | {"crs_wkt": crs.to_wkt(), "spatial_ref": crs.to_wkt()}


def _parameters(crs: pyproj.CRS) -> dict[str, Any]:
    """`to_cf` without the systems it represents incorrectly: angles in units other than degrees,
    the scale of a cone with one standard parallel, and the pole."""
    if crs.geodetic_crs and any(a.unit_name == "grad" for a in crs.geodetic_crs.axis_info):
        return {}
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # its warning about a lost parameter
        try:
            parameters = crs.to_cf()
        except UserWarning:
            return {}
    name, parallel = parameters.get("grid_mapping_name"), parameters.get("standard_parallel")
    if name == "lambert_conformal_conic" and isinstance(parallel, float):
        return {}
    if name == "polar_stereographic" and parallel is not None:
        parameters["latitude_of_projection_origin"] = math.copysign(90.0, parallel)
    return parameters


def _pyproj(crs: CRS) -> pyproj.CRS:
    import pyproj

    return pyproj.CRS.from_json_dict(crs.to_dict(projjson=True))


def _middle(grid: Grid) -> tuple[float, float]:
    return (grid.west + grid.east) / 2, (grid.south + grid.north) / 2


def _degrees(crs: CRS, x: list[float], y: list[float]) -> tuple[list[float], list[float]]:
    """Longitudes and latitudes (WGS 84) of points; not finite where undefined."""
    import pyproj

    nowhere = [math.nan] * len(x)
    if max(map(abs, (*x, *y))) > 1e8:  # PROJ would loop for ever
        return nowhere, nowhere
    try:
        to_degrees = pyproj.Transformer.from_crs(_pyproj(crs), "EPSG:4326", always_xy=True)
    except pyproj.exceptions.ProjError:
        return nowhere, nowhere
    return to_degrees.transform(x, y)
