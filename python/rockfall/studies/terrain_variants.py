# SPDX-License-Identifier: BSD-3-Clause
"""Variants of the terrain of a scene: other precision, or larger cells."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np

from rockfall.scene.scene import Scene


def other_digits(scene: Scene) -> tuple[str, Scene]:
    """Scene with elevations of the other precision, and the name of that.

    float64 elevations are rounded. float32 ones receive random digits in place of those lost by
    rounding: up to half of their last binary digit.
    """
    z = scene.rasters.z
    if z.dtype == np.float64:
        return "float32", scene.replace(z=z.astype("f4"))
    lost = np.random.default_rng(0).uniform(-0.5, 0.5, z.shape) * np.spacing(z)
    return "float64", scene.replace(z=z.astype("f8") + lost)


def larger_cells(scene: Scene, factor: int) -> Scene:
    """Scene on cells of `factor` times the side, from the north-western corner.

    Elevations are means of known ones, zones the most frequent (the first in the table if tied),
    sizes in a raster the median.
    """
    cells = scene.rasters
    z = _blocks(cells.z, factor, np.nan)
    ny, nx, _ = z.shape
    grid = replace(scene.grid, cell=factor * scene.grid.cell, nx=nx, ny=ny)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Mean of empty slice|All-NaN slice")  # of nodata only
        z = np.nanmean(z, axis=2, dtype="f8").astype(cells.z.dtype)
        values = cells.values
        if values is not None:
            values = np.stack(
                [np.nanmedian(_blocks(layer, factor, np.nan), axis=2) for layer in values]
            )
    zone = None if cells.zone is None else _most_frequent(_blocks(cells.zone, factor, 0))
    return scene.replace(z=z, grid=grid, zone=zone, values=values)


def _blocks(raster: np.ndarray, factor: int, fill: float) -> np.ndarray:
    """(ny, nx, cells): the cells merged into each larger cell."""
    beyond = [(0, -size % factor) for size in raster.shape]
    padded = np.pad(raster, beyond, constant_values=fill)
    ny, nx = (size // factor for size in padded.shape)
    cells = padded.reshape(ny, factor, nx, factor).swapaxes(1, 2)
    return cells.reshape(ny, nx, factor**2)


def _most_frequent(zone: np.ndarray) -> np.ndarray:
    """Most frequent zone above 0, 0 if there is none: (ny, nx) of (ny, nx, cells)."""
    best, highest = np.zeros(zone.shape[:2], zone.dtype), np.zeros(zone.shape[:2], int)
    for number in np.unique(zone[zone > 0]):
        count = np.count_nonzero(zone == number, axis=2)
        best[count > highest] = number
        highest = np.maximum(highest, count)
    return best
