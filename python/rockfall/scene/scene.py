# SPDX-License-Identifier: BSD-3-Clause
"""From a case to the arrays that the kernel takes: rasters, sources, impact sets, lines."""

from __future__ import annotations

import hashlib
import importlib.resources
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import FROM_ARRAY, Case
from rockfall.errors import RockfallError
from rockfall.io.files import check_regular, check_text_file
from rockfall.io.grid import NO_ID, Box, Grid, row_blocks
from rockfall.scene.digest import digest
from rockfall.scene.ground import Ground, Lowest, ground_of

if TYPE_CHECKING:
    from rockfall.scene.windows import Tiles

LAWS = {"fixed": 1, "normal": 2, "uniform": 3, "lognormal": 4, "list": 5}
METHODS = {"A": 1, "B": 2}
TURNINGS = {"past_aspect": 1, "to_aspect": 2, "lab": 3}
SAMPLINGS = {"random": 0, "sobol": 13}  # words of a boulder that are of its Sobol' point
MOST_BOULDERS = 2**31 - 1  # of a run: passages count them in 32 bits
SIZE_TO_RADIUS = {"diameter": 0.5, "radius": 1.0}
ANY_SPEED = 1e100  # [m/s] end of the range of a set that tells none, as in the kernel
POLYGONS = {".gpkg", ".geojson", ".json", ".shp", ".fgb"}  # endings of layers of polygons


def _absent(dtype: str, dims: int = 1) -> np.ndarray:
    """What the kernel takes for an array that a scene does not have."""
    return np.zeros((1,) * dims, dtype)


ABSENT = _absent("f8")


class Coefficients(NamedTuple):
    """The numbers of five impact sets, as in the kernel's coefficients_t."""

    mean: np.ndarray  # (9, 5)
    covariance: np.ndarray  # (9, 9, 5)
    incidence: np.ndarray  # (8, 5): angles between the classes of `lateral` [degree]
    lateral: np.ndarray  # (13, 9, 5): quantiles of the lateral deviation [degree]
    speed_range: np.ndarray  # (2, 5): incident speeds that they were fitted on [m/s]
    angle_range: np.ndarray  # (2, 5): and angles from the surface [degree]


@dataclass
class Scene:
    """What a run needs, read and checked. Rasters are (ny, nx), row 0 the northernmost."""

    case: Case
    grid: Grid
    z: np.ndarray  # elevations [m], NaN = none
    sizes: np.ndarray  # (materials, 1 or 3): R_m, or Rg70, Rg20, Rg10 [m]
    zone: np.ndarray | None = None  # int8 or int16: 1-based row of `sizes`
    values: np.ndarray | None = None  # float32 (1 or 3, ny, nx): sizes of each cell [m]
    x: np.ndarray = field(default_factory=lambda: np.empty(0))  # of each source [m]
    y: np.ndarray = field(default_factory=lambda: np.empty(0))
    area: np.ndarray | None = None  # surface over plan area of each, where they release by it
    sets: Coefficients | None = None
    checksums: dict[str, str] = field(default_factory=dict)  # of the input files
    decoded: dict[str, str] = field(default_factory=dict)  # of what was read of them: see `digest`
    at: tuple[int, int] = (0, 0)  # row and column of the grid where its rasters begin
    tiles: Tiles | None = None  # terrain that is read in windows: no rasters here
    marks: Lowest = field(default_factory=Lowest)  # the negatives of what source cells hold
    doubts: list[str] = field(default_factory=list)  # what readers found odd, a line each

    @property
    def boulders(self) -> int:
        """Boulders of the whole run."""
        if self.area is None:
            return self.case.case["boulders"] * self.x.size
        return int(self.ends[-1])

    @cached_property
    def ends(self) -> np.ndarray:
        """The last boulder of each source, where they release by area."""
        return _core.release_ends(self.area, self.case.case["boulders"])

    @cached_property
    def ground(self) -> Ground:
        """What its terrain is like."""
        return self.tiles.ground if self.tiles else ground_of(self)

    def source_of(self, number: int) -> int:
        """The source of a boulder (1..), counted from 0."""
        if self.area is None:
            return (number - 1) // self.case.case["boulders"]
        return int(np.searchsorted(self.ends, number))

    def numbers_of(self, source: int) -> range:
        """The boulders of a source, which is counted from 0."""
        if self.area is None:
            n = self.case.case["boulders"]
            return range(source * n + 1, (source + 1) * n + 1)
        before = self.ends[source - 1] if source else 0
        return range(int(before) + 1, int(self.ends[source]) + 1)

    def forget_rasters(self) -> None:
        """Give their memory back; the scene cannot be run any more."""
        self.z, self.zone, self.values = np.empty((0, 0), self.z.dtype), None, None

    def _has_zones(self, dtype: type) -> bool:
        return self.zone is not None and self.zone.dtype == dtype

    def kernel_arguments(self) -> dict[str, Any]:
        """The arguments of `_core.run` that stay the same from chunk to chunk."""
        case, boulder, release = self.case, self.case.boulder, self.case.release
        single = self.z.dtype == np.float32
        law = [boulder.get(f"volume_{key}", 0.0) for key in ("mean", "std", "min", "max")]
        sets = self.sets._asdict() if self.sets else {}  # read last of all
        lines = case.line or [{"x": ABSENT, "y": ABSENT}]
        return {
            "z8": _absent("f8", 2) if single else self.z.T,
            "z4": self.z.T if single else _absent("f4", 2),
            "west": self.grid.west, "north": self.grid.north, "cell": self.grid.cell,
            "nodes": (self.grid.nx, self.grid.ny), "at": (self.at[1] + 1, self.at[0] + 1),
            "zone1": self.zone.T if self._has_zones(np.int8) else _absent("i1", 2),
            "zone2": self.zone.T if self._has_zones(np.int16) else _absent("i2", 2),
            "values": _absent("f4", 3) if self.values is None else self.values.T,
            "sizes": np.asfortranarray(self.sizes.T),
            "method": METHODS[case.surface["method"]],
            "size_to_radius": SIZE_TO_RADIUS[case.surface["rg_reading"]],
            **{f"set_{name}": values for name, values in sets.items()},
            "turning": TURNINGS[case.impact["turning"]],
            "between": case.impact["ratio"] == "between",
            "gravity": case.flight["gravity"], "stop_speed": case.impact["stop_speed"],
            "impact_limit": case.impact["impact_limit"],
            "law": LAWS[boulder["volume"]], "law_values": law,
            "volumes": boulder.get("volumes", ABSENT), "density": boulder["density"],
            "source_x": self.x, "source_y": self.y,
            "per_source": case.case["boulders"] if self.area is None else self.ends[0],
            "source_end": _absent("i8") if self.area is None else self.ends,
            "drop_height": release["drop_height"], "velocity": release["velocity"],
            "lines": len(case.line), "line_end": np.cumsum([len(line["x"]) for line in lines]),
            "line_x": np.concatenate([line["x"] for line in lines]),
            "line_y": np.concatenate([line["y"] for line in lines]),
            "seed": case.case["seed"], "sobol": SAMPLINGS[case.case["sampling"]],
        }  # fmt: skip


def read_scene(
    case: Case, dem: Any = None, transform: Any = None, memory: float | None = None, **rasters: Any
) -> Scene:
    """Read and check everything that a case names.

    `dem` and `rasters` (zones, mean_radius, rg70, rg20, rg10, cells) may be given as arrays: an
    xarray.DataArray, or NumPy on the cells of the DEM (for the DEM itself with its `transform`).
    If rasters in files need more than half of `memory` [bytes], they are read in windows, as they
    are needed: see `rockfall.scene.windows`.
    """
    from rockfall.io.raster import dem_header, from_array, read_dem

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
                return _tiled(Scene(case, grid, np.empty((0, 0), dtype), np.zeros((1, 1))), cells)
        z, grid = read_dem(path)
    scene = Scene(case, grid, z, np.zeros((1, 1)))
    file = case.path(case.terrain["dem"])
    scene.checksums["dem"] = _checksum(file) if dem is None else _array_checksum(z)
    _read_surface(scene, grid.box, rasters)
    _read_sources(scene, [(scene, grid.box)], rasters)
    _end(scene)
    if rasters:
        raise RockfallError(
            f"{case.name}: rasters that the case does not use: {', '.join(rasters)}"
        )
    scene.decoded = digest(scene)
    return scene


def _tiled(scene: Scene, cells: int) -> Scene:
    """The scene without its rasters, which are read in windows of so many cells; all of them were
    read once, and checked."""
    from rockfall.scene.windows import Tiles, bands

    case = scene.case
    by_source = {"sources", "reach_probability_by_source"} & set(case.output.get("maps", []))
    if by_source:
        raise RockfallError(
            f"{case.name}: &output maps = '{min(by_source)}': needs the whole terrain in memory, "
            "and it does not fit; leave it out, or raise --memory"
        )
    for group, key in (("release", "polygons"), ("surface", "zones")):
        file = getattr(case, group).get(key, "")
        if key == "polygons" and file or Path(file).suffix.lower() in POLYGONS:
            raise RockfallError(
                f"{case.name}: &{group} {key} = '{file}': polygons need the whole terrain in "
                "memory, and it does not fit; make a raster of them, or raise --memory"
            )
    scene.checksums["dem"] = _checksum(case.path(case.terrain["dem"]))
    release, rows = case.release, [(scene, scene.grid.box)]
    if release["steep_cells"] or release["by_area"]:  # the terrain tells
        rows = bands(scene, cells)
    _read_sources(scene, rows, {})
    _end(scene)
    scene.tiles = Tiles(scene, cells)
    scene.decoded = scene.tiles.decoded
    return scene


def read_window(scene: Scene, box: Box) -> Scene:
    """The scene with the rasters of a box of its cells."""
    from rockfall.io.raster import read_elevations

    z = read_elevations(scene.case.path(scene.case.terrain["dem"]), box)
    window = replace(scene, z=z, at=(box.row, box.column), tiles=None)
    _read_surface(window, box, {})
    return window


def cell_bytes(case: Case, dtype: np.dtype) -> int:
    """Memory of a cell of the rasters of a case."""
    surface = case.surface
    if "zones" in surface:
        return dtype.itemsize + 2
    layers = {"mean_radius", "rg70", "rg20", "rg10"} & set(surface)
    return dtype.itemsize + 4 * (3 if surface["method"] == "A" else 1) * bool(layers)


def _end(scene: Scene) -> None:
    """What is checked, and read, when the sources are known."""
    case = scene.case
    if scene.boulders > MOST_BOULDERS:
        raise RockfallError(
            f"{case.name}: &case boulders = {case.case['boulders']} from each of {scene.x.size} "
            f"sources: must be at most {MOST_BOULDERS} together"
        )
    scene.sets, scene.checksums["sets"] = read_sets(case, set_path(case))


def _with_arrays(case: Case, keys: set[str]) -> Case:
    """The case, checked once more, saying which of its rasters came as arrays."""
    groups = {"dem": "terrain", "cells": "release"}
    changes: dict[str, dict[str, str]] = {}
    for key in keys & {"dem", "zones", "mean_radius", "rg70", "rg20", "rg10", "cells"}:
        group = groups.get(key, "surface")
        if key == "dem" or key in getattr(case, group):
            changes.setdefault(group, {})[key] = FROM_ARRAY
    return case.replace(**changes)


def _check_files(case: Case, arrays: dict[str, Any]) -> None:
    """Every file that the case names and that is to be read is there."""
    from rockfall.io.raster_file import raster_file

    sizes = ("mean_radius",) if case.surface["method"] == "B" else ("rg70", "rg20", "rg10")
    keys = {"terrain": ("dem",), "surface": ("zones", "table", *sizes)}
    keys["release"] = ("cells", "polygons")
    for group, names in keys.items():
        for key in names:
            file = getattr(case, group).get(key)
            if file in (None, FROM_ARRAY) or arrays.get(key) is not None:
                continue
            if not os.path.exists(raster_file(str(case.path(file)))):
                raise RockfallError(f"{case.name}: &{group} {key} = '{file}': no such file")


def lines_outside(scene: Scene) -> list[str]:
    """Names of the evaluation lines of which no part lies over the terrain."""
    grid, outside = scene.grid, []
    for line in scene.case.line:
        apart_x = max(line["x"]) < grid.west or min(line["x"]) > grid.east
        apart_y = max(line["y"]) < grid.south or min(line["y"]) > grid.north
        if apart_x or apart_y:
            outside.append(line["name"])
    return outside


def shipped_sets() -> dict[str, Path]:
    """Files of the impact sets that are shipped with the program, by name."""
    folder = Path(str(importlib.resources.files("rockfall") / "data" / "impact_sets"))
    return {path.stem: path for path in sorted(folder.glob("*.nml"))}


def set_path(case: Case, name: str | None = None, group: str = "impact") -> Path:
    """The file of impact sets, the case's or those that a group names: beside it, or shipped."""
    name, shipped = name or case.impact["sets"], shipped_sets()
    if name in shipped:
        return shipped[name]
    if os.path.isfile(case.path(name)):
        return case.path(name)
    known = ", ".join(shipped)
    raise RockfallError(
        f"{case.name}: &{group} sets = '{name}': no such file; shipped sets: {known}"
    )


def _read_surface(scene: Scene, box: Box, rasters: dict[str, Any]) -> None:
    surface = scene.case.surface
    columns = ("mean_radius",) if surface["method"] == "B" else ("rg70", "rg20", "rg10")
    uniform = surface.get("uniform_mean_radius" if surface["method"] == "B" else "uniform_rg")
    if uniform is not None:
        scene.sizes = np.atleast_2d(np.asarray(uniform, dtype=float))
    elif "zones" in surface:
        _read_zones(scene, box, columns, rasters)
    else:
        _read_values(scene, box, columns, rasters)


def _read_zones(scene: Scene, box: Box, columns: tuple[str, ...], rasters: dict[str, Any]) -> None:
    """Zones as an index into the table's sizes."""
    from rockfall.io.raster import burn_polygons, index_blocks, read_zone_table

    case, surface = scene.case, scene.case.surface
    path, table_path = case.path(surface["zones"]), case.path(surface["table"])
    table = read_zone_table(table_path)
    scene.checksums.setdefault("table", _checksum(table_path))
    if "zones" not in rasters and path.suffix.lower() in POLYGONS:
        ids = burn_polygons(path, scene.grid, surface["zone_field"], scene.doubts)
        blocks = ((rows, ids[rows]) for rows in row_blocks(ids.shape))
        scene.checksums["zones"] = _checksum(path)
    else:
        blocks = _blocks(scene, "zones", "zones", np.int32, rasters, box)
    names = ("mean_radius", "rg70", "rg20", "rg10")
    sizes = np.array(list(table.values()))[:, [names.index(column) for column in columns]]
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


def used_zones(scene: Scene) -> np.ndarray:
    """The rows of `sizes`, counted from 0, that some cell has."""
    found = np.zeros(len(scene.sizes) + 1, bool)
    for rows in row_blocks(scene.zone.shape):
        found[scene.zone[rows]] = True
    return np.flatnonzero(found[1:])


def _read_values(scene: Scene, box: Box, columns: tuple[str, ...], rasters: dict[str, Any]) -> None:
    """Rasters of sizes, known wherever the terrain is."""
    scene.values = np.empty((len(columns), *box.shape), np.float32)
    for name, layer in zip(columns, scene.values, strict=True):
        missing = bad = 0
        for rows, block in _blocks(scene, name, f"values of {name}", np.float32, rasters, box):
            layer[rows] = block
            missing += np.count_nonzero(np.isnan(block) & ~np.isnan(scene.z[rows]))
            bad += np.count_nonzero(block <= 0)
        if missing or bad:
            raise RockfallError(
                f"{scene.case.path(scene.case.surface.get(name, name))}: {missing} cells of the "
                f"terrain without a value, {bad} not > 0 (Inf absorbs)"
            )


def _read_sources(
    scene: Scene, bands: Iterable[tuple[Scene, Box]], rasters: dict[str, Any]
) -> None:
    """Release points, or the centres of source cells in the order of the raster.

    `bands` are rows of the terrain in order, each in a scene that holds it and what lies about it.
    """
    from rockfall.scene.sources import area_ratios, threshold

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
            area.append(area_ratios(replace(band, x=found[-1][0], y=found[-1][1])))
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
    from rockfall.io.raster import burn_polygons
    from rockfall.scene.sources import steep_blocks

    case, release = scene.case, scene.case.release
    parts = list(row_blocks(box.shape))
    if "polygons" in release:
        path = case.path(release["polygons"])
        inside = burn_polygons(path, scene.grid, doubts=scene.doubts)
        blocks = ((rows, inside[rows] & ~np.isnan(scene.z[rows])) for rows in parts)
        scene.checksums["polygons"] = _checksum(path)
    elif "cells" in release:
        blocks = _noted(scene, _blocks(scene, "cells", "source cells", np.int32, rasters, box))
    else:
        blocks = ((rows, np.ones((rows.stop - rows.start, box.shape[1]), bool)) for rows in parts)
    blocks = ((slice(box.row + rows.start, box.row + rows.stop), block) for rows, block in blocks)
    yield from steep_blocks(scene, blocks) if release["steep_cells"] else blocks


def _noted(
    scene: Scene, blocks: Iterable[tuple[slice, np.ndarray]]
) -> Iterator[tuple[slice, np.ndarray]]:
    """The blocks of source cells; which values they have is noted."""
    for rows, block in blocks:
        scene.marks.take(-block[block > 0].astype(float))
        yield rows, block


def read_sets(case: Case, path: Path) -> tuple[Coefficients, str]:
    """The impact sets in a file, with all that the case needs of them, and its checksum."""
    text = _sets_text(path)
    sets, _ = _sets_of(path, text, case.impact["turning"], 0)
    return sets, hashlib.sha256(text).hexdigest()


def read_set_draws(path: Path, turning: str) -> tuple[list[Coefficients], str]:
    """The same of a file that may hold several draws of them, with all that a rule of turning
    needs."""
    text = _sets_text(path)
    first, draws = _sets_of(path, text, turning, 1)
    rest = [_sets_of(path, text, turning, draw)[0] for draw in range(2, draws + 1)]
    return [first, *rest], hashlib.sha256(text).hexdigest()


def _sets_text(path: Path) -> bytes:
    check_text_file(path)
    return path.read_bytes()


def _sets_of(path: Path, text: bytes, turning: str, draw: int) -> tuple[Coefficients, int]:
    """A draw of the sets in a text, and how many there are; 0: the only one."""
    *values, draws, code, message = _core.read_sets(
        text or b"\n", str(path).encode(), TURNINGS[turning], draw
    )
    if code:
        raise RockfallError(message.decode(errors="replace").strip(), code)
    return Coefficients(*values), draws


def _blocks(
    scene: Scene, key: str, what: str, dtype: Any, rasters: dict[str, Any], box: Box | None = None
) -> Iterator[tuple[slice, np.ndarray]]:
    """A raster on the cells of the DEM, as blocks of rows in any order.

    It is the array given for it, or the file that the case names.
    """
    from rockfall.io.raster import aligned_blocks

    given = rasters.pop(key, None)
    if given is None:
        group = scene.case.release if key == "cells" else scene.case.surface
        path = scene.case.path(group[key])
        if key not in scene.checksums:
            scene.checksums[key] = _checksum(path)
        yield from aligned_blocks(path, scene.grid, what, dtype, box)
        return
    given = _on_cells(scene.grid, key, given)
    scene.checksums[key] = _array_checksum(given)
    if np.dtype(dtype).kind == "i":
        given = _whole_numbers(key, given, dtype)
    for rows in row_blocks(given.shape):
        block = given[rows]
        yield rows, np.ma.filled(block.astype(dtype), NO_ID if dtype == np.int32 else np.nan)


def _on_cells(grid: Grid, key: str, given: Any) -> np.ma.MaskedArray:
    """An array (ny, nx) on the cells of the DEM, missing values masked."""
    from rockfall.io.arrays import as_plan, grid_of
    from rockfall.io.crs import crs_name, same_crs

    if hasattr(given, "coords"):
        given = as_plan(given)
        own, flipped = grid_of(given)
        if not same_crs(own.crs, grid.crs):
            raise RockfallError(
                f"{key} = (array): is in {crs_name(own.crs)}, the DEM in {crs_name(grid.crs)}"
            )
        if not own.matches(grid):
            raise RockfallError(f"{key} = (array): is not on the cells of the DEM")
        given = given.values[::-1] if flipped else given.values
    given = np.ma.asarray(given)
    if given.dtype.kind not in "biuf":
        raise RockfallError(f"{key} = (array): holds {given.dtype}, must be numbers")
    if given.shape != grid.shape:
        raise RockfallError(
            f"{key} = (array): has the shape {given.shape}, must be that of the DEM {grid.shape}"
        )
    return np.ma.masked_where(np.isnan(given), given) if given.dtype.kind == "f" else given


def _whole_numbers(key: str, given: np.ma.MaskedArray, dtype: Any) -> np.ma.MaskedArray:
    """The array, if all its values are integers that `dtype` holds."""
    limits = np.iinfo(dtype)
    wrong = (given < limits.min + 1) | (given > limits.max) | (given != np.rint(given))
    if np.ma.filled(wrong, False).any():
        value = given[np.ma.filled(wrong, False)][0]
        raise RockfallError(f"{key} = (array): {value}: must be an integer of 32 bits")
    return given


def _array_checksum(array: np.ndarray) -> str:
    """SHA-256 of the bytes of an array, and of its mask where it has one."""
    found = hashlib.sha256(np.ascontiguousarray(np.ma.getdata(array)).data)
    if np.ma.is_masked(array):
        found.update(np.ascontiguousarray(np.ma.getmaskarray(array)).data)
    return found.hexdigest()


def _checksum(path: Path) -> str:
    """SHA-256 of a file."""
    from rockfall.io.raster_file import raster_file

    file = raster_file(str(path))
    check_regular(file)
    try:
        with open(file, "rb") as opened:
            return hashlib.file_digest(opened, "sha256").hexdigest()
    except OSError as error:
        raise RockfallError(f"{path}: cannot be read: {error.strerror}") from error
