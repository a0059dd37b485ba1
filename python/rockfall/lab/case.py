# SPDX-License-Identifier: BSD-3-Clause
"""The case of the laboratory: what is packed, what is fired at it, and what is made of it.

A namelist file with the groups &lab, &material, &packing, &impact and &correction. Whatever is not
given has its default; names and defaults of the physics stand in the kernel alone.
"""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from rockfall._lab import lab_f2py as _lab
from rockfall.errors import RockfallError

COEFFICIENTS = tuple(f"a{k}" for k in range(1, 10))
PLAN = {"title": "", "seed": 1, "ratios": [1, 2, 3, 4, 5], "points": 200, "impacts": 100}
SWITCHES = "periodic", "by_mass"
WHOLE = "retries", "seed", "points", "impacts"
RANGED = "speed", "angle", "spin"  # of an impact, drawn between two values
SET_ELSEWHERE = "radius", "aim", "gravity"  # of an impact: by its ratio, its point, the packing


@cache
def names(kind: int) -> tuple[str, ...]:
    """Names in the kernel's rows: 1 material, 2 packing, 3 impact, 4 ranges, 5 outcome, 6 its
    counts, 7 layer."""
    return tuple(_lab.names(kind).decode().split())


@cache
def _defaults() -> dict[str, dict[str, Any]]:
    material, packing, shot, limits = (
        dict(zip(names(kind), _lab.defaults(kind).tolist(), strict=False)) for kind in range(1, 5)
    )
    impact = {key: value for key, value in shot.items() if key not in (*SET_ELSEWHERE, *RANGED)}
    impact |= {key: [limits[f"{key}_min"], limits[f"{key}_max"]] for key in RANGED}
    groups = {"lab": dict(PLAN), "material": material, "packing": packing, "impact": impact}
    for values in groups.values():
        values |= {key: bool(values[key]) for key in SWITCHES if key in values}
        values |= {key: int(values[key]) for key in WHOLE if key in values}
    return groups | {"correction": dict.fromkeys(COEFFICIENTS, 1.0)}


def read_lab_case(path: str | Path) -> LabCase:
    """The laboratory case in a namelist file."""
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise RockfallError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise RockfallError(f"{path}: is not text (UTF-8)") from error
    return lab_case_of(text, str(path))


def lab_case_of(text: str, name: str) -> LabCase:
    """The laboratory case in a text."""
    import f90nml

    try:
        groups = f90nml.reads(text).todict()
    except Exception as error:  # f90nml raises whatever its tokens led to
        raise RockfallError(f"{name}: is not a namelist file: {error}") from error
    return LabCase(name=name, **groups)


class LabCase:
    """A laboratory case, group by group: `case.packing["depth"]`.

    `lab`: title, seed, ratios R_b/R_m, points for each ratio (each on a layer of its own), impacts
    at each point. `correction`: factors on the means of a1..a9, the second stage of a calibration.
    """

    def __init__(self, *, name: str = "laboratory case", **groups: Mapping[str, Any]) -> None:
        self.name = name
        known = _defaults()
        self._groups: dict[str, dict[str, Any]] = {}
        for group in groups:
            if group not in known:
                raise RockfallError(f"{name}: &{group}: unknown group; known: {', '.join(known)}")
            if not isinstance(groups[group], Mapping):
                raise RockfallError(f"{name}: &{group}: stands more than once")
        for group, defaults in known.items():
            given = {key.lower(): value for key, value in groups.get(group, {}).items()}
            for key in given:
                if key not in defaults:
                    allowed = ", ".join(defaults)
                    raise RockfallError(f"{name}: &{group} {key}: unknown key; known: {allowed}")
            self._groups[group] = {
                key: self._typed(group, key, given.get(key, value), value)
                for key, value in defaults.items()
            }
        self._check()

    def __getattr__(self, group: str) -> dict[str, Any]:
        try:
            return self.__dict__["_groups"][group]
        except KeyError:
            raise AttributeError(f"a laboratory case has no group {group!r}") from None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, LabCase) and self._groups == other._groups

    __hash__ = None

    def replace(self, **groups: Mapping[str, Any]) -> LabCase:
        """With other values: `case.replace(packing={"depth": 6})`."""
        changed = dict(self._groups)
        for name, values in groups.items():
            changed[name] = {**changed.get(name, {}), **values}
        return LabCase(name=self.name, **changed)

    def text(self) -> str:
        """The case, every value, as the text of a namelist file."""
        import f90nml

        text = io.StringIO()
        namelist = f90nml.Namelist(self._groups)
        namelist.indent = 2
        namelist.write(text)
        return text.getvalue()

    def row(self, kind: int, ratio: float = 1.0) -> np.ndarray:
        """A row of the kernel, in the order of `names(kind)`; `ratio` sets the sphere's radius."""
        middle = {key: sum(self.impact[key]) / 2 for key in RANGED}  # in place of what is drawn
        values = {
            1: self.material,
            2: self.packing,
            3: self.impact
            | middle
            | {
                "radius": ratio * self.packing["mean_radius"],
                "aim": 0.5,
                "gravity": self.packing["gravity"],
            },
            4: {
                f"{key}_{end}": value
                for key in RANGED
                for end, value in zip(("min", "max"), self.impact[key], strict=True)
            },
        }[kind]
        return np.array([float(values[key]) for key in names(kind)])

    def _typed(self, group: str, key: str, value: Any, default: Any) -> Any:
        about = f"{self.name}: &{group} {key} = {value}"
        if isinstance(default, list):
            values = list(value) if isinstance(value, (list, tuple, np.ndarray)) else [value]
            if len(values) != 2 and key in RANGED:
                raise RockfallError(f"{about}: must be two values, least and greatest")
            return [self._number(about, one) for one in values]
        if isinstance(default, bool | str):
            if not isinstance(value, type(default)):
                wanted = "text" if isinstance(default, str) else ".true. or .false."
                raise RockfallError(f"{about}: must be {wanted}")
            return value
        number = self._number(about, value)
        if isinstance(default, int):
            if number != int(number):
                raise RockfallError(f"{about}: must be a whole number")
            return int(number)
        return number

    @staticmethod
    def _number(about: str, value: Any) -> float:
        if isinstance(value, bool | str) or not math.isfinite(value):
            raise RockfallError(f"{about}: must be a number")
        return float(value)

    def _check(self) -> None:
        plan = self.lab
        for key, least, most in (
            ("seed", 0, 2**63 - 1),
            ("points", 1, 10**6),
            ("impacts", 1, 10**6),
        ):
            if not least <= plan[key] <= most:
                about = f"{self.name}: &lab {key} = {plan[key]}"
                raise RockfallError(f"{about}: must be {least} to {most}")
        ratios = plan["ratios"]
        if not ratios or min(ratios) <= 0 or len(set(ratios)) < len(ratios):
            raise RockfallError(f"{self.name}: &lab ratios = {ratios}: must be > 0, each once")
        for key in RANGED:
            if self.impact[key][0] > self.impact[key][1]:
                about = f"{self.name}: &impact {key} = {self.impact[key]}"
                raise RockfallError(f"{about}: must be least and greatest")
        for key, factor in self.correction.items():
            if abs(factor) > 100:
                about = f"{self.name}: &correction {key} = {factor}"
                raise RockfallError(f"{about}: must be -100 to 100")
        for ratio in ratios:  # what the kernel refuses
            rows = self.row(1), self.row(2), self.row(3, ratio), self.row(4)
            code, message = _lab.check_case(*rows)
            if code:
                raise RockfallError(f"{self.name}: {message.decode().strip()}", code)
