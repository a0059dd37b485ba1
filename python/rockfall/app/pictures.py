# SPDX-License-Identifier: BSD-3-Clause
"""Terrain and results as messages for the page."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from rockfall.analysis.population import scenario_note
from rockfall.analysis.validity.remarks import model_remarks
from rockfall.app.messages import binary_message
from rockfall.case import Case
from rockfall.io.coordinates.crs import crs_name
from rockfall.io.rasters.arrays import north_up
from rockfall.io.rasters.grid import Grid
from rockfall.io.zone_table import Zone
from rockfall.language import speaking
from rockfall.plots.cartography.rasters import cropped, merged
from rockfall.plots.cartography.relief import shade
from rockfall.plots.extent import of_none
from rockfall.result.maps.classes import map_unit, shown_as
from rockfall.result.maps.map_labels import map_label
from rockfall.result.samples import has_rows
from rockfall.result.trajectories import POINTS, Trajectory, ended
from rockfall.result.variables import MAP, TYPES
from rockfall.scene.scene import Scene

MAX_HEIGHTS, MAX_SHADE = 1001, 2001  # maximum cells along a side: 3-D view, map
MAX_OVERLAY = 1001
MAX_TRAJECTORIES = 1000
MAX_LINES = 30  # lines with statistics in each message; of more lines, only those in view
MAX_STOPS, MAX_SOURCES, MAX_TREES = 5000, 20_000, 20_000
WIDE = 100.0  # ratio of largest to smallest value above which a map gets a log scale
BY_SOURCE = ("sources", "reach_probability_by_source")  # maps computed source by source


class View(NamedTuple):
    """View selected on the page: map, number of trajectories, section, object layer and others;
    with more than MAX_LINES lines, also the lines in view."""

    map: str = ""
    trajectories: int = 100
    lines: tuple[str, ...] = ()
    section: tuple[tuple[float, ...], ...] = ()  # vertices [m]
    objects: str = ""  # label of the `Offer`
    basemap: str = ""  # label of the picture
    net: str = ""  # line or barrier with a design check
    hazard: bool = False  # True to run the scenarios
    origin: str = ""  # place whose sources are shown


class Ground:
    """Terrain as sent to the page: thinned elevations and hillshade."""

    def __init__(self, z: np.ndarray, grid: Grid) -> None:
        extent = grid.west, grid.east, grid.south, grid.north
        self.full = grid
        self.heights, self.grid = cropped(z, grid, extent, np.add, MAX_HEIGHTS)
        z, self.shade_grid = cropped(z, grid, extent, np.add, MAX_SHADE)
        self.shade = np.where(np.isnan(z), 0, 1 + 254 * shade(z, self.shade_grid.cell))

    @property
    def step(self) -> int:
        """Size of a hillshade cell, in raster cells."""
        return round(self.shade_grid.cell / self.full.cell)

    def message(self) -> bytes:
        """Message `terrain`: thinned elevations and hillshade."""
        grid = self.grid
        return binary_message(
            "terrain",
            {"heights": self.heights.astype("f4"), "shade": self.shade.astype("u1")},
            west=grid.west, north=grid.north, cell=grid.cell, nx=grid.nx, ny=grid.ny,
            crs=crs_name(self.full.crs) if self.full.crs else "", full_cell=self.full.cell,
            shade_cell=self.shade_grid.cell,
        )  # fmt: skip

    def relative(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Places (n, 2) relative to the south-western corner [m]."""
        return np.column_stack([x - self.grid.west, y - self.grid.south])


def background_message(
    scene: Scene, zones: dict[int, Zone], sources: bool, ground: Ground, **fields: Any
) -> bytes:
    """Message `background`: the parts of a case that are not features of its document. `zones` are
    rows of its zone raster; `sources` is True if it has sources that were not drawn."""
    arrays: dict[str, np.ndarray] = {}
    entries, rows = [], scene.rasters.zone
    if zones and rows is not None and len(zones) < 256:
        row, column = (
            (np.arange(n) * ground.step + ground.step // 2).clip(max=size - 1)
            for n, size in zip(ground.shade.shape, rows.shape, strict=True)
        )
        arrays["zones"] = rows[np.ix_(row, column)].astype("u1")
        entries = [
            {"value": k, "name": zone.name or str(id)}
            for k, (id, zone) in enumerate(zones.items(), start=1)
        ]
    if sources:
        arrays["sources"] = sampled_rows(MAX_SOURCES, scene.x, scene.y)
    if scene.trees is not None:
        arrays["trees"] = sampled_rows(MAX_TREES, scene.trees.x, scene.trees.y, scene.trees.dbh)
    number = {"sources": scene.x.size if sources else 0, "trees": 0}
    if scene.trees is not None:
        number["trees"] = len(scene.trees.x)
    return binary_message("background", arrays, **fields, zones=entries, **number)


def sampled_rows(most: int, *columns: np.ndarray) -> np.ndarray:
    """At most `most` evenly spaced rows of these columns."""
    step = max(1, -(-len(columns[0]) // most))
    return np.column_stack([column[::step] for column in columns]).astype("f8")


def map_choices(names: Sequence[str], language: str) -> list[dict[str, str]]:
    """Maps with these names, with labels and units."""
    with speaking(language):
        return [_about_map(name) for name in names]


def _about_map(name: str) -> dict[str, str]:
    """Name, label and unit of a map, in the current language."""
    unit, _ = map_unit(name, MAP[name]["units"], np.dtype(TYPES["map"][name]))
    return {"name": name, "label": map_label(name, MAP[name]["long_name"]), "unit": unit}


def batch_message(
    result: xr.Dataset, case: Case, shown: str, ground: Ground, language: str, **fields: Any
) -> bytes:
    """Message `batch`: results so far, and the map `shown`, if the result has it."""
    with speaking(language):
        warnings = [
            f"{remark.text}." for remark in model_remarks(result, case) if remark.is_warning
        ]
        warnings += scenario_note(case)
    arrays = _stops(result, ground)
    overlay = None
    if shown and shown in result:
        with speaking(language):
            overlay, arrays["overlay"] = _overlay(result, shown)
    return binary_message(
        "batch", arrays, **fields, warnings=warnings, ended=ended(result), overlay=overlay
    )


def _stops(result: xr.Dataset, ground: Ground) -> dict[str, np.ndarray]:
    """End points and statuses of an evenly spaced sample of boulders."""
    if not has_rows(result):
        return {"stops": np.zeros((0, 2), "f4"), "stop_status": np.zeros(0, "u1")}
    step = -(-result.sizes["boulder"] // MAX_STOPS)
    x, y, status = (result[name].values[::step] for name in ("stop_x", "stop_y", "status"))
    places = ground.relative(x, y).astype("f4")
    return {"stops": places, "stop_status": status.astype("u1")}


def _overlay(result: xr.Dataset, shown: str) -> tuple[dict[str, Any], np.ndarray]:
    """Message fields, and map in display units thinned by maxima; NaN where no boulder passed."""
    data = result[shown]
    (_, factor), (values, grid) = shown_as(data), north_up(data)
    values = np.where(values > of_none(result, shown), values * factor, np.nan).astype("f4")
    step = int(max(values.shape) / MAX_OVERLAY) + 1
    values = merged(values, step, np.fmax)
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
    fields = {
        "west": grid.west, "north": grid.north, "cell": grid.cell * step, "low": low, "high": high,
        "scale": "log" if low > 0 and high > WIDE * low else "linear",
        "whole": data.dtype.kind in "iu",
    }  # fmt: skip
    return _about_map(shown) | fields, values


def trajectory_message(
    shown: Sequence[Trajectory], mass: np.ndarray, ground: Ground, **fields: Any
) -> bytes:
    """Message `trajectories`; `mass` is the mass of each boulder [kg]."""
    points = [_points(trajectory, ground) for trajectory in shown]
    first = np.cumsum([0, *map(len, points)])
    arrays = {
        "points": np.concatenate([np.zeros((0, 6)), *points]).astype("f4"),
        "first": first.astype("u4"),
        "boulder": np.array([trajectory.boulder for trajectory in shown], "u4"),
        "mass": mass.astype("f4"),
    }
    return binary_message("trajectories", arrays, **fields, count=len(shown))


def _points(path: Trajectory, ground: Ground) -> np.ndarray:
    """Points (n, 6) at the ends of each piece of a trajectory: x, y, z, time, speed and gravity.
    Between them, the page draws a parabola, or a straight line without gravity."""
    place = np.arange(path.x.size) % POINTS
    chosen = (place == 0) | (place == POINTS - 1)
    plan = ground.relative(path.x[chosen], path.y[chosen])
    columns = path.z, path.time, path.speed, path.gravity
    return np.column_stack([plan, *(values[chosen] for values in columns)])


def masses(result: xr.Dataset, boulders: Sequence[int], case: Case) -> np.ndarray:
    """Mass [kg] of these boulders, by number; NaN for boulders without a row in the result."""
    numbers = result["boulder"].values
    order = np.argsort(numbers)
    place = np.searchsorted(numbers, boulders, sorter=order).clip(max=max(numbers.size - 1, 0))
    if not numbers.size:
        return np.full(len(boulders), np.nan)
    row = order[place]
    if "mass" in result:
        mass = result["mass"].values
    else:
        mass = case.boulder["density"] * result["volume"].values
    return np.where(numbers[row] == boulders, mass[row], np.nan)
