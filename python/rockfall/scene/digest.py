# SPDX-License-Identifier: BSD-3-Clause
"""SHA-256 of the decoded inputs of the kernel, whatever their file formats.

The checksum of a named file does not cover its companion files (tables of a shapefile, tiles of a
mosaic, masks). Rows are hashed in order, so terrain in windows has the same checksums as the
complete raster.
"""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from rockfall.io.grid import Grid
    from rockfall.scene.scene import Scene


class Digest:
    """Checksums of a scene, computed from all its rows."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.layers: list = []  # of the elevations, and of the rasters of the surface
        self.sizes = hashlib.sha256()

    def take(self, window: Scene, first: int, stop: int) -> None:
        """Add rows `first` to `stop` - 1 of the raster, all columns, which the window must hold."""
        layers = [window.z] if window.zone is None else [window.z, window.zone]
        layers += [] if window.values is None else list(window.values)
        layers += [] if window.cell_ground is None else [window.cell_ground]
        if first == 0:
            self.layers = [hashlib.sha256(layer.dtype.str.encode()) for layer in layers]
            self.sizes = hashlib.sha256(np.ascontiguousarray(window.sizes).data)
            for ground in window.grounds:
                self.sizes.update(f"{ground.name}\n{len(ground.text)}\n".encode() + ground.text)
            if window.material_ground is not None:
                self.sizes.update(window.material_ground.data)
        rows = slice(first - window.at[0], stop - window.at[0])
        for known, layer in zip(self.layers, layers, strict=True):
            known.update(np.ascontiguousarray(layer[rows]))

    def sums(self) -> dict[str, str]:
        """Checksum of each input, by name."""
        scene = self.scene
        dem, *surface = self.layers
        dem.update(_place(scene.grid).encode())
        for layer in surface:
            self.sizes.update(layer.digest())
        sources = hashlib.sha256(b"" if scene.area is None else scene.area.data)
        sources.update(b"" if scene.frequency is None else scene.frequency.data)
        sources.update(np.concatenate((scene.x, scene.y)).data)
        if scene.features is not None:
            sources.update("\n".join(scene.features.names).encode())
        of_features = scene.features[1:] if scene.features else ()
        for values in (*(scene.source_boulders or ()), *of_features):
            sources.update(b"" if values is None else np.ascontiguousarray(values).data)
        found = {"dem": dem, "surface": self.sizes, "sources": sources}
        if scene.trees is not None:
            found["trees"] = hashlib.sha256()
            for values in scene.trees:
                found["trees"].update(np.ascontiguousarray(values).data)
        return {name: known.hexdigest() for name, known in found.items()}


def digest(scene: Scene) -> dict[str, str]:
    """Checksums of a scene whose rasters are in memory."""
    found = Digest(scene)
    found.take(scene, 0, scene.grid.ny)
    return found.sums()


def _place(grid: Grid) -> str:
    """Exact text form of the position and cell size of a grid."""
    crs = "" if grid.crs is None else grid.crs.to_epsg() or grid.crs.to_wkt()
    return f"{grid.west!r} {grid.north!r} {grid.cell!r} {grid.nx} {grid.ny} {crs}"
