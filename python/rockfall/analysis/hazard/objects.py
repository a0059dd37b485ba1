# SPDX-License-Identifier: BSD-3-Clause
"""Objects at risk: number of boulders that hit each, and the resulting cost.

A boulder hits an object when it touches it with its side in plan. Lines and outlines become
evaluation lines with the width of the object, which count a boulder once; so do points with a
width of their own. The others are taken to be as wide as the objects of the maps, in their cell.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.analysis.hazard.classes import Frequencies
from rockfall.errors import RockfallError
from rockfall.io.grid import Grid
from rockfall.io.layers import read_features
from rockfall.result.samples import check_all_rows
from rockfall.result.variables import LINE
from rockfall.simulation.memory import machine_memory

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.scene.scene import Scene

WIDTH = "width"  # attribute: of the object across a line, or of a point [m]
MAX_WIDTH = 1000.0  # of an object, as in a case [m]
VULNERABILITY = "vulnerability"  # an attribute for all intensities, or with _1, _2, ... for each
FRACTIONS = (VULNERABILITY, "exposure")
BYTES = 8 * len(LINE)  # of a boulder at a line
ROOM = 0.5  # fraction of the memory
MAX_NAMED = 5  # of objects in a remark


@dataclass
class Objects:
    """Points, lines and polygons, with their attributes."""

    path: str = ""
    shapes: np.ndarray = field(default_factory=lambda: np.empty(0, object))
    names: list[str] = field(default_factory=list)
    lines: list[dict[str, Any]] = field(default_factory=list)  # in the form of a case
    owner: np.ndarray = field(default_factory=lambda: np.empty(0, int))  # object of each line
    point: np.ndarray = field(default_factory=lambda: np.empty(0, int))  # points without a width
    places: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))  # their x and y [m]
    vulnerability: np.ndarray | None = None  # (objects, intensities)
    exposure: np.ndarray = field(default_factory=lambda: np.empty(0))
    value: np.ndarray = field(default_factory=lambda: np.empty(0))

    def __len__(self) -> int:
        return len(self.shapes)


def read_objects(
    path: str | Path, layer: str | None, grid: Grid, intensities: int, remarks: list[str]
) -> Objects:
    """Read the objects in a layer (None: the only one), with vulnerabilities for the given number
    of intensities."""
    import shapely

    shapes, columns = read_features(path, grid, remarks, layer, "--objects-layer")
    found = Objects(str(path), shapely.force_2d(shapes))
    columns = {name.lower(): values for name, values in columns.items()}
    numbers = [str(number) for number in range(1, len(shapes) + 1)]
    found.names = [str(name) for name in columns.get("name", numbers)]
    widths = _numbers(found, columns, WIDTH, np.full(len(shapes), np.nan), missing=True)
    for number, (shape, width) in enumerate(zip(found.shapes, widths.tolist(), strict=True)):
        _place(found, number, shape, width, grid)
    _take_values(found, columns, intensities)
    return found


def beyond_elevations(objects: Objects, scene: Scene) -> list[str]:
    """Remark on objects that extend to where missing elevations stop boulders."""
    import shapely

    grid, cells, names = scene.grid, scene.rasters, []
    for name, shape in zip(objects.names, objects.shapes, strict=True):
        x, y = shapely.get_coordinates(shape).T
        inside = (grid.west <= x) & (x <= grid.east) & (grid.south <= y) & (y <= grid.north)
        row, column = (one - begin for one, begin in zip(grid.cells(x, y), cells.at, strict=True))
        known = (0 <= row) & (row < cells.z.shape[0]) & (0 <= column) & (column < cells.z.shape[1])
        if not inside.all() or np.isnan(cells.z[row[known], column[known]]).any():
            names.append(name)
    if not names:
        return []
    more = f" and {len(names) - MAX_NAMED} more" if len(names) > MAX_NAMED else ""
    return [
        f"{objects.path}: {', '.join(names[:MAX_NAMED])}{more}: beyond the elevations of the "
        "terrain no boulder meets them"
    ]


def check_room(objects: Objects, boulders: int) -> None:
    """Refuse more lines than fit in memory with their boulders."""
    need = BYTES * len(objects.lines) * boulders
    if need > ROOM * machine_memory():
        raise RockfallError(
            f"{objects.path}: {len(objects.lines):,} lines and outlines, of {boulders:,} boulders "
            f"each, take {need / 1e9:.1f} GB: more than half of the memory; give fewer objects or "
            "boulders"
        )


def _place(objects: Objects, number: int, shape: Any, width: float, grid: Grid) -> None:
    """Place an object: add the line or cell at which boulders hit it. `width` is NaN if none."""
    west, south, east, north = shape.bounds
    if not (
        west <= grid.east and east >= grid.west and south <= grid.north and north >= grid.south
    ):
        raise RockfallError(f"{objects.path}: feature {number + 1}: lies outside the terrain")
    if shape.geom_type == "Point" and np.isnan(width):
        objects.point = np.append(objects.point, number)
        objects.places = np.vstack([objects.places, [[shape.x, shape.y]]])
        return
    for part in getattr(shape, "geoms", [shape]):
        curve = part.exterior if part.geom_type == "Polygon" else part
        x, y = np.array(curve.coords)[[0, 0] if part.geom_type == "Point" else slice(None)].T
        about = {
            "name": f"object {number + 1} part {len(objects.lines) + 1}",
            "object_width": 0.0 if np.isnan(width) else width,
        }
        objects.lines.append(about | {"x": x.tolist(), "y": y.tolist()})
        objects.owner = np.append(objects.owner, number)


def _take_values(objects: Objects, columns: dict[str, np.ndarray], intensities: int) -> None:
    """Read vulnerability, exposure and value, if the layer has them."""
    size = len(objects)
    objects.exposure = _numbers(objects, columns, "exposure", np.ones(size))
    objects.value = _numbers(objects, columns, "value", np.ones(size))
    several = [f"{VULNERABILITY}_{k}" for k in range(1, intensities + 1)]
    given = [name for name in columns if name.startswith(VULNERABILITY)]
    if given == [VULNERABILITY]:
        one = _numbers(objects, columns, VULNERABILITY, np.ones(size))
        objects.vulnerability = np.repeat(one[:, None], intensities, axis=1)
    elif given:
        if {*given} != {*several}:
            raise RockfallError(
                f"{objects.path}: attributes {', '.join(given)}: must be {VULNERABILITY}, or "
                f"{several[0]} to {several[-1]}: one for each intensity"
            )
        by_class = [_numbers(objects, columns, name, np.ones(size)) for name in several]
        objects.vulnerability = np.stack(by_class, axis=1)
        if (falls := np.argwhere(np.diff(objects.vulnerability, axis=1) < 0)).size:
            number, k = falls[0]
            raise RockfallError(
                f"{objects.path}: feature {number + 1}: {several[k + 1]}: must not be below "
                f"{several[k]}"
            )


def _numbers(
    objects: Objects,
    columns: dict[str, np.ndarray],
    name: str,
    default: np.ndarray,
    missing: bool = False,
) -> np.ndarray:
    """Values of an attribute, which objects may lack (NaN) if it may be `missing`."""
    if name not in columns:
        return default
    values, most = columns[name], 1.0 if name.startswith(FRACTIONS) else np.inf
    most = MAX_WIDTH if name == WIDTH else most
    rule = ">= 0" if most == np.inf else f"0 to {most:g}"
    if values.dtype.kind not in "iufb":
        raise RockfallError(f"{objects.path}: attribute {name}: must be a number, {rule}")
    for number, value in enumerate(values.tolist(), start=1):
        if not 0 <= value <= most and not (missing and np.isnan(value)):
            raise RockfallError(
                f"{objects.path}: feature {number}: {name} = {value}: must be {rule}"
            )
    return values.astype(float)


def object_counts(objects: Objects, result: xr.Dataset, grid: Grid, maps: np.ndarray) -> np.ndarray:
    """Boulders of a run that hit each object, and those with more energy than each threshold
    (intensities, objects); `maps` are the corresponding counts by cell (intensities, y, x)."""
    thresholds = result["threshold"].values
    counts = np.zeros((1 + thresholds.size, len(objects)), "i4")
    rows, columns = grid.cells(*objects.places.T)
    counts[:, objects.point] = maps[:, rows, columns]
    for number in np.unique(objects.owner):
        check_all_rows(result, "an object that is a line")
        energy = np.full(result.sizes["boulder"], np.nan)
        for line in np.flatnonzero(objects.owner == number):
            parts = (f"line_energy_{kind}" for kind in ("translational", "rotational"))
            energy = np.fmax(energy, sum(result[part].values[line] for part in parts))
        counts[0, number] = np.isfinite(energy).sum()
        counts[1:, number] = (energy > thresholds[:, None]).sum(axis=1)
    return counts


def risks(objects: Objects, found: Frequencies) -> Frequencies | None:
    """Annual risk of each object: the sum over intensities of their frequency, times vulnerability,
    exposure and value; limits follow from those of frequencies, since vulnerability does not
    decrease with intensity."""
    if objects.vulnerability is None:
        return None
    more = np.diff(objects.vulnerability, axis=1, prepend=0.0).T  # than at the next lower intensity
    of = objects.exposure * objects.value
    value, low, high = ((more * one).sum(axis=0) * of for one in found)
    return Frequencies(value, low, high)
