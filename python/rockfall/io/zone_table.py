# SPDX-License-Identifier: BSD-3-Clause
"""Zones of surface material: their table, and the row of it that each cell has."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from itertools import islice
from pathlib import Path

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.grid import NO_ID
from rockfall.io.tables import decimal, table_rows

#: Columns of lengths in metres, in the order of the values in a row.
RADII = ("mean_radius", "rg70", "rg20", "rg10")

_INTEGER = re.compile(r"[+-]?[0-9]+")


def read_zone_table(path: str | Path) -> dict[int, tuple[float, float, float, float]]:
    """Zone id -> (mean_radius, rg70, rg20, rg10) [m], in the order of the file.

    NaN where a column is absent, Inf where a zone absorbs. Commas or semicolons separate; other
    columns are free text.
    """
    path = str(path)
    zones: dict[int, tuple[float, float, float, float]] = {}
    rows = table_rows(path)
    _, header = next(rows, (1, []))
    columns = _columns(path, header)
    for line, row in rows:
        where = f"{path}: line {line}"
        if len(row) != len(header):
            raise RockfallError(f"{where}: {len(row)} columns, the header has {len(header)}")
        zone = _zone(where, row[columns["zone"]])
        if zone in zones:
            raise RockfallError(f"{where}: zone {zone}: is in the table twice")
        zones[zone] = tuple(
            _radius(where, name, row[columns[name]]) if name in columns else float("nan")
            for name in RADII
        )
    if not zones:
        raise RockfallError(f"{path}: no zones below the header")
    return zones


def index_blocks(
    blocks: Iterable[tuple[slice, np.ndarray]],
    shape: tuple[int, int],
    table_ids: list[int],
    default_zone: int | None = None,
    valid: np.ndarray | None = None,
    path: str = "zones",
    table: str = "table",
) -> np.ndarray:
    """The row of the table (int8 or int16, counted from 1) of each cell; 0 where the terrain is not
    valid.

    `blocks` are zone ids by rows, `NO_ID` in cells without a zone, which take `default_zone`.
    `valid` is a mask, or the elevations themselves (NaN = not valid). `path` and `table` are names
    for messages.
    """
    if len(table_ids) > np.iinfo(np.int16).max:
        raise RockfallError(f"{table}: {len(table_ids)} zones: at most {np.iinfo(np.int16).max}")
    if default_zone is not None and default_zone not in table_ids:
        raise RockfallError(f"&surface default_zone = {default_zone}: has no row in {table}")
    order = np.argsort(table_ids)
    dtype = np.int8 if len(table_ids) <= np.iinfo(np.int8).max else np.int16
    known, row_of = np.asarray(table_ids, np.int64)[order], (order + 1).astype(dtype)
    index = np.empty(shape, dtype)
    unknown: dict[int, int] = {}
    for rows, block in blocks:
        if default_zone is not None:
            block = np.where(block == NO_ID, default_zone, block)
        place = np.searchsorted(known, block).clip(max=known.size - 1)
        found = known[place] == block
        index[rows] = np.where(found, row_of[place], 0)
        if valid is not None:
            inside = _is_valid(valid[rows])
            index[rows][~inside] = 0
            found |= ~inside
        for zone, cells in zip(*np.unique(block[~found], return_counts=True), strict=True):
            unknown[int(zone)] = unknown.get(int(zone), 0) + int(cells)
    if unknown:
        raise RockfallError(_without_row(unknown, path, table))
    return index


def _columns(path: str, header: list[str]) -> dict[str, int]:
    """Where the columns that we use are."""
    if not header:
        raise RockfallError(f"{path}: is empty")
    names = [name.lower() for name in header]
    for name in ("zone", *RADII):
        if names.count(name) > 1:
            raise RockfallError(f"{path}: line 1: column {name}: is there twice")
    if "zone" not in names:
        raise RockfallError(f"{path}: line 1: no column zone; has: {', '.join(header)}")
    columns = {name: names.index(name) for name in ("zone", *RADII) if name in names}
    if len(columns) == 1:
        raise RockfallError(f"{path}: line 1: none of the columns {', '.join(RADII)}")
    return columns


def _zone(where: str, text: str) -> int:
    if not _INTEGER.fullmatch(text):
        raise RockfallError(f"{where}: zone = {text}: must be an integer")
    if abs(int(text)) > np.iinfo(np.int32).max:
        raise RockfallError(f"{where}: zone = {text}: must fit in 32 bits")
    return int(text)


def _radius(where: str, name: str, text: str) -> float:
    spelled = text.lower().lstrip("+-") in ("inf", "infinity", "nan")
    value = float(text) if spelled else decimal(text)
    if math.isnan(value) and not spelled:
        raise RockfallError(f"{where}: {name} = {text}: must be a number")
    if not value > 0:
        raise RockfallError(f"{where}: {name} = {text}: must be > 0 (Inf absorbs)")
    return value


def _is_valid(block: np.ndarray) -> np.ndarray:
    return block if block.dtype == bool else ~np.isnan(block)


def _without_row(unknown: dict[int, int], path: str, table: str) -> str:
    """What to say of cells whose zone is not in the table, or that have none."""
    if NO_ID in unknown:
        return (
            f"{path}: {unknown[NO_ID]} cells of the terrain have no zone; "
            "give them one, or set &surface default_zone"
        )
    zones = [f"zone {zone} ({unknown[zone]} cells)" for zone in islice(sorted(unknown), 10)]
    if len(unknown) > len(zones):
        zones.append(f"{len(unknown) - len(zones)} more")
    verb = "has" if len(unknown) == 1 else "have"
    return f"{path}: {', '.join(zones)} {verb} no row in {table}"
