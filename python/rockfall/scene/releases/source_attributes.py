# SPDX-License-Identifier: BSD-3-Clause
"""Release attributes of polygons or points in a layer or table, with the names in
docs/releases.md. Other attributes are ignored; the case gives values for missing attributes."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NoReturn

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case, facts, keys_of
from rockfall.errors import RockfallError
from rockfall.grounds.impact_tables import BLOCK_SHAPES, BY_SOURCE
from rockfall.io.tables import decimal
from rockfall.io.vectors.layers import attribute, named_attribute, plain
from rockfall.result.variables import fields
from rockfall.scene.parts import Features

VALUES = fields("feature")  # kernel order: volume distributions first
VOLUMES = tuple(name for name in VALUES if name.startswith("volume_"))
VELOCITY = tuple(name for name in VALUES if name.startswith("velocity_"))
DENSITY = VALUES.index("density")
LAWS = tuple(fields("distribution")[:4])  # distributions, numbered from 1
AXES = ("a", "b", "c")  # block axes, as in surveys
MAX_AXIS_RATIO = 20.0  # longest over shortest axis; no block exceeds it
RANGE = re.compile(r"\s*([0-9.eE+]+)\s*(?:-|to)\s*([0-9.eE+]+)\s*")  # a volume class [m3]


@dataclass(frozen=True)
class Table:
    """Attributes of features, numbered from 0."""

    path: str
    columns: dict[str, np.ndarray]
    size: int
    where: Callable[[int], str]  # position of a feature, used in messages
    is_text: bool = False  # True if numbers are stored as text, as in CSV
    asked: set[str] = field(default_factory=set)  # names of requested attributes

    def refuse(self, k: int, name: str, value: Any, rule: str) -> NoReturn:
        raise RockfallError(f"{self.where(k)}: {name} = {value!r}: {rule}")

    def values(self, name: str) -> list[Any]:
        """Values of an attribute; None for empty or missing values."""
        self.asked.add(name)
        column = attribute(self.columns, name)
        return [None] * self.size if column is None else [*map(plain, column)]

    def numbers(self, name: str) -> np.ndarray:
        """Numbers of an attribute that is also a case key; NaN for missing values. Refuses values
        that the key refuses."""
        self.asked.add(name)
        column = attribute(self.columns, name)
        if column is None:
            return np.full(self.size, np.nan)
        if column.dtype.kind in "iuf":
            numbers = column.astype(float)
        else:
            numbers = np.array(
                [self.number(k, name, raw) for k, raw in enumerate(self.values(name))]
            )
        given = np.flatnonzero(~np.isnan(numbers))
        if given.size:
            first, rule = _core.check_numbers(*_key(name), numbers[given])
            if first:
                k = given[first - 1]
                raise RockfallError(
                    f"{self.where(k)}: {name} = {numbers[k]:.10g}: {rule.decode().strip()}"
                )
        return numbers

    def places(self, axis: str) -> np.ndarray:
        """Coordinates [m] of all features."""
        coordinates = self.numbers(axis)
        for k in np.flatnonzero(np.isnan(coordinates))[:1]:
            self.refuse(int(k), axis, "", "must be a number")
        return coordinates

    def number(self, k: int, name: str, value: Any) -> float:
        """Number in a cell of a column that may also contain texts; NaN if missing."""
        if value is None:
            return np.nan
        if self.is_text and np.isfinite(number := decimal(value)):
            return number
        if isinstance(value, bool | str) or not isinstance(value, int | float):
            self.refuse(k, name, value, "must be a number")
        return float(value)


def read_attributes(case: Case, table: Table, feature: np.ndarray) -> tuple[Features, np.ndarray]:
    """Return features with their attributes, and the frequency of each feature (NaN if missing).
    `feature` is the feature number of each source. Refuses the attribute `velocity`: its components
    are needed."""
    if attribute(table.columns, "velocity") is not None:
        raise RockfallError(
            f"{table.path}: attribute velocity: must be {', '.join(VELOCITY)} [m/s]"
        )
    law, volumes = _laws(case, table)
    rest = [table.numbers(name) for name in VALUES[len(VOLUMES) :]]
    given = np.array([*volumes, *rest]).T
    _check_source(case, table, law, given)
    names, frequency, shape = _names(case, table), table.numbers("frequency"), _shapes(table)
    _check_shapes(case, table, shape)
    if not law.any() and np.isnan(given).all():
        return Features(names, feature, shape=shape), frequency
    return Features(names, feature, law.astype("i4"), given, shape), frequency


def values_of(case: Case, features: Features | None) -> np.ndarray | None:
    """Density, drop height and velocity of each feature (features, 5); the case gives missing
    values. None if the features give none of them."""
    if features is None or features.value is None:
        return None
    boulder, release = case.boulder, case.release
    usual = [boulder["density"], release["drop_height"], *release["velocity"]]
    given = features.value[:, len(VOLUMES) :]
    return np.where(np.isnan(given), usual, given)


@cache
def _key(name: str) -> tuple[str, str]:
    """Group and name of the case key that corresponds to an attribute."""
    name = "velocity" if name in VELOCITY else "volume_mean" if name == "volume" else name
    groups = ("boulder", "release", "scenario")
    return next((group, name) for group in groups if name in keys_of(group))


def _laws(case: Case, table: Table) -> tuple[np.ndarray, np.ndarray]:
    """Volume distribution of each feature (0: as in the case), and its numbers (4, features)."""
    boulder, law = case.boulder, np.zeros(table.size, int)
    given = np.array([table.numbers(name) for name in VOLUMES])
    usual = boulder["volume"] if boulder["volume"] in LAWS else "fixed"
    law[~np.isnan(given).all(axis=0)] = 1 + LAWS.index(usual)
    law[~np.isnan(given[2:]).all(axis=0)] = 1 + LAWS.index("uniform")
    for k, value in enumerate(table.values("volume")):
        if isinstance(value, str) and value.strip() in LAWS:
            law[k] = 1 + LAWS.index(value.strip())
        elif value is not None:
            if isinstance(value, str) and not (table.is_text and np.isfinite(decimal(value))):
                table.refuse(k, "volume", value, f"must be a number [m3], or {', '.join(LAWS)}")
            law[k], given[0, k] = 1, _volume(table, k, "volume", value)
    for k, value in enumerate(table.values("volume_class")):
        if value is not None:
            match = RANGE.fullmatch(str(value))
            if not match:
                table.refuse(k, "volume_class", value, "must be MIN-MAX [m3]")
            law[k] = 1 + LAWS.index("uniform")
            given[2:, k] = [_volume(table, k, "volume_class", decimal(x)) for x in match.groups()]
    filled = given.copy()
    if boulder["volume"] in LAWS:
        for row, name in zip(filled, VOLUMES, strict=True):
            lacking = (law == 1 + LAWS.index(boulder["volume"])) & np.isnan(row)
            row[lacking] = boulder.get(name, np.nan)
    _check_laws(case, table, law, filled)
    return law, given


def _shapes(table: Table) -> np.ndarray | None:
    """Block shape of each feature, by name or axes; 0 if missing. None if all are missing."""
    shape = _axis_shapes(table)
    for k, value in enumerate(table.values("block_shape")):
        if value is None:
            continue
        if shape[k]:
            table.refuse(k, "block_shape", value, "give this or the axes a, b, c")
        if value not in BLOCK_SHAPES:
            table.refuse(k, "block_shape", value, f"must be one of: {', '.join(BLOCK_SHAPES)}")
        shape[k] = 1 + BLOCK_SHAPES.index(value)
    return shape if shape.any() else None


def has_axes(columns: dict[str, np.ndarray]) -> bool:
    """Return True if all three block axes are attributes; one or two have another meaning."""
    return all(attribute(columns, axis) is not None for axis in AXES)


def axes_of(table: Table) -> np.ndarray | None:
    """Block axes (3, features), NaN if missing; None unless all three attributes exist."""
    if not has_axes(table.columns):
        return None
    return np.array([
        [table.number(k, axis, value) for k, value in enumerate(table.values(axis))]
        for axis in AXES
    ])  # fmt: skip


def _axis_shapes(table: Table) -> np.ndarray:
    """Number of the block shape nearest to the axes of each feature; 0 without axes. Refuse
    incomplete axes."""
    shape = np.zeros(table.size, np.int8)
    if (given := axes_of(table)) is None:
        return shape
    has = ~np.isnan(given)
    for k in np.flatnonzero(has.any(axis=0)).tolist():
        for axis, value, is_given in zip(AXES, given[:, k].tolist(), has[:, k], strict=True):
            if not is_given:
                table.refuse(k, axis, "", "is missing: a block requires the axes a, b and c")
            if not 0 < value < np.inf:
                table.refuse(k, axis, value, "must be > 0")
        a, b, c = given[:, k].tolist()
        if not a >= b >= c:
            table.refuse(k, AXES[0 if b > a else 1], a if b > a else b, "must be a >= b >= c")
    whole = has.all(axis=0)
    shape[whole] = _core.shapes_of_axes(np.asfortranarray(given[:, whole]))
    return shape


def _volume(table: Table, k: int, name: str, value: Any) -> float:
    number = table.number(k, name, value)
    first, rule = _core.check_numbers(*_key("volume"), [number])
    if first:
        table.refuse(k, name, value, rule.decode().strip())
    return number


def _check_laws(case: Case, table: Table, law: np.ndarray, given: np.ndarray) -> None:
    """Check that each distribution has exactly the numbers that it needs, by the rules of &boulder.
    Checked are the first feature with each set of keys, the widest normal distribution, and the
    narrowest range, because the others then pass, too."""
    patterns = np.vstack([law, ~np.isnan(given)]).T
    firsts = np.unique(patterns[law > 0], axis=0, return_index=True)[1]
    given_features = set(np.flatnonzero(law > 0)[firsts].tolist())
    wide = np.where(law == 1 + LAWS.index("normal"), given[1] / given[0], np.nan)
    if not np.isnan(wide).all():
        given_features.add(int(np.nanargmax(wide)))
    spread = given[3] - given[2]
    if not np.isnan(spread).all():
        given_features.add(int(np.nanargmin(spread)))
    own = dict.fromkeys(keys_of("boulder").keys() - {"density"})
    for k in sorted(given_features):
        values = {n: None if np.isnan(v) else v for n, v in zip(VOLUMES, given[:, k], strict=True)}
        alone = case.replace()
        alone.name = table.where(k)
        alone.replace(boulder=own | {"volume": LAWS[law[k] - 1], **values})  # raises the error


def _check_shapes(case: Case, table: Table, shape: np.ndarray | None) -> None:
    """Check that every feature (or a raster) gives a block shape if the sources must define it."""
    if BY_SOURCE not in case.boulder["block_shape"] or facts(case, "boulder", "release").by_raster:
        return
    given = np.zeros(table.size, bool) if shape is None else shape > 0
    if not given.all():
        k = int(np.argmin(given))
        raise RockfallError(
            f"{table.where(k)}: has no block_shape and no axes a, b, c: needed for &boulder "
            "block_shape = 'source'"
        )


def _check_source(case: Case, table: Table, law: np.ndarray, given: np.ndarray) -> None:
    """Refuse boulders defined by both attributes and rasters, and a feature without a required
    volume."""
    density, says = ~np.isnan(given[:, DENSITY]), facts(case, "boulder", "release")
    if says.by_raster and (law.any() or density.any()):
        k = int(np.argmax((law > 0) | density))
        raise RockfallError(
            f"{table.where(k)}: attributes and rasters of &boulder both define its boulders: "
            "remove one of the two"
        )
    if says.by_layer and not law.all():
        k = int(np.argmin(law))
        raise RockfallError(
            f"{table.where(k)}: has no volume: needed for &boulder volume = 'source'"
        )


def _names(case: Case, table: Table) -> list[str]:
    """Names of the features; unnamed features get their numbers."""
    names = table.values("name")
    if own := case.release.get("name_field"):
        table.asked.add(own)
        names = [*map(plain, named_attribute(table.path, table.columns, own))]
    texts = (str(k if name is None else name) for k, name in enumerate(names, start=1))
    return [" ".join(text.split()) for text in texts]
