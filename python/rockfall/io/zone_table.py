# SPDX-License-Identifier: BSD-3-Clause
"""Table of surface zones, and the table row of each cell."""

import math
import re
from collections.abc import Iterable, Mapping
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.rasters.grid import NO_ID
from rockfall.io.tables import Row, check_columns, check_needed, read_table
from rockfall.io.vectors.layers import attribute, plain
from rockfall.io.vectors.unused_attributes import note_marks, note_unused

#: Length columns [m], in the order of the values in a row.
RADII = ("mean_radius", "rg70", "rg20", "rg10")
#: Columns for a zone's strength [Pa] and relief [degree].
PAIR = ("ground_strength", "ground_relief")
MATERIAL = (*RADII, "ground", *PAIR)  # a zone table needs at least one of these columns
NAMES = ("name", "description")  # free-text columns used as zone names

_INTEGER = re.compile(r"[+-]?[0-9]+")


class NamedGround(NamedTuple):
    """Name of a ground, and a strength [Pa] and relief [degree] that replace its own."""

    name: str
    pair: Mapping[str, float] = MappingProxyType({})  # keys: columns of a ground table

    def __str__(self) -> str:
        units = {"strength": "Pa", "relief": "degrees"}
        own = [f"{repr(value).removesuffix('.0')} {units[key]}" for key, value in self.pair.items()]
        return self.name + (f" ({', '.join(own)})" if own else "")


class Zone(NamedTuple):
    """A row of a zone table."""

    sizes: tuple[float, ...]  # [m] in the order of RADII; NaN: not given, inf: absorbs
    ground: str = ""  # ground for rebounds; "": as in the case
    strength: float = math.nan  # strength of the ground [Pa]; NaN: not given
    relief: float = math.nan  # relief of the ground [degree]; NaN: not given
    where: str = ""  # position of the row, used in messages
    name: str = ""  # name; "": not given

    @property
    def pair(self) -> dict[str, float]:
        """Strength and relief of the zone, if given, by column name of a ground table."""
        given = {"strength": self.strength, "relief": self.relief}
        return {name: value for name, value in given.items() if not math.isnan(value)}

    @property
    def names_ground(self) -> bool:
        """Return True if the zone gives a ground, a strength or a relief."""
        return bool(self.ground or self.pair)

    def ground_in(self, usual: NamedGround) -> NamedGround:
        """Ground of the zone; `usual` is the case's ground.

        >>> usual = NamedGround("talus", {"strength": 2e5, "relief": 12.5})
        >>> str(Zone((), "", 3e5).ground_in(usual))
        'talus (300000 Pa, 12.5 degrees)'
        """
        if self.ground:
            return NamedGround(self.ground, self.pair)
        return NamedGround(usual.name, {**usual.pair, **self.pair})


def read_zone_table(path: str | Path, remarks: list[str] | None = None) -> dict[int, Zone]:
    """Read the zones by id, in the order of the file. Raises a RockfallError for repeated zones and
    missing columns.

    Cells are separated by commas or semicolons; unknown columns are ignored and mentioned in
    `remarks`. An empty cell gives no size. A zone with its own ground may have zero sizes (no
    rocks). A strength or relief replaces that of the ground.
    """
    where, columns, rows = read_table(path)
    names = ("zone", *MATERIAL)
    check_needed(where, columns, names[:1])
    if set(names[1:]).isdisjoint(columns):
        raise RockfallError(f"{where}: must have at least one of the columns {', '.join(RADII)}")
    check_columns(where, [name for name in columns if name in names], names)
    if remarks is not None:
        note_unused(remarks, path, columns, (*names, *NAMES))
    zones: dict[int, Zone] = {}
    for row in rows:
        zone = _zone(row)
        if zone in zones:
            raise RockfallError(f"{row.where}: zone {zone}: occurs twice in the table")
        zones[zone] = _made(row)
    if remarks is not None:
        _note_marks(remarks, path, zones)
    return zones


def _note_marks(remarks: list[str], path: str | Path, zones: dict[int, Zone]) -> None:
    names = (*RADII, *PAIR)
    numbers = np.array([(*zone.sizes, zone.strength, zone.relief) for zone in zones.values()])
    note_marks(remarks, path, dict(zip(names, numbers.T, strict=True)), names)


def zones_of_polygons(
    columns: dict[str, np.ndarray], path: str, field: str, remarks: list[str] | None = None
) -> tuple[np.ndarray, dict[int, Zone], bool]:
    """Zone id of each polygon (int32), zones by id, and True if the ids are from the layer. Polygon
    attributes mean the same as columns of a zone table; a RockfallError if they are missing.

    The zone id is the integer attribute `field` if polygons with the same id have equal attributes.
    Otherwise, polygons with equal attributes form a zone, numbered in file order from 1.
    """
    texts_of = {name: attribute(columns, name) for name in (*MATERIAL, *NAMES)}
    given = {
        name: [_text(text) for text in data] for name, data in texts_of.items() if data is not None
    }
    if not {*MATERIAL} & given.keys():
        raise RockfallError(
            f"{path}: attributes are missing: give polygons {', '.join(RADII)} or ground, or give "
            "a &surface table"
        )
    if remarks is not None:
        note_unused(remarks, path, columns, (*MATERIAL, *NAMES, field))
    size = len(next(iter(given.values())))
    rows = [
        Row(f"{path}: feature {k + 1}", {name: texts[k] for name, texts in given.items()})
        for k in range(size)
    ]
    kinds = [tuple(row.cells.values()) for row in rows]
    number = {kind: k for k, kind in enumerate(dict.fromkeys(kinds), start=1)}
    own = _own_ids(attribute(columns, field), kinds)
    ids = own or [number[kind] for kind in kinds]
    zones: dict[int, Zone] = {}
    for zone_id, row in zip(ids, rows, strict=True):
        if zone_id not in zones:
            zones[zone_id] = _made(row)
    if remarks is not None:
        _note_marks(remarks, path, zones)
    return np.array(ids, np.int32), zones, own is not None


def _own_ids(values: np.ndarray | None, kinds: list[tuple[str, ...]]) -> list[int] | None:
    """Ids of the polygons; None without 32-bit integers, or if polygons with different attributes
    share an id."""
    if values is None or values.dtype.kind not in "iu":
        return None
    ids = [int(value) for value in values]
    fits = max(map(abs, ids)) <= np.iinfo(np.int32).max
    return ids if fits and len({*zip(ids, kinds, strict=True)}) == len({*ids}) else None


def _text(value: Any) -> str:
    """Attribute as text of a cell; "" if empty."""
    value = plain(value)
    return "" if value is None else str(value).strip()


def _made(row: Row) -> Zone:
    sizes = tuple(_radius(row, name) if row.cells.get(name) else math.nan for name in RADII)
    name = next((row.cells[key] for key in NAMES if row.cells.get(key)), "")
    strength, relief = map(row.maybe, PAIR)
    return Zone(sizes, row.cells.get("ground", ""), strength, relief, row.where, name)


def index_blocks(
    blocks: Iterable[tuple[slice, np.ndarray]],
    shape: tuple[int, int],
    table_ids: list[int],
    default_zone: int | None = None,
    valid: np.ndarray | None = None,
    path: str = "zones",
    table: str = "table",
    what: str = "zone",
) -> np.ndarray:
    """Table row (int8 or int16, from 1) of each cell; 0 where the terrain is not valid. Raises a
    RockfallError for ids without a row.

    `blocks` are rows of zone ids; cells with `NO_ID` belong to `default_zone`. `valid` is a mask,
    or elevations (NaN: not valid). `path`, `table` and `what` (the term for an id) are used in
    messages.
    """
    if len(table_ids) > np.iinfo(np.int16).max:
        raise RockfallError(
            f"{table}: {len(table_ids)} zones: must be at most {np.iinfo(np.int16).max}"
        )
    if default_zone is not None and default_zone not in table_ids:
        raise RockfallError(f"&surface default_zone = {default_zone}: has no row in {table}")
    order = np.argsort(table_ids)
    dtype = np.int8 if len(table_ids) <= np.iinfo(np.int8).max else np.int16
    ids, row_of = np.asarray(table_ids, np.int64)[order], (order + 1).astype(dtype)
    index = np.empty(shape, dtype)
    unknown: dict[int, int] = {}
    for rows, block in blocks:
        if default_zone is not None:
            block = np.where(block == NO_ID, default_zone, block)
        place = np.searchsorted(ids, block).clip(max=ids.size - 1)
        matches = ids[place] == block
        index[rows] = np.where(matches, row_of[place], 0)
        if valid is not None:
            inside = _is_valid(valid[rows])
            index[rows][~inside] = 0
            matches |= ~inside
        for zone, cells in zip(*np.unique(block[~matches], return_counts=True), strict=True):
            unknown[int(zone)] = unknown.get(int(zone), 0) + int(cells)
    if unknown:
        raise RockfallError(_without_row(unknown, path, table, what))
    return index


def _zone(row: Row) -> int:
    text = row.cells["zone"]
    if not _INTEGER.fullmatch(text):
        row.refuse("zone", "must be an integer")
    if abs(int(text)) > np.iinfo(np.int32).max:
        row.refuse("zone", "must fit in 32 bits")
    return int(text)


def _radius(row: Row, name: str) -> float:
    text, may_have_none = row.cells[name], any(map(row.cells.get, ("ground", *PAIR)))
    spelled = text.lower().lstrip("+-") in ("inf", "infinity", "nan")
    value = float(text) if spelled else row.number(name)
    if not value > 0 and not (may_have_none and value == 0):
        row.refuse(name, "must be > 0 (Inf absorbs)")
    return value


def _is_valid(block: np.ndarray) -> np.ndarray:
    return block if block.dtype == bool else ~np.isnan(block)


def _without_row(unknown: dict[int, int], path: str, table: str, what: str) -> str:
    """Message about cells whose zone is missing or not in the table."""
    if NO_ID in unknown:
        return (
            f"{path}: {unknown[NO_ID]} cells of the terrain have no zone: "
            "give them one, or set &surface default_zone"
        )
    zones = [f"{what} {zone} ({unknown[zone]} cells)" for zone in islice(sorted(unknown), 10)]
    if len(unknown) > len(zones):
        zones.append(f"{len(unknown) - len(zones)} more")
    verb = "has" if len(unknown) == 1 else "have"
    return f"{path}: {', '.join(zones)} {verb} no row in {table}"
