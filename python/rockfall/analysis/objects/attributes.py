# SPDX-License-Identifier: BSD-3-Clause
"""Attributes of objects at risk, read from layer columns and checked against their ranges. Errors
give file, feature and attribute in one line."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NoReturn

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.vectors.layers import attribute, plain
from rockfall.language import remark

Columns = dict[str, np.ndarray]

NAMED = "lethality_curve"  # a text, although its name starts like a numeric attribute
FRACTIONS = ("vulnerability", "exposure", "presence", "lethality")  # names or prefixes
RANGES = {  # lowest and highest values of the other attributes
    "width": (0.0, 100.0),  # [m] same limits as in a case
    "speed": (1.0, 500.0),  # [km/h]
    "vehicle_length": (0.0, 1000.0),  # [m]
}

USUAL = {  # plausible range in a layer, and the probable unit outside it
    "width": (0.0, 50.0, "is the value in cm?"),  # [m]
    "speed": (25.0, 300.0, "is the value in m/s?"),  # [km/h]
    "vehicle_length": (1.5, 420.0, "is the value in cm?"),  # [m] from a bicycle to a train
    "aadt": (10.0, 1e5, "vehicles per day: is the value per hour, per year, or in thousands?"),
    "trips": (0.0, 50.0, "passages of a person per day: is the value per year?"),
    "persons_per_vehicle": (0.5, 500.0, "persons in a vehicle: is the value per day?"),
    "persons": (0.0, 1e4, "persons in one object: is the value for all objects?"),
}

NEEDED = {  # attributes that only have an effect if the layer also has one of these
    "curve": ("value",),
    "exposure": ("value", "vulnerability"),
    "presence": ("persons",),
    "lethality": ("persons", "aadt"),
    NAMED: ("persons", "aadt"),
    "speed": ("aadt",),
    "vehicle_length": ("aadt",),
    "persons_per_vehicle": ("aadt",),
    "trips": ("aadt",),
}


@dataclass(frozen=True)
class Layer:
    """Path and columns of a layer; names are in lower case."""

    path: str
    columns: Columns
    size: int
    asked: set[str] = field(default_factory=set)  # requested attributes

    def has(self, name: str) -> bool:
        self.asked.add(name)
        return attribute(self.columns, name) is not None

    def numbers(self, name: str, default: float, *, missing: bool = False) -> np.ndarray:
        """Values of an attribute; `default` if the layer lacks it. If `missing`, single objects may
        lack it (NaN). Raises a RockfallError for other values that are no numbers in the valid
        range."""
        self.asked.add(name)
        values = attribute(self.columns, name)
        if values is None:
            return np.full(self.size, default)
        low, high, rule = _range(name)
        if missing and values.dtype.kind == "O" and all(plain(value) is None for value in values):
            return np.full(self.size, np.nan)
        if values.dtype.kind not in "iufb":
            raise RockfallError(f"{self.path}: attribute {name}: must be a number, {rule}")
        for number, value in enumerate(values.tolist()):
            is_valid = low <= value <= high and math.isfinite(value)
            if not is_valid and not (missing and math.isnan(value)):
                self.refuse(number, name, value, f"must be {rule}")
        return values.astype(float)

    def unit_remarks(self) -> Iterator[str]:
        """Remarks on attributes that are probably in another unit."""
        for name, (low, high, question) in USUAL.items():
            if name not in self.asked or not self.has(name):
                continue
            values = self.numbers(name, math.nan, missing=True)
            odd = np.flatnonzero(((values < low) & (values > 0)) | (values > high))
            if odd.size:
                yield (
                    f"{self.path}: feature {odd[0] + 1}: {name} = {values[odd[0]]:g}, as in "
                    f"{odd.size} of {self.size} features: {question}"
                )

    def idle_remarks(self) -> Iterator[str]:
        """Remarks on attributes without effect, because an attribute that they need is missing."""
        for name, needed in NEEDED.items():
            if attribute(self.columns, name) is None or name not in self.asked:
                continue
            if not {column.rstrip("_0123456789") for column in self.columns} & {*needed}:
                yield remark(
                    self.path, "input.idle_attribute", name=name, needed=" / ".join(needed)
                )

    def texts(self, name: str) -> list[str]:
        """Texts of an attribute; "" for objects that lack it."""
        self.asked.add(name)
        values = attribute(self.columns, name)
        if values is None:
            return [""] * self.size
        return ["" if (text := plain(value)) is None else str(text).strip() for value in values]

    def refuse(self, number: int, name: str, value: object, rule: str) -> NoReturn:
        """Raise a RockfallError about an attribute of a feature, numbered from 0."""
        raise RockfallError(f"{self.path}: feature {number + 1}: {name} = {value}: {rule}")

    def by_intensity(self, name: str, intensities: int, *, missing: bool = False) -> np.ndarray:
        """Values (objects, intensities) of an attribute: of `name` for all intensities, or of
        name_1, name_2, ...; empty if the layer has neither. Raises a RockfallError for other
        numbers of columns, and for values that decrease with the intensity."""
        several = [f"{name}_{k}" for k in range(1, intensities + 1)]
        self.asked.update((name, *several))
        given = [column for column in self.columns if column.startswith(name) and column != NAMED]
        if not given:
            return np.empty((0, intensities))
        if given == [name]:
            column = self.numbers(name, math.nan, missing=missing)
            return np.repeat(column[:, None], intensities, axis=1)
        if {*given} != {*several}:
            raise RockfallError(
                f"{self.path}: attributes {', '.join(given)}: must be {name}, or {several[0]} to "
                f"{several[-1]}: one for each intensity"
            )
        columns = [self.numbers(name, math.nan, missing=missing) for name in several]
        values = np.stack(columns, axis=1)
        if (falls := np.argwhere(np.diff(values, axis=1) < 0)).size:
            number, k = falls[0]
            raise RockfallError(
                f"{self.path}: feature {number + 1}: {several[k + 1]}: must not be below "
                f"{several[k]}"
            )
        for number in np.flatnonzero(np.isnan(values).any(axis=1) & ~np.isnan(values).all(axis=1)):
            k = int(np.isnan(values[number]).argmax())
            self.refuse(int(number), several[k], "nan", "must be 0 to 1")
        return values


def _range(name: str) -> tuple[float, float, str]:
    """Lowest and highest value of an attribute, and the rule as text."""
    low, high = RANGES.get(name, (0.0, math.inf))
    if name.startswith(FRACTIONS):
        low, high = 0.0, 1.0
    return low, high, f">= {low:g}" if high == math.inf else f"{low:g} to {high:g}"
