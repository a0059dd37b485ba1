# SPDX-License-Identifier: BSD-3-Clause
"""Grounds: rebound models that replace the impact sets of a case, and tables that define grounds
(docs/grounds.md). The kernel defines the parameters of each model and their ranges.
"""

import importlib.resources
import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case, facts, in_kernel
from rockfall.errors import RockfallError, check_kernel
from rockfall.grounds.impact_sets import find_set, shipped_sets
from rockfall.grounds.impact_tables import (
    BLOCK_SHAPES,
    ImpactTable,
    YieldingGround,
    open_table,
    own_table,
    plane_table,
    possible_shapes,
    tables_of_all_shapes,
)
from rockfall.io.files import check_text_file
from rockfall.io.tables import Row, check_columns, check_needed, read_table
from rockfall.io.zone_table import PAIR, NamedGround, Zone
from rockfall.kernel_rules import kernel_numbers
from rockfall.limits import MAX_NAME

IMPACT_SETS = "impact_sets"  # model of a ground that is not in the ground table
BLOCK_TABLE = "impact_table"  # model with impact tables of blocks on yielding ground
RATIO_TABLE = "ratio_table"  # model with impact tables by R_b/R_m
TABLES = BLOCK_TABLE, RATIO_TABLE  # models that use impact tables
YIELDING = "ploughed", "hard"  # models with a plane of tables (see Plane)
ENSEMBLE = "-ensemble"  # suffix for names of ensembles
ANY_RADIUS = 0.02, 20.0  # range of R_b [m] if volumes are not known in advance
ABSORBS = "absorbs"  # model of a ground without rebounds
MAX_GROUNDS = int(_core.constant("max_grounds"))  # maximum grounds in a scene
WORDS = ("name", "id", "model", "meaning", "source")  # text columns
#: Changes of &surface that remove the case's ground.
NO_GROUND: Mapping[str, None] = MappingProxyType(dict.fromkeys(("ground", *PAIR)))


class Plane(NamedTuple):
    """Ground and boulder sizes that select parts of a plane, which is a set of impact tables over
    boulder size and ground relief."""

    model: str  # one of YIELDING
    ground: YieldingGround
    radii: tuple[float, float]  # usual range of R_b [m]
    weight: float  # unit weight of boulders, rho_b g [N/m3]


class GroundRule(NamedTuple):
    """A ground in the form that the kernel reads."""

    name: str
    model: str = IMPACT_SETS
    text: bytes = b""  # content of an impact set file, or a row of parameters
    file: str = ""  # source of the content, used in messages
    rest_angle: float | None = None  # [degree]; None if not given, as for rocky ground
    block_radius: float = math.nan  # R_b [m] of the largest blocks in its table; NaN: no table
    plane: Plane | None = None  # plane with its table
    table: ImpactTable | None = None

    @property
    def has_case_sets(self) -> bool:
        """Return True if the ground uses the case's impact sets."""
        return not self.text and self.table is None

    @property
    def rocks(self) -> int:
        """Rock data that the ground requires: 0 none, 1 a size, 2 a size above zero."""
        return models()[self.model]


class Parameter(NamedTuple):
    """Description of a parameter (column of a ground table), from the kernel."""

    name: str
    default: str
    allowed: str
    unit: str
    meaning: str
    models: str

    @property
    def limits(self) -> tuple[float, float]:
        low, _, high = self.allowed.partition(" to ")
        return float(low), float(high)


@cache
def models() -> dict[str, int]:
    """Models of grounds, with the rock data that each requires, as in `GroundRule.rocks`."""
    rows: dict[str, int] = {}
    while text := _core.table_row("ground_models", len(rows) + 1).decode().strip():
        name, rocks = text.split("|")
        rows[name] = int(rocks)
    return rows


@cache
def _columns() -> tuple[Parameter, ...]:
    """The kernel's parameter table; the model comes first."""
    rows: list[Parameter] = []
    while text := _core.table_row("ground_parameters", len(rows) + 1).decode().strip():
        _, name, _, _, default, allowed, unit, meaning, _, takers = text.split("|")
        rows.append(Parameter(name, default, allowed, unit, meaning, takers))
    return tuple(rows)


def parameters() -> tuple[Parameter, ...]:
    """Parameters of all models, without the model column."""
    return _columns()[1:]


@cache
def repose() -> float:
    """Rest angle of rocky ground [degree], which is also the default."""
    return next(
        float(parameter.default) for parameter in parameters() if parameter.name == "rest_angle"
    )


def shipped_grounds() -> Path:
    """Path of the shipped ground table."""
    return Path(str(importlib.resources.files("rockfall") / "data" / "grounds.csv"))


def other_tables() -> dict[str, Path]:
    """Other shipped ground tables, by the name used in cases."""
    folder = shipped_grounds().parent
    return {path.stem.partition("_")[2]: path for path in sorted(folder.glob("grounds_*.csv"))}


def table_path(case: Case) -> Path:
    """Path of the ground table of a case: its own, or a shipped table."""
    own = case.surface.get("ground_table")
    if not own:
        return shipped_grounds()
    return other_tables().get(own) or case.path(own)


class GroundTable:
    """Rows of a ground table, by name and by id."""

    def __init__(self, path: Path) -> None:
        self.path = path
        where, columns, rows = read_table(path)
        allowed = (*WORDS, *(parameter.name for parameter in parameters()))
        check_columns(where, columns, allowed)
        check_needed(where, columns, ("name", "model", "source"))
        self.rows: dict[str, Row] = {}
        self.names: dict[int, str] = {}  # id -> name
        for row in rows:
            self._take(row)

    def _take(self, row: Row) -> None:
        name = row.text("name")
        row.text("source")
        if len(name) > MAX_NAME or not name.isprintable():
            row.refuse("name", f"must be at most {MAX_NAME} characters")
        if name in self.rows:
            row.refuse("name", "must be unique among grounds")
        self.rows[name] = row
        if number := row.cells.get("id"):
            if not re.fullmatch(r"[0-9]{1,9}", number):
                row.refuse("id", "must be an integer from 0 to 999999999")
            if int(number) in self.names:
                row.refuse("id", "must be unique among grounds")
            self.names[int(number)] = name

    def ground(self, name: str, case: Case, pair: Mapping[str, float] | None = None) -> GroundRule:
        """Ground of a row, for the boulders of a case; `pair` (strength [Pa], relief [degree])
        replaces the values of the row. The kernel checks the values."""
        row, pair = self.rows[name], pair or {}
        model = row.choice("model", _columns()[0].allowed.split(", "))
        numbers = _numbers(row)
        cells = {key: row.cells[key] for key in numbers}
        text = _row_text(model, {**cells, **pair})
        numbers.update(pair)
        if model in YIELDING:
            return _plane_rule(name, model, text, numbers, row.where, case)
        return GroundRule(name, model, text.encode(), row.where, numbers.get("rest_angle"))

    @property
    def yielding(self) -> list[str]:
        """Names of rows that use planes of impact tables."""
        return [name for name, row in self.rows.items() if row.cells["model"] in YIELDING]


def _numbers(row: Row) -> dict[str, float]:
    """Numbers in a row, by column; empty cells are omitted."""
    names = (parameter.name for parameter in parameters())
    return {name: row.number(name) for name in names if row.cells.get(name)}


def yielding_ground(row: Row) -> tuple[str, YieldingGround]:
    """Model and values of a row that uses a plane of tables."""
    return row.cells["model"], _yielding(_numbers(row))


def _yielding(numbers: Mapping[str, float]) -> YieldingGround:
    """Ground with these values; missing values have the kernel's defaults."""
    usual = {
        key.name: float(key.default)
        for key in parameters()
        if key.name in YieldingGround._fields and key.default != "required"
    }
    return YieldingGround(**{**usual, **numbers})


def is_calibrated(plane: Plane) -> bool:
    """Return True if strength and relief are those of a shipped ground."""
    apart = {"rest_angle": 0.0, "strength_sigma": 0.0}
    shipped = (yielding_ground(shipped_rows().rows[name]) for name in shipped_rows().yielding)
    own = plane.model, plane.ground._replace(**apart)
    return any(own == (model, ground._replace(**apart)) for model, ground in shipped)


def check_yielding(where: str, model: str, numbers: Mapping[str, float]) -> None:
    """Raise the kernel's error for invalid values of a ground."""
    _check_text(_row_text(model, numbers), where)


def _check_text(text: str, where: str) -> None:
    check_kernel(*_core.check_ground(text.encode(), where.encode()))


def _row_text(model: str, numbers: Mapping[str, float | str]) -> str:
    values = "".join(f" {name} = {value}" for name, value in numbers.items())
    return f"&ground model = '{model}'{values} /"


def _plane_rule(
    name: str, model: str, text: str, numbers: Mapping[str, float], where: str, case: Case
) -> GroundRule:
    """Ground with a plane of tables, for the boulders of a case. The kernel checks the values
    first, because parts can only be selected for valid values."""
    _check_text(text, where)
    ground = _yielding(numbers)
    sigma = case.boulder.get("ground_strength_sigma", ground.strength_sigma)
    weight = case.boulder["density"] * case.flight["gravity"]
    plane = Plane(model, ground._replace(strength_sigma=sigma), usual_radii(case), weight)
    shape = (possible_shapes(case) or BLOCK_SHAPES)[0]
    return _of_plane(
        GroundRule(name, BLOCK_TABLE, text.encode(), where, ground.rest_angle), plane, shape
    )


def _of_plane(rule: GroundRule, plane: Plane, shape: str) -> GroundRule:
    """Ground with the tables of a block shape."""
    table = plane_table(plane.model, shape, plane.ground, np.array(plane.radii), plane.weight)
    return rule._replace(plane=plane, table=table, block_radius=block_radius(table))


def scaled_pair(rule: GroundRule, strength: float, relief: float, case: Case) -> GroundRule:
    """Ground with strength and relief multiplied by factors, within limits beyond all tables."""
    assert rule.plane is not None
    given = rule.plane.ground
    limits = {parameter.name: parameter.limits for parameter in parameters()}
    scaled = {"strength": strength * given.strength, "relief": relief * given.relief}
    clipped = {key: float(np.clip(value, *limits[key])) for key, value in scaled.items()}
    ground = given._replace(**clipped)
    text = _row_text(rule.plane.model, ground._asdict()).encode()
    shape = (possible_shapes(case) or BLOCK_SHAPES)[0]
    return _of_plane(rule._replace(text=text), rule.plane._replace(ground=ground), shape)


def usual_radii(case: Case) -> tuple[float, float]:
    """Range of R_b [m] that contains nearly all boulders of a case."""
    given = facts(case, "boulder", "release", "breakage")
    low, high = _core.usual_radii(in_kernel(case)).tolist()
    if given.by_raster or given.by_layer or not {"points", "polygons"}.isdisjoint(case.release):
        low, high = ANY_RADIUS
    return (ANY_RADIUS[0] if case.breakage["at"] != "none" else low), high


@cache
def shipped_rows() -> GroundTable:
    """The shipped ground table."""
    return GroundTable(shipped_grounds())


def table_names() -> list[str]:
    """Names of shipped impact tables: grounds with a table for each block shape, and tables for all
    shapes."""
    return sorted([*shipped_rows().yielding, *tables_of_all_shapes()])


@cache
def band(name: str) -> tuple[str, ...]:
    """Names of the next softer and the next firmer shipped ground with impact tables. At the ends
    of the scale there is only one name; for a ground whose strength depends on boulder size there
    is none.

    >>> band("meadow")
    ('vegetated-soil', 'compact')
    """
    rows = shipped_rows().rows
    grounds = {row: yielding_ground(rows[row])[1] for row in shipped_rows().yielding}
    fixed = {row: ground.strength for row, ground in grounds.items() if not ground.strength_radius}
    names = sorted(fixed, key=fixed.__getitem__)
    if name not in names:
        return ()
    place = names.index(name)
    return (*names[max(0, place - 1) : place], *names[place + 1 : place + 2])


@cache
def draws_of(name: str) -> list[dict[str, float]]:
    """Values of the uncertain parameters of a shipped ground, by draw; may be empty."""
    _, columns, rows = read_table(_draws())
    return [
        {key: row.number(key) for key in columns if key != "ground"}
        for row in rows
        if row.text("ground") == name
    ]


def _draws() -> Path:
    return shipped_grounds().with_name("ground_draws.csv")


def ensemble_names() -> list[str]:
    """Names of shipped ensembles of grounds, which are only allowed in `&ensemble sets`."""
    return [name + ENSEMBLE for name in shipped_rows().yielding if draws_of(name)]


def find_operator(case: Case, name: str) -> tuple[Path | None, bool]:
    """File with the impact sets or tables of a name, shipped or next to the case (for a shipped
    ground or ensemble its CSV table); None if not found. Also return True for impact tables."""
    if name in ensemble_names():
        return _draws(), True
    if name in shipped_rows().yielding:
        return shipped_grounds(), True
    if table := own_table(case, name):
        return table, True
    return find_set(case, name), False


def find_ground(case: Case, table: GroundTable, name: str, where: str) -> GroundRule:
    """Ground with a given name: a row in the ground table, an impact table, or impact sets. `where`
    is the position of the name, for messages. Raises a RockfallError for other names."""
    if name in table.rows:
        return table.ground(name, case)
    path, is_table = find_operator(case, name)
    if path is None:
        rows, tables, sets = map(", ".join, (table.rows, table_names(), shipped_sets()))
        raise RockfallError(
            f"{where} = '{name}': is not a ground of {table.path.name}, an impact table or an "
            f"impact set. Grounds: {rows}. Impact tables: {tables}. Impact sets: {sets}"
        )
    if name in ensemble_names():
        raise RockfallError(
            f"{where} = '{name}': is an ensemble of impact tables: use it in &ensemble sets"
        )
    if is_table:
        return table_ground(case, name)
    check_text_file(path)
    if len(name) > MAX_NAME:
        raise RockfallError(f"{where} = '{name}': must be at most {MAX_NAME} characters")
    return GroundRule(name, IMPACT_SETS, path.read_bytes(), str(path))


def zone_ground(case: Case, table: GroundTable, zone: Zone) -> GroundRule:
    """Ground of a zone that gives a ground, a strength or a relief."""
    named = zone.ground_in(named_ground(case))
    rule = find_ground(case, table, named.name, f"{zone.where}: ground")
    return _with_pair(rule, case, table, named, f"{zone.where}: ")


def case_ground(case: Case, table: GroundTable) -> GroundRule:
    """Default ground of a case, for cells where neither a zone nor a raster gives one."""
    where, named = f"{case.name}: &surface ", named_ground(case)
    if "ground" in case.surface:
        rule = find_ground(case, table, named.name, f"{where}ground")
    else:
        rule = usual_ground(case)
    return _with_pair(rule, case, table, named, where)


def _with_pair(
    rule: GroundRule, case: Case, table: GroundTable, named: NamedGround, where: str
) -> GroundRule:
    """Replace strength and relief of a ground; messages start with `where`. Refuses values out of
    range, and grounds without these parameters."""
    if not named.pair:
        return rule
    limits = {parameter.name: parameter.limits for parameter in parameters()}
    for key, value in named.pair.items():
        given, (low, high) = f"{where}ground_{key} = {value:g}", limits[key]
        if rule.plane is None:
            names = ", ".join(dict.fromkeys([*table.yielding, *shipped_rows().yielding]))
            raise RockfallError(
                f"{given}: is not valid for ground '{named.name}': only for {names}"
            )
        if not low <= value <= high:
            raise RockfallError(f"{given}: must be {low:g} to {high:g}")
    own = str(named)
    if len(own) > MAX_NAME:
        raise RockfallError(f"{where}ground '{own}': must be at most {MAX_NAME} characters")
    rows = table if named.name in table.rows else shipped_rows()
    return rows.ground(named.name, case, named.pair)._replace(name=own)


def usual_key(case: Case) -> str:
    """Key of &impact used by a case: sets or table."""
    return "sets" if case.impact["form"] == "matrix" else "table"


def named_ground(case: Case) -> NamedGround:
    """Name of the default ground, impact sets or impact table, with the strength and relief of the
    case."""
    surface = case.surface
    pair = {key.removeprefix("ground_"): surface[key] for key in PAIR if key in surface}
    return NamedGround(surface.get("ground", case.impact[usual_key(case)]), pair)


def usual_name(case: Case) -> str:
    """Name of the default ground in results."""
    return str(named_ground(case))


def usual_ground(case: Case) -> GroundRule:
    """Default ground of a case: its impact sets or its impact table. Raises a RockfallError for an
    unknown table."""
    if case.impact["form"] == "matrix":
        return GroundRule(case.impact["sets"])
    name = case.impact["table"]
    if find_operator(case, name)[1] and name not in ensemble_names():
        return table_ground(case, name)
    names = ", ".join(table_names())
    raise RockfallError(
        f"{case.name}: &impact table = '{name}': no such impact table or .nc file (shipped tables: "
        f"{names})"
    )


def table_ground(case: Case, name: str) -> GroundRule:
    """Ground with the impact table of a name known to `find_operator`. Raises a RockfallError for a
    name longer than the kernel stores."""
    path = own_table(case, name)
    if path is None:
        return shipped_rows().ground(name, case)
    if len(name) > MAX_NAME:
        raise RockfallError(f"ground '{name}': must be at most {MAX_NAME} characters")
    table = open_table(path)
    model = _core.table_model(len(table.size), table.ground.strength).decode().strip()
    angle, radius = table.ground.rest_angle, block_radius(table)
    return GroundRule(name, model, b"", str(path), angle, radius, table=table)


def ensemble_grounds(case: Case, name: str) -> list[GroundRule]:
    """Grounds from all draws of an ensemble, or a single ground from a single table."""
    if name not in ensemble_names():
        return [table_ground(case, name)]
    ground = name.removesuffix(ENSEMBLE)
    row = shipped_rows().rows[ground]
    model, own = row.cells["model"], _numbers(row)
    drawn = [own | values for values in draws_of(ground)]
    return [
        _plane_rule(ground, model, _row_text(model, numbers), numbers, str(_draws()), case)
        for numbers in drawn
    ]


def block_radius(table: ImpactTable) -> float:
    """R_b [m] of the largest blocks in a table; NaN if the table does not depend on R_b."""
    ground = table.ground
    largest = float(table.size.max())
    return float(_core.largest_block(largest, ground.strength, ground.strength_radius))


def block_axes() -> dict[str, tuple[float, ...]]:
    """Axes of the blocks for each shape, relative to the longest axis."""
    axes = kernel_numbers("block_axes").reshape(-1, 3).tolist()
    return dict(zip(BLOCK_SHAPES, map(tuple, axes), strict=True))


def grounds_by_shape(
    grounds: Sequence[GroundRule], shapes: Collection[str]
) -> tuple[tuple[GroundRule, ...], list[list[int]]]:
    """Grounds for boulders of several block shapes: the given grounds with the table for one shape,
    followed by their replacements for other shapes. Also return, for each of BLOCK_SHAPES, the
    number (from 1) of the ground that replaces each given ground."""
    rules = [*grounds]
    serving = [[*range(1, len(rules) + 1)] for _ in BLOCK_SHAPES]
    for k, ground in enumerate(grounds):
        if ground.plane is None:
            continue
        needed = [shape for shape in BLOCK_SHAPES if shape in shapes]
        for shape in needed:
            rule = _of_plane(ground, ground.plane, shape)
            if shape == needed[0]:
                rules[k] = rule
            else:
                rules.append(rule)
                serving[BLOCK_SHAPES.index(shape)][k] = len(rules)
    return tuple(rules), serving


def check_number(grounds: Iterable[GroundRule], where: str) -> None:
    """Refuse more grounds than a scene can have."""
    if (number := len(list(grounds))) > MAX_GROUNDS:
        raise RockfallError(f"{where}: {number} grounds: must be at most {MAX_GROUNDS}")
