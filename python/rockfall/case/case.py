# SPDX-License-Identifier: BSD-3-Clause
"""The case: the inputs of a run, with the keys, defaults and ranges of the kernel's table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rockfall._core import rockfall_f2py as _core
from rockfall.case.keys import REPEATABLE, Key, file_keys, gone_with, idle_of_hazard
from rockfall.case.rules import first_fault
from rockfall.case.text import (
    KernelValues,
    changed_values,
    literal,
    namelist_text,
    plain_values,
    read_values,
    remember,
)
from rockfall.errors import RockfallError
from rockfall.io.files import check_text_file, reason

if TYPE_CHECKING:
    from rockfall.result.contents import Held

FROM_ARRAY = "(array)"  # replaces the name of a file whose contents are given as an array
LINES = tuple(_core.fields("line_group").decode().split())  # groups that define lines, in order
OPERATOR = {"sets": "matrix", "table": "table"}  # rebound form by key of `impact`


def read_case(path: str | Path) -> Case:
    """Read a case from a namelist file. A RockfallError gives file, group, key, value and rule.

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
    """Case stored in a result; file names are relative to the folder of the original case."""
    return case_in(result.attrs)


def case_in(attrs: Mapping[str, Any]) -> Case:
    """Case stored in attributes; file names as in `case_of`."""
    return _case(str(attrs["case"]).encode(errors="replace"), Path(str(attrs["case_file"])))


def _case(text: bytes, path: Path) -> Case:
    return _made(read_values(text, str(path), "case"), path.parent, str(path))


def _made(values: KernelValues, folder: Path, name: str) -> Case:
    case = Case.__new__(Case)
    case._take(values, folder, name)
    return case


class Case:
    """A case, organised in groups as in its file: `case.boulder["density"]`,
    `case.line[0]["name"]`.

    Keys missing in the file have their default, or are absent. File names are relative to
    `folder`. Repeatable groups (`REPEATABLE`) are lists.

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
        lists = {group: groups.pop(group, ()) for group in REPEATABLE}
        text = namelist_text(_plain(groups | lists)).encode()
        self._take(read_values(text, name, "case"), Path(folder), name)

    def _take(self, values: KernelValues, folder: Path, name: str) -> None:
        """Take the values that the kernel read, or raise its error; `name` is used in messages."""
        self.folder, self.name, self._values = folder, name, values
        self._facts = Facts(*values.facts)
        groups = _all_values(values)
        if fault := first_fault(groups, self._facts.has_points):
            message = _core.refusal(values, *fault)
            raise RockfallError(message.decode(errors="replace").strip())
        self.__dict__ |= {group: groups.pop(group) for group in REPEATABLE}
        self._groups: dict[str, dict[str, Any]] = groups  # all groups

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_values": self.text()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        values = read_values(state["_values"].encode(), state["name"], "case")
        self.__dict__ |= state | {"_values": values}

    def __getattr__(self, group: str) -> dict[str, Any]:
        try:
            return self.__dict__["_groups"][group]
        except KeyError:
            raise AttributeError(f"a case has no group {group!r}") from None

    @property
    def has_forest(self) -> bool:
        """Return True if the case has trees, listed or generated.

        >>> import rockfall
        >>> case = rockfall.read_case("case.nml")
        >>> case.has_forest, case.replace(forest={"trees": "trees.csv"}).has_forest
        (False, True)
        """
        return facts(self, "forest").has_forest

    @property
    def lines(self) -> list[dict[str, Any]]:
        """Lines at which crossings are recorded: evaluation lines, then barriers.

        >>> import rockfall
        >>> [line["name"] for line in rockfall.read_case("case.nml").lines]
        ['L']
        """
        return [line for group in LINES for line in getattr(self, group)]

    def files(self) -> Iterator[tuple[Key, str]]:
        """Yield each key whose value is a file, and the file.

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
        """Return a copy with different values: `case.replace(surface={"method": "A"})`. None
        removes a key and all keys that are only valid with it; for `zones` these are table, field
        and layer. A list replaces all groups of its name: `case.replace(line=[])`. Changing `sets`
        or `table` of `impact` also sets the matching form; keys of `hazard` are removed together
        with the `maps` or `scenario` that they need.

        >>> import rockfall
        >>> case = rockfall.read_case("case.nml")
        >>> other = case.replace(boulder={"volume_mean": 2.0}, line=[])
        >>> other.boulder["volume_mean"], other.boulder["density"], other.line
        (2.0, 2800.0, [])
        >>> "table" in case.replace(surface={"zones": None, "ground": "talus"}).surface
        False
        """
        changes = self._changes_in_place()
        for group, values in groups.items():
            if group not in REPEATABLE:
                changes[group] = {**changes.get(group, {}), **values}
                changes[group] |= gone_with(group, self._groups[group], changes[group])
            elif values is not None:
                changes[group] = values
        if "impact" in groups:
            changes["impact"] |= _new_form(groups["impact"])
        if "scenario" in groups or "maps" in groups.get("output", {}):
            maps = changes.get("output", {}).get("maps", self.output.get("maps"))
            idle = idle_of_hazard(changes.get("scenario", self.scenario), maps or ())
            changes["hazard"] = {**changes.get("hazard", {}), **idle, **groups.get("hazard", {})}
        return _made(self._changed(changes), self.folder, self.name)

    def _changed(self, changes: dict[str, Any]) -> KernelValues:
        """Values after changes (None removes a key or group); only changed keys are parsed."""
        plain, removed = _plain(changes), []
        for group, values in changes.items():
            keys = {} if group in REPEATABLE else {key.lower() for key in values}
            removed += [f"{group}%{key}" for key in keys if key not in plain[group]]
        removed += [group for group in changes if group in REPEATABLE]
        return changed_values(self._values, removed, namelist_text(plain).encode(), self.name)

    def _changes_in_place(self) -> dict[str, Any]:
        """Values assigned by `case.boulder[key] = value`, and removed keys."""
        changes: dict[str, Any] = {}
        groups = self._groups | {group: self.__dict__[group] for group in REPEATABLE}
        for group, was in _all_values(self._values).items():
            if (own := groups[group]) == was:
                continue
            changes[group] = own
            if group not in REPEATABLE:
                new = {key: value for key, value in own.items() if value != was.get(key)}
                changes[group] = dict.fromkeys(was.keys() - own.keys()) | new
        return changes

    def text(self) -> str:
        """Text of the case as a namelist file.

        >>> import rockfall
        >>> case = rockfall.read_case("case.nml").replace(case={"seed": 8})
        >>> print(case.text()[:19])
        &boulder
            block_
        """
        values = in_kernel(self)
        if not values.text:
            values.text = namelist_text(_all_values(values))
            remember(values.text.encode(errors="replace"), self.name, "case", values)
        return values.text

    def path(self, file: str) -> Path:
        """Path of a file in the case, relative names resolved.

        >>> import rockfall
        >>> case = rockfall.read_case("case.nml")
        >>> case.path(case.terrain["dem"]).name
        'dem.tif'
        """
        return self.folder / file


class Facts(NamedTuple):
    """Properties of a case that the kernel derives from its keys."""

    has_forest: bool
    has_points: bool  # sources are points instead of terrain cells
    by_layer: bool  # source attributes define the boulders
    by_raster: bool  # rasters define the boulders
    by_table: bool  # an impact table is the default rebound model
    is_compact: bool  # boulders of the case can have the compact shape
    is_elongated: bool
    is_platy: bool


def facts(case: Case, *groups: str) -> Facts:
    """Facts that derive from these groups of a case. The groups are accessed, so that a case that
    records accessed groups includes them."""
    for group in groups:
        getattr(case, group)
    return case._facts


def in_kernel(case: Case) -> KernelValues:
    """Case in the kernel, including values assigned in place since it was read."""
    changes = case._changes_in_place()
    return case._changed(changes) if changes else case._values


def check_all_kept(case: Case, needs: str) -> None:
    """Raise a RockfallError for a case whose runs do not keep the rows of all boulders; the message
    starts with `needs`."""
    if (kept := case.output["kept"]) != "all":
        raise RockfallError(
            f"{case.name}: &output kept = {literal(kept)}: {needs} the rows of all boulders: "
            "kept = 'all'"
        )


def is_given(case: Case, group: str, key: str) -> bool:
    """Return True if a key differs from its default. The group is accessed, as in `facts`."""
    own = getattr(case, group).get(key)
    read = next(read for read in case._values.groups if read.name == group)
    return key in read.given or own != read.usual.get(key)


def _plain(groups: Mapping[str, Any]) -> dict[str, Any]:
    """Convert groups and lists of groups to values for a namelist file."""
    return {
        group: [*map(plain_values, values)] if group in REPEATABLE else plain_values(values)
        for group, values in groups.items()
    }


def _all_values(values: KernelValues) -> dict[str, Any]:
    """Values of each group of a case; lists for repeatable groups."""
    groups: dict[str, Any] = {group: [] for group in REPEATABLE}
    for group in values.groups:
        if group.name in REPEATABLE:
            groups[group.name].append(group.all())
        else:
            groups[group.name] = group.all()
    return groups


def _new_form(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Change of `form` that a change of `sets` or `table` in &impact implies; without it, the
    kernel would refuse both together or ignore the change."""
    named = [form for key, form in OPERATOR.items() if changes.get(key) is not None]
    if changes.get("form") is not None or not (named or {"form", "table"} & changes.keys()):
        return {}
    return {"form": named[0] if len(named) == 1 else None}


def given_groups(case: Case) -> dict[str, dict[str, Any]]:
    """Non-repeatable groups, with the keys that differ from their defaults."""
    return {
        group.name: group.given
        for group in in_kernel(case).groups
        if group.given and group.name not in REPEATABLE
    }


def given_in_lists(case: Case) -> dict[str, list[dict[str, Any]]]:
    """Repeatable groups, with the keys that differ from their defaults."""
    groups: dict[str, list[dict[str, Any]]] = {group: [] for group in REPEATABLE}
    for group in in_kernel(case).groups:
        if group.name in REPEATABLE:
            groups[group.name].append(group.given)
    return groups


def given_text(case: Case) -> str:
    """Text of a case without the groups in which all keys have their defaults."""
    given = {group: case._groups[group] for group in given_groups(case)}
    return namelist_text(given | {name: getattr(case, name) for name in REPEATABLE})
