# SPDX-License-Identifier: BSD-3-Clause
"""Handle of a run in the kernel, which accumulates its results, and views of its arrays by name."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.errors import check_kernel
from rockfall.io.grid import Box
from rockfall.scene.scene import Scene

MAX_COLUMNS = int(_core.constant("max_columns"))  # maximum columns of `bin_counts`, one to spare


class Array(NamedTuple):
    """A row of the kernel's table of the arrays of a run, with a view of the array."""

    group: str  # group and name in the table of variables; "work": in no file
    name: str
    file_name: str
    dims: tuple[str, ...]
    values: np.ndarray


class _Row(NamedTuple):
    """A row of that table as the kernel has it. (Run keeps no views, which keep it alive.)"""

    group: str
    name: str
    file_name: str
    dims: tuple[str, ...]
    kind: str  # type of its values
    shape: tuple[int, ...]
    address: int


class Run:
    """Handle of a run; closed when neither the run nor a view of it remains."""

    def __init__(self, opened: tuple[int, int, bytes], name: str) -> None:
        handle, code, message = opened
        check_kernel(code, message, name)
        self.handle = handle
        self.successor: Run | None = None  # the run that took over its tallies
        self._table: list[_Row] | None = None  # None: not listed since it last changed
        weakref.finalize(self, _core.close_run, handle)

    @classmethod
    def of_scene(cls, scene: Scene, numbers: range, box: Box, threads: int) -> Run:
        """Create a run of the boulders with these numbers, counted from 0, with maps of some
        cells."""
        handle, name = scene.kernel.handle, scene.case.name
        extent = numbers.start, len(numbers), window(box), threads, MAX_COLUMNS
        return cls(_core.open_run(handle, *extent), name)

    @classmethod
    def joined(
        cls, case: str, boulders: tuple[int, int, int], box: Box, grounds: int, features: bool,
        *layout: np.ndarray,
    ) -> Run:  # fmt: skip
        """Create a run to be joined from parts, or a part. `boulders`: of the complete run, before
        the part, in it; `layout`: part_last and group_part of samples."""
        extent = case.encode(), boulders, window(box), grounds, features
        return cls(_core.open_joined_run(*extent, *layout), "merge")

    def merge(self, part: Run) -> None:
        """Add a part."""
        code, message = _core.merge_run(self.handle, part.handle)
        self.changed()
        check_kernel(code, message, "merge")

    def continued(self, scene: Scene) -> Run:
        """Create a run of a scene with more boulders that starts from the results of this one."""
        self.changed()
        self.successor = Run(_core.continue_run(scene.kernel.handle, self.handle), scene.case.name)
        return self.successor

    def arrays(self, *groups: str) -> Iterator[Array]:
        """All arrays, or those of some groups, including those that the next chunk replaces."""
        if self._table is None:
            self._table = [*self._listed()]
        for group, name, file_name, dims, kind, shape, address in self._table:
            if groups and group not in groups:
                continue
            if 0 in shape:
                values = np.empty(shape, kind)
            else:
                values = np.asarray(_Memory(self, address, shape, np.dtype(kind).str))
            yield Array(group, name, file_name, dims, values)

    def _listed(self) -> Iterator[_Row]:
        """The kernel's table of arrays."""
        k = 1
        while text := (row := _core.array(self.handle, k))[0].decode().split():
            group, name, file_name, kind, *axes = text
            shape = tuple(row[1][: len(axes)][::-1].tolist())
            yield _Row(group, name, file_name, tuple(axes[::-1]), kind, shape, int(row[2]))
            k += 1

    def changed(self) -> None:
        """Note that the kernel may have replaced arrays."""
        self._table = None

    def array(self, file_name: str) -> np.ndarray:
        """View of an array by its name in files."""
        for array in self.arrays():
            if array.file_name == file_name:
                return array.values
        raise KeyError(file_name)

    def advance(
        self, scene: Scene, first: int, size: int, step: int = 1
    ) -> tuple[np.ndarray, np.ndarray]:
        """Run boulders, every `step`-th from number `first` (from 1) on, on a scene, which may be a
        window. Returns the numbers of the boulders that left it, which are not tallied, and the
        places where they left it (2, n)."""
        left, code, message = _core.advance(self.handle, scene.kernel.handle, first, step, size)
        self.changed()
        scene.kernel.check(code, message)
        if not left:
            return np.empty(0, "i8"), np.empty((2, 0))
        return self.array("left").copy(), self.array("left_at").copy()

    def forget_tallies(
        self, counts: bool = False, sums: bool = False, maxima: bool = False
    ) -> None:
        """Free the memory of map tallies and samples once their results are made, except for stacks
        with remaining views."""
        _core.forget_tallies(self.handle, [not held for held in (counts, sums, maxima)])
        self.changed()


class _Memory:
    """Memory of a run, kept as long as there are views of it."""

    def __init__(self, run: Run, address: int, shape: tuple[int, ...], dtype: str) -> None:
        self.run = run
        self.__array_interface__: dict[str, Any] = {
            "version": 3, "data": (address, False), "shape": shape, "typestr": dtype,
        }  # fmt: skip


def window(box: Box) -> list[int]:
    """First column and row, from 1, and numbers of columns and rows, in the kernel's form."""
    return [box.column + 1, box.row + 1, *box.shape[::-1]]
