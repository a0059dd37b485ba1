# SPDX-License-Identifier: BSD-3-Clause
"""Files of a Rockyfor3D folder, by the program's file names."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.rasters.aligned import aligned_blocks
from rockfall.io.rasters.dem import dem_header
from rockfall.io.rasters.grid import Grid

RASTERS = (
    "dem", "rockdensity", "d1", "d2", "d3", "blshape", "rg70", "rg20", "rg10", "soiltype",
    "nrtrees", "dbhmean", "dbhstd", "conif_percent", "net_number", "net_energy", "net_height",
)  # fmt: skip
NEEDED = ("dem", "rockdensity", "d1", "d2", "d3", "rg70", "rg20", "rg10")
OUTPUTS = ("e_", "ph_", "nr_", "v_max", "el_angle", "traj_time", "reach_prob", "tree_")
LISTS = (".txt", ".csv", ".xyz")  # extensions of tree lists


class Folder:
    """Contents of a Rockyfor3D folder."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        if not self.path.is_dir():
            raise RockfallError(f"{self.path}: no such folder")
        files = sorted(file for file in self.path.iterdir() if file.is_file())
        by_name = {file.name.lower(): file for file in files}
        self.rasters = {
            name: by_name[f"{name}.asc"] for name in RASTERS if f"{name}.asc" in by_name
        }
        if missing := self.missing(NEEDED):
            raise RockfallError(
                f"{self.path}: {', '.join(missing)} missing: a Rockyfor3D folder requires "
                f"{', '.join(f'{name}.asc' for name in NEEDED)}"
            )
        lists = [file for name, file in by_name.items() if "tree" in name and name.endswith(LISTS)]
        self.trees = lists[0] if lists else None
        named = {*self.rasters.values(), self.trees}
        self.unread = [
            file.name
            for file in files
            if (file.suffix.lower() == ".asc" or file in lists)
            and file not in named
            and not file.name.lower().startswith(OUTPUTS)
        ]
        self.grid: Grid = dem_header(self.rasters["dem"])[0]

    def __contains__(self, name: str) -> bool:
        return name in self.rasters

    def missing(self, names: Iterable[str]) -> list[str]:
        """File names of missing rasters."""
        return [f"{name}.asc" for name in names if name not in self.rasters]

    def read(self, name: str) -> np.ndarray:
        """Read a raster on the DEM cells, NaN where it has no data."""
        values = np.empty(self.grid.shape)
        path, what = self.rasters[name], f"values of {name}"
        for rows, block in aligned_blocks(path, self.grid, what, "f8", smooth=False):
            values[rows] = block
        return values
