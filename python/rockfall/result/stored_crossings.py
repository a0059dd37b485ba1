# SPDX-License-Identifier: BSD-3-Clause
"""Crossings that are read on demand from the result file, and checked a few lines at a time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.errors import RockfallError
from rockfall.result import variables
from rockfall.result.validate import fault_of_crossings

if TYPE_CHECKING:
    import xarray as xr

MOST = 1_000_000  # maximum crossings read into memory at once


def crossings_in_file(data: xr.Dataset, path: str | Path) -> dict[str, xr.Variable]:
    """Crossing variables of an open result, read from its file on demand; {} if there are few
    crossings. Raises a RockfallError for impossible numbers of crossings. `data` must stay open
    meanwhile: HDF5 fails on a file that is opened twice and closed once."""
    if data.sizes.get("crossing", 0) <= MOST:
        return {}
    import xarray as xr
    from xarray.core.indexing import LazilyIndexedArray

    sizes, kept = data["row_size"].values, data["boulder"].values
    if (sizes < 0).any() or sizes.sum() != data.sizes["crossing"]:
        raise RockfallError(f"{path}: row_size: contains impossible values")
    rows = _Rows(str(path), data, np.cumsum(sizes, dtype="i8"), kept)
    return {
        str(name): xr.Variable(
            variable.dims, LazilyIndexedArray(_column(rows, str(name))), variable.attrs
        )
        for name, variable in data.variables.items()
        if variable.dims == ("crossing",)
    }


class _Rows:
    """Rows of crossings in a file."""

    def __init__(self, name: str, data: xr.Dataset, ends: np.ndarray, kept: np.ndarray) -> None:
        self._name, self._data, self._kept = name, data, kept
        self._ends = ends  # end row of each line

    def dtype(self, name: str) -> np.dtype:
        return self._data.variables[name].dtype

    @property
    def size(self) -> int:
        return int(self._ends[-1])

    def values(self, name: str, first: int, last: int) -> np.ndarray:
        """Values of a variable in rows first to last - 1. Raises a RockfallError if they cannot be
        read, or are impossible."""
        try:
            values = self._data.variables[name][first:last].values
        except (OSError, RuntimeError) as error:
            raise RockfallError(f"{self._name}: {name}: cannot be read: {error}") from error
        fault = fault_of_crossings(name, values, self._lines(first, last), self._kept)
        if fault := fault or variables.fault_of(name, values):
            raise RockfallError(f"{self._name}: {fault}")
        return values

    def _lines(self, first: int, last: int) -> np.ndarray:
        """Index of the line of each row."""
        lines = np.arange(*np.searchsorted(self._ends, [first, last], side="right") + [0, 1])
        lines = lines[lines < self._ends.size]
        ends = np.clip(self._ends[lines], first, last)
        return np.repeat(lines, np.diff(ends, prepend=first))


def _column(rows: _Rows, name: str) -> Any:
    """Variable of these rows, in a form that xarray can index."""
    from xarray.backends import BackendArray
    from xarray.core.indexing import IndexingSupport, explicit_indexing_adapter

    class Column(BackendArray):
        """Read-only one-dimensional column; copying returns the column itself."""

        shape, dtype = (rows.size,), rows.dtype(name)

        def __getitem__(self, key: Any) -> np.ndarray:
            return explicit_indexing_adapter(key, self.shape, IndexingSupport.OUTER, self._read)

        def __deepcopy__(self, memo: Any) -> Column:
            return self

        def _read(self, key: tuple[Any, ...]) -> np.ndarray:
            (chosen,) = key
            if isinstance(chosen, slice):
                first, last, step = chosen.indices(rows.size)
                if step == 1:
                    return rows.values(name, first, max(first, last))
                chosen = np.arange(first, last, step)
            index = np.asarray(chosen)
            if not index.size:
                return np.empty(0, self.dtype)
            first = int(index.min())
            return rows.values(name, first, int(index.max()) + 1)[index - first]

    return Column()
