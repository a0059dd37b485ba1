# SPDX-License-Identifier: BSD-3-Clause
"""Length units as files give them: as a unit, in words, or as an EPSG code."""

import math
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from rockfall.errors import RockfallError


class Unit(NamedTuple):
    """A unit of length."""

    name: str
    factor: float  # [m]; NaN if unknown

    @property
    def is_metre(self) -> bool:
        return abs(self.factor - 1.0) <= 1e-9


class Stated(NamedTuple):
    """Unit of elevations, and the part of a file that states it."""

    unit: Unit
    where: str


METRE = Unit("metre", 1.0)
_METRE_CODE = 9001
_METRES = {"", "m", "metre", "metres", "meter", "meters"}
#: Units: words that count anywhere, and symbols that count only in brackets or after "in".
_WORDS = (
    (
        Unit("US survey foot", 1200 / 3937),
        r"(?:us|u\.s\.)[\s_-]*(?:survey[\s_-]*)?(?:feet|foot|ft)|survey[\s_-]*(?:feet|foot|ft)"
        r"|s?ft[\s_-]?us|feet[\s_-]us|foot[\s_-]us",
        "usft",
    ),
    (Unit("foot", 0.3048), "feet|ft|pieds|piedi|piedes", "foot|fu(?:ss|ß)"),
    (Unit("yard", 0.9144), "yards", "yard|yd"),
    (Unit("fathom", 1.8288), "fathoms", "fathom"),
    (Unit("inch", 0.0254), "inches", "inch|zoll"),
    (Unit("millimetre", 0.001), "millimet(?:re|er)s", "mm|millimet(?:re|er)"),
    (Unit("centimetre", 0.01), "(?:c|z)entimet(?:re|er)s", "cm|(?:c|z)entim[eè]t(?:re|er)"),
    (Unit("decimetre", 0.1), "decimet(?:re|er)s", "dm|d[eé]zim[eè]ter|d[eé]cim[eè]t(?:re|er)"),
    (Unit("kilometre", 1000.0), "kilometers|kilometres", "km|kilom[eè]t(?:re|er)"),
)
_ENDS = r"(?<![a-zß\d])(?:{})(?![a-zß\d])"
_METRE_WORDS = re.compile(
    r"(?<![a-z])(?:m[eè]t(?:re|er)s?|metri)(?![a-z])|[(\[/]\s*m\s*[)\]]|(?<![a-z])in m(?![a-z])"
)
_NUMBER = re.compile(r"(?<![a-z\d])[\d.]+[\s_-]*$")
_HORIZONTAL = re.compile(r"horizontal|planar|plan_|resolution|^x|_xy?_|cell")
_PROSE = re.compile(r"long_?name|description|title|comment|abstract|summary")


def is_metre(unit: str | None) -> bool:
    """Return True if a unit, as spelled in files, is the metre or is missing."""
    return (unit or "").strip().lower() in _METRES


def unit_of(text: str) -> Unit:
    """Unit for a spelling; its factor is NaN if the spelling is unknown."""
    spelled = text.strip().lower()
    if is_metre(spelled):
        return METRE
    for unit, words, symbols in _WORDS:
        if re.fullmatch(f"{words}|{symbols}", spelled):
            return unit
    return Unit(text.strip(), math.nan)


def unit_in_words(text: str) -> Unit | None:
    """Elevation unit in a sentence; None without one, or if metres occur too. A unit after a number
    is ignored, because it is that of a size, such as a cell size."""
    spelled = text.lower()
    if _METRE_WORDS.search(spelled):
        return None
    for unit, words, symbols in _WORDS:
        either = f"{words}|{symbols}"
        for match in re.finditer(_ENDS.format(words), spelled):
            if not _NUMBER.search(spelled[: match.start()]):
                return unit
        if re.search(
            rf"[(\[]\s*(?:{either})\s*[)\]]|(?<![a-z])in\s+(?:{either})(?![a-z])", spelled
        ):
            return unit
    return None


def unit_of_code(code: int) -> Unit | None:
    """Linear unit of an EPSG code; None if there is none."""
    if code == _METRE_CODE:
        return METRE
    from pyproj.database import get_units_map

    for unit in get_units_map(auth_name="EPSG", category="linear").values():
        if unit.code == str(code):
            return Unit(unit.name, unit.conv_factor)
    return None


def stated_in_attributes(attributes: Mapping[str, Any]) -> list[Stated]:
    """Elevation units in a unit attribute, except those of cell sizes, or in a description."""
    stated = []
    for key, value in attributes.items():
        name = key.lower()
        if not isinstance(value, str) or not value.strip() or _HORIZONTAL.search(name):
            continue
        unit = unit_of(value)
        if "unit" in name and unit.is_metre:
            stated.append(Stated(METRE, key))
        elif not unit.is_metre and (name == "units" or not math.isnan(unit.factor)):
            stated.append(Stated(unit, key))
        elif _PROSE.search(name) and (in_words := unit_in_words(value)):
            stated.append(Stated(in_words, key))
    return stated


def contradiction(stated: Iterable[Stated]) -> tuple[Stated, Stated] | None:
    """First two unit statements that contradict each other, or None. International and US feet
    count as equal."""
    first, *others = [*stated, None]
    for other in others:
        if first and other and not math.isclose(first.unit.factor, other.unit.factor, rel_tol=1e-5):
            return first, other
    return None


def refuse_units(path: str | Path, stated: Iterable[Stated], command: Callable[[str], str]) -> None:
    """Refuse point heights in units other than the metre; `command` returns the conversion command
    for a factor."""
    for unit, where in stated:
        if not unit.is_metre:
            is_known = math.isfinite(unit.factor)
            cure = f": convert with: {command(f'{unit.factor:.16g}')}" if is_known else ""
            raise RockfallError(
                f"{path}: z is in {unit.name} ({where}), but must be in metres{cure}"
            )
