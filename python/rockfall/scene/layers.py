# SPDX-License-Identifier: BSD-3-Clause
"""Reading of the layers of a case, from raster files or given arrays."""

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from rockfall.case import Case, file_keys
from rockfall.errors import RockfallError
from rockfall.io.coordinates.crs import crs_name, same_crs
from rockfall.io.files import check_regular, reason
from rockfall.io.rasters.aligned import aligned_blocks
from rockfall.io.rasters.arrays import as_plan, grid_of
from rockfall.io.rasters.grid import NO_ID, Box, Grid, row_blocks
from rockfall.io.rasters.raster_file import raster_file
from rockfall.io.vectors.layers import REPROJECTED, name_of
from rockfall.scene.stages import Stages

T = TypeVar("T")


@dataclass
class Inputs:
    """Case and grid of a scene that is being read, with given arrays, checksums and remarks."""

    case: Case
    grid: Grid
    arrays: dict[str, Any] = field(default_factory=dict)  # replace rasters; removed once read
    checksums: dict[str, str] = field(default_factory=dict)  # keys: input files
    remarks: list[str] = field(default_factory=list)  # remarks, one per line

    def blocks(
        self, key: str, what: str, dtype: Any, box: Box | None = None, smooth: bool = True
    ) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield blocks of rows, in any order, of a raster on the DEM cells, from the given array or
        the case's file. For `smooth` see `aligned_blocks`."""
        given = self.arrays.pop(key, None)
        if given is None:
            group = next(row.group for row in file_keys() if row.name == key)
            path = self.case.path(getattr(self.case, group)[key])
            remarks = None if key in self.checksums else self.remarks  # only once
            if key not in self.checksums:
                self.checksums[key] = file_checksum(path)
            yield from aligned_blocks(path, self.grid, what, dtype, box, smooth, remarks)
            return
        given = _on_cells(self.grid, key, given)
        self.checksums[key] = array_checksum(given)
        if np.dtype(dtype).kind == "i":
            given = _whole_numbers(key, given, dtype)
        for rows in row_blocks(given.shape):
            block = given[rows]
            yield rows, np.ma.filled(block.astype(dtype), NO_ID if dtype == np.int32 else np.nan)

    def note_layer(self, name: str, path: Path, layer: str | None = None) -> None:
        """Record the checksum of a layer, and the CRS from which it was reprojected."""
        self.checksums[name] = file_checksum(path)
        where = name_of(path, layer)
        for remark in self.remarks:
            if remark.startswith(f"{where}: {REPROJECTED} "):
                self.checksums[name] += remark.removeprefix(where).replace(":", ",", 1)


def take_inputs(
    stages: Stages,
    name: str,
    inputs: Inputs,
    uses: tuple[Any, ...],
    make: Callable[[Inputs], T],
) -> T:
    """Run a reading stage and return its result. Add its checksums and remarks to the inputs, and
    remove the arrays that it used. The result depends on the grid, all arrays, and `uses`."""

    def read(case: Case) -> tuple[T, Inputs]:
        own = Inputs(case, inputs.grid, dict(inputs.arrays))
        return make(own), own

    given = tuple(part for item in inputs.arrays.items() for part in item)
    taken, own = stages.take(name, inputs.case, (inputs.grid, *uses, *given), read)
    inputs.checksums |= own.checksums
    inputs.remarks += [remark for remark in own.remarks if remark not in inputs.remarks]
    inputs.arrays = {key: array for key, array in inputs.arrays.items() if key in own.arrays}
    return taken


def _on_cells(grid: Grid, key: str, given: Any) -> np.ma.MaskedArray:
    """Array (ny, nx) on the DEM cells, with missing values masked; refuses arrays on other
    cells."""
    if hasattr(given, "coords"):
        given = as_plan(given)
        own, flipped = grid_of(given)
        if not same_crs(own.crs, grid.crs):
            raise RockfallError(
                f"{key} = (array): is in {crs_name(own.crs)}, but the DEM is in "
                f"{crs_name(grid.crs)}"
            )
        if not own.matches(grid):
            raise RockfallError(f"{key} = (array): is not on the cells of the DEM")
        given = given.values[::-1] if flipped else given.values
    given = np.ma.asarray(given)
    if given.dtype.kind not in "biuf":
        raise RockfallError(f"{key} = (array): must contain numbers, not {given.dtype}")
    if given.shape != grid.shape:
        raise RockfallError(
            f"{key} = (array): has the shape {given.shape}: must have the shape of the DEM, "
            f"{grid.shape}"
        )
    return np.ma.masked_where(np.isnan(given), given) if given.dtype.kind == "f" else given


def _whole_numbers(key: str, given: np.ma.MaskedArray, dtype: Any) -> np.ma.MaskedArray:
    """Return the array; refuse values that are not whole numbers in the range of `dtype`."""
    limits = np.iinfo(dtype)
    wrong = (given < limits.min + 1) | (given > limits.max) | (given != np.rint(given))
    if np.ma.filled(wrong, False).any():
        value = given[np.ma.filled(wrong, False)][0]
        raise RockfallError(f"{key} = (array): {value}: must be a 32-bit integer")
    return given


def array_checksum(array: np.ndarray) -> str:
    """SHA-256 of an array's bytes, including its mask if any."""
    digest = hashlib.sha256(np.ascontiguousarray(np.ma.getdata(array)).data)
    if np.ma.is_masked(array):
        digest.update(np.ascontiguousarray(np.ma.getmaskarray(array)).data)
    return digest.hexdigest()


def file_checksum(path: Path) -> str:
    """SHA-256 of a file. Raises a RockfallError if it cannot be read."""
    file = raster_file(str(path))
    check_regular(file)
    try:
        with open(file, "rb") as opened:
            return hashlib.file_digest(opened, "sha256").hexdigest()
    except OSError as error:
        raise RockfallError(f"{path}: cannot be read: {reason(error, path)}") from error
