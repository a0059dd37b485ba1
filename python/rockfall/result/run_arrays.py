# SPDX-License-Identifier: BSD-3-Clause
"""Results of a run in the kernel: its handle, and views of its arrays by name."""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple, Self

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case, in_kernel
from rockfall.errors import check_kernel
from rockfall.io.rasters.grid import Box, Grid


class Array(NamedTuple):
    """A row of the kernel's array table, with a view of the array."""

    group: str  # key in the variable table; "work" arrays are not written to files
    name: str
    file_name: str
    dims: tuple[str, ...]
    values: np.ndarray


class _Row(NamedTuple):
    """A row of the kernel's array table without a view, which would keep RunArrays alive."""

    group: str
    name: str
    file_name: str
    dims: tuple[str, ...]
    kind: str  # type of the values
    shape: tuple[int, ...]
    address: int


class RunArrays:
    """Handle of a run, closed when no run or view uses it any more."""

    def __init__(self, opened: tuple[int, int, bytes], name: str) -> None:
        handle, code, message = opened
        check_kernel(code, message, name)
        self.handle = handle
        self._table: list[_Row] | None = None  # None if not listed since the last change
        weakref.finalize(self, _core.close_run, handle)

    @classmethod
    def joined(
        cls, case: Case, boulders: tuple[int, int, int], box: Box, grounds: int, features: bool,
        shapes: bool, *layout: np.ndarray,
    ) -> Self:  # fmt: skip
        """Create an empty run for a part, or for joined parts. `boulders` are the numbers of
        boulders in the complete run, before the part, and in the part; `layout` is part_last and
        group_part of samples."""
        extent = in_kernel(case), boulders, window(box), grounds, features, shapes
        return cls(_core.open_joined_run(*extent, *layout), "merge")

    def merge(self, part: RunArrays) -> None:
        """Add the results of a part."""
        code, message = _core.merge_run(self.handle, part.handle)
        self.changed()
        check_kernel(code, message, "merge")

    def arrays(self, *groups: str) -> Iterator[Array]:
        """Yield views of all arrays, or of some groups; the next chunk may replace the arrays."""
        if self._table is None:
            self._table = [*self._listed()]
        return self._views(row for row in self._table if not groups or row.group in groups)

    def part_arrays(self) -> Iterator[Array]:
        """Yield views of all arrays of the part, as in files; the next part replaces some of the
        arrays."""
        return self._views([*self._listed(of_part=True)])

    def _views(self, rows: Iterable[_Row]) -> Iterator[Array]:
        for group, name, file_name, dims, kind, shape, address in rows:
            if 0 in shape:
                values = np.empty(shape, kind)
            else:
                values = np.asarray(_Memory(self, address, shape, np.dtype(kind).str))
            yield Array(group, name, file_name, dims, values)

    def _listed(self, of_part: bool = False) -> Iterator[_Row]:
        """The kernel's table of arrays."""
        k = 1
        while text := (row := _core.array(self.handle, of_part, k))[0].decode().split():
            group, name, file_name, kind, *axes = text
            shape = tuple(row[1][: len(axes)][::-1].tolist())
            yield _Row(group, name, file_name, tuple(axes[::-1]), kind, shape, int(row[2]))
            k += 1

    def changed(self) -> None:
        """Note that the kernel may have replaced arrays."""
        self._table = None

    def array(self, file_name: str) -> np.ndarray:
        """View of an array by its name in files; a KeyError for other names."""
        for array in self.arrays():
            if array.file_name == file_name:
                return array.values
        raise KeyError(file_name)

    def pack_part(self, only_samples: bool = False) -> None:
        """Pack the results up to the last boulder, or only samples, as a part."""
        check_kernel(*_core.pack_part(self.handle, only_samples))

    def begin_part(self, boulders: int, lengths: Sequence[int], name: str) -> None:
        """Allocate a part for the first boulders. `lengths` are the numbers of rows, cells, shared
        cells, bins, coarse sample bins, and crossings (-1: none)."""
        code, message = _core.begin_part(self.handle, boulders, lengths)
        check_kernel(code, message, name)
        self.changed()

    def unpack_part(self, name: str, grid: Grid, only_samples: bool = False) -> None:
        """Store the filled part, or only its samples and row numbers, and free the part. Raises a
        RockfallError for values that are impossible in a run."""
        corner, nodes = (grid.west, grid.north, grid.cell), (grid.nx, grid.ny)
        code, message = _core.unpack_part(self.handle, only_samples, corner, nodes)
        check_kernel(code, message, name)
        self.changed()

    def sort_crossings(self) -> None:
        """Sort crossings by line, then by boulder; views of crossings become invalid."""
        check_kernel(*_core.sort_crossings(self.handle))
        self.changed()

    def forget_crossings(self) -> None:
        """Free the memory of crossings; views of crossings become invalid."""
        _core.forget_crossings(self.handle)
        self.changed()

    def forget_part(self) -> None:
        """Free the memory of the part."""
        _core.forget_part(self.handle)

    def forget_tallies(
        self, counts: bool = False, sums: bool = False, maxima: bool = False
    ) -> None:
        """Free the memory of maps and samples; True keeps a stack, because views of it remain."""
        _core.forget_tallies(self.handle, [not held for held in (counts, sums, maxima)])
        self.changed()


class _Memory:
    """Memory of a run, kept while views of it exist."""

    def __init__(self, run: RunArrays, address: int, shape: tuple[int, ...], dtype: str) -> None:
        self.run = run
        self.__array_interface__: dict[str, Any] = {
            "version": 3, "data": (address, False), "shape": shape, "typestr": dtype,
        }  # fmt: skip


def window(box: Box) -> list[int]:
    """First column and row, from 1, and numbers of columns and rows, as the kernel expects them."""
    return [box.column + 1, box.row + 1, *box.shape[::-1]]
