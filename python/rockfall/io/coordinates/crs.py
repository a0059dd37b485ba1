# SPDX-License-Identifier: BSD-3-Clause
"""Coordinate reference systems: names, comparison, checks, transformations, CF attributes (1.8)."""

from __future__ import annotations

import json
import math
import re
import warnings
from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.coordinates.length_units import METRE, Stated, Unit, contradiction
from rockfall.language import remark

if TYPE_CHECKING:
    import pyproj
    from rasterio.crs import CRS

    from rockfall.io.rasters.grid import Grid

NO_DATUM = "not stated"
_NAMELESS = re.compile(r"(d_)?(unknown|unnamed|undefined|not.specified)", re.IGNORECASE)
_NEAR = 1e-3  # maximum difference of equal coordinates [m]


def crs_name(crs: CRS) -> str:
    """Short name of a system: its EPSG code, as in EPSG:25832; without a code, its name; without a
    name, its projection and ellipsoid."""
    return _short_name(_pyproj(crs))


def _short_name(system: pyproj.CRS) -> str:
    code = system.to_epsg()
    return f"EPSG:{code}" if code else _title(system)


def _title(system: pyproj.CRS) -> str:
    """Name of a system; its projection and ellipsoid if it has no name."""
    source = _source(system)
    if not _NAMELESS.match(system.name) or source.coordinate_operation is None:
        return system.name
    body = source.ellipsoid.name if source.ellipsoid else system.name
    method = source.coordinate_operation.method_name
    return method if _NAMELESS.match(body) else f"{method}, {body}"


def crs_argument(crs: CRS) -> str:
    """Horizontal system as a command argument: its code, or well-known text."""
    code = in_plan(crs).to_epsg()
    return f"EPSG:{code}" if code else plan_wkt(crs)


def same_crs(a: CRS | None, b: CRS | None) -> bool:
    """Return True if plan coordinates are equivalent; an unknown system equals any other.

    A projection can be given as a code, as well-known text, or as a PROJ string, which lacks the
    datum name but may include a shift to WGS 84.
    """
    if a is None or b is None:
        return True
    a, b = in_plan(a), in_plan(b)
    if a == b or (a.to_epsg() is not None and a.to_epsg() == b.to_epsg()):
        return True
    first, second = _source(_pyproj(a)), _source(_pyproj(b))
    return _same_datum(first, second) and _same_coordinates(first, second)


def _source(system: pyproj.CRS) -> pyproj.CRS:
    """System without a shift to WGS 84."""
    return system.source_crs if system.is_bound and system.source_crs else system


def _same_datum(a: pyproj.CRS, b: pyproj.CRS) -> bool:
    """Return True if both datums are known and have the same name, or one has no name."""
    if a.datum is None or b.datum is None:
        return False
    names = a.datum.name, b.datum.name
    if any(map(_NAMELESS.match, names)):
        return True
    plain = [re.sub(r"^d_|ensemble$|[^a-z0-9]", "", name.lower()) for name in names]
    return plain[0] == plain[1] or a.datum == b.datum


def _same_coordinates(a: pyproj.CRS, b: pyproj.CRS) -> bool:
    """Return True if two projections of the same ellipsoid agree near their centres."""
    import pyproj

    if not (a.is_projected and b.is_projected):
        return False
    if not np.allclose(_body(a), _body(b), rtol=1e-9, atol=0.0):
        return False
    try:
        first, second = (_projected(system, *_places(a)) for system in (a, b))
    except pyproj.exceptions.ProjError:
        return False
    return bool(np.isfinite(first).all() and (np.abs(first - second) <= _NEAR).all())


def _body(system: pyproj.CRS) -> tuple[float, float, float]:
    """Semi-major axis [m], inverse flattening, and prime meridian + pi [rad], which is never 0."""
    ellipsoid, meridian = system.ellipsoid, system.prime_meridian
    assert ellipsoid is not None and meridian is not None
    greenwich = meridian.longitude * float(meridian.unit_conversion_factor)
    return ellipsoid.semi_major_metre, ellipsoid.inverse_flattening, math.pi + greenwich


def _places(system: pyproj.CRS) -> tuple[np.ndarray, np.ndarray]:
    """Longitudes and latitudes [degree] of test points near the centre of a projection."""
    assert system.coordinate_operation is not None
    angles: dict[str, list[float]] = {"ongitude": [], "atitude": []}
    for parameter in system.coordinate_operation.params:
        for word, values in angles.items():
            if word in parameter.name:
                unit = float(parameter.unit_conversion_factor)
                values.append(math.degrees(float(parameter.value) * unit))
    longitudes, latitudes = angles.values()
    away = [x for x in latitudes if abs(x) < 85.0] or [math.copysign(80.0, sum(latitudes))]
    east, north = np.meshgrid(
        (longitudes or [0.0])[0] + np.array([-1.5, 0.5, 2.5]),
        [latitude + step for latitude in away for step in (-1.0, 0.7)],
    )
    return east.ravel(), north.ravel()


def _projected(system: pyproj.CRS, longitude: np.ndarray, latitude: np.ndarray) -> np.ndarray:
    """Projected coordinates (2, n) of points given in degrees from the system's prime meridian."""
    import pyproj

    base = system.geodetic_crs
    assert base is not None
    unit = math.degrees(base.axis_info[0].unit_conversion_factor)
    way = pyproj.Transformer.from_crs(base, system, always_xy=True)
    return np.array(way.transform(longitude / unit, latitude / unit))


class Transformation(NamedTuple):
    """A transformation between two coordinate systems."""

    transform: Callable[..., tuple[Any, Any]]  # x and y to x and y; infinite where undefined
    is_best: bool  # False if it needs a missing grid, or applies to another area


def transformation(crs: CRS, grid: Grid) -> Transformation:
    """Plan transformation from a system to the system of a raster."""
    assert grid.crs is not None
    return _best_way(_pyproj(in_plan(crs)), _pyproj(in_plan(grid.crs)), grid.crs, grid)


def degrees_way(crs: CRS, bounds: Bounds) -> Transformation:
    """Best transformation within `bounds`, given in `crs`, to longitude and latitude (WGS 84)."""
    import pyproj

    return _best_way(_pyproj(in_plan(crs)), pyproj.CRS.from_user_input("OGC:CRS84"), crs, bounds)


def vertical_datum(crs: CRS) -> str:
    """Name of the vertical system; "ellipsoid" for ellipsoidal heights, `NO_DATUM` if unknown."""
    system = _pyproj(crs)
    names = [part.name for part in system.sub_crs_list if part.is_vertical]
    if not names and len(system.axis_info) == 3:
        names = ["ellipsoid"]
    return names[0] if names else NO_DATUM


class Bounds(NamedTuple):
    """Plan bounds [m]."""

    west: float
    south: float
    east: float
    north: float


def _best_way(
    source: pyproj.CRS, target: pyproj.CRS, crs: CRS, bounds: Bounds | Grid
) -> Transformation:
    """Best transformation between systems within bounds given in `crs`. Raises a RockfallError if
    there is none."""
    import pyproj

    corners = _degrees(crs, [bounds.west, bounds.east], [bounds.south, bounds.north])
    area = None
    if np.isfinite(corners).all():
        (west, east), (south, north) = corners
        area = pyproj.transformer.AreaOfInterest(west, south, east, north)
    # Outside the area of a datum shift, PROJ would omit a shift of 100 m or more. Applying it is
    # more accurate. A datum without a name has no shift.
    for within, allow_ballpark in ((area, False), (None, False), (area, True)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # suppress PROJ's warning about a missing grid
            ways = pyproj.transformer.TransformerGroup(
                source, target, True, within, allow_ballpark=allow_ballpark
            )
        if ways.transformers:
            is_best = ways.best_available and within is area and not allow_ballpark
            return Transformation(ways.transformers[0].transform, is_best)
    raise RockfallError(
        f"no coordinate transformation from {source.name} to {target.name} is available"
    )


#: Returns a command that converts a raster to metres, given a plan system (None: unchanged) and a
#: factor for its heights.
Cure = Callable[[str | None, float], str]


def check_metres(
    grid: Grid, path: str, stated: Iterable[Stated] = (), cure: Cure | None = None
) -> None:
    """Refuse units other than the metre, contradictory elevation units, depths, and systems without
    plan coordinates. `stated`: elevation units that the file gives in addition to its CRS. `cure`
    returns the command that converts to a plan CRS (None: unchanged) and multiplies elevations by a
    factor."""
    system = None if grid.crs is None else _pyproj(grid.crs)
    plan = METRE
    if system is not None:
        _check_kind(path, system)
        plan, heights = _units(system)
        if heights is not None:
            stated = [Stated(heights, "CRS"), *stated]
    stated = [*stated]
    if pair := contradiction(stated):
        units = " and in ".join(f"{unit.name} ({where})" for unit, where in pair)
        raise RockfallError(f"{path}: elevations are in {units}: correct one of the units")
    wrong = next((heights for heights in stated if not heights.unit.is_metre), None)
    if plan.is_metre and wrong is None:
        return
    if plan.is_metre:
        assert wrong is not None
        problem = (
            f"{path}: elevations are in {wrong.unit.name} ({wrong.where}), but must be in metres"
        )
        if cure is not None and math.isfinite(wrong.unit.factor):
            problem += f": convert with: {cure(None, wrong.unit.factor)}"
        raise RockfallError(problem)
    raise _plan_refusal(grid, path, plan, wrong.unit if wrong else None, bool(stated), cure)


def _plan_refusal(
    grid: Grid, path: str, plan: Unit, heights: Unit | None, is_stated: bool, cure: Cure | None
) -> RockfallError:
    """Error for plan coordinates not in metres, with the command that converts them. `heights` is
    the elevation unit if it must be converted too; `is_stated`: the file gives that unit."""
    assert grid.crs is not None
    both = f", elevations in {heights.name}" if heights else ""
    problem = (
        f"{path}: cells are in {plan.name}{both} ({crs_name(grid.crs)}), but must be in metres"
    )
    utm = _utm(grid)
    if utm is None or (heights and math.isnan(heights.factor)):
        return RockfallError(problem)
    if cure is None:
        return RockfallError(f"{problem}: reproject to {utm}")
    if heights:
        return RockfallError(f"{problem}: convert with: {cure(utm, heights.factor)}")
    alone = cure(utm, 1.0)
    if is_stated or not math.isfinite(plan.factor):
        return RockfallError(f"{problem}: reproject with: {alone}")
    return RockfallError(
        f"{problem}. If elevations are also in {plan.name}, run: {cure(utm, plan.factor)}. If they "
        f"are in metres, run: {alone}"
    )


def _check_kind(path: str, system: pyproj.CRS) -> None:
    """Refuse systems without plan coordinates, and systems with depths."""
    if system.is_geocentric:
        raise RockfallError(
            f"{path}: coordinates are geocentric ({_short_name(system)}), from the centre of the "
            "Earth: a projected CRS in metres is needed"
        )
    if system.is_vertical and not system.is_compound:
        raise RockfallError(
            f"{path}: its CRS is only vertical ({_title(system)}): a projected CRS is needed"
        )
    if any(axis.direction == "down" for axis in system.axis_info):
        raise RockfallError(
            f"{path}: has depths ({_title(system)}): must have elevations, positive upwards"
        )


def check_area(grid: Grid, path: str, remarks: list[str]) -> None:
    """Add a remark if a raster's centre is outside the area of its CRS; refuse swapped x and y."""
    code = None if grid.crs is None else in_plan(grid.crs).to_epsg()
    if code is None:
        return
    import pyproj

    area = pyproj.CRS.from_epsg(code).area_of_use
    if area is None:
        return
    west, south, east, north = area.bounds

    def is_within(x: float, y: float) -> bool:
        (longitude,), (latitude,) = _degrees(grid.crs, [x], [y])
        in_north = math.isfinite(longitude) and south <= latitude <= north
        return in_north and (longitude - west) % 360.0 <= ((east - west) % 360.0 or 360.0)

    x, y = _middle(grid)
    if is_within(x, y):
        return
    if is_within(y, x):
        raise RockfallError(
            f"{path}: x {x:.0f}, y {y:.0f} lies outside EPSG:{code}, but within it with x and y "
            "exchanged: exchange them"
        )
    remarks.append(remark(path, "input.outside_area", x=x, y=y, crs=f"EPSG:{code}"))


def _units(crs: pyproj.CRS) -> tuple[Unit, Unit | None]:
    """Units of plan coordinates (degrees have a NaN factor) and of heights (None if not given)."""
    plan, heights = METRE, None
    for axis in crs.axis_info:
        factor, name = axis.unit_conversion_factor, axis.unit_name
        if axis.direction == "up":
            heights = Unit(name, factor)
        elif name in ("degree", "grad", "radian", "unity"):
            plan = Unit("degrees" if name == "degree" else name, math.nan)
        elif abs(factor - 1.0) > 1e-9:
            plan = Unit(name, factor if factor > 0.0 else math.nan)
    return plan, heights


def in_plan(crs: CRS) -> CRS:
    """Horizontal part of a system."""
    from rasterio.crs import CRS

    description = crs.to_dict(projjson=True)
    kind = description.get("type")
    if kind == "BoundCRS" and description["source_crs"].get("type") == "CompoundCRS":
        description, kind = description["source_crs"], "CompoundCRS"
    if kind == "CompoundCRS":
        return CRS.from_user_input(json.dumps(description["components"][0]))
    system = _pyproj(crs)
    return CRS.from_wkt(system.to_2d().to_wkt()) if len(system.axis_info) == 3 else crs


def plan_wkt(crs: CRS | str) -> str:
    """Well-known text of the horizontal part of a system, which may be well-known text itself."""
    from rasterio.crs import CRS

    return in_plan(CRS.from_user_input(crs)).to_wkt()


def _utm(grid: Grid) -> str | None:
    """EPSG code of the UTM zone at the centre of a raster; None if the centre is not on the Earth.

    `pyproj.database.query_utm_crs_info` takes 0.1 s, and near the poles it gives two zones or
    none.
    """
    (longitude,), (latitude,) = _degrees(grid.crs, *([c] for c in _middle(grid)))
    if not (abs(longitude) <= 360.0 and abs(latitude) <= 90.0):
        return None
    zone = int((longitude + 180.0) // 6.0) % 60 + 1
    return f"EPSG:{(32600 if latitude >= 0 else 32700) + zone}"


def length_scale(grid: Grid) -> float:
    """Coordinate metres per metre on the ground at the centre of a raster: geometric mean of the
    east and north scales; 1 without a projected CRS, or if undefined.

    `pyproj.Proj.get_factors` has an error of 0.2 % for the Mercator projection of web maps.
    """
    if grid.crs is None or not grid.crs.is_projected:
        return 1.0
    import pyproj

    x, y = _middle(grid)
    step = 100.0  # [m] long compared with rounding of degrees, short compared with the Earth
    longitude, latitude = _degrees(grid.crs, [x, x + step, x], [y, y, y + step])
    start = [longitude[0]] * 2, [latitude[0]] * 2
    *_, ground = pyproj.Geod(ellps="WGS84").inv(*start, longitude[1:], latitude[1:])
    if not (all(map(math.isfinite, ground)) and min(ground) > 0):
        return 1.0
    return step / math.sqrt(ground[0] * ground[1])


def grid_mapping(crs: CRS) -> dict[str, Any]:
    """Attributes of a CF grid mapping variable. They give only the horizontal system, because
    readers would apply a vertical unit to counts and energies. `crs_wkt` (WKT 2) and `spatial_ref`
    (WKT 1, for older programs) define it completely; CF parameters are added if equivalent, and
    `vertical_datum` if there is a vertical system."""
    texts = crs.to_wkt(version="WKT2_2019"), crs.to_wkt()
    if texts not in _MAPPINGS:
        _MAPPINGS[texts] = _grid_mapping(crs)
    return dict(_MAPPINGS[texts])


#: Cached attributes: creating a system takes longer than a small run.
_MAPPINGS: dict[tuple[str, str], dict[str, Any]] = {}


def _grid_mapping(crs: CRS) -> dict[str, Any]:
    plan, heights = in_plan(crs), vertical_datum(crs)
    system = _pyproj(plan)
    attrs = _parameters(system)
    if system.is_projected and _NAMELESS.match(system.name):
        attrs |= {"projected_crs_name": _title(system)}
    if heights != NO_DATUM:
        attrs |= {"vertical_datum": heights}
    return attrs | {"crs_wkt": plan.to_wkt(version="WKT2_2015"), "spatial_ref": plan.to_wkt()}


def _parameters(crs: pyproj.CRS) -> dict[str, Any]:
    """CF parameters of `to_cf`, if they alone define the coordinates of the system.

    Oblique Mercator projections are excluded: CF lacks the angle of the rectified grid, and PROJ
    readers disagree on its default (with pyproj up to 3.7, EPSG:2056 is wrong by over 100 km).
    """
    import pyproj

    source = _ellipsoidal(_source(crs))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # some versions warn of lost parameters
        parameters = source.to_cf()
        parameters.pop("crs_wkt", None)
        name, parallel = parameters.get("grid_mapping_name"), parameters.get("standard_parallel")
        if name == "polar_stereographic" and parallel is not None:
            parameters["latitude_of_projection_origin"] = math.copysign(90.0, parallel)
        if not source.is_projected:
            return parameters
        if name in (None, "oblique_mercator"):
            return {}
        try:
            read = pyproj.CRS.from_cf(parameters)
        except (pyproj.exceptions.ProjError, KeyError, ValueError):
            return {}
    return parameters if _same_coordinates(_source(crs), read) else {}


def _ellipsoidal(system: pyproj.CRS) -> pyproj.CRS:
    """System with the ellipsoidal formulas that CF requires, even on a sphere."""
    import pyproj

    description = system.to_json_dict()
    method = description.get("conversion", {}).get("method", {})
    if not method.get("name", "").endswith(" (Spherical)"):
        return system
    method["name"] = method["name"].removesuffix(" (Spherical)")
    method.pop("id", None)
    return pyproj.CRS.from_json_dict(description)


def _pyproj(crs: CRS) -> pyproj.CRS:
    return _system(json.dumps(crs.to_dict(projjson=True)))


@lru_cache  # creating a system takes a millisecond
def _system(definition: str) -> pyproj.CRS:
    import pyproj

    return pyproj.CRS.from_json(definition)


def _middle(grid: Grid) -> tuple[float, float]:
    return (grid.west + grid.east) / 2, (grid.south + grid.north) / 2


def _degrees(crs: CRS, x: list[float], y: list[float]) -> tuple[list[float], list[float]]:
    """Longitudes and latitudes (WGS 84) of points; not finite where undefined."""
    import pyproj

    nowhere = [math.nan] * len(x)
    if max(map(abs, (*x, *y))) > 1e8:  # PROJ never returns for such values
        return nowhere, nowhere
    try:
        to_degrees = pyproj.Transformer.from_crs(_pyproj(crs), "EPSG:4326", always_xy=True)
    except pyproj.exceptions.ProjError:
        return nowhere, nowhere
    return to_degrees.transform(x, y)
