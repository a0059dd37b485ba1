# SPDX-License-Identifier: BSD-3-Clause
"""The files of impact sets that a case may name: shipped with the program, or beside the case."""

from __future__ import annotations

import importlib.resources
import os
from functools import cache
from pathlib import Path

from rockfall.case import Case
from rockfall.errors import RockfallError


@cache
def shipped_sets() -> dict[str, Path]:
    """Files of the impact sets that are shipped with the program, by name."""
    folder = Path(str(importlib.resources.files("rockfall") / "data" / "impact_sets"))
    return {path.stem: path for path in sorted(folder.glob("*.nml"))}


def set_path(case: Case, name: str | None = None, group: str = "impact") -> Path:
    """The file of impact sets, the case's or those that a group names: shipped, or beside it."""
    name, shipped = name or case.impact["sets"], shipped_sets()
    if name in shipped:
        return shipped[name]
    if os.path.isfile(case.path(name)):
        return case.path(name)
    known = ", ".join(shipped)
    raise RockfallError(
        f"{case.name}: &{group} sets = '{name}': no such file; shipped sets: {known}"
    )
