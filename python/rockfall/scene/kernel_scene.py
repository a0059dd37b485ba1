# SPDX-License-Identifier: BSD-3-Clause
"""A scene in the kernel, built once from the text of its case and from arrays."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.errors import check_kernel
from rockfall.io.grid import Box

if TYPE_CHECKING:
    from rockfall.scene.scene import Scene

#: Of the arrays of a scene that are not float64; "": of more than one, or of texts.
KINDS = {
    "cell_size": "f4", "source_feature": "i4", "feature_law": "i4", "ground_length": "i4",
    "material_ground": "i1", "cell_ground": "i1",
    **dict.fromkeys(("elevation", "zone", "impact_sets", "impact_sets_file"), ""),
    "ground_text": "", "ground_names": "",
}  # fmt: skip
NO_TERRAIN = np.zeros((1, 1), "f4")  # of a scene that has windows


class KernelScene:
    """Handle of a scene, with the arrays that the kernel reads during its lifetime."""

    def __init__(self, scene: Scene) -> None:
        self.name = scene.case.name
        self._arrays = scene_arrays(scene)
        self.handle = _new_scene(scene, self._arrays)
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


def _new_scene(scene: Scene, arrays: dict[str, np.ndarray]) -> int:
    """The handle of a scene that has these arrays, and is not built."""
    grid, (row, column) = scene.grid, scene.at
    nodes, first = (grid.nx, grid.ny), (column + 1, row + 1)
    handle = _core.new_scene(grid.west, grid.north, grid.cell, nodes, first, scene.sets.draw)
    for name, array in arrays.items():
        lengths = [*array.shape[::-1], 1, 1, 1][:3]  # the first runs fastest
        _core.pass_array(handle, name, array.dtype.str[1:], lengths, array.ctypes.data)
    return handle


def scene_arrays(scene: Scene) -> dict[str, np.ndarray]:
    """All arrays of a scene by their names in the kernel and in scene files. The texts of grounds
    come before their lengths."""
    boulders, grounds = scene.source_boulders, scene.grounds
    names = "\n".join(f"{one.name}\n{one.file}" for one in grounds).encode()
    of_sources = () if boulders is None else boulders._asdict().items()
    found: dict[str, Any] = {
        "elevation": _elevations(scene), "cell_size": scene.values, "zone": scene.zone,
        "material_size": scene.sizes, "impact_sets": _bytes(scene.sets.text),
        "impact_sets_file": _bytes(scene.sets.name.encode()),
        "ground_text": _bytes(b"".join(one.text for one in grounds)),
        "ground_names": _bytes(names),
        "ground_length": [len(one.text) for one in grounds] or None,
        "material_ground": scene.material_ground, "cell_ground": scene.cell_ground,
        "source_x": scene.x, "source_y": scene.y, "area_ratio": scene.area,
        "source_frequency": scene.frequency, **{f"source_{name}": one for name, one in of_sources},
    }  # fmt: skip
    if scene.features is not None:
        _, of, law, value = scene.features
        found |= {"source_feature": of, "feature_law": law, "feature_value": value}
    if scene.trees is not None:
        names = "tree_x", "tree_y", "tree_dbh", "tree_factor"
        found |= zip(names, scene.trees, strict=True)
    return {
        name: np.require(one, KINDS.get(name, "f8") or None, ["C", "A"])
        for name, one in found.items()
        if one is not None
    }


def _bytes(text: bytes) -> np.ndarray:
    return np.frombuffer(text, "i1")


def _elevations(scene: Scene) -> np.ndarray:
    """Those of a scene, in the precision that they have."""
    z = scene.z if scene.z.size else NO_TERRAIN
    return np.require(z, "f4" if z.dtype == np.float32 else "f8", ["C", "A"])


@contextmanager
def terrain_of(scene: Scene) -> Iterator[int]:
    """The handle of the elevations of a scene alone."""
    arrays = {"elevation": _elevations(scene)}
    handle = _new_scene(scene, arrays)
    yield handle
    _core.close_scene(handle)


def area_ratios(scene: Scene, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Surface over plan area (Horn 1981) of the cells at places [m]."""
    with terrain_of(scene) as terrain:
        return _core.area_ratios(terrain, x, y)


def known_at(scene: Scene, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Mark places [m] where boulders can start: between four cells with an elevation."""
    return _core.known_at(scene.kernel.handle, x, y).astype(bool)
