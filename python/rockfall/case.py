# SPDX-License-Identifier: BSD-3-Clause
"""The case: the input of a run. Keys, defaults and ranges are defined only in the kernel's
table."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rockfall._core import rockfall_f2py as _core
from rockfall.case_rules import first_fault
from rockfall.errors import RockfallError, check_kernel
from rockfall.io.files import check_text_file, reason

if TYPE_CHECKING:
    from rockfall.result.contents import Held

FROM_ARRAY = "(array)"  # the DEM of a case whose elevations come from `run(case, dem=...)`
WIDTH = 72  # columns after which a list continues on the next line
LINES = tuple(_core.fields("line_group").decode().split())  # groups of lines, in their order
OPERATOR = {"sets": "matrix", "table": "table"}  # forms of what keys of `impact` name
OF_MAPS = ("map_extent", "min_passages")  # keys of `output` that only concern maps
REPEATABLE = tuple(_core.fields("repeatable_group").decode().split())  # groups that are lists


class Key(NamedTuple):
    """A row of the table of keys; `default` is text as in a case file, "required" or "absent"."""

    group: str
    name: str
    kind: str
    most: int
    default: str
    allowed: str
    unit: str
    meaning: str
    file: str  # kind of file: raster, layer, raster layer (either), table, sets; ""

    @property
    def is_varied(self) -> bool:
        """Return True for a key of &variant that takes the place of one of another group."""
        return self.group == "variant" and varied_key(self.name) is not None


@cache
def key_table() -> tuple[Key, ...]:
    """Every key of a case file, in order."""
    rows: list[Key] = []
    while text := _core.table_row("keys", len(rows) + 1).decode().strip():
        group, name, kind, most, *rest = text.split("|")
        rows.append(Key(group, name, kind, int(most), *rest))
    return tuple(rows)


@cache
def keys_of(group: str) -> dict[str, Key]:
    """Keys of a group by name, in order."""
    return {key.name: key for key in key_table() if key.group == group}


@cache
def varied_key(name: str) -> tuple[str, str] | None:
    """Group and key whose value a key of &variant replaces; None for its other keys."""
    group, _, key = name.partition("_")
    keys = {(row.group, row.name) for row in key_table()}
    return (group, key) if (group, key) in keys else None


def file_keys() -> list[Key]:
    """The keys that name files."""
    return [key for key in key_table() if key.file]


def read_case(path: str | Path) -> Case:
    """Read the case in a namelist file. A RockfallError names file, group, key, value and the rule.

    >>> import rockfall
    >>> rockfall.read_case("case.nml").boulder["density"]
    2800.0
    """
    path = Path(path)
    check_text_file(path)
    try:
        text = path.read_bytes()
    except OSError as error:
        raise RockfallError(f"{path}: cannot be read: {reason(error, path)}") from error
    check_namelist(_core.check_case, text, str(path))
    return _case(text, path)


def case_of(result: Held) -> Case:
    """Case stored in a result; file names are relative to the folder of the run's case."""
    return case_in(result.attrs)


def case_in(attrs: Mapping[str, Any]) -> Case:
    """Case stored in attributes; file names as in `case_of`."""
    text, name = str(attrs["case"]).encode(errors="replace"), str(attrs["case_file"])
    _checked(text, name)
    return _case(text, Path(name))


def _case(text: bytes, path: Path) -> Case:
    """Case of a text that the kernel has checked."""
    case = Case.__new__(Case)
    case._set(path.parent, str(path), {**_parse(text.decode("utf-8-sig"))}, text)
    return case


class Case:
    """A case, group by group as in its file: `case.boulder["density"]`, `case.line[0]["name"]`.

    Keys that are not given have their default, or are absent. File names are relative to `folder`.
    Groups that may be repeated (`REPEATABLE`) are lists.

    >>> import rockfall
    >>> case = rockfall.Case(
    ...     case={"boulders": 100},
    ...     terrain={"dem": "dem.tif"},
    ...     surface={"uniform_mean_radius": 0.3},
    ...     boulder={"volume_mean": 1.0},
    ...     release={"steep_cells": True, "slope_threshold": 30.0},
    ... )
    >>> case.replace(case={"boulders": 50}).release["drop_height"]
    0.0
    """

    line: list[dict[str, Any]]
    barrier: list[dict[str, Any]]
    dam: list[dict[str, Any]]
    scenario: list[dict[str, Any]]
    variant: list[dict[str, Any]]

    def __init__(self, *, folder: str | Path = ".", name: str = "case", **groups: Any) -> None:
        self._set(folder, name, groups)

    def _set(
        self, folder: str | Path, name: str, groups: dict[str, Any], written: bytes = b""
    ) -> None:
        """Complete and check the groups; `written` is their text in a file, for messages."""
        self.folder, self.name = Path(folder), name
        lists = {group: [dict(entry) for entry in groups.pop(group, ())] for group in REPEATABLE}
        self.__dict__ |= lists
        for key in key_table():
            if key.group not in REPEATABLE and key.group not in groups:
                groups[key.group] = {}
        if "dem" not in groups["terrain"]:
            groups["terrain"] = {**groups["terrain"], "dem": FROM_ARRAY}
        self._groups = {group: plain_values(values) for group, values in groups.items()}
        self._checked_text = self.text().encode()
        _checked(self._checked_text, name)
        defaults = default_values()
        if "form" not in self._groups["impact"]:
            by_table = _facts(self._checked_text).by_table
            self._groups["impact"] |= {"form": "table" if by_table else "matrix"}
        for group, values in self._groups.items():
            self._groups[group] = _typed(group, defaults.get(group, {}) | values)
        for group, several in lists.items():
            self.__dict__[group] = [_completed(group, plain_values(entry)) for entry in several]
        self._check_rules(written or self._checked_text)

    def _check_rules(self, text: bytes) -> None:
        """Refuse a case that breaks a rule of `case_rules`; its text is shown in the message."""
        groups = self._groups | {group: getattr(self, group) for group in REPEATABLE}
        at_points = bool(self.scenario) and _facts(self._checked_text).has_points
        classes = keys_of("hazard")["matrix"].allowed.split(", ")
        if fault := first_fault(groups, at_points, classes):
            message = _core.refusal(text, self.name, *fault)
            raise RockfallError(message.decode(errors="replace").strip())

    def __getattr__(self, group: str) -> dict[str, Any]:
        try:
            return self.__dict__["_groups"][group]
        except KeyError:
            raise AttributeError(f"a case has no group {group!r}") from None

    @property
    def has_forest(self) -> bool:
        """Return True if there are trees, listed or generated.

        >>> import rockfall
        >>> case = rockfall.read_case("case.nml")
        >>> case.has_forest, case.replace(forest={"trees": "trees.csv"}).has_forest
        (False, True)
        """
        return facts(self, "forest").has_forest

    @property
    def lines(self) -> list[dict[str, Any]]:
        """Lines at which crossings are recorded: the evaluation lines, then the barriers.

        >>> import rockfall
        >>> [line["name"] for line in rockfall.read_case("case.nml").lines]
        ['L']
        """
        return [line for group in LINES for line in getattr(self, group)]

    def files(self) -> Iterator[tuple[Key, str]]:
        """Files that the case names, with their keys.

        >>> import rockfall
        >>> for key, name in rockfall.read_case("case.nml").files():
        ...     print(f"&{key.group} {key.name}: {name}")
        &terrain dem: dem.tif
        &surface zones: zones.tif
        &surface table: zones.csv
        &impact table: talus
        &impact sets: sets.nml
        """
        for key in file_keys():
            groups = (
                self.__dict__[key.group] if key.group in REPEATABLE else [self._groups[key.group]]
            )
            for values in groups:
                named = values.get(key.name, [])
                for name in named if isinstance(named, list) else [named]:
                    yield key, name

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Case) or self.folder != other.folder:
            return False
        return self.text() == other.text()

    def __hash__(self) -> int:
        return hash((self.folder, self.text()))

    def __repr__(self) -> str:
        return f"<rockfall.Case {self.name}: {self.case['title']!r}>"

    def replace(self, **groups: Any) -> Case:
        """Return a copy with other values: `case.replace(surface={"method": "A"})`; None removes a
        key. A list replaces all groups of its name: `case.replace(line=[])`. `sets` or `table` of
        `impact` bring their form with them; `maps` of `output` takes its keys along.

        >>> import rockfall
        >>> case = rockfall.read_case("case.nml")
        >>> other = case.replace(boulder={"volume_mean": 2.0}, line=[])
        >>> other.boulder["volume_mean"], other.boulder["density"], other.line
        (2.0, 2800.0, [])
        """
        lists = {group: groups.pop(group, None) for group in REPEATABLE}
        changed = {
            group: {**self._groups.get(group, {}), **groups.get(group, {})}
            for group in {**self._groups, **groups}
        }
        changed |= {g: self.__dict__[g] if given is None else given for g, given in lists.items()}
        changed["impact"] = _new_operator(self.impact, groups.get("impact", {}))
        if changed["output"].get("maps") is None and "maps" in self.output:
            changed["output"] |= dict.fromkeys(OF_MAPS)
        return Case(folder=self.folder, name=self.name, **changed)

    def text(self) -> str:
        """Case as the text of a namelist file.

        >>> import rockfall
        >>> case = rockfall.read_case("case.nml").replace(case={"seed": 8})
        >>> print(case.text()[:19])
        &boulder
            block_
        """
        lists = {group: [*map(plain_values, self.__dict__[group])] for group in REPEATABLE}
        return namelist_text(self._groups, lists)

    def path(self, file: str) -> Path:
        """The path of a file that the case names.

        >>> import rockfall
        >>> case = rockfall.read_case("case.nml")
        >>> case.path(case.terrain["dem"]).name
        'dem.tif'
        """
        return self.folder / file


class Facts(NamedTuple):
    """Facts of a case that the kernel derives from its keys."""

    has_forest: bool
    has_points: bool  # sources are points, not cells
    by_layer: bool  # the layer of sources says what its boulders are
    by_raster: bool  # rasters say it
    by_table: bool  # a table of impacts is the operator where nothing else is said
    is_compact: bool  # boulders of the case can have this block shape
    is_elongated: bool
    is_platy: bool


def facts(case: Case, *groups: str) -> Facts:
    """Facts of a case, which follow from the keys of these groups: stages note them."""
    for group in groups:
        getattr(case, group)
    return _facts(case._checked_text)


@lru_cache(maxsize=8)
def _facts(text: bytes) -> Facts:
    return Facts(*_core.case_facts(text).astype(bool).tolist())


def _new_operator(own: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Group `impact` with changes. Sets or a table that they name bring their form, without which
    they would have no effect; both together are for the kernel to refuse."""
    kept = dict(own)
    named = [form for key, form in OPERATOR.items() if changes.get(key) is not None]
    if changes.get("form") is None and (named or {"form", "table"} & changes.keys()):
        usual = default_values()["impact"]
        kept = {key: own[key] for key in own if key not in OPERATOR or own[key] != usual[key]}
        del kept["form"]
        if len(named) == 1:
            kept["form"] = named[0]
    return kept | {key: value for key, value in changes.items() if key != "form" or value}


def given_groups(case: Case) -> dict[str, dict[str, Any]]:
    """Groups of a case that may not be repeated, without keys that have their default."""
    groups: dict[str, dict[str, Any]] = {}
    for group, values in case._groups.items():
        usual = _typed(group, default_values().get(group, {}))
        given = {key: value for key, value in values.items() if value != usual.get(key)}
        if "table" in given and group == "impact":  # which brings a form of its own
            given["form"] = values["form"]
        if given:
            groups[group] = given
    return groups


def given_text(case: Case) -> str:
    """Text of a case without the groups in which every key has its default."""
    defaults, groups = default_values(), case._groups
    given = {
        group: values
        for group, values in groups.items()
        if values != _typed(group, defaults.get(group, {}))
    }
    return namelist_text(
        given, {name: map(plain_values, getattr(case, name)) for name in REPEATABLE}
    )


def check_namelist(check: Callable[[bytes, bytes], tuple], text: bytes, name: str) -> None:
    """Refuse a text that a procedure of the kernel rejects."""
    if b"\0" in text:  # the kernel would stop reading there
        raise RockfallError(f"{name}: character code 0 is not text")
    check_kernel(*check(text or b"\n", name.encode()))


def namelist_text(
    groups: Mapping[str, Mapping[str, Any]],
    lists: Mapping[str, Iterable[dict]] | None = None,
    indent: int = 4,
) -> str:
    """Text of a namelist file with the non-empty groups and repeated groups, line for line as
    f90nml writes it. f90nml takes ten times as long, and a study makes many cases."""
    texts = [_group_text(name, keys, " " * indent) for name, keys in sorted(groups.items()) if keys]
    for name, several in (lists or {}).items():
        texts += [_group_text(name, values, " " * indent) for values in several]
    return "\n".join(texts)


def _group_text(name: str, values: Mapping[str, Any], indent: str) -> str:
    """A group as text."""
    lines = [f"&{name}"]
    for key, value in sorted(values.items()):
        line = f"{indent}{key} = "
        blank = " " * len(line)
        literals = [*map(namelist_value, value if isinstance(value, list) else [value])]
        for literal in literals[:-1]:
            line += f"{literal}, "
            if len(line) >= WIDTH:
                lines.append(line.rstrip())
                line = blank
        lines.append(line + literals[-1])
    return "\n".join([*lines, "/", ""])


def namelist_value(value: Any) -> str:
    """A value in namelist format."""
    if isinstance(value, bool):
        return ".true." if value else ".false."
    if isinstance(value, str):
        return "'" + value.replace("'", "''") + "'"
    return float.__repr__(value) if isinstance(value, float) else str(value)


@lru_cache(maxsize=8)
def _parse(text: str) -> dict[str, Any]:
    """Groups of a checked text; those that may be repeated are lists. A `Case` copies the groups.
    Cached, because a result's case is used often and f90nml is slow."""
    import f90nml

    namelist = f90nml.reads(text)
    groups: dict[str, Any] = {}
    for name in dict.fromkeys(key.group for key in key_table()):
        if name in namelist:
            parsed = namelist[name]  # a list where the group is repeated
            several = [dict(entry) for entry in (parsed if isinstance(parsed, list) else [parsed])]
            groups[name] = several if name in REPEATABLE else several[0]
    return groups


@lru_cache(maxsize=8)
def _checked(text: bytes, name: str) -> None:
    """Check a text, cached: a case of many lines takes long, and is made repeatedly."""
    check_namelist(_core.check_case, text, name)


@cache
def default_values() -> dict[str, dict[str, Any]]:
    """Default values of each group, which are not to be changed."""
    texts: dict[str, str] = {}
    for key in key_table():
        if key.default not in ("required", "absent"):
            texts[key.group] = f"{texts.get(key.group, '')} {key.name} = {key.default}"
    parsed = _parse("\n".join(f"&{group} {values} /" for group, values in texts.items()))
    return {group: keys[0] if group in REPEATABLE else keys for group, keys in parsed.items()}


def _completed(group: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """A repeated group with its defaults, except for values that a layer may supply."""
    defaults = {} if "file" in values else default_values().get(group, {})
    return _typed(group, defaults | dict(values))


def plain_values(values: Mapping[str, Any]) -> dict[str, Any]:
    """NumPy numbers, arrays, paths and tuples in types for a namelist file, without empty ones."""

    def plain(value: Any) -> Any:
        if isinstance(value, Path):
            return str(value)
        if hasattr(value, "tolist"):
            return value.tolist()
        return list(value) if isinstance(value, tuple) else value

    plain_keys = {key.lower(): plain(value) for key, value in values.items()}
    return {key: value for key, value in plain_keys.items() if value is not None and value != []}


def _typed(group: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Reals as float, and a list wherever the table allows several values."""
    kinds = keys_of(group)
    typed = {}
    for name, value in plain_values(values).items():
        several = [*value] if isinstance(value, list) else [value]
        if kinds[name].kind == "real":
            several = [float(number) for number in several]
        typed[name] = several if kinds[name].most > 1 else several[0]
    return typed
