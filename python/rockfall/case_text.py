# SPDX-License-Identifier: BSD-3-Clause
"""Text of a case with comments, as its author would write it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

VALUE_COLUMN = 44  # column at which comments begin


class Entry(NamedTuple):
    """A key and its value; a disabled one is written as a comment."""

    key: str
    value: Any
    comment: str = ""
    on: bool = True


class Group(NamedTuple):
    """A group of a case."""

    name: str
    entries: list[Entry]
    comment: str = ""


def case_text(head: Iterable[str], groups: Iterable[Group], foot: Iterable[str]) -> str:
    """Text of a case between comments."""
    lines = [_comment(line) for line in head]
    for group in groups:
        lines += ["", *_group_lines(group)]
    foot = [_comment(line) for line in foot]
    return "\n".join([*lines, *([""] if foot else []), *foot, ""])


def _comment(text: str) -> str:
    """Comment on one line, whatever the names of files and layers contain."""
    return f"! {' '.join(text.splitlines())}"


def _group_lines(group: Group) -> Iterator[str]:
    if group.comment:
        yield _comment(group.comment)
    yield f"&{group.name}"
    for key, value, comment, on in group.entries:
        line = f"    {'' if on else '! '}{key} = {_literal(value)}"
        yield f"{line:<{VALUE_COLUMN}} {_comment(comment)}" if comment else line
    yield "/"


def _literal(value: Any) -> str:
    """A value in namelist format."""
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_literal, value))
    if isinstance(value, bool):
        return ".true." if value else ".false."
    if isinstance(value, str):
        return "'" + value.replace("'", "''") + "'"
    return repr(value)
