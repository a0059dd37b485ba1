# SPDX-License-Identifier: BSD-3-Clause
"""Elevation models from surveyed points, and edits of existing models."""

import math
import shlex
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rockfall.case import Case
from rockfall.draft.survey_remarks import (
    cell_remarks,
    check_cell,
    height_remarks,
    place_remarks,
    slope_remarks,
    spike_remarks,
)
from rockfall.errors import RockfallError
from rockfall.io.coordinates.crs import check_area, check_metres, crs_name
from rockfall.io.output_files import check_output
from rockfall.io.rasters.arrays import check_elevations
from rockfall.io.rasters.dem import read_dem
from rockfall.io.rasters.geotiff import write_geotiff
from rockfall.io.rasters.grid import Grid
from rockfall.io.rasters.raster_file import open_raster, raster_files
from rockfall.io.tables import read_table
from rockfall.io.vectors.layers import read_features
from rockfall.io.vectors.point_clouds import is_cloud, read_clouds
from rockfall.io.vectors.point_text import MISSING
from rockfall.language import Number, remark, say
from rockfall.limits import MAX_ELEVATION, MAX_REAL
from rockfall.scene.layers import Inputs, file_checksum
from rockfall.scene.lines import read_lines
from rockfall.scene.rules.protection import dam_rules
from rockfall.terrain.dams import with_dam
from rockfall.terrain.inverse_distance import Weights, interpolated, left_out
from rockfall.terrain.regular_points import MAX_CELLS, Nodes, regular_nodes, resampled, spacings
from rockfall.terrain.repairs import lowered, smoothed, without_holes, without_pits
from rockfall.version import __version__

DEEP = 30.0  # depth of a cut [m] that triggers a remark; ditches above dams are a few metres deep
PIT = 3.0  # depth of a filled pit [m] that triggers a remark: it may be a real hollow or ditch
BEYOND = 50.0  # --fill [m] that triggers a remark: the ground in larger holes is unknown
BLURRED = 5.0  # --smooth [cells] that triggers a remark: survey noise needs two

MAX_LEFT_OUT = 1_000_000  # approximate maximum points used for leave-one-out errors
FAR = 3.0  # [point spacings] elevations farther from all points are unknown
NICE = (1.0, 2.0, 5.0, 10.0)  # leading digits of cell sides
STEEPEST = 10.0  # maximum ratio of rise to extent for points in metres
NODATA = -9999.0
SURFACE = {"uniform_mean_radius": 1.0}  # surface of cases that only serve to read dams


class Dem(NamedTuple):
    """Elevations (ny, nx) [m], their grid and nodata value."""

    z: np.ndarray
    grid: Grid
    nodata: float = math.nan


class Survey(NamedTuple):
    """Summary of a DEM made from points."""

    points: int
    spacing: float  # [m]
    errors: np.ndarray  # leave-one-out errors of some points [m]; NaN: no near points
    nodes: Nodes | None = None  # set if points form a regular grid; `errors` is then empty
    remarks: tuple[str, ...] = ()

    @property
    def standard_error(self) -> float:
        """Root mean square of the errors [m]."""
        return float(np.sqrt(np.nanmean(self.errors**2)))


def dem_of_points(
    *paths: str | Path,
    cell: float | None = None,
    power: float = 2.0,
    neighbours: int = 12,
    within: float | None = None,
    crs: str | None = None,
    classes: Sequence[int] | None = None,
    thin: float | None = None,
) -> tuple[Dem, Survey]:
    """Make a DEM from points in a CSV file (columns x, y, z [m]) or in point clouds (LAS, LAZ, XYZ;
    `classes`, `thin`: see `read_clouds`) by inverse-distance weighting (exponent `power`) of the
    nearest `neighbours` within `within` [m] (default: three point spacings). Return the DEM and a
    summary. Invalid points or arguments raise a RockfallError.

    The default `cell` [m] is 1, 2 or 5 times a power of ten, at most the mean spacing.

    Points on the nodes of a regular grid give this grid: the default `cell` is then their spacing,
    and each node is a cell centre. Nodes without a point are nodata, unless `within` is given. With
    another `cell`, elevations are interpolated bilinearly.
    """
    path, system = paths[0], _crs(crs)
    if all(map(is_cloud, paths)):
        points, system = read_clouds(paths, classes, thin, system)
    elif len(paths) > 1:
        raise RockfallError(f"{path}: several files: must all be .las, .laz or .xyz")
    elif classes is not None or thin is not None:
        raise RockfallError(f"{path}: --classes and --thin are only valid for .las, .laz and .xyz")
    else:
        points = _read_points(path)
    remarks: list[str] = []
    points = _known(path, points, remarks)
    low, high = points.min(axis=0), points.max(axis=0)
    doubts = [*height_remarks(points)]
    nodes = regular_nodes(points)
    spacing = math.sqrt(np.prod((high - low)[:2]) / len(points))
    if nodes is not None:
        spacing = nodes.grid.cell
    elif not spacing and (cell is None or within is None):
        raise RockfallError(
            f"{path}: all points lie on a line along an axis: give --cell and --within"
        )
    weights = Weights(power, neighbours, FAR * spacing if within is None else within)
    cell = (_nice(spacing) if nodes is None else spacing) if cell is None else cell
    for name, value in (("cell", cell), *weights._asdict().items()):
        if not 0 < value < math.inf:
            raise RockfallError(f"--{name} {value:g}: must be > 0")
    check_cell(cell, (high - low)[:2], spacing)
    if nodes is None:
        grid, z = _covering(low, high, cell), None
        if (steps := spacings(points)) and max(steps) > 1.01 * min(steps):
            sides = {"dx": steps[0], "dy": steps[1]}
            remarks.append(remark(path, "input.nodes_not_square", **sides))
    elif math.isclose(cell, spacing, rel_tol=1e-6):
        z, grid = nodes.z, nodes.grid
    else:
        z, grid = resampled(nodes, cell)
    grid = replace(grid, crs=system)
    check_metres(grid, str(path))
    check_area(grid, str(path), remarks)
    if system is None and _may_be_degrees(low, high):
        ends = {"west": low[0], "east": high[0], "south": low[1], "north": high[1]}
        remarks.append(remark(path, "input.degrees", cell=Number(f"{cell:.3g}"), **ends))
    if nodes is None:
        _check_places(path, points)
    if z is None or within is not None:
        made = interpolated(points, grid, weights)
        z = made if z is None else np.where(np.isnan(z), made, z)
    z = z.astype(np.float32)
    check_elevations(str(path), z)
    errors = np.empty(0)
    if nodes is None:
        errors = left_out(points, weights, math.ceil(len(points) / MAX_LEFT_OUT))
        doubts += [] if doubts or remarks else place_remarks(points)
    doubts += [] if doubts or remarks else slope_remarks(z, cell)
    doubts += [] if doubts or remarks else spike_remarks(points, errors, spacing)
    doubts += cell_remarks(cell, spacing)
    remarks += [say("input.remark", where=str(path), text=text) for text in doubts]
    return Dem(z, grid, NODATA), Survey(len(points), spacing, errors, nodes, tuple(remarks))


def _known(path: str | Path, points: np.ndarray, remarks: list[str]) -> np.ndarray:
    """Points (n, 3) without those whose elevation marks missing data; refuses points that are all
    missing."""
    missing = np.isin(points[:, 2], MISSING)
    if not missing.any():
        return points
    if missing.all():
        raise RockfallError(f"{path}: all elevations are nodata ({points[0, 2]:g})")
    value, n = float(points[missing][0, 2]), int(missing.sum())
    remarks.append(remark(path, "input.points_missing", n=n, value=value))
    return points[~missing]


def _may_be_degrees(low: np.ndarray, high: np.ndarray) -> bool:
    """Return True if x and y may be in degrees: at most 360 and 90, and with an extent far smaller
    than the range of elevations."""
    apart, rise = (high - low)[:2].max(), high[2] - low[2]
    is_round = (abs(low[:2]) <= (360, 90)).all() and (abs(high[:2]) <= (360, 90)).all()
    return bool(is_round and apart < rise / STEEPEST)


def _check_places(path: str | Path, points: np.ndarray) -> None:
    """Raise a RockfallError if most points coincide in plan, but not in elevation."""
    places = len(np.unique(points[:, 0] + 1j * points[:, 1]))
    if places < len(points) / 2 and len(np.unique(points[:, 2])) > places:
        raise RockfallError(
            f"{path}: {len(points):,} points at {places:,} different places: are x and y rounded?"
        )


def _covering(low: np.ndarray, high: np.ndarray, cell: float) -> Grid:
    """Grid that covers `low` to `high`, with cell edges at multiples of the cell side; refuses too
    many cells."""
    west, north = math.floor(low[0] / cell) * cell, (math.floor(high[1] / cell) + 1) * cell
    nx, ny = (high[0] - west) // cell + 1, (north - low[1]) // cell + 1
    if not nx * ny <= MAX_CELLS:
        raise RockfallError(
            f"--cell {cell:g}: {nx:,.0f} x {ny:,.0f} cells: must be at most {MAX_CELLS:,}"
        )
    return Grid(west, north, cell, max(2, int(nx)), max(2, int(ny)))


def read_source(path: str | Path, crs: str | None = None, remarks: list[str] | None = None) -> Dem:
    """Read a DEM from a raster file. `crs` applies to a file without a CRS and is refused if the
    file has another; if the DEM lies outside its area of use, a remark is added."""
    z, grid = read_dem(path)
    if crs is not None:
        if grid.crs is not None:
            raise RockfallError(f"--crs {crs}: {path} has its own CRS, {crs_name(grid.crs)}")
        grid = replace(grid, crs=_crs(crs))
        check_metres(grid, str(path))
        check_area(grid, str(path), [] if remarks is None else remarks)
    with open_raster(path) as raster:
        nodata = raster.source.nodata
    return Dem(z, grid, math.nan if nodata is None else float(nodata))


def edited(dem: Dem, steps: Iterable[tuple[str, Any]], remarks: list[str]) -> Dem:
    """Apply edits (a name in EDITS, its argument) to a DEM in order; remarks go to `remarks`."""
    for name, given in steps:
        dem = dem._replace(z=EDITS[name](dem, given, remarks))
    return dem


def write_dem(
    dem: Dem, path: str | Path, made_from: Sequence[str | Path], options: Iterable[str] = ()
) -> None:
    """Write a DEM as GeoTIFF with its provenance, atomically."""
    made = shlex.join(["dem", *map(str, made_from), *options])
    tags = {
        "TIFFTAG_SOFTWARE": "rockfall", "units": "m", "long_name": "elevation",
        "history": f"rockfall {__version__}: {made}",
        "source_sha256": " ".join(file_checksum(Path(file)) for file in made_from),
    }  # fmt: skip
    z = dem.z if math.isnan(dem.nodata) else np.where(np.isnan(dem.z), dem.nodata, dem.z)
    write_geotiff(Path(path), z.astype(dem.z.dtype), dem.grid, nodata=dem.nodata, **tags)


def check_place(
    path: str | Path, sources: Iterable[str | Path], steps: Iterable[tuple[str, Any]]
) -> None:
    """Raise a RockfallError for an invalid output path of a DEM, before the work starts."""
    if Path(path).suffix.lower() not in (".tif", ".tiff"):
        raise RockfallError(f"{path}: output name must end in .tif")
    layers = [given for _, given in steps if isinstance(given, Path)]
    files = (file for source in sources for file in raster_files(source))
    check_output(path, [*files, *layers])


def _read_points(path: str | Path) -> np.ndarray:
    """Read points (n, 3) from the columns x, y and z of a table; refuses missing or repeated
    columns."""
    where, columns, rows = read_table(path)
    for axis in "xyz":
        if columns.count(axis) != 1:
            raise RockfallError(
                f"{where}: must have exactly one column {axis} (columns: {', '.join(columns)})"
            )
    limits = {"x": MAX_REAL, "y": MAX_REAL, "z": MAX_ELEVATION}
    return np.array([[row.number(axis, -far, far) for axis, far in limits.items()] for row in rows])


def _nice(spacing: float) -> float:
    """Round down to 1, 2 or 5 times a power of ten."""
    unit = 10.0 ** math.floor(math.log10(spacing))
    return max(factor * unit for factor in NICE if factor * unit <= spacing)


def _crs(text: str | None) -> Any:
    from rasterio.crs import CRS
    from rasterio.errors import CRSError

    try:
        return None if text is None else CRS.from_user_input(text)
    except CRSError as error:
        raise RockfallError(f"--crs {text}: is not a known CRS, such as EPSG:2056") from error


def _positive(option: str, value: float) -> float:
    if not 0 < value < math.inf:
        raise RockfallError(f"--{option} {value:g}: must be > 0 [m]")
    return value


def _fill(dem: Dem, far: float, remarks: list[str]) -> np.ndarray:
    z = without_holes(dem.z, _positive("fill", far) / dem.grid.cell)
    n = int(np.count_nonzero(np.isnan(dem.z) & ~np.isnan(z)))
    if far > BEYOND and n:
        remarks.append(remark(f"--fill {far:g}", "input.far_fill", n=n, far=far))
    return z


def _pits(dem: Dem, deepest: float, remarks: list[str]) -> np.ndarray:
    z = without_pits(dem.z, _positive("pits", deepest))
    if (depth := float(np.nanmax(z - dem.z))) > PIT:
        n = int(np.count_nonzero(z > dem.z))
        remarks.append(remark(f"--pits {deepest:g}", "input.deep_pits", n=n, depth=depth))
    return z


def _smooth(dem: Dem, std: float, remarks: list[str]) -> np.ndarray:
    cells = _positive("smooth", std) / dem.grid.cell
    if cells > max(dem.grid.shape):
        raise RockfallError(f"--smooth {std:g}: must be at most the size of the terrain [m]")
    if cells > BLURRED:
        remarks.append(remark(f"--smooth {std:g}", "input.blurred", cells=cells))
    return smoothed(dem.z, cells)


def _dam(dem: Dem, path: Path, remarks: list[str]) -> np.ndarray:
    """Elevations [m] with the dams of a layer, as with &dam file; a temporary case checks the
    keys."""
    x, y = [float(dem.grid.x[0])], [float(dem.grid.y[0])]
    case = Case(
        name=str(path), case={"boulders": 1}, surface=SURFACE, boulder={"volume_mean": 1.0},
        release={"x": x, "y": y}, dam=[{"file": str(path)}],
    )  # fmt: skip
    z, shapes = dem.z, []
    for dam in read_lines(Inputs(case, dem.grid, remarks=remarks)).dam:
        z, shape = with_dam(z, dem.grid, dam, str(path))
        shapes.append(shape)
    warnings = dam_rules(shapes, dem.grid.cell)
    remarks += [f"{path}: {where}: {text}" for where, text in warnings]
    return z


def _cut(dem: Dem, path: Path, remarks: list[str]) -> np.ndarray:
    """Elevations lowered within polygons or along lines, by `depth` or to `level` [m]. Refuses
    points, invalid depths, and layers that lower nothing."""
    shapes, columns = read_features(path, dem.grid, remarks)
    columns = {name.lower(): values for name, values in columns.items()}
    z = dem.z
    for k, shape in enumerate(shapes):
        depth, level, width = (
            _attribute(path, columns, name, k) for name in ("depth", "level", "width")
        )
        if math.isnan(depth) == math.isnan(level):
            raise RockfallError(f"{path}: feature {k + 1}: must have one of depth and level [m]")
        if depth < 0:
            raise RockfallError(f"{path}: feature {k + 1}: depth = {depth:g}: must be > 0 [m]")
        if "Point" in shape.geom_type:
            raise RockfallError(f"{path}: feature {k + 1}: is a point: must be a line or polygon")
        if "Polygon" not in shape.geom_type:
            if not width > 0:
                raise RockfallError(f"{path}: feature {k + 1}: a line must have a width > 0 [m]")
            shape = shape.buffer(width / 2, cap_style="flat")
        z = lowered(z, dem.grid, shape, depth, level)
    if np.array_equal(z, dem.z, equal_nan=True):
        raise RockfallError(f"{path}: does not lower any cell of the terrain")
    if (depth := float(np.nanmax(dem.z - z))) > DEEP:
        remarks.append(remark(path, "input.deep_cut", depth=depth))
    return z


def _attribute(path: Path, columns: dict[str, np.ndarray], name: str, k: int) -> float:
    """Numeric attribute of a feature; NaN if missing. Refuses text."""
    if name not in columns:
        return math.nan
    if columns[name].dtype.kind not in "iuf":
        raise RockfallError(f"{path}: attribute {name} is not a number")
    return float(columns[name][k])


EDITS: dict[str, Callable[[Dem, Any, list[str]], np.ndarray]] = {
    "fill": _fill, "pits": _pits, "smooth": _smooth, "dam": _dam, "cut": _cut,
}  # fmt: skip
