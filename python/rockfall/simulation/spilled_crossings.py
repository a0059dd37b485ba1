# SPDX-License-Identifier: BSD-3-Clause
"""Crossings of a long run, stored in a file next to its output to limit memory. The kernel
delivers blocks sorted by line; results are read by line.
"""

import tempfile
from collections.abc import Iterator
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rockfall.errors import RockfallError
from rockfall.result.run_arrays import Array, RunArrays

GROUPS = ("crossing", "fragment", "hit")
BLOCK = 1_000_000  # maximum crossings in the kernel
PIECE = 1_000_000  # crossings read at a time


class _Block(NamedTuple):
    """Positions of a block's columns in the file, and its rows by line."""

    offsets: dict[str, int]  # file position by column name
    ends: np.ndarray  # cumulative rows at the end of each line, starting with 0


class SpilledCrossings:
    """Crossings of a run in a temporary file, as blocks in the order in which boulders end."""

    def __init__(self, folder: Path, lines: int) -> None:
        self._folder = folder
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115  as long as this lives
        self._blocks: list[_Block] = []
        self._columns: dict[str, Array] = {}  # columns by name, without values
        self._lines = lines

    def take(self, run: RunArrays, least: int | None = None) -> None:
        """Move the crossings of a run to the file if there are at least `least` (default: a full
        block)."""
        if run.array("crossing_line").size < (BLOCK if least is None else least):
            return
        run.sort_crossings()
        offsets = {}
        for array in run.arrays(*GROUPS):
            offsets[array.file_name] = self._file.seek(0, 2)
            self._write(array.values)
            self._columns[array.file_name] = array._replace(values=array.values[:0].copy())
        sizes = np.bincount(run.array("crossing_line"), minlength=self._lines)
        self._blocks.append(_Block(offsets, np.array([0, *accumulate(sizes.tolist())])))
        run.forget_crossings()

    def _write(self, values: np.ndarray) -> None:
        try:
            self._file.write(values.data)
            self._file.flush()
        except OSError as error:
            raise RockfallError(
                f"{self._folder}: cannot store line crossings: {error.strerror}: "
                "free disk space, or use fewer lines"
            ) from error

    def columns(self, run: RunArrays) -> list[Array]:
        """Arrays of all crossings, including those still in the run, read on demand."""
        self.take(run, 1)
        if not self._blocks:
            return [*run.arrays(*GROUPS)]
        return [
            array._replace(values=_Column(self, name, array.values.dtype))  # type: ignore[arg-type]
            for name, array in self._columns.items()
        ]

    @property
    def ends(self) -> np.ndarray:
        """Cumulative rows of all blocks at the end of each line, starting with 0."""
        none = np.zeros(self._lines + 1, "i8")
        return np.sum([none, *(block.ends for block in self._blocks)], axis=0)

    def rows(self, name: str, first: int, last: int) -> np.ndarray:
        """Values of a column at lines first to last - 1, sorted by line and boulder."""
        dtype = self._columns[name].values.dtype
        ends = self.ends[first : last + 1] - self.ends[first]
        values = np.empty(int(ends[-1]), dtype)
        free = ends[:-1].copy()  # first unfilled row of each line
        for block in self._blocks:
            begin, *stops = (block.ends[first : last + 1] - block.ends[first]).tolist()
            if not stops or not stops[-1]:
                continue
            start = block.offsets[name] + int(block.ends[first]) * dtype.itemsize
            part = self._read(start, stops[-1], dtype)
            for k, stop in enumerate(stops):
                if stop > begin:
                    values[free[k] : free[k] + stop - begin] = part[begin:stop]
                    free[k] += stop - begin
                begin = stop
        return values

    def _read(self, start: int, size: int, dtype: np.dtype) -> np.ndarray:
        self._file.seek(start)
        return np.frombuffer(self._file.read(size * dtype.itemsize), dtype)


class _Column:
    """A column of all crossings, which NumPy can read completely or in slices."""

    def __init__(self, store: SpilledCrossings, name: str, dtype: np.dtype) -> None:
        self._store, self._name, self.dtype = store, name, dtype
        self._ends = store.ends
        self.shape, self.ndim = (int(self._ends[-1]),), 1

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self[:], dtype)

    def __getitem__(self, rows: slice) -> np.ndarray:
        start, stop, step = rows.indices(self.shape[0])
        first = int(np.searchsorted(self._ends, start, side="right")) - 1
        last = int(np.searchsorted(self._ends, stop, side="left"))
        values = self._store.rows(self._name, first, max(first, last))
        return values[start - self._ends[first] : stop - self._ends[first] : step]

    def pieces(self) -> Iterator[np.ndarray]:
        """Yield all values, for a few lines at a time."""
        first = 0
        while first < self._ends.size - 1:
            last = int(np.searchsorted(self._ends, self._ends[first] + PIECE, side="right")) - 1
            last = max(first + 1, last)
            yield self._store.rows(self._name, first, last)
            first = last
