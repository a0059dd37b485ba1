# SPDX-License-Identifier: BSD-3-Clause
"""A scene in the kernel, built once from a case and arrays."""

import weakref
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from typing import Any, NoReturn

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case, in_kernel
from rockfall.errors import check_kernel
from rockfall.grounds.impact_tables import table_arrays
from rockfall.io.rasters.grid import Box
from rockfall.scene.parts import Rasters

ARRAYS: dict[str, list[str]] = {}  # name -> type ("" for several), dimensions, units, meaning
while _text := _core.table_row("scene", len(ARRAYS) + 1).decode().strip():
    _name, *ARRAYS[_name] = _text.split("|")
NO_TERRAIN = np.zeros((1, 1), "f4")  # placeholder for a scene read in windows


class KernelScene:
    """Handle of a scene, with the arrays that the kernel uses while it exists."""

    def __init__(
        self, case: Case, rasters: Rasters, draw: int, others: dict[str, np.ndarray]
    ) -> None:
        self.name, self._case, self._rasters, self._draw = case.name, case, rasters, draw
        self._others = others  # non-raster arrays
        self._box: Box | None = None

    def __reduce__(self) -> NoReturn:
        raise TypeError("a scene in the kernel belongs to its process and cannot be copied")

    def arrays(self) -> dict[str, np.ndarray]:
        """All arrays, by the names used in the kernel and in scene files."""
        return raster_arrays(self._rasters) | self._others

    @cached_property
    def handle(self) -> int:
        """Number of the scene in the kernel, which builds it on first use."""
        self._given = self.arrays()
        handle = _new_scene(self._rasters, self._given, self._draw)
        check_kernel(*_core.build_scene(handle, in_kernel(self._case)))
        self._close = weakref.finalize(self, _core.close_scene, handle)
        return handle

    def close(self) -> None:
        """Free the scene in the kernel; the next use rebuilds it."""
        if "handle" in vars(self):
            self._close()
            del self.handle, self._given
            self._box = None

    def keep_within(self, box: Box) -> None:
        """Confine boulders to the cells of a box; repeated calls with this box have no effect."""
        if self._box != box:
            _core.limit_terrain(self.handle, **box.corners())
            self._box = box

    def check(self, code: int, message: bytes) -> None:
        """Raise the error reported by a kernel procedure for the scene."""
        check_kernel(code, message, self.name)


def _new_scene(rasters: Rasters, arrays: Mapping[str, np.ndarray], draw: int = 0) -> int:
    """Handle of a new scene with these arrays; the kernel has not built it yet."""
    grid, (row, column) = rasters.grid, rasters.at
    nodes, first = (grid.nx, grid.ny), (column + 1, row + 1)
    handle = _core.new_scene(grid.west, grid.north, grid.cell, nodes, first, draw)
    for name, array in arrays.items():
        lengths = [*array.shape[::-1], 1, 1, 1][:3]  # the first dimension varies fastest
        _core.pass_array(handle, name, array.dtype.str[1:], lengths, array.ctypes.data)
    return handle


def raster_arrays(rasters: Rasters) -> dict[str, np.ndarray]:
    """Kernel arrays of the terrain and ground, by name."""
    grounds = rasters.grounds
    names = "\n".join(f"{ground.name}\n{ground.file}" for ground in grounds).encode()
    tables = [ground.table for ground in grounds if ground.table is not None]
    has_table = np.array([ground.table is not None for ground in grounds], int)
    return kernel_arrays({
        "elevation": _elevations(rasters), "cell_size": rasters.values, "zone": rasters.zone,
        "material_size": rasters.sizes,
        "ground_text": np.frombuffer(b"".join(ground.text for ground in grounds), "i1"),
        "ground_names": np.frombuffer(names, "i1"),
        "ground_length": [len(ground.text) for ground in grounds] or None,
        "ground_table": has_table * np.cumsum(has_table) if tables else None,
        **table_arrays(tables),
        "material_ground": rasters.material_ground, "cell_ground": rasters.cell_ground,
    })  # fmt: skip


def kernel_arrays(arrays: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Arrays converted to the kernel's types, without those that are None."""
    return {
        name: np.require(array, ARRAYS[name][0] or None if name in ARRAYS else None, ["C", "A"])
        for name, array in arrays.items()
        if array is not None
    }


def _elevations(rasters: Rasters) -> np.ndarray:
    """Elevations in their own precision."""
    z = rasters.z if rasters.z.size else NO_TERRAIN
    return np.require(z, "f4" if z.dtype == np.float32 else "f8", ["C", "A"])


@contextmanager
def terrain_of(rasters: Rasters) -> Iterator[int]:
    """Yield the kernel handle of a scene with only the elevations; it is closed after the block."""
    handle = _new_scene(rasters, {"elevation": _elevations(rasters)})
    yield handle
    _core.close_scene(handle)


def area_ratios(rasters: Rasters, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Ratio of surface area to plan area (Horn 1981) of the cells at points [m]."""
    with terrain_of(rasters) as terrain:
        return _core.area_ratios(terrain, x, y)


def can_start(rasters: Rasters, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Mask of points [m] where boulders can start: the four surrounding cells have elevations."""
    with terrain_of(rasters) as terrain:
        return _core.known_at(terrain, x, y).astype(bool)
