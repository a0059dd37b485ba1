# SPDX-License-Identifier: BSD-3-Clause
"""Classes of hazard as polygons, whose sides are those of cells: no line says more than that."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.analysis.hazard.classes import CLASSES
from rockfall.io.arrays import grid_of

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.io.grid import Grid


class Zones(NamedTuple):
    """Patches of cells alike: polygons, and for each its number and how many cells it has."""

    shapes: np.ndarray
    number: np.ndarray
    cells: np.ndarray
    patch: np.ndarray  # (y, x): of each cell, from 1; 0 where it is of none


def zones_of(found: xr.Dataset, minimum_area: float) -> Zones:
    """Zones of a class of hazard, each of an area [m2] at least: GDAL's sieve gives smaller patches
    the class of the largest beside them."""
    from rasterio.features import sieve

    numbers, grid = _north_up(found["hazard_class"])
    size = int(np.ceil(minimum_area / grid.cell**2))
    return _patches(sieve(numbers, size, connectivity=4) if size > 1 else numbers, grid)


def highest_classes(zones: Zones, found: xr.Dataset) -> np.ndarray:
    """The highest class on the map within each zone: what a small patch had before it joined."""
    numbers, _ = _north_up(found["hazard_class"])
    highest = np.zeros(len(zones.cells) + 1, "u1")
    np.maximum.at(highest, zones.patch, numbers)
    return highest[1:]


def lowered_area(found: xr.Dataset, minimum_area: float) -> np.ndarray:
    """Of each class, the area [m2] that zones show as a lower one, or as none."""
    numbers, grid = _north_up(found["hazard_class"])
    zones = zones_of(found, minimum_area)
    shown = np.concatenate([[0], zones.number])[zones.patch]
    return np.bincount(numbers[shown < numbers], minlength=len(CLASSES)) * grid.cell**2


def uncertain_of(found: xr.Dataset) -> Zones:
    """Patches of cells whose class is not certain: their number is that of the lowest class, times
    the number of classes, plus that of the highest."""
    low, grid = _north_up(found["hazard_class_lower"])
    high, _ = _north_up(found["hazard_class_upper"])
    return _patches(np.where(low == high, 0, low * len(CLASSES) + high), grid)


def certain_fractions(zones: Zones, found: xr.Dataset) -> np.ndarray:
    """Of the cells of each zone, the fraction whose class is certain."""
    certain, _ = _north_up(found["hazard_class_certain"])
    patch = zones.patch.ravel()
    return np.bincount(patch, certain.ravel(), len(zones.cells) + 1)[1:] / zones.cells


def _north_up(data: xr.DataArray) -> tuple[np.ndarray, Grid]:
    grid, flipped = grid_of(data)
    values = data.values.astype("u1")
    return (values[::-1] if flipped else values), grid


def _patches(numbers: np.ndarray, grid: Grid) -> Zones:
    """Patches of equal numbers above zero, by rows from the north-west."""
    import shapely
    from rasterio.features import rasterize, shapes

    numbers = np.ascontiguousarray(numbers, "u1")
    found = list(shapes(numbers, mask=numbers > 0, connectivity=4, transform=grid.transform))
    polygons = [shapely.geometry.shape(shape) for shape, _ in found]
    patch = np.zeros(numbers.shape, "i4")
    if polygons:
        pairs = zip(polygons, range(1, len(polygons) + 1), strict=True)
        rasterize(pairs, out=patch, transform=grid.transform)
    return Zones(
        np.array(polygons, dtype=object),
        np.array([int(number) for _, number in found], "i8"),
        np.bincount(patch.ravel(), minlength=len(polygons) + 1)[1:],
        patch,
    )
