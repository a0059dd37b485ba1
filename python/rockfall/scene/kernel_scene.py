# SPDX-License-Identifier: BSD-3-Clause
"""A scene in the kernel: built once, of the text of its case and of arrays."""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.errors import check_kernel
from rockfall.io.grid import Box

if TYPE_CHECKING:
    from rockfall.scene.scene import Scene

ABSENT = {  # what the kernel takes for an array that a scene does not have
    "z8": np.zeros((1, 1)), "z4": np.zeros((1, 1), "f4"), "zone1": np.zeros((1, 1), "i1"),
    "zone2": np.zeros((1, 1), "i2"), "values": np.zeros((1, 1, 1), "f4"),
    "area_ratio": np.zeros(1), "source_frequency": np.zeros(1), "source_feature": np.zeros(1, "i4"),
    "feature_law": np.full(1, -1, "i4"), "feature_value": np.zeros((1, 9)),
    "of_sources": np.zeros(1), "trees": np.zeros(1),
    "material_ground": np.zeros(1, "i1"), "cell_ground": np.zeros((1, 1), "i1"),
}  # fmt: skip


class KernelScene:
    """The handle of a scene, and the arrays that the kernel looks at as long as there is one."""

    def __init__(self, scene: Scene) -> None:
        self.name = scene.case.name
        self._views = views(scene)
        grid = scene.grid
        self.handle, code, message = _core.open_scene(
            text=scene.case.text().encode(), name=self.name.encode(), **self._views,
            west=grid.west, north=grid.north, cell=grid.cell, nodes=(grid.nx, grid.ny),
            first=(scene.at[1] + 1, scene.at[0] + 1), sizes=np.asfortranarray(scene.sizes.T),
            source_x=scene.x, source_y=scene.y,
            **releases(scene), **of_sources(scene), **trees(scene),
            sets_text=scene.sets.text or b"\n", sets_name=scene.sets.name.encode(),
            draw=scene.sets.draw, **_grounds(scene),
        )  # fmt: skip
        check_kernel(code, message)
        self._box: Box | None = None
        weakref.finalize(self, _core.close_scene, self.handle)

    def __reduce__(self) -> NoReturn:
        raise TypeError("a scene in the kernel belongs to its process; copies make their own")

    def keep_within(self, box: Box) -> None:
        """Let boulders come no farther than the cells of maps: once, the same for all runs."""
        if self._box != box:
            _core.limit_terrain(self.handle, **box.corners())
            self._box = box

    def check(self, code: int, message: bytes) -> None:
        """Raise what a procedure of the kernel says is wrong with the scene."""
        check_kernel(code, message, self.name)


def releases(scene: Scene) -> dict[str, np.ndarray]:
    """How many boulders sources release, and what the features of a layer say of them."""
    found = scene.features or (None,) * 4
    names = "area_ratio", "source_frequency", "source_feature", "feature_law", "feature_value"
    pairs = zip(names, (scene.area, scene.frequency, *found[1:]), strict=True)
    given = {name: ABSENT[name] if one is None else one for name, one in pairs}
    return given | {"feature_value": given["feature_value"].T}


def of_sources(scene: Scene) -> dict[str, np.ndarray]:
    """What the sources of a scene say of their boulders."""
    found = scene.source_boulders
    values = (None,) * 3 if found is None else (found.volume, found.inertia, found.density)
    names = "source_volume", "source_inertia", "source_density"
    pairs = zip(names, values, strict=True)
    return {name: ABSENT["of_sources"] if one is None else one for name, one in pairs}


def trees(scene: Scene) -> dict[str, np.ndarray]:
    """The stems of a scene."""
    values = scene.trees or [ABSENT["trees"]] * 4
    names = "tree_x", "tree_y", "tree_dbh", "tree_factor"
    return {name: np.ascontiguousarray(one) for name, one in zip(names, values, strict=True)}


def elevations(scene: Scene) -> dict[str, np.ndarray]:
    """Those of a scene as (x, y), in the precision that they have; none where it has windows."""
    if not scene.z.size:
        return {name: ABSENT[name] for name in ("z8", "z4")}
    mine = "z4" if scene.z.dtype == np.float32 else "z8"
    return {name: _view(scene.z, name) if name == mine else ABSENT[name] for name in ("z8", "z4")}


def on_raster(scene: Scene) -> dict[str, Any]:
    """Elevations, and where they lie on the raster."""
    nodes, at = (scene.grid.nx, scene.grid.ny), (scene.at[1] + 1, scene.at[0] + 1)
    return {**elevations(scene), "nodes": nodes, "at": at}


def area_ratios(scene: Scene, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Surface over plan area (Horn 1981) of the cells at places [m]."""
    corner = {name: getattr(scene.grid, name) for name in ("west", "north", "cell")}
    return _core.area_ratios(**on_raster(scene), **corner, source_x=x, source_y=y)


def known_at(scene: Scene, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Whether boulders can start from places [m]: between four cells with an elevation."""
    return _core.known_at(scene.kernel.handle, x, y).astype(bool)


def views(scene: Scene) -> dict[str, Any]:
    """The rasters of a scene as the kernel looks at them: no copies that f2py would throw away."""
    names = "zone1", "zone2", "values", "cell_ground"
    found = {**elevations(scene), **{name: ABSENT[name] for name in names}}
    if scene.zone is not None:
        name = f"zone{scene.zone.dtype.itemsize}"
        found[name] = _view(scene.zone, name)
    if scene.values is not None:
        found["values"] = _view(scene.values, "values")
    if scene.cell_ground is not None:
        found["cell_ground"] = _view(scene.cell_ground, "cell_ground")
    return found


def _grounds(scene: Scene) -> dict[str, Any]:
    """What rebounds follow: texts one after the other, and their names and files by lines."""
    material, grounds = scene.material_ground, scene.grounds
    return {
        "ground_text": np.frombuffer(b"".join(one.text for one in grounds) or b"\n", "i1"),
        "ground_length": [len(one.text) for one in grounds] or [-1],
        "ground_names": "\n".join(f"{one.name}\n{one.file}" for one in grounds).encode() or b"\n",
        "material_ground": ABSENT["material_ground"] if material is None else material,
    }


def _view(raster: np.ndarray, name: str) -> np.ndarray:
    return np.require(raster.T, ABSENT[name].dtype, ["F", "A"])
