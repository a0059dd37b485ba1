# SPDX-License-Identifier: BSD-3-Clause
"""Files of impact sets, shipped or next to the case."""

import importlib.resources
import os
from functools import cache
from pathlib import Path

from rockfall.case import Case
from rockfall.errors import RockfallError

RENAMED = {
    "rocky-slope": "laboratory-spheres",
    "rocky-slope-ensemble": "laboratory-spheres-ensemble",
}


@cache
def shipped_sets() -> dict[str, Path]:
    """Files of shipped impact sets, by name."""
    folder = Path(str(importlib.resources.files("rockfall") / "data" / "impact_sets"))
    return {path.stem: path for path in sorted(folder.glob("*.nml"))}


def find_set(case: Case, name: str) -> Path | None:
    """File of impact sets with this name, shipped or next to the case; None if not found."""
    if name in shipped_sets():
        return shipped_sets()[name]
    return case.path(name) if os.path.isfile(case.path(name)) else None


def set_path(case: Case, name: str | None = None, group: str = "impact") -> Path:
    """File of impact sets (default: those of the case), shipped or next to the case; raises a
    RockfallError if not found."""
    name = name or case.impact["sets"]
    if path := find_set(case, name):
        return path
    if name in RENAMED:
        raise RockfallError(
            f"{case.name}: &{group} sets = '{name}': was renamed to '{RENAMED[name]}'"
        )
    names = ", ".join(shipped_sets())
    raise RockfallError(
        f"{case.name}: &{group} sets = '{name}': no such file (shipped sets: {names}). Give impact "
        "tables in &impact table"
    )
