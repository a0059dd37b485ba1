# SPDX-License-Identifier: BSD-3-Clause
"""Hazard classes as polygons: along cell edges, or generalised to avoid false precision."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import xarray as xr

from rockfall.analysis.hazard.classes import CLASSES
from rockfall.analysis.hazard.outlines import GRID, NEGLIGIBLE, generalised, polygons_of
from rockfall.case import case_in
from rockfall.io.rasters.arrays import north_up
from rockfall.io.rasters.grid import Grid
from rockfall.io.vectors.polygons import held_cells

if TYPE_CHECKING:
    from shapely import Geometry


class Zones(NamedTuple):
    """Polygons (shapely), with the class `number` and the number of cells of each."""

    shapes: np.ndarray
    number: np.ndarray
    cells: np.ndarray
    patch: np.ndarray  # (y, x): polygon number at each cell centre, from 1; 0 if none


def zones_by_cell(hazard: xr.Dataset) -> Zones:
    """Zones of the hazard classes along cell edges. GDAL's sieve merges patches smaller than the
    case's `minimum_area` [m2] with their largest neighbour."""
    numbers, grid = _north_up(hazard["hazard_class"])
    return _by_cell(numbers, grid, case_in(hazard.attrs).hazard["minimum_area"])


def _by_cell(numbers: np.ndarray, grid: Grid, minimum_area: float) -> Zones:
    from rasterio.features import sieve

    size = int(np.ceil(minimum_area / grid.cell**2))
    return _patches(sieve(numbers, size, connectivity=4) if size > 1 else numbers, grid)


def zones_of(hazard: xr.Dataset) -> Zones:
    """Zones of the hazard classes for texts, files and figures: generalised outlines without parts
    narrower than the case's `minimum_width` [m], or cell edges if this width is zero."""
    numbers, grid = _north_up(hazard["hazard_class"])
    keys = case_in(hazard.attrs).hazard
    return _generalised(numbers.tobytes(), grid, keys["minimum_area"], keys["minimum_width"])


@lru_cache(maxsize=4)
def _generalised(content: bytes, grid: Grid, minimum_area: float, width: float) -> Zones:
    import shapely

    numbers = np.frombuffer(content, "u1").reshape(grid.shape)
    zones = _by_cell(numbers, grid, minimum_area)
    if not width or not zones.shapes.size:
        return zones
    classes = np.arange(1, len(CLASSES))
    areas = [shapely.union_all(zones.shapes[zones.number == k]) for k in classes]
    terrain = shapely.box(grid.west, grid.south, grid.east, grid.north)
    outlines = generalised(areas, width, grid.cell)
    shown = shapely.intersection(outlines, terrain, grid_size=GRID * grid.cell)
    polygons = [[*polygons_of(area, NEGLIGIBLE * grid.cell**2)] for area in shown]
    number = np.repeat(classes, [len(polygon) for polygon in polygons])
    return _zones([part for polygon in polygons for part in polygon], number, grid.shape, grid)


def highest_classes(zones: Zones, hazard: xr.Dataset) -> np.ndarray:
    """Highest class of the cells in each zone, before generalisation."""
    numbers, _ = _north_up(hazard["hazard_class"])
    highest = np.zeros(len(zones.cells) + 1, "u1")
    np.maximum.at(highest, zones.patch, numbers)
    return highest[1:]


def lowered_area(zones: Zones, hazard: xr.Dataset) -> np.ndarray:
    """Area [m2] of each class whose cells lie in zones of a lower class, or in none."""
    numbers, grid = _north_up(hazard["hazard_class"])
    shown = np.concatenate([[0], zones.number])[zones.patch]
    return np.bincount(numbers[shown < numbers], minlength=len(CLASSES)) * grid.cell**2


def uncertain_of(hazard: xr.Dataset) -> Zones:
    """Patches of cells with uncertain class; `number` is the lowest possible class multiplied by
    the number of classes, plus the highest possible class."""
    low, grid = _north_up(hazard["hazard_class_lower"])
    high, _ = _north_up(hazard["hazard_class_upper"])
    return _patches(np.where(low == high, 0, low * len(CLASSES) + high), grid)


def certain_fractions(zones: Zones, hazard: xr.Dataset) -> np.ndarray:
    """Fraction of the cells in each zone whose class is certain."""
    certain, _ = _north_up(hazard["hazard_class_certain"])
    patch = zones.patch.ravel()
    count = np.bincount(patch, certain.ravel(), len(zones.cells) + 1)[1:]
    return count / np.maximum(zones.cells, 1)


def _north_up(data: xr.DataArray) -> tuple[np.ndarray, Grid]:
    """Map of classes with the northernmost row first, and its grid, without CRS and path."""
    values, grid = north_up(data)
    return values.astype("u1"), replace(grid, crs=None, path=None)


def _patches(numbers: np.ndarray, grid: Grid) -> Zones:
    """Patches of equal positive numbers, ordered row by row from the north-west."""
    return _outlined(np.asarray(numbers, "u1").tobytes(), grid)


@lru_cache(maxsize=8)
def _outlined(content: bytes, grid: Grid) -> Zones:
    import shapely
    from rasterio.features import shapes

    numbers = np.frombuffer(content, "u1").reshape(grid.shape)
    patches = list(shapes(numbers, mask=numbers > 0, connectivity=4, transform=grid.transform))
    polygons = [shapely.geometry.shape(shape) for shape, _ in patches]
    number = np.array([int(number) for _, number in patches], "i8")
    return _zones(polygons, number, numbers.shape, grid)


def _zones(
    polygons: list[Geometry], number: np.ndarray, shape: tuple[int, ...], grid: Grid
) -> Zones:
    patch = np.zeros(shape, "i4")
    if polygons:
        pairs = zip(polygons, range(1, len(polygons) + 1), strict=True)
        held_cells(pairs, grid, patch)
    cells = np.bincount(patch.ravel(), minlength=len(polygons) + 1)[1:]
    zones = Zones(np.array(polygons, dtype=object), number, cells, patch)
    for values in zones:  # results are cached and shared
        values.flags.writeable = False
    return zones
