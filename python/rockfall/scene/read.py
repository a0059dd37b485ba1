# SPDX-License-Identifier: BSD-3-Clause
"""Reading of all rasters, sources and impact sets of a case."""

import os
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rockfall.case import FROM_ARRAY, Case, file_keys
from rockfall.case.variants import check_single
from rockfall.errors import FAULT_MARK, RockfallError
from rockfall.grounds import other_tables
from rockfall.grounds.impact_sets import set_path
from rockfall.io.rasters.arrays import check_known, from_array
from rockfall.io.rasters.dem import dem_header, packing_note, read_dem
from rockfall.io.rasters.grid import Box, Grid
from rockfall.io.rasters.raster_file import raster_file
from rockfall.io.vectors.layers import EXTENSIONS
from rockfall.io.zone_table import RADII
from rockfall.language import remark
from rockfall.scene.digest import Digest
from rockfall.scene.forest.planted import read_forest
from rockfall.scene.frames import FrameFiles, is_frame, with_frames
from rockfall.scene.ground import Ground
from rockfall.scene.layers import Inputs, array_checksum, file_checksum, take_inputs
from rockfall.scene.lines import read_lines
from rockfall.scene.parts import Rasters
from rockfall.scene.rebounds.coefficients import open_sets
from rockfall.scene.releases.reach import Survey
from rockfall.scene.releases.sources import has_idle_shapes, read_sources
from rockfall.scene.rules.effects import check_effects
from rockfall.scene.scene import Scene
from rockfall.scene.stages import FRESH, Stages
from rockfall.scene.surface import cell_bytes, read_grounds, read_rasters, size_columns
from rockfall.scene.windows import Windows, bands
from rockfall.terrain.dams import with_dams


def read_scene(
    case: Case,
    dem: Any = None,
    transform: Any = None,
    memory: float | None = None,
    *,
    stages: Stages = FRESH,
    frame_store: FrameFiles | None = None,
    **rasters: Any,
) -> Scene:
    """Read and check all inputs of a case; invalid inputs raise a RockfallError. `dem` and
    `rasters` (zones, mean_radius, rg70, rg20, rg10, ground_map, cells, stems, dbh_mean, dbh_std,
    conifers) may be given as arrays: an xarray.DataArray, or NumPy on the cells of the DEM (for the
    DEM itself with its `transform`). Layers (lines, barriers, dams, zones, sources, trees, stands,
    clearings) may be given as GeoDataFrames: lines, barriers and dams in addition to those of the
    case. Rasters in files that need more than half of `memory` [bytes] (None: no limit) are read in
    windows on demand: see `rockfall.scene.windows`. An open session passes `stages` and
    `frame_store` to each reading, so that only changed inputs are read."""
    if not isinstance(case, Case):
        raise RockfallError(f"case = {case!r}: must be a Case, as read by rockfall.read_case(path)")
    check_single(case)
    frames = {name: frame for name, frame in rasters.items() if is_frame(frame)}
    if frames:
        rasters = {name: raster for name, raster in rasters.items() if name not in frames}
        return with_frames(
            frames, case,
            lambda named: read_scene(named, dem, transform, memory, stages=stages, **rasters),
            frame_store,
        )  # fmt: skip
    arrays = {"dem": dem, **rasters}
    case = _with_arrays(case, {key for key, array in arrays.items() if array is not None})
    _check_files(case, arrays)
    if dem is None and case.terrain["dem"] == FROM_ARRAY:
        raise RockfallError(
            f"{case.name}: &terrain dem is missing: give a raster file, or call run(case, dem=...)"
        )
    if dem is None and memory is not None and not rasters:
        grid, dtype = stages.take("header", case, (), lambda case: dem_header(_dem_path(case)))
        if (cells := int(memory / 2 / cell_bytes(case, dtype))) < grid.nx * grid.ny:
            return _windowed(Inputs(case, grid), dtype, cells)
    z, grid, checksum, remarks = stages.take(
        "dem", case, (dem, transform), lambda case: _elevations(case, dem, transform)
    )
    inputs = Inputs(case, grid, rasters)
    inputs.case = read_lines(inputs, stages)
    z, dams = stages.take(
        "dams", inputs.case, (z,), lambda case: with_dams(z, grid, case.dam, case.name)
    )
    inputs.checksums["dem"] = checksum or array_checksum(z)
    inputs.remarks += remarks
    terrain = take_inputs(
        stages, "surface", inputs, (z,), lambda inputs: read_rasters(inputs, z, grid.box)
    )
    scene = _scene(inputs, terrain, lambda: [(Rasters(grid, z), grid.box)], stages)
    sums = stages.take("digest", inputs.case, (terrain,), lambda _: _digest(terrain))
    scene = replace(scene, dams=dams, decoded=sums.sums(scene, scene.trees), stages=stages)
    _ = scene.kernel.handle  # raises errors that the case text alone does not show
    check_effects(scene)
    return scene


def _elevations(case: Case, dem: Any, transform: Any) -> tuple[np.ndarray, Grid, str, list[str]]:
    """Elevations, from an array or a file, with grid, file checksum and remarks."""
    if dem is not None:
        return *from_array(dem, transform), "", []
    file = _dem_path(case)
    remarks: list[str] = []
    z, grid = read_dem(file, remarks)
    return z, grid, file_checksum(file), remarks


def _dem_path(case: Case) -> Path:
    return case.path(case.terrain["dem"])


def _digest(rasters: Rasters) -> Digest:
    """Checksums of a terrain in memory and its ground."""
    sums = Digest(rasters.grid)
    sums.take(rasters, 0, rasters.grid.ny)
    return sums


def _scene(
    inputs: Inputs,
    rasters: Rasters,
    rows: Callable[[], Iterable[tuple[Rasters, Box]]],
    stages: Stages = FRESH,
) -> Scene:
    """Scene of a case with its rasters; impact sets are read last. Refuses rasters that the case
    does not use."""
    sources = take_inputs(
        stages, "sources", inputs, (rasters.z,), lambda inputs: read_sources(inputs, rows())
    )
    if has_idle_shapes(sources, rasters.grounds):
        path = inputs.case.path(
            inputs.case.release.get("points") or inputs.case.release["polygons"]
        )
        inputs.remarks.append(remark(path, "input.shapes_not_used"))
    trees, stands = read_forest(inputs, sources.x, sources.y, stages)
    sets = stages.take("sets", inputs.case, (), lambda case: open_sets(set_path(case)))
    inputs.checksums["sets"] = sets.checksum
    if inputs.arrays:
        raise RockfallError(
            f"{inputs.case.name}: rasters not used by the case: {', '.join(inputs.arrays)}"
        )
    return Scene(
        case=inputs.case, rasters=rasters, **vars(sources), trees=trees, stands=stands, sets=sets,
        checksums=inputs.checksums, remarks=tuple(inputs.remarks),
    )  # fmt: skip


def _windowed(inputs: Inputs, dtype: np.dtype, cells: int) -> Scene:
    """Scene without rasters: all rows are read and checked once here, and again in windows by a
    run."""
    inputs.case = read_lines(inputs)
    case, grid = inputs.case, inputs.grid
    by_source = {"sources", "reach_probability_by_source"} & set(case.output.get("maps", []))
    if by_source:
        raise RockfallError(
            f"{case.name}: &output maps = '{min(by_source)}': needs the whole terrain in memory, "
            "where it does not fit: omit it, or raise --memory"
        )
    if case.dam:
        raise RockfallError(
            f"{case.name}: &dam: needs the whole terrain in memory, where it does not fit: "
            "raise --memory"
        )
    for key, file in case.files():
        if key.file == "layer" or ("layer" in key.file and Path(file).suffix.lower() in EXTENSIONS):
            raise RockfallError(
                f"{case.name}: &{key.group} {key.name} = '{file}': polygons need the whole terrain "
                "in memory, where it does not fit: convert them to a raster, or raise --memory"
            )
    inputs.checksums["dem"] = file_checksum(case.path(case.terrain["dem"]))
    inputs.remarks += packing_note(case.path(case.terrain["dem"]))
    empty = Rasters(grid, np.empty((0, 0), dtype))
    read_grounds(inputs, empty)
    from_terrain = case.release["steep_cells"] or case.release["by_area"]
    rows = bands(inputs, cells) if from_terrain else [(empty, grid.box)]
    scene = _scene(inputs, empty, lambda: rows)
    survey, ground, sums, checked = Survey(case, grid), Ground(), Digest(grid), False
    for band, box in bands(inputs, cells):
        checked = check_known(grid.path, band.z, band.at[0]) or checked
        survey.take(replace(scene, rasters=band).kernel, box.row, box.stop_row)
        ground.take(band, box)
        ground = ground.with_sources(band, box, scene.x, scene.y)
        sums.take(band, box.row, box.stop_row)
    if not checked:
        raise RockfallError(f"{grid.path}: all cells are nodata")
    windows = Windows(cells, cell_bytes(case, dtype), survey, ground)
    decoded = sums.sums(scene, scene.trees)
    check_effects(scene)
    return replace(scene, windows=windows, decoded=decoded, remarks=tuple(inputs.remarks))


def _with_arrays(case: Case, keys: set[str]) -> Case:
    """Case in which arrays replace the files of rasters, checked again."""
    changes: dict[str, Any] = {}
    for key in file_keys():
        if "raster" in key.file and key.name in keys and key.name in getattr(case, key.group):
            changes.setdefault(key.group, {})[key.name] = FROM_ARRAY
    return case.replace(**changes) if changes else case


def _check_files(case: Case, arrays: dict[str, Any]) -> None:
    """Check that all input files of the case exist; the error lists missing files."""
    missing = []
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
            missing.append(f"{case.name}: &{key.group} {key.name} = '{file}': no such file")
    if missing:
        raise RockfallError(FAULT_MARK.join(missing))
