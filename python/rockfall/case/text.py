# SPDX-License-Identifier: BSD-3-Clause
"""Namelist texts, which the kernel reads and this module writes."""

import json
import weakref
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.errors import RockfallError, check_kernel

WIDTH = 72  # columns, after which a list continues on the next line
VALUE_COLUMN = 44  # column at which comments start
KEPT = 8  # number of texts whose values are cached


class Values(NamedTuple):
    """Values of a group, in their types."""

    name: str
    given: dict[str, Any]
    usual: dict[str, Any]  # defaults of keys that are not given

    def all(self) -> dict[str, Any]:
        """Given values and defaults, by key."""
        return self.usual | self.given


class KernelValues:
    """Groups of a text or case in the kernel; deleting this object frees them."""

    def __init__(
        self, handle: int, facts: np.ndarray, length: int, code: int, message: bytes
    ) -> None:
        check_kernel(code, message)
        self._handle = handle
        weakref.finalize(self, _core.close_values, handle)
        self.facts: tuple[bool, ...] = tuple(facts.astype(bool).tolist())  # properties of a case
        self._json = _core.values_of(handle, length).tobytes()
        self.text = ""  # text of a case, once written

    def __index__(self) -> int:
        return self._handle

    def __reduce__(self) -> NoReturn:
        raise TypeError("a parsed case cannot be copied to another process")

    @property
    def groups(self) -> list[Values]:
        """Values of the groups, in order; the caller may change the copy."""
        return [Values(*group) for group in json.loads(self._json)]


_READ: dict[tuple[bytes, str, str], KernelValues] = {}  # cached texts, oldest first


def read_values(text: bytes, name: str, form: str = "any") -> KernelValues:
    """Read the groups of a text. `form` is "case" (checked and completed), "any" (unknown keys are
    allowed), or "defaults" (defaults of all case groups, regardless of the text)."""
    if (kept := _READ.get((text, name, form))) is not None:
        return kept
    read = KernelValues(*_core.read_values(form, *kernel_text(text, name)))
    remember(text, name, form, read)
    return read


def remember(text: bytes, name: str, form: str, values: KernelValues) -> None:
    """Cache the values of a text that is often needed, such as the case of a result."""
    _READ[text, name, form] = values
    for oldest in [*_READ][:-KEPT]:
        _READ.pop(oldest, None)


def changed_values(
    values: KernelValues, removed: Iterable[str], text: bytes, name: str
) -> KernelValues:
    """Values of a case without the groups or keys (`group%key`) in `removed`, plus `text`'s."""
    words = " ".join(removed) or " "
    return KernelValues(*_core.change_case(values, words, *kernel_text(text, name)))


def read_groups(text: str, name: str) -> dict[str, dict[str, Any]]:
    """Values by group and key, from a text in which no group is repeated."""
    return {group.name: group.given for group in read_values(text.encode(), name).groups}


def kernel_text(text: bytes, name: str) -> tuple[bytes, bytes]:
    """Encode a text and its name for the kernel; refuses a zero byte, which would end the text."""
    if b"\0" in text:
        raise RockfallError(f"{name}: character code 0 is not text")
    return text or b"\n", name.encode()


def plain_values(values: Mapping[str, Any]) -> dict[str, Any]:
    """Convert NumPy numbers, arrays, paths and tuples to namelist types; drop empty values."""

    def plain(value: Any) -> Any:
        if isinstance(value, Path):
            return str(value)
        if hasattr(value, "tolist"):
            return value.tolist()
        return list(value) if isinstance(value, tuple) else value

    plain_keys = {key.lower(): plain(value) for key, value in values.items()}
    return {key: value for key, value in plain_keys.items() if value is not None and value != []}


def namelist_text(groups: Mapping[str, Any], indent: int = 4) -> str:
    """Text of a namelist file that reproduces these values when read: non-empty groups, then
    repeated groups (lists)."""
    single = {name: keys for name, keys in groups.items() if isinstance(keys, Mapping)}
    texts = [_group_text(name, keys, " " * indent) for name, keys in sorted(single.items()) if keys]
    for name, several in groups.items():
        if name not in single:
            texts += [_group_text(name, values, " " * indent) for values in several]
    return "\n".join(texts)


def _group_text(name: str, values: Mapping[str, Any], indent: str) -> str:
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
    """Text of one or several values in namelist format."""
    if isinstance(value, float):
        return float.__repr__(value)
    if isinstance(value, list | tuple):
        return ", ".join(map(literal, value))
    if isinstance(value, bool):
        return ".true." if value else ".false."
    return "'" + value.replace("'", "''") + "'" if isinstance(value, str) else str(value)


class Entry(NamedTuple):
    """Key and value in a commented text; a disabled entry is written as a comment."""

    key: str
    value: Any
    comment: str = ""
    on: bool = True


class Group(NamedTuple):
    """Group in a commented text."""

    name: str
    entries: list[Entry]
    comment: str = ""


def case_text(head: Iterable[str], groups: Iterable[Group], foot: Iterable[str]) -> str:
    """Text of a case with comments."""
    lines = [_comment(line) for line in head]
    for group in groups:
        lines += ["", *_commented_lines(group)]
    foot = [_comment(line) for line in foot]
    return "\n".join([*lines, *([""] if foot else []), *foot, ""])


def _comment(text: str) -> str:
    """Comment in a single line, even if file or layer names contain line breaks."""
    return f"! {' '.join(text.splitlines())}"


def _commented_lines(group: Group) -> Iterator[str]:
    if group.comment:
        yield _comment(group.comment)
    yield f"&{group.name}"
    for key, value, comment, on in group.entries:
        line = f"    {'' if on else '! '}{key} = {literal(value)}"
        yield f"{line:<{VALUE_COLUMN}} {_comment(comment)}" if comment else line
    yield "/"
