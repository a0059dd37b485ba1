# SPDX-License-Identifier: BSD-3-Clause
"""Values of netCDF grids: missing data, packing, and unit.

GDAL supports only some CF attributes, so they are read here, and contradictory attributes are
refused. The position follows from the coordinates, because a cut-out keeps the original's
GeoTransform, which newer versions of GDAL use.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.coordinates.crs_statements import check_statements
from rockfall.io.coordinates.length_units import is_metre
from rockfall.io.netcdf import open_netcdf
from rockfall.io.rasters.grid import TOLERANCE, Box, Transform, row_blocks

if TYPE_CHECKING:
    import netCDF4
    from affine import Affine

_MAX_SIDE = 10_000_000  # cells
_EVEN = 1e-3  # tolerance of coordinate steps, in cells


@dataclass(frozen=True)
class NetcdfCells:
    """A variable on (y, x), read north-up from either storage order."""

    variable: netCDF4.Variable
    dtype: np.dtype  #: type of the stored numbers
    shape: tuple[int, int]
    transform: Affine | Transform  #: north-up
    packing: tuple[float, float]  #: scale and offset
    missing: tuple[float, ...]  #: stored numbers that mark missing data
    valid: tuple[float, float]  #: range of stored numbers that are data
    rising: bool  #: True if the first stored row is the southernmost

    def rows(self, box: Box) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
        """Yield blocks of the rows of a box: (rows, stored numbers, valid mask)."""
        ny = self.shape[0]
        chunks = self.variable.chunking()
        tile = chunks[-2] if isinstance(chunks, list) else 1
        row, stop_row = box.row, box.stop_row
        if self.rising:
            row, stop_row = ny - stop_row, ny - row
        start = row // tile * tile
        for rows in row_blocks((stop_row - start, box.shape[1]), tile):
            first, stop = max(start + rows.start, row), start + rows.stop
            block = self._stored(slice(first, stop), box.columns)
            data = np.ones(block.shape, bool)
            if self.valid != (-np.inf, np.inf):
                data = (block >= self.valid[0]) & (block <= self.valid[1])
            for mark in self.missing:
                data &= block != mark
            if self.rising:
                first, stop, block, data = ny - stop, ny - first, block[::-1], data[::-1]
            yield slice(first, stop), block, data

    def _stored(self, rows: slice, columns: slice) -> np.ndarray:
        outer = (0,) * (self.variable.ndim - 2)
        block = np.asarray(self.variable[(*outer, rows, columns)])
        return block.view(self.dtype) if block.dtype != self.dtype else block


@contextmanager
def open_grid_file(file: str) -> Iterator[netCDF4.Dataset]:
    """Open a netCDF file after checking its dimensions, because GDAL reads all coordinates first.
    Refuses dimensions of more than `_MAX_SIDE` values."""
    with open_netcdf(file) as data:
        data.set_auto_maskandscale(False)
        for group in (data, *data.groups.values()):
            for name, dimension in group.dimensions.items():
                if dimension.size > _MAX_SIDE:
                    raise RockfallError(
                        f"{file}: dimension {name} has {dimension.size} values: must be at most "
                        f"{_MAX_SIDE}"
                    )
        yield data


def cells_of(path: str, data: netCDF4.Dataset, name: str, transform: Affine) -> NetcdfCells:
    """Cells of a variable; GDAL's exact `transform` is used if it agrees with the coordinates.
    Raises a RockfallError if the variable is no map."""
    try:
        variable = data[name]
    except (IndexError, KeyError):
        raise RockfallError(f"{path}: has no variable {name}") from None
    attributes = {key: variable.getncattr(key) for key in variable.ncattrs()}
    if variable.ndim < 2 or any(n != 1 for n in variable.shape[:-2]):
        raise RockfallError(
            f"{path}: {name} has the shape {variable.shape}: must have dimensions y, x"
        )
    if (mapping := _found(variable, str(attributes.get("grid_mapping", "")))) is not None:
        texts = {key: mapping.getncattr(key) for key in mapping.ncattrs()}
        check_statements(f"{path}: {mapping.name}", texts)
    x, y = (_coordinates(path, variable, axis) for axis in (-1, -2))
    dtype = _stored_type(path, name, variable.dtype, attributes)
    scale, offset = (
        _single(path, name, key, attributes.get(key, without))
        for key, without in (("scale_factor", 1.0), ("add_offset", 0.0))
    )
    if scale == 0:
        raise RockfallError(f"{path}: {name}: scale_factor = 0: must not be 0")
    packing = scale, offset
    validity = _Validity(f"{path}: {name}", dtype, attributes, packing != (1.0, 0.0))
    return NetcdfCells(
        variable, dtype, variable.shape[-2:], _place(x, y, transform), packing,
        validity.missing(_default_fill(variable)), validity.range(), bool(y[0] < y[-1]),
    )  # fmt: skip


@dataclass(frozen=True)
class _Validity:
    """Attributes that define which stored numbers are valid."""

    where: str
    dtype: np.dtype
    attributes: dict[str, Any]
    packed: bool

    def missing(self, default: float | str | None) -> tuple[float, ...]:
        """Missing-value markers: the fill value (from the file or the library), and others."""
        fill = self.values("_FillValue", 1)
        if fill.size == 0 and default is not None:
            fill = np.array([default]).astype(self.dtype)
        marks = [*fill, *self.values("missing_value", None)]
        return tuple(mark for mark in marks if mark == mark)  # NaN needs no marker

    def range(self) -> tuple[float, float]:
        """Minimum and maximum of valid stored numbers. Refuses contradictory attributes."""
        both = self.values("valid_range", 2)
        lowest, highest = self.values("valid_min", 1), self.values("valid_max", 1)
        if both.size and (lowest.size or highest.size):
            raise RockfallError(
                f"{self.where}: has valid_range, and valid_min or valid_max: remove one of them"
            )
        low = [*both[:1], *lowest, -np.inf][0]
        high = [*both[1:], *highest, np.inf][0]
        if not low <= high:
            raise RockfallError(f"{self.where}: valid from {low} to {high}: the range is empty")
        return low, high

    def values(self, key: str, many: int | None) -> np.ndarray:
        """Attribute values in the variable's type; there must be exactly `many`, unless `many` is
        None. Empty without the attribute; refuses values that do not fit the type."""
        if key not in self.attributes:
            return np.empty(0, self.dtype)
        given = np.atleast_1d(np.asarray(self.attributes[key]))
        problem = f"{self.where}: {key} = {self.attributes[key]}"
        if given.dtype.kind not in "iuf" or many not in (None, given.size):
            raise RockfallError(f"{problem}: must be {f'{many} numbers' if many else 'numbers'}")
        alike = given.dtype.kind == self.dtype.kind
        if (given.dtype.kind, self.dtype.kind) == ("i", "u"):  # due to _Unsigned, or small numbers
            alike = True
            given = np.where(given < 0, given.astype(object) + 256**self.dtype.itemsize, given)
        with np.errstate(all="ignore"):
            stored = given.astype(self.dtype)
        same = (stored == given) | (self.dtype.kind == given.dtype.kind == "f")
        if not same.all() or (self.packed and not alike):
            raise RockfallError(f"{problem}: does not fit the type of the variable, {self.dtype}")
        return stored


def _unit(path: str, name: str, attributes: dict[str, Any]) -> str | None:
    unit = attributes.get("units")
    if unit is not None and not isinstance(unit, str):
        raise RockfallError(f"{path}: {name}: units = {unit}: must be text")
    return unit


def _found(variable: netCDF4.Variable, name: str) -> netCDF4.Variable | None:
    """Variable with this name in the group of `variable` or in a parent group."""
    group = variable.group()
    while group is not None and name not in group.variables:
        group = group.parent
    return None if group is None else group[name]


def _coordinates(path: str, variable: netCDF4.Variable, axis: int) -> np.ndarray:
    """Cell centres along a dimension [m]; refuses other units, and coordinates that are missing,
    packed, uneven or fewer than 2."""
    name = variable.dimensions[axis]
    coordinate = _found(variable, name)
    if coordinate is None or coordinate.dimensions != (name,) or coordinate.dtype.kind not in "iuf":
        raise RockfallError(f"{path}: has no coordinate {name} (cell centres [m])")
    attributes = {key: coordinate.getncattr(key) for key in coordinate.ncattrs()}
    unit = _unit(path, name, attributes)
    if not is_metre(unit):
        raise RockfallError(f"{path}: coordinate {name} is in {unit}, but must be in metres")
    if packed := {"scale_factor", "add_offset", "_Unsigned"} & attributes.keys():
        raise RockfallError(f"{path}: coordinate {name}: {min(packed)}: must be plain numbers")
    centres = np.asarray(coordinate[...], np.float64)
    if centres.size < 2:
        raise RockfallError(f"{path}: {name} has {centres.size} cells: must have at least 2")
    step = (centres[-1] - centres[0]) / (centres.size - 1)
    even = centres[0] + step * np.arange(centres.size)
    with np.errstate(invalid="ignore"):
        if not (step != 0 and (np.abs(centres - even) <= _EVEN * abs(step)).all()):
            raise RockfallError(f"{path}: coordinate {name} is not evenly spaced")
    return centres


def _place(x: np.ndarray, y: np.ndarray, transform: Affine) -> Affine | Transform:
    """GDAL's transform if it agrees with the coordinates, else one from the coordinates."""
    t, far = transform, max(x.size, y.size)
    west, east = t.c + 0.5 * t.a, t.c + (x.size - 0.5) * t.a
    north, south = t.f + 0.5 * t.e, t.f + (y.size - 0.5) * t.e
    near = max(_EVEN, TOLERANCE * far) * abs(t.a)
    places = (x[0], west), (x[-1], east), (y.max(), north), (y.min(), south)
    if not (any(abs(own - other) > near for own, other in places) or t.b or t.d):
        return transform
    width, height = (x[-1] - x[0]) / (x.size - 1), abs(y[-1] - y[0]) / (y.size - 1)
    return Transform(
        *map(float, (width, 0.0, x[0] - width / 2, 0.0, -height, y.max() + height / 2))
    )


def _stored_type(path: str, name: str, stored: np.dtype, attributes: dict[str, Any]) -> np.dtype:
    """Type of the stored numbers; _Unsigned marks unsigned integers if the format has none. Refuses
    other marks."""
    unsigned = str(attributes.get("_Unsigned", "")).lower()
    if unsigned not in ("", "true", "false") or (unsigned and stored.kind not in "iu"):
        raise RockfallError(
            f"{path}: {name}: _Unsigned = {attributes['_Unsigned']}: must be 'true' or 'false', "
            "and only for integers"
        )
    if unsigned:
        return np.dtype(f"{'u' if unsigned == 'true' else 'i'}{stored.itemsize}")
    return np.dtype(stored).newbyteorder("=")


def _single(path: str, name: str, key: str, value: Any) -> float:
    given = np.asarray(value)
    if given.dtype.kind not in "iuf" or given.size != 1 or not np.isfinite(given).all():
        raise RockfallError(f"{path}: {name}: {key} = {value}: must be a number")
    return float(given.reshape(()))


def _default_fill(variable: netCDF4.Variable) -> float | str | None:
    """Default fill value, for a file that sets none; bytes have no default."""
    import netCDF4

    stored = variable.dtype
    return None if stored.itemsize == 1 else netCDF4.default_fillvals[stored.str[1:]]
