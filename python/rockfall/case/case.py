# SPDX-License-Identifier: BSD-3-Clause
"""The case: the input of a run, as the kernel reads it. Keys, defaults and ranges are defined only
in the kernel's table."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rockfall._core import rockfall_f2py as _core
from rockfall.case.keys import REPEATABLE, Key, default_values, file_keys
from rockfall.case.rules import first_fault
from rockfall.case.text import namelist_text, plain_values, read_values
from rockfall.errors import RockfallError
from rockfall.io.files import check_text_file, reason

if TYPE_CHECKING:
    from rockfall.result.contents import Held

FROM_ARRAY = "(array)"  # the DEM of a case whose elevations come from `run(case, dem=...)`
LINES = tuple(_core.fields("line_group").decode().split())  # groups of lines, in their order
OPERATOR = {"sets": "matrix", "table": "table"}  # forms of what keys of `impact` name
OF_MAPS = ("map_extent", "min_passages")  # keys of `output` that only concern maps


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
    return _case(text, path)


def case_of(result: Held) -> Case:
    """Case stored in a result; file names are relative to the folder of the run's case."""
    return case_in(result.attrs)


def case_in(attrs: Mapping[str, Any]) -> Case:
    """Case stored in attributes; file names as in `case_of`."""
    return _case(str(attrs["case"]).encode(errors="replace"), Path(str(attrs["case_file"])))


def _case(text: bytes, path: Path) -> Case:
    case = Case.__new__(Case)
    case._read(text, path.parent, str(path))
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
        terrain = groups.get("terrain", {})
        groups["terrain"] = terrain if "dem" in terrain else {**terrain, "dem": FROM_ARRAY}
        lists = {group: map(plain_values, groups.pop(group, ())) for group in REPEATABLE}
        plain = {group: plain_values(values) for group, values in groups.items()}
        self._read(namelist_text(plain, lists).encode(), Path(folder), name)

    def _read(self, text: bytes, folder: Path, name: str) -> None:
        """Take the values of a text, which messages show."""
        self.folder, self.name = folder, name
        groups, facts = read_values(text, name, "case")
        self._facts = Facts(*facts)
        self._groups: dict[str, dict[str, Any]] = {}  # complete
        self._given: dict[str, Any] = {group: [] for group in REPEATABLE}
        self.__dict__ |= {group: [] for group in REPEATABLE}
        for group in groups:
            if group.name in REPEATABLE:
                self.__dict__[group.name].append(group.all())
                self._given[group.name].append(group.given)
            else:
                self._groups[group.name] = group.all()
                self._given[group.name] = group.given
        every = self._groups | {group: self.__dict__[group] for group in REPEATABLE}
        self._as_read = copy.deepcopy(every)
        if fault := first_fault(every, self._facts.has_points):
            message = _core.refusal(text, name, *fault)
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
        given = self._with_changes_in_place()
        changed = dict(given)
        for group, values in groups.items():
            if group not in REPEATABLE:
                changed[group] = {**given.get(group, {}), **values}
            elif values is not None:
                changed[group] = values
        changed["impact"] = _new_operator(given["impact"], groups.get("impact", {}))
        if changed["output"].get("maps") is None and "maps" in self.output:
            changed["output"] = changed["output"] | dict.fromkeys(OF_MAPS)
        return Case(folder=self.folder, name=self.name, **changed)

    def _with_changes_in_place(self) -> dict[str, Any]:
        """Return what was given, with values that were set since by `case.boulder[key] = value`."""
        given = dict(self._given)
        for group, values in self._groups.items():
            was = self._as_read[group]
            changes = {key: value for key, value in values.items() if value != was.get(key)}
            removed = dict.fromkeys(was.keys() - values.keys())
            given[group] = {**given[group], **changes, **removed}
        for group in REPEATABLE:
            if self.__dict__[group] != self._as_read[group]:
                given[group] = self.__dict__[group]
        return given

    def text(self) -> str:
        """Case as the text of a namelist file.

        >>> import rockfall
        >>> case = rockfall.read_case("case.nml").replace(case={"seed": 8})
        >>> print(case.text()[:19])
        &boulder
            block_
        """
        return namelist_text(self._groups, {group: self.__dict__[group] for group in REPEATABLE})

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
    return case._facts


def _new_operator(own: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Group `impact` with changes. Sets or a table that they name bring their form, without which
    they would have no effect; both together are for the kernel to refuse."""
    kept = dict(own)
    named = [form for key, form in OPERATOR.items() if changes.get(key) is not None]
    if changes.get("form") is None and (named or {"form", "table"} & changes.keys()):
        usual = default_values()["impact"]
        kept = {key: own[key] for key in own if key not in OPERATOR or own[key] != usual[key]}
        kept.pop("form", None)
        if len(named) == 1:
            kept["form"] = named[0]
    return kept | {key: value for key, value in changes.items() if key != "form" or value}


def given_groups(case: Case) -> dict[str, dict[str, Any]]:
    """Groups of a case that may not be repeated, without keys that have their default."""
    groups: dict[str, dict[str, Any]] = {}
    for group, values in case._groups.items():
        usual = default_values().get(group, {})
        given = {key: value for key, value in values.items() if value != usual.get(key)}
        if "table" in given and group == "impact":  # which brings a form of its own
            given["form"] = values["form"]
        if given:
            groups[group] = given
    return groups


def given_text(case: Case) -> str:
    """Text of a case without the groups in which every key has its default."""
    defaults = default_values()
    given = {name: values for name, values in case._groups.items() if values != defaults.get(name)}
    return namelist_text(given, {name: getattr(case, name) for name in REPEATABLE})
