# SPDX-License-Identifier: BSD-3-Clause
"""Observations at a site, and results published for it (docs/observed.md)."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.rasters.grid import Grid
from rockfall.io.tables import Row, check_columns, read_table
from rockfall.io.vectors.point_rows import is_point_layer, read_area, read_point_rows
from rockfall.result.variables import BLOCK_SHAPE

if TYPE_CHECKING:
    import pandas as pd

METHODS = ("observed", "A", "B")
_ENERGY = {"J": 1.0, "kJ": 1000.0}
UNITS = {  # quantity -> unit -> factor to SI units
    "speed": {"m/s": 1.0},
    "jump_height": {"m": 1.0},
    "passing_height": {"m": 1.0},
    "omega": {"rad/s": 1.0},
    "energy_translational": _ENERGY,
    "energy_rotational": _ENERGY,
    "energy_total": _ENERGY,
    "rotational_share": {"-": 1.0},
}
CONTACT = ("x", "y", "speed", "height", "dbh", "side", "hits")  # columns [m, m/s, cm, degree]
START = ("start_x", "start_y")  # columns of the release, if known [m]
SOURCE, VOLUME = "source", "volume"  # columns of a block's source polygon and volume [m3]
SHAPE = "block_shape"  # column of a block's shape
MAX_DBH = 500.0  # maximum tree diameter [cm]
#: Fraction columns and their divisors; the old name is last.
PASSING = {"fraction": 1.0, "percent": 100.0, "share": 1.0}


@dataclass(frozen=True)
class Observed:
    """Observations in SI units; None, NaN or empty where not given."""

    summaries: pd.DataFrame  # line, method, quantity, mean, std, max, n; NaN if not given
    samples: dict[tuple[str, str], np.ndarray]  # (line, quantity) -> values of boulders
    tests: pd.DataFrame  # line, method, quantity, p: published Kolmogorov-Smirnov tests
    stops: np.ndarray | None  # (n, 2): x, y [m] of blocks at rest
    distances: np.ndarray | None  # plan distances [m] from release to rest, sorted
    passing: pd.DataFrame | None  # distance [m], fraction of boulders that travel at least as far
    lines: dict[str, str]  # line name -> file and row of its first occurrence
    starts: np.ndarray | None = None  # (n, 2): x, y [m] of the release of each block
    contacts: pd.DataFrame | None = None  # impacts with columns CONTACT, NaN if unknown
    #: Other columns by kind of file.
    kept: dict[str, pd.DataFrame] = field(default_factory=dict)
    passing_n: float = np.nan  # number of boulders behind `passing`
    notes: tuple[str, ...] = ()  # notes shown with tables of the observations
    sources: tuple[str, ...] = ()  # source name of each block, "" if unknown; or empty
    volumes: np.ndarray | None = None  # volume of each block [m3], NaN if unknown
    shapes: np.ndarray | None = None  # shape of each block, from 1; 0 if unknown
    #: File rows of stops and contacts.
    where: dict[str, tuple[str, ...]] = field(default_factory=dict)
    area: Any = None  # polygons (shapely) searched for blocks at rest; None: everywhere


def read_observed(*given: str | Path | Observed, grid: Grid | None = None) -> Observed:
    """Read observations from CSV files, whose kind follows from the header. A single `Observed` is
    returned unchanged.

    With the terrain `grid`, layers can be read too: points, with attributes as columns, and
    polygons that outline the mapped area. A RockfallError gives file, line, column, value and
    allowed values.
    """
    import pandas as pd

    if len(given) == 1 and isinstance(given[0], Observed):
        return given[0]
    paths = cast("tuple[str | Path, ...]", given)
    real = [os.path.realpath(path) for path in paths]
    for path, real_path in zip(paths, real, strict=True):
        if real.count(real_path) > 1:
            raise RockfallError(f"{path}: is given twice")
    records: dict[str, list[dict]] = {kind.name: [] for kind in KINDS}
    kept: dict[str, list[dict]] = {kind.name: [] for kind in KINDS}
    notes: list[str] = []
    area = None
    for path in paths:
        if is_point_layer(path) and grid is not None:
            if (polygons := read_area(path, grid, [])) is not None:
                if area is not None:
                    raise RockfallError(
                        f"{path}: is a second layer of polygons: give one mapped area"
                    )
                area = polygons
                _refuse_beyond(str(path), area, grid)
                notes.append(f"{path}: is the area in which blocks at rest were mapped.")
                continue
        kind, rows = _read(str(path), grid, notes)
        for row in rows:
            records[kind.name].append({"where": row.where, **kind.record(row)})
            kept[kind.name].append(
                {name: item for name, item in row.cells.items() if name not in kind.columns}
            )
    named: dict[str, str] = {}
    values: dict[tuple[str, str], list[float]] = {}
    for name in "summaries", "samples", "tests":
        for record in records[name]:
            named.setdefault(record["line"], record["where"])
    for record in records["samples"]:
        values.setdefault((record["line"], record["quantity"]), []).append(record["value"])
    for name in "summaries", "tests":
        _refuse_twice(records[name], ("line", "method", "quantity"))
    _refuse_twice(records["passing"], ("distance",))
    _refuse_rise(records["passing"])

    def frame(kind: str, *columns: str) -> pd.DataFrame:
        return pd.DataFrame(records[kind], columns=columns)

    starts = frame("stops", "start_x", "start_y").to_numpy(float)
    if 0 < np.isnan(starts).any(axis=1).sum() < len(starts):
        where = records["stops"][int(np.isnan(starts).any(axis=1).argmax())]["where"]
        raise RockfallError(f"{where}: {', '.join(START)}: must be given in all rows or in none")
    counts = frame("passing", "n")["n"].dropna().unique()
    if counts.size > 1:
        raise RockfallError(f"{records['passing'][0]['where']}: n: must be equal in all rows")
    distances = frame("distances", "distance")["distance"].to_numpy(float)
    volumes = frame("stops", VOLUME)[VOLUME].to_numpy(float)
    shapes = np.array([BLOCK_SHAPE.get(stop.get(SHAPE, ""), 0) for stop in records["stops"]], int)
    passing = frame("passing", "distance", "fraction").sort_values("distance", ignore_index=True)
    return Observed(
        summaries=frame("summaries", "line", "method", "quantity", "mean", "std", "max", "n"),
        samples={key: np.array(values_) for key, values_ in values.items()},
        tests=frame("tests", "line", "method", "quantity", "p"),
        stops=frame("stops", "x", "y").to_numpy(float) if records["stops"] else None,
        distances=np.sort(distances) if records["distances"] else None,
        passing=passing if records["passing"] else None,
        lines=named,
        starts=starts if starts.size and not np.isnan(starts).any() else None,
        contacts=frame("contacts", *CONTACT) if records["contacts"] else None,
        kept={name: pd.DataFrame(rows) for name, rows in kept.items() if any(rows)},
        passing_n=float(counts[0]) if counts.size else np.nan,
        notes=tuple(notes),
        sources=tuple(stop.get(SOURCE, "") for stop in records["stops"]),
        volumes=volumes if volumes.size and not np.isnan(volumes).all() else None,
        shapes=shapes if shapes.any() else None,
        area=area,
        where={key: tuple(row["where"] for row in records[key]) for key in ("stops", "contacts")},
    )


def _quantity(row: Row) -> tuple[str, float, tuple[float, float]]:
    """Quantity, factor from its unit to SI units, and limits of its values."""
    quantity = row.choice("quantity", UNITS)
    limits = {"omega": (-inf, inf), "rotational_share": (0.0, 1.0)}.get(quantity, (0.0, inf))
    return quantity, UNITS[quantity][row.choice("unit", UNITS[quantity])], limits


def _summary(row: Row) -> dict:
    quantity, unit, limits = _quantity(row)
    mean, max_ = row.maybe("mean", *limits), row.maybe("max", *limits)
    std, n = row.maybe("std", 0.0), row.maybe("n", 1.0)
    if np.isnan([mean, std, max_]).all():
        row.refuse("mean", "a row needs mean, std or max")
    if max_ < mean:
        row.refuse("max", f"must be >= mean = {mean:g}")
    if n % 1 > 0:
        row.refuse("n", "must be an integer")
    method = row.choice("method", METHODS) if "method" in row.cells else "observed"
    attrs = {"line": row.text("line"), "method": method, "quantity": quantity}
    return {**attrs, "mean": unit * mean, "std": unit * std, "max": unit * max_, "n": n}


def _sample(row: Row) -> dict:
    quantity, unit, limits = _quantity(row)
    value = unit * row.number("value", *limits)
    return {"line": row.text("line"), "quantity": quantity, "value": value}


def _test(row: Row) -> dict:
    method, quantity = row.choice("method", METHODS[1:]), row.choice("quantity", UNITS)
    p = row.number("p", 0.0, 1.0)
    return {"line": row.text("line"), "method": method, "quantity": quantity, "p": p}


def _passing(row: Row) -> dict:
    column = next(name for name in PASSING if name in row.cells)
    fraction = row.number(column, 0.0, PASSING[column]) / PASSING[column]
    n = row.maybe("n", 1.0)
    if n % 1 > 0:
        row.refuse("n", "must be an integer")
    return {"distance": row.number("distance", 0.0), "fraction": fraction, "n": n}


def _stop(row: Row) -> dict:
    given = [name for name in START if row.cells.get(name)]
    if len(given) == 1:
        row.refuse(given[0], f"needs {' and '.join(START)} together")
    places = {name: row.maybe(name) for name in START}
    volume = row.maybe(VOLUME, 0.0)
    if volume == 0:
        row.refuse(VOLUME, "must be > 0 [m3], or empty")
    if (shape := row.cells.get(SHAPE, "")) and shape not in BLOCK_SHAPE:
        row.refuse(SHAPE, f"must be one of: {', '.join(BLOCK_SHAPE)}, or empty")
    attrs = {SOURCE: row.cells.get(SOURCE, ""), VOLUME: volume, SHAPE: shape}
    return {"x": row.number("x"), "y": row.number("y"), **places, **attrs}


def _contact(row: Row) -> dict:
    place = {name: row.number(name) for name in ("x", "y")}
    limits = {"dbh": (0.0, MAX_DBH), "side": (0.0, 360.0), "hits": (1.0, inf)}
    contact = {name: row.maybe(name, *limits.get(name, (0.0, inf))) for name in CONTACT[2:]}
    if contact["hits"] % 1 > 0:
        row.refuse("hits", "must be an integer")
    return place | contact


class _Kind(NamedTuple):
    """A kind of file: required and optional columns, and the function that reads a row."""

    name: str
    needed: tuple[str, ...]
    optional: tuple[str, ...]
    record: Callable[[Row], dict]

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns that are interpreted; other columns are kept unchanged."""
        return (*self.needed, *self.optional)


KINDS = (  # in this order: the first kind whose required columns are all in the header is read
    _Kind(
        "summaries", ("line", "quantity", "unit", "mean"), ("method", "std", "max", "n"), _summary
    ),
    _Kind("samples", ("line", "quantity", "unit", "value"), (), _sample),
    _Kind("tests", ("line", "method", "quantity", "p"), (), _test),
    _Kind("contacts", ("impact", "x", "y"), CONTACT[2:], _contact),
    *(_Kind("passing", ("distance", name), ("n",), _passing) for name in PASSING),
    _Kind("stops", ("x", "y"), (*START, SOURCE, VOLUME, SHAPE), _stop),
    _Kind("distances", ("distance",), (), lambda row: {"distance": row.number("distance", 0.0)}),
)


def _read(path: str, grid: Grid | None, notes: list[str]) -> tuple[_Kind, Iterator[Row]]:
    """Kind and rows of a table or layer; refuses layers without `grid`, and unknown kinds."""
    if is_point_layer(path):
        if grid is None:
            raise RockfallError(f"{path}: layers can only be read by compare, back and validate")
        where, columns, rows = read_point_rows(path, grid, notes)
    else:
        where, columns, rows = read_table(path)
    kind = next((kind for kind in KINDS if set(kind.needed) <= set(columns)), None)
    if kind is None:
        kinds = " | ".join(", ".join(kind.needed) for kind in KINDS)
        raise RockfallError(f"{where}: columns {', '.join(columns)}: must include one of: {kinds}")
    check_columns(where, columns, columns)
    return kind, rows


def _refuse_beyond(path: str, area: Any, grid: Grid) -> None:
    """Raise a RockfallError for a mapped area outside the terrain."""
    west, south, east, north = area.bounds
    if west > grid.east or east < grid.west or south > grid.north or north < grid.south:
        raise RockfallError(f"{path}: lies outside the terrain")


def _refuse_twice(records: list[dict], keys: tuple[str, ...]) -> None:
    first: dict[tuple, str] = {}
    for record in records:
        key = tuple(record[name] for name in keys)
        if key in first:
            identity = ", ".join(f"{name} {value}" for name, value in zip(keys, key, strict=True))
            raise RockfallError(f"{record['where']}: {identity}: duplicates {first[key]}")
        first[key] = record["where"]


def _refuse_rise(records: list[dict]) -> None:
    """Raise a RockfallError for fractions that increase with distance."""
    ordered = sorted(records, key=lambda record: record["distance"])
    for near, far in zip(ordered, ordered[1:], strict=False):
        if far["fraction"] > near["fraction"]:
            raise RockfallError(
                f"{far['where']}: fraction {far['fraction']:g} at distance {far['distance']:g}: "
                f"must be <= {near['fraction']:g}, the fraction at distance {near['distance']:g}"
            )
