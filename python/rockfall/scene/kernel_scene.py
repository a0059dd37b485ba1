# SPDX-License-Identifier: BSD-3-Clause
"""A scene in the kernel, built once from the text of its case and from arrays."""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.errors import check_kernel
from rockfall.io.grid import Box

if TYPE_CHECKING:
    from rockfall.scene.scene import Scene

NO_TERRAIN = np.zeros((1, 1), "f4")  # for a scene in windows


class KernelScene:
    """Handle of a scene, with the arrays that the kernel reads during its lifetime."""

    def __init__(self, scene: Scene) -> None:
        self.name = scene.case.name
        grid = scene.grid
        first = scene.at[1] + 1, scene.at[0] + 1
        nodes = grid.nx, grid.ny
        self.handle = _core.new_scene(
            grid.west, grid.north, grid.cell, nodes, first, scene.sets.draw
        )
        self._arrays = {name: one for name, one in _arrays(scene).items() if one is not None}
        for name, array in self._arrays.items():
            _core.give(self.handle, name, *place_of(array))
        text = scene.case.text().encode()
        check_kernel(*_core.build_scene(self.handle, text, self.name.encode()))
        self._box: Box | None = None
        weakref.finalize(self, _core.close_scene, self.handle)

    def __reduce__(self) -> NoReturn:
        raise TypeError("a scene in the kernel belongs to its process; copies make their own")

    def keep_within(self, box: Box) -> None:
        """Confine boulders to the cells of maps; called once, the same for all runs."""
        if self._box != box:
            _core.limit_terrain(self.handle, **box.corners())
            self._box = box

    def check(self, code: int, message: bytes) -> None:
        """Raise the error that a kernel procedure reports for the scene."""
        check_kernel(code, message, self.name)


def place_of(array: np.ndarray) -> tuple[str, list[int], int]:
    """Kind, lengths (the first varies fastest) and address of an array, as the kernel expects
    them."""
    return array.dtype.str[1:], [*array.shape[::-1], 1, 1, 1][:3], array.ctypes.data


def _arrays(scene: Scene) -> dict[str, np.ndarray | None]:
    """All arrays of a scene by their kernel names; None if absent. The texts of grounds precede
    their lengths."""
    features, boulders, grounds = scene.features, scene.source_boulders, scene.grounds
    names = "\n".join(f"{one.name}\n{one.file}" for one in grounds).encode()
    found: dict[str, Any] = {
        "z": (elevations(scene), None), "zone": (scene.zone, None), "values": (scene.values, "f4"),
        "sizes": (scene.sizes, "f8"), "source_x": (scene.x, "f8"), "source_y": (scene.y, "f8"),
        "area_ratio": (scene.area, "f8"), "source_frequency": (scene.frequency, "f8"),
        "source_volume": (boulders and boulders.volume, "f8"),
        "source_inertia": (boulders and boulders.inertia, "f8"),
        "source_density": (boulders and boulders.density, "f8"),
        "source_feature": (features and features.of, "i4"),
        "feature_law": (features and features.law, "i4"),
        "feature_value": (features and features.value, "f8"),
        "sets_text": _bytes(scene.sets.text), "sets_name": _bytes(scene.sets.name.encode()),
        "ground_text": _bytes(b"".join(one.text for one in grounds)),
        "ground_names": _bytes(names),
        "ground_length": ([len(one.text) for one in grounds] or None, "i4"),
        "material_ground": (scene.material_ground, "i1"), "cell_ground": (scene.cell_ground, "i1"),
        **{name: (one, "f8") for name, one in trees(scene).items()},
    }  # fmt: skip
    return {
        name: None if one is None else np.require(one, kind, ["C", "A"])
        for name, (one, kind) in found.items()
    }


def _bytes(text: bytes) -> tuple[np.ndarray, str]:
    return np.frombuffer(text, "i1"), "i1"


def trees(scene: Scene) -> dict[str, np.ndarray]:
    """Stem arrays of a scene."""
    names = "tree_x", "tree_y", "tree_dbh", "tree_factor"
    return dict(zip(names, scene.trees, strict=True)) if scene.trees else {}


def elevations(scene: Scene) -> np.ndarray:
    """Elevation arrays in (x, y) order and native precision; empty for windowed scenes."""
    return np.require(scene.z if scene.z.size else NO_TERRAIN, None, ["C", "A"])


def on_raster(scene: Scene) -> tuple[np.ndarray, tuple]:
    """Elevations, to be kept alive while the kernel reads them, with their address and position on
    the raster."""
    z, grid = elevations(scene), scene.grid
    place = grid.west, grid.north, grid.cell
    nodes, at = (grid.nx, grid.ny), (scene.at[1] + 1, scene.at[0] + 1)
    return z, (*place_of(z), place, nodes, at)


def area_ratios(scene: Scene, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Surface over plan area (Horn 1981) of the cells at places [m]."""
    z, about = on_raster(scene)
    return _core.area_ratios(*about, x, y)


def known_at(scene: Scene, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Mark places [m] where boulders can start: between four cells with an elevation."""
    return _core.known_at(scene.kernel.handle, x, y).astype(bool)
