# SPDX-License-Identifier: BSD-3-Clause
"""Valid but implausible inputs of a scene, with a line for each that gives its literal meaning.

Impossible inputs raise an error when read. Limits are far from usual values, because false
warnings also do harm. Each limit is defined once, with its reason, in `rockfall.scene.rules`.
"""

import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TypeAlias

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
from rockfall.terrain.polyline import lengths, spaced

MIN_BEYOND = 0.01  # minimum fraction of a line without elevations
PART = 500  # points of a line that are looked up together
FAR_SIDES = 3.0  # in terrain side lengths: roads and valleys extend less far beyond the terrain

Rules: TypeAlias = Callable[[Scene], Iterator[InputWarning]]


def input_warnings(scene: Scene) -> list[InputWarning]:
    """Likely mistakes in the inputs; cached for a scene and scenes derived from it."""
    findings = scene.findings
    if findings.warnings is None:
        warnings = (row for rules, uses in RULES.items() for row in _found(scene, rules, uses))
        findings.warnings = list(dict.fromkeys([*warnings, *_read(scene)]))
    return findings.warnings


def _found(scene: Scene, rules: Rules, uses: tuple[str, ...]) -> list[InputWarning]:
    """Warnings of these rules for the case and these parts of a scene."""

    def apply(case: Case) -> list[InputWarning]:
        return [*rules(scene if case is scene.case else replace(scene, case=case))]

    parts = tuple(getattr(scene, name) for name in uses)
    return scene.stages.take(f"rules {rules.__name__}", scene.case, parts, apply, reads=False)


def implausible(scene: Scene) -> list[str]:
    """Likely mistakes as lines of text."""
    return [f"{scene.case.name}: {where}: {text}" for where, text in input_warnings(scene)]


def warn_of(scene: Scene) -> None:
    """Issue the text lines as Python warnings, attributed to the caller's caller."""
    for line in implausible(scene):
        warnings.warn(line, stacklevel=3)


def _lines(scene: Scene) -> Iterator[InputWarning]:
    """Warnings on lines off the terrain: wholly, partly, or with a far vertex. The kernel refuses
    lines farther away."""
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
        off, length = _beyond(scene, x + 1j * y)
        if off > max(grid.cell, MIN_BEYOND * length):
            yield InputWarning(where, say("input.line_beyond", off=off, length=length))


def _beyond(scene: Scene, vertices: np.ndarray) -> tuple[float, float]:
    """Length of a line without elevations, within a cell, and its whole length [m]."""
    grid = scene.grid
    whole = float(lengths(vertices)[-1])
    if not whole:
        return 0.0, whole
    ends = spaced(vertices, int(np.ceil(2 * whole / grid.cell)) + 1)
    middle = (ends[:-1] + ends[1:]) / 2
    x, y = middle.real, middle.imag
    inside = (grid.west <= x) & (x <= grid.east) & (grid.south <= y) & (y <= grid.north)
    for part in np.array_split(np.flatnonzero(inside), 1 + inside.size // PART):
        inside[part] = _is_known(scene, *grid.cells(x[part], y[part]))
    return whole * float(1 - inside.mean()), whole


def _is_known(scene: Scene, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Mask of these nearby cells with elevations, in memory or from the file."""
    if scene.rasters.z.shape == scene.grid.shape or not row.size:
        return ~np.isnan(scene.rasters.z[row, column])
    box = Box(int(row.min()), int(column.min()), int(row.max()) + 1, int(column.max()) + 1)
    z = read_elevations(scene.case.path(scene.case.terrain["dem"]), box)
    return ~np.isnan(z[row - box.row, column - box.column])


def _read(scene: Scene) -> Iterator[InputWarning]:
    """Remarks of the readers with their places."""
    for remark in scene.remarks:
        assert isinstance(remark, Text)
        yield InputWarning(remark.values["where"], remark.values["text"])


#: Rules, and the scene parts that they use in addition to the case.
RULES: dict[Rules, tuple[str, ...]] = {
    _lines: ("grid", "rasters"),
    dem_rules: ("rasters",),
    boulder_rules: ("rasters", "x", "y", "features", "source_boulders", "source_values", "trees"),
    protection_rules: ("grid", "dams"),
}
