# SPDX-License-Identifier: BSD-3-Clause
"""GeoTIFF keys in TIFF and LAS files that define the height unit.

GDAL ignores the unit key unless the system is user-defined, and laspy ignores both.
"""

import math
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

from rockfall.errors import RockfallError
from rockfall.io.coordinates.length_units import Stated, Unit, unit_in_words, unit_of_code

DIRECTORY, TEXTS = 34735, 34737  # ids of TIFF tags, and of LAS records
_PROJECTED, _PLAN_UNIT = 3072, 3076
_SYSTEM, _CITATION, _UNIT = 4096, 4097, 4099
_EPSG = range(1024, 32767)


class Key(NamedTuple):
    """Entry of the key directory."""

    id: int
    location: int
    length: int
    value: int


def keys_of(directory: Sequence[int]) -> list[Key]:
    """Entries of a key directory, whose first four numbers are its header."""
    return [Key(*directory[at : at + 4]) for at in range(4, len(directory) - 3, 4)]


def stated_heights(keys: Sequence[Key], texts: str) -> list[Stated]:
    """Height units from the keys for the vertical system, its citation, and its unit."""
    stated = []
    for key in keys:
        unit = None
        if key.id == _SYSTEM and key.value in _EPSG:
            unit = _axis_unit(key.value, ("up", "down"))
        elif key.id == _CITATION and key.location == TEXTS:
            unit = unit_in_words(texts[key.value : key.value + key.length])
        elif key.id == _UNIT and key.value and not key.location:
            unit = unit_of_code(key.value) or Unit(f"unit {key.value}", math.nan)
        if unit:
            stated.append(Stated(unit, f"GeoKey {key.id}"))
    return stated


def check_plan(path: str, keys: Sequence[Key]) -> None:
    """Refuse a plan unit that differs from the unit of the projected system."""
    values = {key.id: key.value for key in keys if not key.location}
    system, code = values.get(_PROJECTED, 0), values.get(_PLAN_UNIT)
    if system not in _EPSG or code is None:
        return
    own, stated = _axis_unit(system, ("east", "north", "west", "south")), unit_of_code(code)
    if own and stated and abs(own.factor - stated.factor) > 1e-9:
        raise RockfallError(
            f"{path}: EPSG:{system} is in {own.name}, GeoKey {_PLAN_UNIT} gives {stated.name}: "
            "correct one of them"
        )


@cache
def _axis_unit(code: int, directions: tuple[str, ...]) -> Unit | None:
    """Unit of the first axis of a system with one of these directions; None for an unknown code, or
    without such an axis."""
    import pyproj

    try:
        axes = pyproj.CRS.from_epsg(code).axis_info
    except pyproj.exceptions.CRSError:
        return None
    units = (Unit(axis.unit_name, axis.unit_conversion_factor) for axis in axes
             if axis.direction in directions)  # fmt: skip
    return next(units, None)
