# SPDX-License-Identifier: BSD-3-Clause
"""Warnings about valid but implausible inputs of a scene, each with the literal meaning of the
input.

Impossible inputs raise an error when read. Limits are far from usual values, because false warnings
also do harm. Each limit is defined once, with its reason, in `rockfall.scene.rules`.
"""

import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TypeAlias, TypeVar

import numpy as np

from rockfall.case import Case
from rockfall.io.input_warnings import InputWarning
from rockfall.io.rasters.dem import read_elevations
from rockfall.io.rasters.grid import Box
from rockfall.language import Text, say
from rockfall.scene.rules.boulders import boulder_rules
from rockfall.scene.rules.protection import protection_rules
from rockfall.scene.rules.terrain import dem_rules
from rockfall.scene.scene import Scene
from rockfall.terrain.line_beyond import vertices_key
from rockfall.terrain.polyline import lattice_cuts, lengths

MIN_BEYOND = 0.01  # minimum fraction of a line without elevations
PART = 500  # points of a line that are looked up together
FAR_SIDES = 3.0  # in terrain side lengths: roads and valleys extend less far beyond the terrain

T = TypeVar("T")
Rules: TypeAlias = Callable[[Scene], Iterator[InputWarning]]


def input_warnings(scene: Scene) -> list[InputWarning]:
    """Likely mistakes in the inputs; cached for a scene and scenes derived from it."""
    findings = scene.findings
    if findings.warnings is None:
        findings.beyond = dict(_found(scene, _lines_beyond, RULES[_lines]))
        warnings = (row for rules, uses in RULES.items() for row in _found(scene, rules, uses))
        findings.warnings = list(dict.fromkeys([*warnings, *_read(scene)]))
    return findings.warnings


def _found(scene: Scene, rules: Callable[[Scene], Iterator[T]], uses: tuple[str, ...]) -> list[T]:
    """Results of these rules for the case; cached until the case or the parts `uses` change."""

    def apply(case: Case) -> list[T]:
        return [*rules(scene if case is scene.case else replace(scene, case=case))]

    parts = tuple(getattr(scene, name) for name in uses)
    return scene.stages.take(f"rules {rules.__name__}", scene.case, parts, apply, reads=False)


def implausible(scene: Scene) -> list[str]:
    """Likely mistakes as lines of text."""
    return [f"{scene.case.name}: {where}: {text}" for where, text in input_warnings(scene)]


def warn_of(scene: Scene) -> None:
    """Issue the warnings about a scene as Python warnings, attributed to the caller of the calling
    function."""
    for line in implausible(scene):
        warnings.warn(line, stacklevel=3)


def _lines(scene: Scene) -> Iterator[InputWarning]:
    """Warnings on lines with parts or vertices off the terrain. The kernel refuses lines if only
    some vertices are far away."""
    barriers, outside = {barrier["name"] for barrier in scene.case.barrier}, scene.lines_outside()
    grid = scene.grid
    far = FAR_SIDES * grid.cell * max(grid.shape)
    for line in scene.case.lines:
        name = line["name"]
        where = f"&{'barrier' if name in barriers else 'line'} name = '{name}'"
        if name in outside:
            yield InputWarning(where, say("input.line_outside"))
            continue
        x, y = np.array(line["x"]), np.array(line["y"])
        apart = np.hypot(x - x.clip(grid.west, grid.east), y - y.clip(grid.south, grid.north))
        if (farthest := apart.max()) > far:
            values = {"vertex": int(apart.argmax()) + 1, "apart": float(farthest) / 1000}
            yield InputWarning(where, say("input.vertex_far", **values))
        off = float(np.diff(scene.beyond[vertices_key(x, y)]).sum())
        length = float(lengths(x + 1j * y)[-1])
        if off > max(2 * grid.cell, MIN_BEYOND * length):
            yield InputWarning(where, say("input.line_beyond", off=off, length=length))


def _lines_beyond(scene: Scene) -> Iterator[tuple[str, list[list[float]]]]:
    """Key of each line, and its stretches off the terrain, outside the squares between four known
    cell centres."""
    grid = scene.grid
    for line in scene.case.lines:
        x, y = np.array(line["x"]), np.array(line["y"])
        vertices = (x - grid.x[0] + 1j * (y - grid.y[-1])) / grid.cell
        cuts = lattice_cuts(vertices, (grid.nx, grid.ny))
        middle = np.interp((cuts[:-1] + cuts[1:]) / 2, lengths(vertices), vertices)
        column, row = np.floor(middle.real), grid.ny - 2 - np.floor(middle.imag)
        in_grid = (0 <= column) & (column < grid.nx - 1) & (0 <= row) & (row < grid.ny - 1)
        on_terrain = in_grid.copy()
        for part in np.array_split(np.flatnonzero(in_grid), 1 + in_grid.size // PART):
            at = row[part].astype(int), column[part].astype(int)
            on_terrain[part] = _are_known(scene, *at)
        ends = cuts[np.flatnonzero(np.diff(on_terrain, prepend=True, append=True))]
        yield vertices_key(x, y), (grid.cell * ends).reshape(-1, 2).tolist()


def _are_known(scene: Scene, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Mask of cells with elevations, also in their neighbours to the east, south and south-east.
    The cells must be close together if the terrain is read in windows."""
    if not row.size:
        return np.empty(0, bool)
    z, north, west = scene.rasters.z, 0, 0
    if z.shape != scene.grid.shape:
        north, west = int(row.min()), int(column.min())
        box = Box(north, west, int(row.max()) + 2, int(column.max()) + 2)
        z = read_elevations(scene.case.path(scene.case.terrain["dem"]), box)
    square = (z[row - north + i, column - west + k] for i in (0, 1) for k in (0, 1))
    return np.isfinite(sum(square))


def _read(scene: Scene) -> Iterator[InputWarning]:
    """Remarks recorded while reading, as warnings."""
    for remark in scene.remarks:
        assert isinstance(remark, Text)
        yield InputWarning(remark.values["where"], remark.values["text"])


#: Rules, and the parts of a scene that they use in addition to the case.
RULES: dict[Rules, tuple[str, ...]] = {
    _lines: ("grid", "rasters"),
    dem_rules: ("rasters",),
    boulder_rules: ("rasters", "x", "y", "features", "source_boulders", "source_values", "trees"),
    protection_rules: ("grid", "dams"),
}
