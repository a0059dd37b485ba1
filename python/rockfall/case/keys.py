# SPDX-License-Identifier: BSD-3-Clause
"""The kernel's table of case keys."""

from collections.abc import Mapping, Sequence
from functools import cache
from math import isnan
from typing import Any, NamedTuple

from rockfall._core import rockfall_f2py as _core
from rockfall.case.text import read_values

REPEATABLE = tuple(_core.fields("repeatable_group").decode().split())  # groups in the form of lists


FOREST = "trees", "polygons", "stems", "uniform_stems"
#: Keys that are only valid with at least one of some other keys and are removed with the last of
#: these. None: all other keys of the group.
ONLY_WITH: dict[str, list[tuple[tuple[str, ...], tuple[str, ...] | None]]] = {
    "surface": [(("zones",), ("zones_layer", "zone_field", "table", "default_zone"))],
    "release": [
        (("points",), ("points_layer",)),
        (("polygons",), ("polygons_layer",)),
        (("points", "polygons"), ("name_field",)),
    ],
    "forest": [
        (("trees",), ("trees_layer", "dbh_field", "species_field")),
        (("polygons",), ("polygons_layer",)),
        (("clearings",), ("clearings_layer",)),
        (FOREST, None),
    ],
    "output": [(("maps",), ("map_extent", "min_passages"))],
}
OF_MAPS = {
    "thresholds": "exceeded",
    "object_width": "hits",
}  # key of &hazard -> word in its maps


class Key(NamedTuple):
    """Row of the key table; `default` is text as in a case file, "required" or "absent"."""

    group: str
    name: str
    kind: str
    most: int
    default: str
    allowed: str
    unit: str
    meaning: str
    file: str = ""  # file type: raster, layer, raster layer (either), table, sets
    low: float | None = None  # range of allowed numbers
    high: float | None = None

    @property
    def is_varied(self) -> bool:
        """Return True for a key of &variant that replaces a key in another group."""
        return self.group == "variant" and varied_key(self.name) is not None


@cache
def key_table() -> tuple[Key, ...]:
    """All case keys, in order."""
    rows: list[Key] = []
    while text := _core.table_row("keys", len(rows) + 1).decode().strip():
        group, name, kind, most, default, allowed, unit, meaning, file = text.split("|")
        limits = _core.key_limits(len(rows) + 1).tolist()
        low, high = (None if isnan(end) else end for end in limits)
        rows.append(
            Key(group, name, kind, int(most), default, allowed, unit, meaning, file, low, high)
        )
    return tuple(rows)


@cache
def keys_of(group: str) -> dict[str, Key]:
    """Keys of a group by name, in order."""
    return {key.name: key for key in key_table() if key.group == group}


def gone_with(group: str, before: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, None]:
    """Keys of a group that become invalid because another key is removed (None), unless they are
    changed too."""
    after = {**before, **changes}
    gone: dict[str, None] = {}
    for owners, keys in ONLY_WITH.get(group, ()):
        is_removed = any(owner in changes for owner in owners)
        if is_removed and all(after.get(owner) is None for owner in owners):
            idle = keys_of(group).keys() - {*owners} if keys is None else keys
            gone |= dict.fromkeys(key for key in idle if key not in changes)
    return gone


def idle_of_hazard(scenarios: Sequence[Any], maps: Sequence[str]) -> dict[str, None]:
    """Keys of &hazard that neither scenarios nor maps use."""
    used = [key for key, part in OF_MAPS.items() if any(part in name for name in maps)]
    return {} if scenarios else dict.fromkeys(keys_of("hazard").keys() - {*used})


@cache
def varied_key(name: str) -> tuple[str, str] | None:
    """Group and key that a key of &variant replaces; None if it replaces none."""
    group, _, key = name.partition("_")
    keys = {(row.group, row.name) for row in key_table()}
    return (group, key) if (group, key) in keys else None


def broken_rule(group: str, name: str, number: float) -> str:
    """Rule of a key that a number violates; "" if the number is allowed."""
    return _core.check_numbers(group, name, [number])[1].decode().strip()


def file_keys() -> list[Key]:
    """The keys that name files."""
    return [key for key in key_table() if key.file]


@cache
def default_values() -> dict[str, dict[str, Any]]:
    """Default values by group; the caller must not change them."""
    return {group.name: group.usual for group in read_values(b"", "", "defaults").groups}
