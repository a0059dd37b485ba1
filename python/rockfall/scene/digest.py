# SPDX-License-Identifier: BSD-3-Clause
"""SHA-256 of the decoded kernel inputs, independent of file formats.

The checksum of a file in the case does not cover its companion files (tables of a shapefile, tiles
of a mosaic, masks). Rows are hashed in order, so that a terrain read in windows has the same
checksums as the complete raster.
"""

import hashlib

import numpy as np

from rockfall.grounds.impact_tables import table_arrays
from rockfall.io.rasters.grid import Grid
from rockfall.scene.forest.trees import Trees
from rockfall.scene.parts import Rasters, Sources


class Digest:
    """Checksums of a scene, computed from all its rows."""

    def __init__(self, grid: Grid) -> None:
        self.grid = grid
        self.layers: list = []  # elevations and ground rasters
        self.sizes = hashlib.sha256()

    def take(self, window: Rasters, first: int, stop: int) -> None:
        """Add rows `first` to `stop` - 1 of the raster; the window must contain them."""
        layers = [window.z] if window.zone is None else [window.z, window.zone]
        layers += [] if window.values is None else list(window.values)
        layers += [] if window.cell_ground is None else [window.cell_ground]
        if first == 0:
            self.layers = [hashlib.sha256(layer.dtype.str.encode()) for layer in layers]
            self.sizes = hashlib.sha256(np.ascontiguousarray(window.sizes).data)
            for ground in window.grounds:
                self.sizes.update(f"{ground.name}\n{len(ground.text)}\n".encode() + ground.text)
                for array in table_arrays([ground.table] if ground.table else []).values():
                    self.sizes.update(np.ascontiguousarray(array).data)
            if window.material_ground is not None:
                self.sizes.update(window.material_ground.data)
        rows = slice(first - window.at[0], stop - window.at[0])
        for checksum, layer in zip(self.layers, layers, strict=True):
            checksum.update(np.ascontiguousarray(layer[rows]))

    def sums(self, sources: Sources, trees: Trees | None) -> dict[str, str]:
        """Checksum of each input, by name."""
        dem, sizes = self.layers[0].copy(), self.sizes.copy()
        dem.update(_place(self.grid).encode())
        for layer in self.layers[1:]:
            sizes.update(layer.digest())
        of_sources = hashlib.sha256(b"" if sources.area is None else sources.area.data)
        of_sources.update(b"" if sources.frequency is None else sources.frequency.data)
        of_sources.update(np.concatenate((sources.x, sources.y)).data)
        if sources.features is not None:
            of_sources.update("\n".join(sources.features.names).encode())
        of_features = sources.features[1:] if sources.features else ()
        for values in (*(sources.source_boulders or ()), *of_features):
            of_sources.update(b"" if values is None else np.ascontiguousarray(values).data)
        checksums = {"dem": dem, "surface": sizes, "sources": of_sources}
        if trees is not None:
            checksums["trees"] = hashlib.sha256()
            for values in trees:
                checksums["trees"].update(np.ascontiguousarray(values).data)
        return {name: checksum.hexdigest() for name, checksum in checksums.items()}


def _place(grid: Grid) -> str:
    """Exact text of a grid: position, cell size, numbers of cells, and CRS."""
    crs = "" if grid.crs is None else grid.crs.to_epsg() or grid.crs.to_wkt()
    return f"{grid.west!r} {grid.north!r} {grid.cell!r} {grid.nx} {grid.ny} {crs}"
