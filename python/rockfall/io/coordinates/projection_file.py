# SPDX-License-Identifier: BSD-3-Clause
"""Projection files (.prj) next to grids and points.

GDAL reads the horizontal system in ESRI's dialects. It silently skips height units, a second
system on a separate line, and WKT 2.
"""

from __future__ import annotations

import math
import re
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING

from rockfall.errors import RockfallError
from rockfall.io.coordinates.length_units import METRE, Stated, Unit, unit_of
from rockfall.io.files import check_regular
from rockfall.io.gdal_files import companions

if TYPE_CHECKING:
    from rasterio.crs import CRS

_HEIGHTS = re.compile(r"^\s*zunits\s+(\S+)", re.IGNORECASE | re.MULTILINE)
_VERTICAL = re.compile(r"\b(?:VERTCS|VERT_CS|VERTCRS|VERTICALCRS)\[", re.IGNORECASE)
_MAX_SIZE = 100_000  # bytes


def _projection_file(path: str | Path) -> Path | None:
    path = Path(path)
    names = (f"{path.stem}.prj".lower(), f"{path.name}.prj".lower())
    return next((file for file in companions(path) if file.name.lower() in names), None)


def _text(file: Path) -> str:
    check_regular(file)
    with open(file, "rb") as content:
        return content.read(_MAX_SIZE).decode("utf-8-sig", "replace")


def projection_crs(path: str | Path) -> CRS | None:
    """CRS in the projection file of a grid, for grids whose CRS GDAL could not read; None without a
    file or if it is empty. Refuses a file without a readable CRS."""
    from rasterio.crs import CRS
    from rasterio.errors import CRSError

    if (file := _projection_file(path)) is None or not (text := _text(file).strip()):
        return None
    try:
        return CRS.from_user_input(text)
    except CRSError as error:
        raise RockfallError(f"{file}: contains no readable CRS: correct or remove it") from error


def projection_heights(path: str | Path) -> list[Stated]:
    """Height units in the projection file of a grid or of points."""
    if (file := _projection_file(path)) is None:
        return []
    text = _text(file)
    units = [_unit_of_heights(word) for word in _HEIGHTS.findall(text)]
    return [Stated(unit, file.name) for unit in (*units, *vertical_units(text)) if unit]


def vertical_units(text: str) -> list[Unit]:
    """Units of the vertical systems in consecutive well-known texts."""
    return [_vertical_unit(text[match.start() :]) for match in _VERTICAL.finditer(text)]


def _unit_of_heights(word: str) -> Unit | None:
    """Unit on a `Zunits` line: a name, NO, or the number of units per metre."""
    if word.upper() in ("NO", "NONE"):
        return None
    try:
        return Unit(f"1/{word} m", 1.0 / float(word)) if float(word) != 1.0 else METRE
    except (ValueError, ZeroDivisionError):
        return unit_of(word)


def _vertical_unit(text: str) -> Unit:
    """Unit of the vertical system at the start of a text."""
    import pyproj

    depths = accumulate((letter == "[") - (letter == "]") for letter in text)
    ends = (at for at, depth in enumerate(depths) if text[at] == "]" and not depth)
    try:
        (axis,) = pyproj.CRS.from_wkt(text[: next(ends, 0) + 1]).axis_info
    except (pyproj.exceptions.CRSError, ValueError):
        return Unit("an unknown unit", math.nan)
    return Unit(axis.unit_name, axis.unit_conversion_factor)
