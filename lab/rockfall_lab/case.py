# SPDX-License-Identifier: BSD-3-Clause
"""Cases of the laboratory: layers, impacts, and the resulting sets.

A case is a namelist file with the groups &lab, &material, &packing and &impact. A case with a group
&throw throws boulders at the layers instead of simulating single impacts. Missing values have
defaults; the kernel defines names and defaults of the physics.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from rockfall.case.text import kernel_text, namelist_text, plain_values, read_groups
from rockfall.errors import RockfallError, check_kernel
from rockfall.io.files import read_text
from rockfall_lab._lab import lab_f2py as _lab

COEFFICIENTS = tuple(f"a{k}" for k in range(1, 10))
SWITCHES = "rigid_base", "by_mass", "clumps", "adaptive"
WHOLE = "retries", "seed", "layers", "points", "impacts", "on_layer", "contacts"
ADDED = ("packing", "clumps"), ("throw", "shape"), ("throw", "adaptive")  # not in old tables
RANGED = "speed", "angle", "spin"  # random values of an impact: min, median, max
ENDS = "min", "median", "max"
THROWN = {"slope": ("min", "max"), "speed": ENDS, "angle": ENDS, "spin": ENDS}  # drawn for a throw
#: Keys of impact and packing that follow from the ratio, the point or the packing.
SET_ELSEWHERE = "radius", "aim_x", "aim_y", "heading_x", "heading_y", "gravity"


@cache
def names(kind: str) -> tuple[str, ...]:
    """Names in the kernel's rows of a kind, such as `outcome` or `status`."""
    return tuple(_lab.names(kind).decode().split())


@cache
def _defaults() -> dict[str, dict[str, Any]]:
    material, packing, shot, limits = (
        dict(zip(names(kind), _lab.defaults(kind).tolist(), strict=False))
        for kind in ("material", "packing", "shot", "range")
    )
    impact = {key: value for key, value in shot.items() if key not in (*SET_ELSEWHERE, *RANGED)}
    impact |= {key: [limits[f"{key}_{end}"] for end in ENDS] for key in RANGED}
    del packing["ratio"]
    seed, *ratios, layers, points, impacts = _lab.defaults("case")[:9].tolist()
    plan = {"title": "", "seed": seed, "ratios": ratios}
    plan |= {"layers": layers, "points": points, "impacts": impacts}
    groups = {"lab": plan, "material": material, "packing": packing, "impact": impact}
    groups["throw"] = _throw_defaults()
    for values in groups.values():
        values |= {key: bool(values[key]) for key in SWITCHES if key in values}
        values |= {key: int(values[key]) for key in WHOLE if key in values}
    return groups


def _throw_defaults() -> dict[str, Any]:
    boulder = dict(zip(names("boulder"), _lab.defaults("boulder").tolist(), strict=False))
    limits = dict(zip(names("throw"), _lab.defaults("throw").tolist(), strict=False))
    throws, on_layer, contacts, max_depth = _lab.defaults("throws")[:4].tolist()
    plan = {"throws": [throws], "on_layer": on_layer, "contacts": contacts}
    plan |= {"radius": boulder["radius"], "max_depth": max_depth, "relief": [boulder["relief"]]}
    plan["shape"] = names("shape")[int(boulder["shape"]) - 1]
    plan["adaptive"] = boulder["adaptive"]
    return plan | {key: [limits[f"{key}_{end}"] for end in ends] for key, ends in THROWN.items()}


def range_values(group: Mapping[str, Any]) -> dict[str, float]:
    """Ranges from which throws are drawn, by their kernel names."""
    return {
        f"{key}_{end}": value
        for key, ends in THROWN.items()
        for end, value in zip(ends, group[key], strict=True)
    }


def read_lab_case(path: str | Path) -> LabCase:
    """Read a laboratory case from a namelist file."""
    return lab_case_of(read_text(path), str(path))


def lab_case_of(text: str, name: str) -> LabCase:
    """Parse a laboratory case from a text."""
    _check(text, name)
    return LabCase(name=name, **read_groups(text, name))


def _check(text: str, name: str) -> None:
    if names_ground(text, name):
        raise RockfallError(
            f"{name}: &lab ground: is for `rockfall lab impact`, which throws blocks at it; this "
            "needs a case of rocks"
        )
    check_kernel(*_lab.check_case(*kernel_text(text.encode(), name)))


def like(value: Any, default: Any) -> Any:
    """Value converted to the type of the default, if possible."""
    if isinstance(default, list):
        return [float(number) for number in (value if isinstance(value, list) else [value])]
    try:
        return type(default)(value)
    except (TypeError, ValueError):
        return value  # the kernel reports the error


def names_ground(text: str, name: str) -> bool:
    """Return True if the text of a case has a ground, and so belongs to the block laboratory."""
    return bool(_lab.names_ground(*kernel_text(text.encode(), name)))


class LabCase:
    """Laboratory case, group by group: `case.packing["depth"]`.

    `lab`: title, seed, ratios R_b/R_m, layers per ratio, points per layer, impacts per point. A
    case that `throws` has a group `throw` instead of the keys for single impacts.
    """

    def __init__(self, *, name: str = "laboratory case", **groups: Mapping[str, Any]) -> None:
        self.name = name
        given = {group: plain_values(values) for group, values in groups.items()}
        _check(namelist_text(given), name)
        self._groups = {
            group: {
                key: like(given.get(group, {}).get(key, value), value)
                for key, value in defaults.items()
            }
            for group, defaults in _defaults().items()
            if group != "throw" or group in given
        }
        if self.throws:
            for group, key in (name.split(".") for name in names("impact_alone")):
                del self._groups[group][key]

    @property
    def throws(self) -> bool:
        """True if the case throws boulders and records sequences of contacts."""
        return "throw" in self._groups

    def throws_of(self, ratio: float) -> int:
        """Number of throws for a ratio R_b/R_m."""
        return int(self._at("throws", ratio))

    def relief_of(self, ratio: float) -> float:
        """Relief for a ratio R_b/R_m [degree]: standard deviation of the facets' slope along a
        line."""
        return self._at("relief", ratio)

    def _at(self, key: str, ratio: float) -> float:
        """Value for a ratio R_b/R_m from a list in &throw."""
        values = self.throw[key]
        return values[self.lab["ratios"].index(ratio) if len(values) > 1 else 0]

    def radius(self, ratio: float) -> float:
        """R_b for a ratio R_b/R_m [m]."""
        return self.throw["radius"] if self.throws else ratio * self.packing["mean_radius"]

    def __getattr__(self, group: str) -> dict[str, Any]:
        try:
            return self.__dict__["_groups"][group]
        except KeyError:
            raise AttributeError(f"a laboratory case has no group {group!r}") from None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, LabCase) and self._groups == other._groups

    def replace(self, **groups: Mapping[str, Any]) -> LabCase:
        """Return a copy with other values: `case.replace(packing={"depth": 6})`."""
        changed = dict(self._groups)
        for name, values in groups.items():
            changed[name] = {**changed.get(name, {}), **values}
        return LabCase(name=self.name, **changed)

    def text(self) -> str:
        """Complete case as the text of a namelist file. Newer keys are included only if they differ
        from the default, so that the text of older cases does not change."""
        groups = {group: dict(values) for group, values in self._groups.items()}
        for group, key in ADDED:
            if group in groups and groups[group][key] == _defaults()[group][key]:
                del groups[group][key]
        return namelist_text(groups, indent=2)

    def row(self, kind: str, ratio: float = 1.0) -> np.ndarray:
        """Kernel row in the order of `names(kind)`; `ratio` is R_b/R_m."""
        values = {
            "material": lambda: self.material,
            "packing": lambda: self._packing(ratio),
            "shot": lambda: self._shot(ratio),
            "range": lambda: {
                f"{key}_{end}": value
                for key in RANGED
                for end, value in zip(ENDS, self.impact[key], strict=True)
            },
            "throw": lambda: range_values(self.throw) | {"gravity": self.packing["gravity"]},
            "boulder": lambda: (
                self.impact
                | self.throw
                | {"shape": 1 + names("shape").index(self.throw["shape"])}
                | {"relief": self.relief_of(ratio)}
            ),
        }[kind]()
        return np.array([float(values[key]) for key in names(kind)])

    def _packing(self, ratio: float) -> dict[str, Any]:
        """Packing values, as in `packing_of_ratio` of the kernel."""
        values = self.packing | {"ratio": ratio}
        if self.throws:
            values["mean_radius"] = self.throw["radius"] / ratio
            values["depth"] = min(values["depth"], self.throw["max_depth"] / ratio)
        return values

    def _shot(self, ratio: float) -> dict[str, Any]:
        median = {key: self.impact[key][1] for key in RANGED}  # replaced by random values
        place = {"aim_x": 0.5, "aim_y": 0.5, "heading_x": 1.0, "heading_y": 0.0}
        gravity = self.packing["gravity"]
        return self.impact | median | place | {"radius": self.radius(ratio), "gravity": gravity}
