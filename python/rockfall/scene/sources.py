# SPDX-License-Identifier: BSD-3-Clause
"""Sources from the terrain: steep cells, and how many boulders each source releases by its area."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.errors import RockfallError
from rockfall.io.grid import Box, row_blocks
from rockfall.io.layers import burn_polygons
from rockfall.scene.kernel_scene import area_ratios, on_raster
from rockfall.scene.layers import file_checksum, layer_blocks
from rockfall.scene.scene import Scene


def threshold(scene: Scene) -> float:
    """The slope from which cells are steep [degree]: the case's, or the usual one of its cells."""
    usual = _core.slope_threshold(scene.grid.cell)
    return scene.case.release.get("slope_threshold", usual)


def steep_blocks(
    scene: Scene, blocks: Iterable[tuple[slice, np.ndarray]]
) -> Iterator[tuple[slice, np.ndarray]]:
    """Blocks of rows of possible source cells (above zero), less those that are not steep."""
    about = {"cell": scene.grid.cell, "threshold": threshold(scene), **on_raster(scene)}
    for rows, block in blocks:
        cells = np.asfortranarray((block > 0).T, np.int16)
        _core.steep_cells(**about, first=rows.start + 1, cells=cells)
        yield rows, cells.T


def refuse_by_area(scene: Scene, what: str) -> None:
    """Refuse what needs the same number of boulders from each source."""
    if scene.case.release["by_area"]:
        raise RockfallError(
            f"{scene.case.name}: &release by_area = .true.: {what} needs as many boulders from "
            "each source"
        )


def read_sources(scene: Scene, bands: Iterable[tuple[Scene, Box]], rasters: dict[str, Any]) -> None:
    """Release points, or the centres of source cells in the order of the raster.

    `bands` are rows of the terrain in order, each in a scene that holds it and what lies about it.
    """
    case, release = scene.case, scene.case.release
    if "x" in release:
        scene.x, scene.y = np.asarray(release["x"]), np.asarray(release["y"])
        return
    found, area = [], []
    for band, box in bands:
        blocks = {rows.start: np.argwhere(block > 0) for rows, block in _cells(band, box, rasters)}
        cells = [blocks[start] + (start, 0) for start in sorted(blocks)]
        row, column = np.concatenate(cells).T
        found.append((scene.grid.x[column], scene.grid.y[row]))
        if release["by_area"] and row.size:
            area.append(area_ratios(band, *found[-1]))
    scene.x, scene.y = (np.concatenate(axis) for axis in zip(*found, strict=True))
    if not scene.x.size and release["steep_cells"]:
        raise RockfallError(
            f"{case.name}: &release steep_cells: no cell is as steep as {threshold(scene):.1f} "
            "degrees"
        )
    if not scene.x.size:
        path = case.path(release.get("polygons") or release["cells"])
        raise RockfallError(f"{path}: no source cells: must have cells above zero")
    if area:
        scene.area = np.concatenate(area)


def _cells(scene: Scene, box: Box, rasters: dict[str, Any]) -> Iterator[tuple[slice, np.ndarray]]:
    """Blocks of rows of a box, with what is above zero in source cells."""
    case, release = scene.case, scene.case.release
    parts = list(row_blocks(box.shape))
    if "polygons" in release:
        path = case.path(release["polygons"])
        inside = burn_polygons(
            path, scene.grid, remarks=scene.remarks,
            layer=release.get("polygons_layer"), key="polygons_layer",
        )  # fmt: skip
        blocks = ((rows, inside[rows] & ~np.isnan(scene.z[rows])) for rows in parts)
        scene.checksums["polygons"] = file_checksum(path)
    elif "cells" in release:
        blocks = _noted(scene, layer_blocks(scene, "cells", "source cells", np.int32, rasters, box))
    else:
        blocks = ((rows, np.ones((rows.stop - rows.start, box.shape[1]), bool)) for rows in parts)
    blocks = ((slice(box.row + rows.start, box.row + rows.stop), block) for rows, block in blocks)
    yield from steep_blocks(scene, blocks) if release["steep_cells"] else blocks


def _noted(
    scene: Scene, blocks: Iterable[tuple[slice, np.ndarray]]
) -> Iterator[tuple[slice, np.ndarray]]:
    """The blocks of source cells; which values they have is noted."""
    for rows, block in blocks:
        scene.source_values.take(-block[block > 0].astype(float))
        yield rows, block
