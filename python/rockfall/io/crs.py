# SPDX-License-Identifier: BSD-3-Clause
"""Coordinate reference systems: their names, which are alike, and which the model can use."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rockfall.errors import RockfallError

if TYPE_CHECKING:
    from rasterio.crs import CRS

    from rockfall.io.grid import Grid

_METRES = {"", "m", "metre", "metres", "meter", "meters"}


def crs_name(crs: CRS) -> str:
    """A short name: EPSG:25832, or the title of a system that has no number."""
    code = crs.to_epsg()
    return f"EPSG:{code}" if code else crs.to_dict(projjson=True).get("name", "unnamed")


def same_crs(a: CRS | None, b: CRS | None) -> bool:
    """Whether coordinates in plan mean the same; a system that is not known is like any other."""
    if a is None or b is None:
        return True
    a, b = _in_plan(a), _in_plan(b)
    return a == b or (a.to_epsg() is not None and a.to_epsg() == b.to_epsg())


def is_metre(unit: str | None) -> bool:
    """Whether a unit, as files spell it, is the metre; one that is missing is."""
    return (unit or "").strip().lower() in _METRES


def check_metres(grid: Grid, path: str, warp: Callable[[str, str], str] | None = None) -> None:
    """Refuse any unit but the metre; `warp(word, options)` gives the command that makes file_word.

    Heights have a unit where the system says what they refer to.
    """
    crs = grid.crs
    if crs is None:
        return
    if _is_geocentric(crs):
        raise RockfallError(
            f"{path}: coordinates are geocentric ({crs_name(crs)}), from the centre of the Earth: "
            "a projected CRS in metres is needed"
        )
    plan, heights = _units(crs.to_dict(projjson=True))
    if plan == heights == "metre":
        return
    if plan == "metre":
        raise RockfallError(
            f"{path}: elevations are in {heights} ({crs_name(crs)}), metres are needed"
        )
    said = f"{path}: cells are in {plan} ({crs_name(crs)}), metres are needed"
    if (utm := _utm(grid)) is None:
        raise RockfallError(said)
    cure = f"reproject to {utm}"
    if warp is not None:
        cure = f"reproject with: {warp('utm', f'--dst-crs {utm} --resampling bilinear')}"
    raise RockfallError(f"{said}; {cure}")


def _units(about: dict[str, Any]) -> tuple[str, str]:
    """The units of a system in plan and of its heights, from its PROJJSON; metre where none is."""
    if "components" in about:  # one in plan, one of heights
        return _units(about["components"][0])[0], _units(about["components"][-1])[1]
    if "source_crs" in about:  # with a shift to another datum
        return _units(about["source_crs"])
    found = {"up": "metre", "": "metre"}
    for axis in about.get("coordinate_system", {}).get("axis", []):
        unit = axis.get("unit", "metre")
        if isinstance(unit, dict):
            is_one = unit["type"] == "LinearUnit" and abs(unit["conversion_factor"] - 1.0) <= 1e-9
            unit = "metre" if is_one else unit["name"]
        if unit != "metre":
            up = axis.get("direction") in ("up", "down")
            found["up" if up else ""] = "degrees" if unit == "degree" else unit
    return found[""], found["up"]


def _in_plan(crs: CRS) -> CRS:
    """The horizontal part of a system that also tells what heights refer to."""
    from rasterio.crs import CRS

    about = crs.to_dict(projjson=True)
    if about.get("type") != "CompoundCRS":
        return crs
    return CRS.from_user_input(json.dumps(about["components"][0]))


def _utm(grid: Grid) -> str | None:
    """The UTM zone in which the middle of a raster lies; None where the earth has no such place."""
    from rasterio._err import CPLE_BaseError  # what `transform` raises where there is no way
    from rasterio.warp import transform

    middle = (grid.west + grid.east) / 2, (grid.south + grid.north) / 2
    try:
        (longitude,), (latitude,) = transform(grid.crs, "EPSG:4326", *([c] for c in middle))
    except CPLE_BaseError:
        return None
    if not (abs(longitude) <= 360.0 and abs(latitude) <= 90.0):
        return None
    zone = int((longitude + 180.0) // 6.0) % 60 + 1
    return f"EPSG:{(32600 if latitude >= 0 else 32700) + zone}"


def _is_geocentric(crs: CRS) -> bool:
    """Whether its axes run from the centre of the Earth."""
    return crs.to_dict(projjson=True).get("type") == "GeodeticCRS" and not crs.is_geographic


def length_scale(grid: Grid) -> float:
    """How many metres of its coordinates a metre on the ground is, in the middle of a raster: the
    geometric mean of east and north; 1 where the CRS does not tell."""
    from rasterio._err import CPLE_BaseError  # what `transform` raises where there is no way
    from rasterio.warp import transform

    if grid.crs is None or not grid.crs.is_projected:
        return 1.0
    x, y = (grid.west + grid.east) / 2, (grid.south + grid.north) / 2
    if max(abs(x), abs(y)) > 1e8:  # no place on Earth; PROJ would turn round it for ever
        return 1.0
    step = 100.0  # [m]: long beside the rounding of degrees, short beside the Earth
    try:
        longitude, latitude = transform(grid.crs, "EPSG:4326", [x, x + step, x], [y, y, y + step])
    except CPLE_BaseError:
        return 1.0
    flat = 1 - 0.0066944 * math.sin(math.radians(latitude[0])) ** 2  # of the WGS 84 ellipsoid
    prime, meridian = 6378137.0 / flat**0.5, 6335439.3 / flat**1.5  # radii of curvature [m]
    ground = [
        math.hypot(
            math.radians(longitude[k] - longitude[0]) * prime * math.cos(math.radians(latitude[0])),
            math.radians(latitude[k] - latitude[0]) * meridian,
        )
        for k in (1, 2)
    ]
    if not (all(map(math.isfinite, ground)) and min(ground) > 0):
        return 1.0
    return step / math.sqrt(ground[0] * ground[1])
