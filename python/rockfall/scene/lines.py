# SPDX-License-Identifier: BSD-3-Clause
"""Lines, barriers and dams from layers, added to the case as if they were typed there."""

import copy
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rockfall.case import REPEATABLE, Case, file_keys, keys_of
from rockfall.errors import RockfallError
from rockfall.io.vectors.layers import attribute, name_of, named_attribute, plain
from rockfall.io.vectors.layers import read_lines as read_layer
from rockfall.io.vectors.unused_attributes import note_marks, note_unused
from rockfall.result.variables import fields
from rockfall.scene.layers import Inputs, take_inputs
from rockfall.scene.stages import FRESH, Stages

OF_LAYER = {"name", "x", "y", "file", "layer", "field"}  # keys that do not come from attributes
RECORDED = {"line", "barrier"}  # groups whose names appear in results
LOGICAL = {"true": True, "1": True, "false": False, "0": False}  # spelling in vector formats
STRENGTH = {*fields("strength")}  # a barrier needs exactly one


class _Drawn(NamedTuple):
    """A feature as a case group."""

    where: str  # used in messages
    values: dict[str, Any]


def read_lines(inputs: Inputs, stages: Stages = FRESH) -> Case:
    """Case in which the lines, barriers and dams of layers have coordinates and attributes."""
    groups, case = _groups(), inputs.case
    if not any("file" in entry for group in groups for entry in getattr(case, group)):
        return case
    drawn = take_inputs(
        stages, "lines", inputs, (),
        lambda inputs: {group: list(_drawn(inputs, group)) for group in groups},
    )  # fmt: skip
    try:
        lines = {group: [feature.values for feature in several] for group, several in drawn.items()}
        return case.replace(**lines)
    except RockfallError:
        _blame(case, drawn)
        raise


def with_lines_of(case: Case, read: Case) -> Case:
    """Case with the lines, barriers and dams of `read`, a case after `read_lines`."""
    return case.replace(**{group: getattr(read, group) for group in _groups()})


def _groups() -> list[str]:
    """Case groups that a layer can give: lines, barriers and dams."""
    drawn = {key.group for key in file_keys() if key.name == "file"}
    return [group for group in REPEATABLE if group in drawn]


def _blame(case: Case, drawn: Mapping[str, list[_Drawn]]) -> None:
    """If a single layer feature is invalid, raise the error with its file and number."""
    for group, several in drawn.items():
        for feature in several:
            alone = copy.copy(case)
            alone.name = feature.where
            alone.replace(**(dict.fromkeys(drawn, []) | {group: [feature.values]}))


def _drawn(inputs: Inputs, group: str) -> Iterator[_Drawn]:
    """Yield a group for each layer feature, and the groups that are not from a layer."""
    for entry in getattr(inputs.case, group):
        if "file" in entry:
            yield from _features(inputs, group, entry)
        else:
            yield _Drawn(inputs.case.name, entry)


def _features(inputs: Inputs, group: str, given: Mapping[str, Any]) -> Iterator[_Drawn]:
    """Yield a group for each line in a layer; feature attributes give the missing keys."""
    path = inputs.case.path(given["file"])
    parts, columns = read_layer(path, given.get("layer"), inputs.grid, inputs.remarks)
    layer = given.get("layer")
    inputs.note_layer(f"{group} {name_of(given['file'], layer)}", path, layer)
    keys = keys_of(group)
    own = {key: value for key, value in given.items() if key not in OF_LAYER}
    asked = keys.keys() - OF_LAYER - own.keys()
    if STRENGTH & own.keys():
        asked -= STRENGTH
    by_key = {key: attribute(columns, key) for key in sorted(asked)}
    attributes = {key: column for key, column in by_key.items() if column is not None}
    names = None
    used = {*asked, given.get("field", "name")}
    note_unused(inputs.remarks, name_of(path, layer), columns, sorted(used))
    note_marks(inputs.remarks, name_of(path, layer), columns, sorted(asked))
    if group in RECORDED:
        names = _names(path, given, columns, [len(parts_) for parts_ in parts])
    for k, feature in enumerate(parts):
        values = {name: _plain(column[k], keys[name].kind) for name, column in attributes.items()}
        values = {name: value for name, value in values.items() if value is not None} | own
        for part in feature:
            name = {} if names is None else {"name": next(names)}
            x, y = part.T.tolist()
            yield _Drawn(f"{path}: feature {k + 1}", {**name, "x": x, "y": y, **values})


def _names(
    path: Path, given: Mapping[str, Any], columns: dict[str, np.ndarray], parts: list[int]
) -> Iterator[str]:
    """Yield a name for each part of each feature; duplicates get numbers."""
    usual = given.get("name") or given.get("layer") or path.stem
    texts: list[str | None] = [None] * len(parts)
    column = attribute(columns, "name")
    if "field" in given:
        column = named_attribute(path, columns, given["field"])
    if column is not None and "name" not in given:
        texts = [_plain(value, "text") for value in column]
    names = [str(name or usual) for name, n in zip(texts, parts, strict=True) for _ in range(n)]
    yield from numbered(names)


def numbered(names: Sequence[str]) -> Iterator[str]:
    """Yield the names, with numbers added to repeated names."""
    often, count = Counter(names), Counter[str]()
    for name in names:
        count[name] += 1
        while often[name] > 1 and f"{name} {count[name]}" in often:
            count[name] += 1
        yield name if often[name] == 1 else f"{name} {count[name]}"


def _plain(value: Any, kind: str) -> Any:
    """Attribute converted to the type of the case key; None if empty. Whole reals are accepted as
    integers."""
    if (value := plain(value)) is None:
        return None
    if kind == "logical":
        return LOGICAL.get(str(value).strip().lower(), value)
    if kind != "real" and isinstance(value, float) and value.is_integer():
        value = int(value)
    return str(value).strip() if kind == "text" else value
