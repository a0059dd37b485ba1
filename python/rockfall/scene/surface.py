# SPDX-License-Identifier: BSD-3-Clause
"""What the slope is made of: the sizes of its rocks, everywhere, by zones, or cell by cell."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.io.grid import Box, row_blocks
from rockfall.io.layers import burn_polygons
from rockfall.io.raster import read_elevations
from rockfall.io.zone_table import RADII, index_blocks, read_zone_table
from rockfall.scene.layers import LAYERS, file_checksum, layer_blocks
from rockfall.scene.scene import Scene, used_zones


def size_columns(case: Case) -> tuple[str, ...]:
    """The sizes that the method of a case asks for."""
    return RADII[:1] if case.surface["method"] == "B" else RADII[1:]


def radius_over_rg(case: Case) -> float:
    """R_m over Rg of method A: Rg is a diameter, or a radius as it is read."""
    return _core.size_to_radius(case.surface["rg_reading"])


def read_surface(scene: Scene, box: Box, rasters: dict[str, Any]) -> None:
    """The sizes of the rocks in a box of cells, by the method of the case."""
    surface = scene.case.surface
    columns = size_columns(scene.case)
    uniform = surface.get("uniform_mean_radius" if surface["method"] == "B" else "uniform_rg")
    if uniform is not None:
        scene.sizes = np.atleast_2d(np.asarray(uniform, dtype=float))
    elif "zones" in surface:
        _read_zones(scene, box, columns, rasters)
    else:
        _read_values(scene, box, columns, rasters)


def _read_zones(scene: Scene, box: Box, columns: tuple[str, ...], rasters: dict[str, Any]) -> None:
    """Zones as an index into the table's sizes."""
    case, surface = scene.case, scene.case.surface
    path, table_path = case.path(surface["zones"]), case.path(surface["table"])
    table = read_zone_table(table_path)
    scene.checksums.setdefault("table", file_checksum(table_path))
    if "zones" not in rasters and path.suffix.lower() in LAYERS:
        ids = burn_polygons(
            path, scene.grid, surface["zone_field"], scene.remarks,
            layer=surface.get("zones_layer"), key="zones_layer",
        )  # fmt: skip
        blocks = ((rows, ids[rows]) for rows in row_blocks(ids.shape))
        scene.checksums["zones"] = file_checksum(path)
    elif "zones_layer" in surface:
        raise RockfallError(f"{case.name}: &surface zones_layer: has no meaning for a raster")
    else:
        blocks = layer_blocks(scene, "zones", "zones", np.int32, rasters, box)
    sizes = np.array(list(table.values()))[:, [RADII.index(column) for column in columns]]
    scene.zone = index_blocks(
        blocks, box.shape, list(table), surface.get("default_zone"), scene.z,
        str(path), str(table_path),
    )  # fmt: skip
    scene.sizes = sizes
    used = set(used_zones(scene).tolist())
    for k, zone in enumerate(table):
        if k in used and np.isnan(sizes[k]).any():
            raise RockfallError(
                f"{table_path}: zone {zone}: {', '.join(columns)} needed for method "
                f"{surface['method']}"
            )


def _read_values(scene: Scene, box: Box, columns: tuple[str, ...], rasters: dict[str, Any]) -> None:
    """Rasters of sizes, known wherever the terrain is."""
    scene.values = np.empty((len(columns), *box.shape), np.float32)
    for name, layer in zip(columns, scene.values, strict=True):
        missing = bad = 0
        for rows, block in layer_blocks(scene, name, f"values of {name}", np.float32, rasters, box):
            layer[rows] = block
            missing += np.count_nonzero(np.isnan(block) & ~np.isnan(scene.z[rows]))
            bad += np.count_nonzero(block <= 0)
        if missing or bad:
            raise RockfallError(
                f"{scene.case.path(scene.case.surface.get(name, name))}: {missing} cells of the "
                f"terrain without a value, {bad} not > 0 (Inf absorbs)"
            )


def read_window(scene: Scene, box: Box) -> Scene:
    """The scene with the rasters of a box of its cells."""
    z = read_elevations(scene.case.path(scene.case.terrain["dem"]), box)
    window = replace(scene, z=z, at=(box.row, box.column), windows=None)
    read_surface(window, box, {})
    return window


def cell_bytes(case: Case, dtype: np.dtype) -> int:
    """Memory of a cell of the rasters of a case."""
    surface = case.surface
    if "zones" in surface:
        return dtype.itemsize + 2
    has_layers = not set(RADII).isdisjoint(surface)
    return dtype.itemsize + 4 * len(size_columns(case)) * has_layers
