# SPDX-License-Identifier: BSD-3-Clause
"""Text in namelist format: read by the kernel, and written here."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from rockfall._core import rockfall_f2py as _core
from rockfall.errors import RockfallError, check_kernel

WIDTH = 72  # columns after which a list continues on the next line
VALUE_COLUMN = 44  # column at which comments begin
#: Bytes of JSON that are more than the kernel makes of a short text; a longer one needs more.
ROOM, ROOM_PER_BYTE = 2**15, 3

Groups = Mapping[str, Mapping[str, Any]]


class Values(NamedTuple):
    """Values of a group in their types."""

    name: str
    given: dict[str, Any]
    usual: dict[str, Any]  # defaults of keys that are not given

    def all(self) -> dict[str, Any]:
        """All values."""
        return self.usual | self.given


class Read(NamedTuple):
    """Groups that the kernel found in a text."""

    groups: list[Values]
    facts: tuple[bool, ...]  # of a case


def read_values(text: bytes, name: str, form: str = "any") -> Read:
    """Values of the groups of a text, in its order. `form` is "case", which is checked and
    complete; "defaults", those of every group of a case, whatever the text; or "any", with
    unknown keys."""
    document, facts = _read(text, name, form)
    return Read([Values(*group) for group in json.loads(document)], facts)


@lru_cache(maxsize=8)
def _read(text: bytes, name: str, form: str) -> tuple[bytes, tuple[bool, ...]]:
    """JSON of the values, and facts of a case: cached, because a result's case is used often."""
    room = ROOM + ROOM_PER_BYTE * len(text)
    while True:
        facts, document, length, *status = _core.values_of(form, *kernel_text(text, name), room)
        check_kernel(*status)
        if length <= room:
            return document[:length].tobytes(), tuple(facts.astype(bool).tolist())
        room = length


def read_groups(text: str, name: str) -> dict[str, dict[str, Any]]:
    """Values of a text in which each group is there once."""
    return {group.name: group.given for group in read_values(text.encode(), name).groups}


def kernel_text(text: bytes, name: str) -> tuple[bytes, bytes]:
    """A text and its name for the kernel, which would stop reading at a zero."""
    if b"\0" in text:
        raise RockfallError(f"{name}: character code 0 is not text")
    return text or b"\n", name.encode()


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


def namelist_text(
    groups: Groups, lists: Mapping[str, Iterable[Mapping]] | None = None, indent: int = 4
) -> str:
    """Text of a namelist file with the non-empty groups and repeated groups, which reads as equal
    values."""
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
        literals = [*map(literal, value if isinstance(value, list) else [value])]
        for written in literals[:-1]:
            line += f"{written}, "
            if len(line) >= WIDTH:
                lines.append(line.rstrip())
                line = blank
        lines.append(line + literals[-1])
    return "\n".join([*lines, "/", ""])


def literal(value: Any) -> str:
    """A value, or several, in namelist format."""
    if isinstance(value, float):
        return float.__repr__(value)
    if isinstance(value, list | tuple):
        return ", ".join(map(literal, value))
    if isinstance(value, bool):
        return ".true." if value else ".false."
    return "'" + value.replace("'", "''") + "'" if isinstance(value, str) else str(value)


class Entry(NamedTuple):
    """A key and its value, in a text with comments; a disabled one is written as a comment."""

    key: str
    value: Any
    comment: str = ""
    on: bool = True


class Group(NamedTuple):
    """A group in a text with comments."""

    name: str
    entries: list[Entry]
    comment: str = ""


def case_text(head: Iterable[str], groups: Iterable[Group], foot: Iterable[str]) -> str:
    """Text of a case with comments, as its author would write it."""
    lines = [_comment(line) for line in head]
    for group in groups:
        lines += ["", *_commented_lines(group)]
    foot = [_comment(line) for line in foot]
    return "\n".join([*lines, *([""] if foot else []), *foot, ""])


def _comment(text: str) -> str:
    """Comment on one line, whatever the names of files and layers contain."""
    return f"! {' '.join(text.splitlines())}"


def _commented_lines(group: Group) -> Iterator[str]:
    if group.comment:
        yield _comment(group.comment)
    yield f"&{group.name}"
    for key, value, comment, on in group.entries:
        line = f"    {'' if on else '! '}{key} = {literal(value)}"
        yield f"{line:<{VALUE_COLUMN}} {_comment(comment)}" if comment else line
    yield "/"
