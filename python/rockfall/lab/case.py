# SPDX-License-Identifier: BSD-3-Clause
"""The case of the laboratory: what is packed, what is fired at it, and what is made of it.

A namelist file with the groups &lab, &material, &packing and &impact. Whatever is not given has its
default; names and defaults of the physics stand in the kernel alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from rockfall._lab import lab_f2py as _lab
from rockfall.case import check_namelist, namelist_text, plain_values
from rockfall.errors import RockfallError
from rockfall.io.files import read_text

COEFFICIENTS = tuple(f"a{k}" for k in range(1, 10))
SWITCHES = "rigid_base", "by_mass"
WHOLE = "retries", "seed", "layers", "points", "impacts"
RANGED = "speed", "angle", "spin"  # of an impact, drawn: min, median, max
ENDS = "min", "median", "max"
#: Of an impact and a packing: by the ratio, the point, the packing.
SET_ELSEWHERE = "radius", "aim_x", "aim_y", "heading_x", "heading_y", "gravity"


@cache
def names(kind: int) -> tuple[str, ...]:
    """Names in the kernel's rows: 1 material, 2 packing, 3 impact, 4 ranges, 5 outcome, 6 its
    counts, 7 layer, 8 statuses of an outcome."""
    return tuple(_lab.names(kind).decode().split())


@cache
def _defaults() -> dict[str, dict[str, Any]]:
    material, packing, shot, limits = (
        dict(zip(names(kind), _lab.defaults(kind).tolist(), strict=False)) for kind in range(1, 5)
    )
    impact = {key: value for key, value in shot.items() if key not in (*SET_ELSEWHERE, *RANGED)}
    impact |= {key: [limits[f"{key}_{end}"] for end in ENDS] for key in RANGED}
    del packing["ratio"]
    seed, *ratios, layers, points, impacts = _lab.defaults(5)[:9].tolist()
    plan = {"title": "", "seed": seed, "ratios": ratios}
    plan |= {"layers": layers, "points": points, "impacts": impacts}
    groups = {"lab": plan, "material": material, "packing": packing, "impact": impact}
    for values in groups.values():
        values |= {key: bool(values[key]) for key in SWITCHES if key in values}
        values |= {key: int(values[key]) for key in WHOLE if key in values}
    return groups


def read_lab_case(path: str | Path) -> LabCase:
    """The laboratory case in a namelist file."""
    return lab_case_of(read_text(path), str(path))


def lab_case_of(text: str, name: str) -> LabCase:
    """The laboratory case in a text."""
    import f90nml

    _check(text, name)
    return LabCase(name=name, **f90nml.reads(text).todict())


def _check(text: str, name: str) -> None:
    if names_ground(text, name):
        raise RockfallError(
            f"{name}: &lab ground: is for `rockfall lab impact`, which throws blocks at it; this "
            "needs a case of rocks"
        )
    check_namelist(_lab.check_case, text.encode(), name)


def _like(value: Any, default: Any) -> Any:
    """A value that has been checked, with the type of the default."""
    if isinstance(default, list):
        return [float(one) for one in (value if isinstance(value, list) else [value])]
    return type(default)(value)


def names_ground(text: str, name: str) -> bool:
    """Does the text of a case name a ground, so that it is one of the laboratory of blocks?"""
    return bool(_lab.names_ground(text.encode() or b"\n", name.encode()))


class LabCase:
    """A laboratory case, group by group: `case.packing["depth"]`.

    `lab`: title, seed, ratios R_b/R_m, layers for each ratio, points on each, impacts at each.
    """

    def __init__(self, *, name: str = "laboratory case", **groups: Mapping[str, Any]) -> None:
        self.name = name
        given = {group: plain_values(values) for group, values in groups.items()}
        _check(namelist_text(given), name)
        self._groups = {
            group: {
                key: _like(given.get(group, {}).get(key, value), value)
                for key, value in defaults.items()
            }
            for group, defaults in _defaults().items()
        }

    def __getattr__(self, group: str) -> dict[str, Any]:
        try:
            return self.__dict__["_groups"][group]
        except KeyError:
            raise AttributeError(f"a laboratory case has no group {group!r}") from None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, LabCase) and self._groups == other._groups

    def replace(self, **groups: Mapping[str, Any]) -> LabCase:
        """With other values: `case.replace(packing={"depth": 6})`."""
        changed = dict(self._groups)
        for name, values in groups.items():
            changed[name] = {**changed.get(name, {}), **values}
        return LabCase(name=self.name, **changed)

    def text(self) -> str:
        """The case, every value, as the text of a namelist file."""
        return namelist_text(self._groups, indent=2)

    def row(self, kind: int, ratio: float = 1.0) -> np.ndarray:
        """A row of the kernel, in the order of `names(kind)`; `ratio` is R_b/R_m."""
        median = {key: self.impact[key][1] for key in RANGED}  # in place of what is drawn
        place = {"aim_x": 0.5, "aim_y": 0.5, "heading_x": 1.0, "heading_y": 0.0}
        radius, gravity = ratio * self.packing["mean_radius"], self.packing["gravity"]
        values = {
            1: self.material,
            2: self.packing | {"ratio": ratio},
            3: self.impact | median | place | {"radius": radius, "gravity": gravity},
            4: {
                f"{key}_{end}": value
                for key in RANGED
                for end, value in zip(ENDS, self.impact[key], strict=True)
            },
        }[kind]
        return np.array([float(values[key]) for key in names(kind)])
