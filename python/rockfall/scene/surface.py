# SPDX-License-Identifier: BSD-3-Clause
"""Rock sizes of the ground: uniform, by zones, or cell by cell."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.grounds import GroundTable, check_number, find_ground, table_path, usual_ground
from rockfall.io.grid import NO_ID, Box, row_blocks
from rockfall.io.layers import burn_polygons
from rockfall.io.raster import read_elevations
from rockfall.io.zone_table import RADII, Zone, index_blocks, read_zone_table
from rockfall.scene.layers import LAYERS, file_checksum, layer_blocks, note_layer
from rockfall.scene.scene import Scene, used_zones


def size_columns(case: Case) -> tuple[str, ...]:
    """Size columns that the method of a case needs."""
    return RADII[:1] if case.surface["method"] == "B" else RADII[1:]


def radius_over_rg(case: Case) -> float:
    """Ratio of R_m to Rg in method A, where Rg is read as a diameter or a radius."""
    return _core.size_to_radius(case.surface["rg_reading"])


def read_surface(scene: Scene, box: Box, rasters: dict[str, Any]) -> None:
    """Read the rock sizes in a box of cells by the method of the case, and the grounds there."""
    surface = scene.case.surface
    columns = size_columns(scene.case)
    uniform = surface.get("uniform_mean_radius" if surface["method"] == "B" else "uniform_rg")
    zones = read_grounds(scene)
    if "ground_map" in surface:
        _read_cell_grounds(scene, box, rasters)
    if uniform is not None:
        scene.sizes = np.atleast_2d(np.asarray(uniform, dtype=float))
        _check_sizes(scene, columns, f"{scene.case.name}: &surface", [""])
    elif "zones" in surface:
        _read_zones(scene, box, columns, zones, rasters)
    elif set(columns).isdisjoint(surface):
        scene.sizes = np.full((1, len(columns)), np.nan)
        _check_sizes(scene, columns, f"{scene.case.name}: &surface", [""])
    else:
        _read_values(scene, box, columns, rasters)


def read_grounds(scene: Scene) -> dict[int, Zone]:
    """Read the grounds of a scene, where they differ from the case's impact sets, and the ground of
    each material. Returns its zones by id."""
    case, surface = scene.case, scene.case.surface
    zones = read_zone_table(case.path(surface["table"])) if "zones" in surface else {}
    named = [zone for zone in zones.values() if zone.ground]
    if case.impact["form"] == "matrix" and not named:
        if {"ground", "ground_map"}.isdisjoint(surface):
            return zones
    if named and "ground_map" in surface:
        raise RockfallError(
            f"{case.name}: &surface ground_map: the zones have grounds of their own "
            f"({named[0].where}); give one of both"
        )
    table = GroundTable(table_path(case))
    scene.checksums.setdefault("ground_table", file_checksum(table.path))
    if "ground" in surface:
        usual = find_ground(case, table, surface["ground"], f"{case.name}: &surface ground")
    else:
        usual = usual_ground(case)
    found = {usual.name: usual}
    for zone in named:
        if zone.ground not in found:
            found[zone.ground] = find_ground(case, table, zone.ground, f"{zone.where}: ground")
    if zones and len(named) == len(zones) and all(one.ground != usual.name for one in named):
        del found[usual.name]
    if "ground_map" in surface:
        found |= {name: table.ground(name) for name in table.names.values() if name not in found}
        scene.ground_ids = dict(table.names)
    check_number(found.values(), str(table.path))
    scene.grounds = tuple(found.values())
    numbers = {name: k for k, name in enumerate(found, start=1)}
    if named:
        of_zones = [numbers[zone.ground or usual.name] for zone in zones.values()]
        scene.material_ground = np.array(of_zones, np.int8)
    return zones


def _read_cell_grounds(scene: Scene, box: Box, rasters: dict[str, Any]) -> None:
    """Read the ground number of each cell; cells without an id have the case's ground."""
    case, ids = scene.case, scene.ground_ids
    blocks = layer_blocks(scene, "ground_map", "ids of grounds", np.int32, rasters, box)
    names = [scene.grounds[0].name, *ids.values()]
    place = index_blocks(
        blocks, box.shape, [NO_ID, *ids], None, scene.z, str(case.path(case.surface["ground_map"])),
        str(table_path(case)), "id",
    )  # fmt: skip
    numbers = {one.name: k for k, one in enumerate(scene.grounds, start=1)}
    scene.cell_ground = np.array([0, *(numbers[name] for name in names)], np.int8)[place]


def _read_zones(
    scene: Scene,
    box: Box,
    columns: tuple[str, ...],
    zones: dict[int, Zone],
    rasters: dict[str, Any],
) -> None:
    """Read zones as indices into the table of sizes."""
    case, surface = scene.case, scene.case.surface
    path, table_path_ = case.path(surface["zones"]), case.path(surface["table"])
    scene.checksums.setdefault("table", file_checksum(table_path_))
    if "zones" not in rasters and path.suffix.lower() in LAYERS:
        ids = burn_polygons(
            path, scene.grid, surface["zone_field"], scene.remarks,
            layer=surface.get("zones_layer"), key="zones_layer",
        )  # fmt: skip
        blocks = ((rows, ids[rows]) for rows in row_blocks(ids.shape))
        note_layer(scene, "zones", path, surface.get("zones_layer"))
    elif "zones_layer" in surface:
        raise RockfallError(f"{case.name}: &surface zones_layer: is not valid for a raster")
    else:
        blocks = layer_blocks(scene, "zones", "zones", np.int32, rasters, box)
    scene.zone = index_blocks(
        blocks, box.shape, list(zones), surface.get("default_zone"), scene.z,
        str(path), str(table_path_),
    )  # fmt: skip
    of_each = np.array([zone.sizes for zone in zones.values()])
    scene.sizes = of_each[:, [RADII.index(column) for column in columns]]
    _check_sizes(scene, columns, str(table_path_), [f": zone {zone}" for zone in zones])


def _check_sizes(scene: Scene, columns: tuple[str, ...], where: str, names: list[str]) -> None:
    """Check that used materials have the sizes that their grounds need; for grounds that need none,
    missing sizes become zero."""
    for k, ground in sorted(_used(scene)):
        need = scene.grounds[ground].rocks if scene.grounds else 2
        missing = np.isnan(scene.sizes[k]).any()
        if need and missing and not scene.grounds:
            method = scene.case.surface["method"]
            raise RockfallError(
                f"{where}{names[k]}: {', '.join(columns)} needed for method {method}"
            )
        if need and (missing or (need == 2 and not scene.sizes[k].all())):
            name = scene.grounds[ground].name if scene.grounds else scene.case.impact["sets"]
            about = f"ground '{name}' needs {', '.join(columns)}"
            raise RockfallError(f"{where}{names[k]}: {about}{' > 0' if need == 2 else ''}")
    if scene.grounds:
        scene.sizes = np.where(np.isnan(scene.sizes), 0.0, scene.sizes)


def _used(scene: Scene) -> set[tuple[int, int]]:
    """Pairs of material and ground that occur in some cell, both counted from 0."""
    if scene.cell_ground is None:
        used = [0] if scene.zone is None else used_zones(scene).tolist()
        grounds = scene.material_ground
        return {(k, 0 if grounds is None else int(grounds[k]) - 1) for k in used}
    found = np.zeros((len(scene.sizes) + 1, len(scene.grounds) + 1), bool)
    for rows in row_blocks(scene.z.shape):
        zone = np.ones((), np.int8) if scene.zone is None else scene.zone[rows]
        found[zone, scene.cell_ground[rows]] = True
    return {(int(k), int(ground)) for k, ground in np.argwhere(found[1:, 1:])}


def _read_values(scene: Scene, box: Box, columns: tuple[str, ...], rasters: dict[str, Any]) -> None:
    """Read rasters of sizes, required wherever the terrain is known and its ground needs them."""
    need = np.array([0, *(ground.rocks for ground in scene.grounds)] if scene.grounds else [0, 2])
    scene.values = np.empty((len(columns), *box.shape), np.float32)
    for name, layer in zip(columns, scene.values, strict=True):
        missing = bad = 0
        for rows, block in layer_blocks(scene, name, f"values of {name}", np.float32, rasters, box):
            here = need[1 if scene.cell_ground is None else scene.cell_ground[rows]]
            unknown = np.isnan(block)
            layer[rows] = np.where(unknown & (here == 0), 0, block) if scene.grounds else block
            missing += np.count_nonzero(unknown & (here > 0) & ~np.isnan(scene.z[rows]))
            bad += np.count_nonzero((block < 0) | ((block == 0) & (here == 2)))
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
    """Memory per cell of the rasters of a case."""
    surface = case.surface
    own = dtype.itemsize + ("ground_map" in surface)
    if "zones" in surface:
        return own + 2
    has_layers = not set(RADII).isdisjoint(surface)
    return own + 4 * len(size_columns(case)) * has_layers
