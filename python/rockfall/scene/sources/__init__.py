# SPDX-License-Identifier: BSD-3-Clause
"""Sources from the terrain: steep cells, the number of boulders per area, and the size and shape of
boulders."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.errors import RockfallError
from rockfall.io.grid import NO_ID, Box, row_blocks
from rockfall.io.layers import numbered_polygons, read_points
from rockfall.io.tables import read_columns
from rockfall.limits import MAX_REAL
from rockfall.scene.kernel_scene import area_ratios, terrain_of
from rockfall.scene.layers import LAYERS, layer_blocks, note_layer
from rockfall.scene.scene import Scene, SourceBoulders
from rockfall.scene.sources.attributes import Table, read_attributes

SIDES = ("d1", "d2", "d3")
SHAPES = int(_core.constant("shapes"))  # numbered from 1
SPHERE = 3  # default shape
MAX_SIDE = 1e3  # [m]


def threshold(scene: Scene) -> float:
    """Slope from which cells are steep [degree]: the case's, or the default for its cell size."""
    usual = _core.slope_threshold(scene.grid.cell)
    return scene.case.release.get("slope_threshold", usual)


def steep_blocks(
    scene: Scene, blocks: Iterable[tuple[slice, np.ndarray]]
) -> Iterator[tuple[slice, np.ndarray]]:
    """Blocks of rows of possible source cells (above zero), less those that are not steep."""
    with terrain_of(scene) as terrain:
        for rows, block in blocks:
            cells = np.asfortranarray((block > 0).T, np.int16)
            _core.steep_cells(terrain, threshold(scene), rows.start + 1, cells)
            yield rows, cells.T


def refuse_by_area(scene: Scene, what: str) -> None:
    """Refuse an option that requires the same number of boulders from each source."""
    if scene.frequency is not None:
        raise RockfallError(
            f"{scene.case.name}: sources have a frequency: {what} needs as many boulders from each"
        )
    if scene.case.release["by_area"]:
        raise RockfallError(
            f"{scene.case.name}: &release by_area = .true.: {what} needs as many boulders from "
            "each source"
        )


def read_sources(scene: Scene, bands: Iterable[tuple[Scene, Box]], rasters: dict[str, Any]) -> None:
    """Release points, or the centres of source cells in raster order, with their boulder
    properties.

    `bands` are rows of the terrain in order, each in a scene that holds it and its neighbours.
    """
    _find_sources(scene, bands, rasters)
    if "d1" in scene.case.boulder:
        _read_boulders(scene, rasters)


def _find_sources(
    scene: Scene, bands: Iterable[tuple[Scene, Box]], rasters: dict[str, Any]
) -> None:
    case, release = scene.case, scene.case.release
    if "x" in release:
        scene.x, scene.y = np.asarray(release["x"]), np.asarray(release["y"])
        return
    if "points" in release:
        _find_points(scene)
        return
    found, area = [], []
    polygons, table = _polygons(scene)
    of: list[np.ndarray] = []
    for band, box in bands:
        parts = _cells(band, box, rasters, polygons)
        blocks = {rows.start: np.argwhere(block > 0) for rows, block in parts}
        cells = [blocks[start] + (start, 0) for start in sorted(blocks)]
        row, column = np.concatenate(cells).T
        found.append((scene.grid.x[column], scene.grid.y[row]))
        of += [] if polygons is None else [polygons[row, column].astype("i4")]
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
    if table is not None:
        _take_attributes(scene, table, np.concatenate(of))


def _polygons(scene: Scene) -> tuple[np.ndarray | None, Table | None]:
    """Polygon number of each cell, from 1, and the attributes of polygons; None without a layer."""
    case, release = scene.case, scene.case.release
    if "polygons" not in release:
        return None, None
    path = case.path(release["polygons"])
    layer = release.get("polygons_layer")
    cells, columns = numbered_polygons(path, scene.grid, scene.remarks, layer, "polygons_layer")
    note_layer(scene, "polygons", path, layer)
    size = max([int(cells.max()), *map(len, columns.values())])
    return cells, Table(str(path), columns, size, lambda k: f"{path}: feature {k + 1}")


def _find_points(scene: Scene) -> None:
    """Read sources at the points of a layer or a table."""
    case, release = scene.case, scene.case.release
    path = case.path(release["points"])
    if path.suffix.lower() in LAYERS:
        layer = release.get("points_layer")
        scene.x, scene.y, columns, feature = read_points(
            path, scene.grid, scene.remarks, layer, "points_layer"
        )
        table = Table(str(path), columns, feature.size, lambda k: f"{path}: feature {feature[k]}")
    elif "points_layer" in release:
        raise RockfallError(f"{case.name}: &release points_layer: is not valid for a table")
    else:
        lines, columns = read_columns(path, ("x", "y"))
        table = Table(str(path), columns, len(lines), lambda k: lines[k], is_text=True)
        places = [table.places(axis) for axis in "xy"]
        scene.x, scene.y = places
    note_layer(scene, "points", path, release.get("points_layer"))
    _take_attributes(scene, table, np.arange(1, scene.x.size + 1, dtype="i4"))


def _take_attributes(scene: Scene, table: Table, of: np.ndarray) -> None:
    """Apply the release attributes of features; those of each source are given."""
    scene.features, frequency = read_attributes(scene, table, of)
    some = ~np.isnan(frequency)
    if not some.any():
        return
    if "boulders" in scene.case.case:
        scene.remarks.append(
            f"{table.path}: frequency is not used: &case boulders come from each source; "
            "boulders_total shares a number by it"
        )
    if not some.all():
        k = int(np.argmin(some))
        raise RockfallError(f"{table.where(k)}: has no frequency: all must have one, or none")
    own = np.ones(of.size) if scene.area is None else scene.area
    together = np.bincount(of, own, minlength=table.size + 1)
    scene.frequency = frequency[of - 1] * own / together[of]


def _read_boulders(scene: Scene, rasters: dict[str, Any]) -> None:
    """Read volume, inertia and density of the boulders of each source; sources of shape 0 have none
    and are left out."""
    boulder = scene.case.boulder
    if "shape" in boulder:
        shape = _at_sources(scene, "shape", "shapes", np.int32, rasters)
        _check(scene, "shape", shape, (shape >= 0) & (shape <= SHAPES), f"0 to {SHAPES}")
    else:
        shape = np.full(scene.x.size, SPHERE)
    some = shape > 0
    if not some.any():
        raise RockfallError(
            f"{scene.case.path(boulder['shape'])}: 0 at all sources: none has boulders"
        )
    if not some.all():
        out = np.count_nonzero(~some)
        scene.remarks.append(
            f"&boulder shape: 0 at {out:,} of {some.size:,} sources: no boulders there"
        )
    scene.x, scene.y = scene.x[some], scene.y[some]
    scene.area = None if scene.area is None else scene.area[some]
    scene.frequency = None if scene.frequency is None else scene.frequency[some]
    scene.features = scene.features and scene.features.at(some)
    d = np.array([_at_sources(scene, key, "sides", np.float64, rasters) for key in SIDES])
    for key, side in zip(SIDES, d, strict=True):
        _check(scene, key, side, (side > 0) & (side <= MAX_SIDE), f"> 0 and at most {MAX_SIDE:g} m")
    volume, inertia = _core.shape_numbers(shape[some], np.asfortranarray(d))
    density = None
    if "rock_density" in boulder:
        density = _at_sources(scene, "rock_density", "densities", np.float64, rasters)
        good = (density > 0) & (density <= MAX_REAL)
        _check(scene, "rock_density", density, good, "> 0 kg/m3")
    scene.source_boulders = SourceBoulders(volume, inertia, density)


def _at_sources(
    scene: Scene, key: str, what: str, dtype: Any, rasters: dict[str, Any]
) -> np.ndarray:
    """Values of a raster at the source cells."""
    grid, found = scene.grid, np.empty(scene.x.size, dtype)
    row = ((grid.north - scene.y) / grid.cell).astype(int).clip(0, grid.ny - 1)
    column = ((scene.x - grid.west) / grid.cell).astype(int).clip(0, grid.nx - 1)
    for rows, block in layer_blocks(scene, key, what, dtype, rasters, smooth=False):
        mine = (row >= rows.start) & (row < rows.stop)
        found[mine] = block[row[mine] - rows.start, column[mine]]
    return found


def _check(scene: Scene, key: str, values: np.ndarray, good: np.ndarray, allowed: str) -> None:
    """Refuse invalid boulder properties of a source."""
    if good.all():
        return
    k = np.flatnonzero(~good)[0]
    value = "no data" if np.isnan(values[k]) or values[k] == NO_ID else f"{values[k]:g}"
    raise RockfallError(
        f"{scene.case.path(scene.case.boulder[key])}: {value} at the source {scene.x[k]:.10g}, "
        f"{scene.y[k]:.10g}: must be {allowed}"
    )


def _cells(
    scene: Scene, box: Box, rasters: dict[str, Any], polygons: np.ndarray | None
) -> Iterator[tuple[slice, np.ndarray]]:
    """Blocks of rows of a box, positive in source cells."""
    release = scene.case.release
    parts = list(row_blocks(box.shape))
    if polygons is not None:
        blocks = ((rows, (polygons[rows] > 0) & ~np.isnan(scene.z[rows])) for rows in parts)
    elif "cells" in release:
        blocks = _noted(scene, layer_blocks(scene, "cells", "source cells", np.int32, rasters, box))
    else:
        blocks = ((rows, np.ones((rows.stop - rows.start, box.shape[1]), bool)) for rows in parts)
    blocks = ((slice(box.row + rows.start, box.row + rows.stop), block) for rows, block in blocks)
    yield from steep_blocks(scene, blocks) if release["steep_cells"] else blocks


def _noted(
    scene: Scene, blocks: Iterable[tuple[slice, np.ndarray]]
) -> Iterator[tuple[slice, np.ndarray]]:
    """Pass on blocks of source cells and record their values."""
    for rows, block in blocks:
        scene.source_values.take(-block[block > 0].astype(float))
        yield rows, block
