# SPDX-License-Identifier: BSD-3-Clause
"""Reading of the rasters, sources and impact sets that a case names."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from rockfall.case import FROM_ARRAY, Case, file_keys
from rockfall.errors import RockfallError
from rockfall.grounds import other_tables
from rockfall.impact_sets import set_path
from rockfall.io.arrays import from_array
from rockfall.io.raster import dem_header, packing_note, read_dem
from rockfall.io.raster_file import raster_file
from rockfall.io.zone_table import RADII
from rockfall.scene.coefficients import open_sets
from rockfall.scene.digest import digest
from rockfall.scene.forest.read import read_forest
from rockfall.scene.frames import is_frame, with_frames
from rockfall.scene.layers import LAYERS, array_checksum, file_checksum
from rockfall.scene.lines import read_lines
from rockfall.scene.scene import Scene
from rockfall.scene.sources import read_sources
from rockfall.scene.surface import cell_bytes, read_grounds, read_surface, size_columns
from rockfall.scene.windows import Windows, bands
from rockfall.terrain.dams import with_dam


def read_scene(
    case: Case, dem: Any = None, transform: Any = None, memory: float | None = None, **rasters: Any
) -> Scene:
    """Read and check everything that a case names.

    `dem` and `rasters` (zones, mean_radius, rg70, rg20, rg10, ground_map, cells, stems, dbh_mean,
    dbh_std, conifers) may be given as arrays: an xarray.DataArray, or NumPy on the cells of the DEM
    (for the DEM itself with its `transform`). Layers (lines, barriers, dams, zones, sources, trees)
    may be given as GeoDataFrames: lines, barriers and dams in addition to those of the case. If
    rasters in files need more than half of `memory` [bytes], they are read in windows on demand:
    see `rockfall.scene.windows`.
    """
    if not isinstance(case, Case):
        raise RockfallError(f"case = {case!r}: must be a Case; rockfall.read_case(path) reads one")
    frames = {name: one for name, one in rasters.items() if is_frame(one)}
    if frames:
        rasters = {name: one for name, one in rasters.items() if name not in frames}
        return with_frames(
            frames, case, lambda named: read_scene(named, dem, transform, memory, **rasters)
        )
    arrays = {"dem": dem, **rasters}
    case = _with_arrays(case, {key for key, array in arrays.items() if array is not None})
    _check_files(case, arrays)
    if dem is not None:
        z, grid = from_array(dem, transform)
    elif case.terrain["dem"] == FROM_ARRAY:
        raise RockfallError(
            f"{case.name}: &terrain dem is missing: a raster file, or run(case, dem=...)"
        )
    else:
        path = case.path(case.terrain["dem"])
        if memory is not None and not rasters:
            grid, dtype = dem_header(path)
            if (cells := int(memory / 2 / cell_bytes(case, dtype))) < grid.nx * grid.ny:
                scene = Scene(case, grid, np.empty((0, 0), dtype), np.zeros((1, 1)))
                read_lines(scene)
                return _windowed(scene, cells)
        z, grid = read_dem(path)
    scene = Scene(case, grid, z, np.zeros((1, 1)))
    read_lines(scene)
    for dam in scene.case.dam:
        scene.z, shape = with_dam(scene.z, grid, dam, case.name)
        scene.dams.append(shape)
    file = case.path(case.terrain["dem"])
    scene.checksums["dem"] = file_checksum(file) if dem is None else array_checksum(scene.z)
    scene.remarks += packing_note(file) if dem is None else []
    read_surface(scene, grid.box, rasters)
    read_sources(scene, [(scene, grid.box)], rasters)
    read_forest(scene, rasters)
    _read_sets(scene)
    if rasters:
        raise RockfallError(
            f"{case.name}: rasters that the case does not use: {', '.join(rasters)}"
        )
    scene.decoded = digest(scene)
    _ = scene.kernel  # raises errors that the case text alone cannot reveal
    return scene


def _windowed(scene: Scene, cells: int) -> Scene:
    """The scene without rasters, which are read in windows of the given number of cells; all rows
    have been read and checked once."""
    case = scene.case
    by_source = {"sources", "reach_probability_by_source"} & set(case.output.get("maps", []))
    if by_source:
        raise RockfallError(
            f"{case.name}: &output maps = '{min(by_source)}': needs the whole terrain in memory, "
            "and it does not fit; leave it out, or raise --memory"
        )
    if case.dam:
        raise RockfallError(
            f"{case.name}: &dam: needs the whole terrain in memory, and it does not fit; "
            "raise --memory"
        )
    for key, file in case.files():
        if key.file == "layer" or ("layer" in key.file and Path(file).suffix.lower() in LAYERS):
            raise RockfallError(
                f"{case.name}: &{key.group} {key.name} = '{file}': polygons need the whole terrain "
                "in memory, and it does not fit; make a raster of them, or raise --memory"
            )
    scene.checksums["dem"] = file_checksum(case.path(case.terrain["dem"]))
    scene.remarks += packing_note(case.path(case.terrain["dem"]))
    release, rows = case.release, [(scene, scene.grid.box)]
    if release["steep_cells"] or release["by_area"]:  # sources from the terrain
        rows = bands(scene, cells)
    read_sources(scene, rows, {})
    read_forest(scene, {})
    _read_sets(scene)
    read_grounds(scene)
    scene.windows = Windows(scene, cells)
    scene.decoded = scene.windows.decoded
    return scene


def _read_sets(scene: Scene) -> None:
    """Read the impact sets, last of all."""
    scene.sets = open_sets(set_path(scene.case))
    scene.checksums["sets"] = scene.sets.checksum


def _with_arrays(case: Case, keys: set[str]) -> Case:
    """Check the case again, with the rasters that were given as arrays."""
    changes: dict[str, Any] = {}
    for key in file_keys():
        if "raster" in key.file and key.name in keys and key.name in getattr(case, key.group):
            changes.setdefault(key.group, {})[key.name] = FROM_ARRAY
    return case.replace(**changes)


def _check_files(case: Case, arrays: dict[str, Any]) -> None:
    """Check that every file exists that the case names and that is to be read."""
    unread = {*RADII} - {*size_columns(case)}
    for key, file in case.files():
        if (
            key.file in ("sets", "impact_table")
            or (key.name == "ground_table" and file in other_tables())
            or key.name in unread
            or arrays.get(key.name) is not None
        ):
            continue
        if file != FROM_ARRAY and not os.path.exists(raster_file(str(case.path(file)))):
            raise RockfallError(f"{case.name}: &{key.group} {key.name} = '{file}': no such file")
