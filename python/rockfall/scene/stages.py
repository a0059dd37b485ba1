# SPDX-License-Identifier: BSD-3-Clause
"""Reading stages, which an open session repeats only if their inputs have changed."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from operator import is_
from pathlib import Path
from typing import Any, TypeVar

from rockfall.case import REPEATABLE, Case
from rockfall.case.files import group_files

T = TypeVar("T")


class Stages:
    """Stages of reading a case without a cache: each call of `take` computes its stage."""

    def take(
        self,
        name: str,
        case: Case,
        uses: tuple[Any, ...],
        make: Callable[[Case], T],
        reads: bool = True,
    ) -> T:
        """Result of `make(case)`, which depends only on the case, the objects `uses`, and files if
        `reads`."""
        return make(case)

    def find(self, name: str, uses: tuple[Any, ...]) -> Any:
        """Result stored by `keep` with the same objects; None if there is none."""
        return None

    def keep(self, name: str, uses: tuple[Any, ...], result: Any) -> None:
        """Store a result that depends only on these objects."""


FRESH = Stages()


@dataclass(frozen=True)
class _Kept:
    """Result of a stage, with the inputs on which it depends."""

    uses: tuple[Any, ...]  # compared by identity, as none is changed in place
    seen: dict[str, Any]  # case groups that were read, by name
    states: dict[Path, Any]  # states of the files in these groups
    result: Any

    def is_of(self, uses: tuple[Any, ...]) -> bool:
        """Return True if the result depends on exactly these objects."""
        return len(self.uses) == len(uses) and all(map(is_, self.uses, uses))

    def holds(self, case: Case, uses: tuple[Any, ...]) -> bool:
        """Return True if the case, the objects and the files are unchanged."""
        return (
            self.is_of(uses)
            and all(getattr(case, group) == value for group, value in self.seen.items())
            and all(_state(path) == state for path, state in self.states.items())
        )


class KeptStages(Stages):
    """Stages that keep their results between readings."""

    def __init__(self, kept: dict[str, _Kept] | None = None) -> None:
        self._kept = kept or {}

    def copy(self) -> KeptStages:
        """Copy that starts with these results and leaves the original unchanged."""
        return KeptStages(dict(self._kept))

    def take(
        self,
        name: str,
        case: Case,
        uses: tuple[Any, ...],
        make: Callable[[Case], T],
        reads: bool = True,
    ) -> T:
        kept = self._kept.get(name)
        if kept is None or not kept.holds(case, uses):
            watched = WatchedCase(case, reads)
            result = make(watched)
            kept = self._kept[name] = _Kept(uses, watched.seen, watched.states, result)
        return kept.result

    def find(self, name: str, uses: tuple[Any, ...]) -> Any:
        kept = self._kept.get(name)
        return kept.result if kept and kept.is_of(uses) else None

    def keep(self, name: str, uses: tuple[Any, ...], result: Any) -> None:
        self._kept[name] = _Kept(uses, {}, {}, result)


class WatchedCase(Case):
    """A case that records which groups are read and, for a stage that `reads` files, the states of
    the files in these groups before reading."""

    def __init__(self, case: Case, reads: bool) -> None:
        self.__dict__ |= case.__dict__
        self.__dict__ |= {"seen": {}, "states": {}, "_original": case, "_reads": reads}

    def __getattribute__(self, name: str) -> Any:
        value = super().__getattribute__(name)
        if name in REPEATABLE:
            self._note(name, value)
        elif name in ("_groups", "_given"):  # reading all groups, to write a text or another case
            state = self.__dict__
            for group in (*state["_groups"], *REPEATABLE):
                self._note(group, state[group] if group in REPEATABLE else state["_groups"][group])
        return value

    def __getattr__(self, group: str) -> dict[str, Any]:
        value = super().__getattr__(group)
        self._note(group, value)
        return value

    def _note(self, group: str, value: Any) -> None:
        state = self.__dict__
        if group not in state["seen"]:
            state["seen"][group] = value
            for path in group_files(state["_original"], group) if state["_reads"] else ():
                state["states"][path] = _state(path)


def _state(path: Path) -> tuple[int, int, int] | None:
    """Marker that changes when a file is rewritten; None for a missing file."""
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino
