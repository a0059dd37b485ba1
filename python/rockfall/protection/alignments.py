# SPDX-License-Identifier: BSD-3-Clause
"""Candidate barrier alignments above a protected line: shifted copies of the line towards the
sources, or drawn lines."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.scene.frames import frame_files, is_frame
from rockfall.scene.read import read_scene
from rockfall.scene.scene import Scene
from rockfall.terrain.height import height, inside
from rockfall.terrain.polyline import beside, lengths, spaced

MAX_ALIGNMENTS = 200
SAMPLES = 200  # points on a line at which elevation and distance are computed


class Alignment(NamedTuple):
    """Candidate line [m]: vertices, mean distance from the protected line (or shift), minimum
    distance (`space`), mean elevation, length."""

    name: str
    x: list[float]
    y: list[float]
    distance: float
    space: float
    elevation: float
    length: float


class Shift(NamedTuple):
    """Shifts of the protected line: step [m], maximum distance [m], and azimuth [degree] (None:
    perpendicular to the line, towards the sources)."""

    every: float
    to: float
    direction: float | None = None


def shifted_scene(scene: Scene, line: str, shift: Shift) -> tuple[Scene, list[Alignment]]:
    """Scene with copies of a line as evaluation lines, and these lines, the original first. Copies
    entirely outside the terrain are omitted."""
    number = _steps(shift)
    vertices = vertices_of(scene.case, line)
    step = _direction(scene, line, vertices, shift.direction) * shift.every
    copies = {
        f"{line} +{k * shift.every:.10g} m": vertices + k * step for k in range(1, number + 1)
    }
    drawn = [
        {"name": name, "x": copy.real.tolist(), "y": copy.imag.tolist()}
        for name, copy in copies.items()
    ]
    case = scene.case
    outside = {*scene.replace(case=case.replace(line=[*case.line, *drawn])).lines_outside()}
    drawn = [entry for entry in drawn if entry["name"] not in outside]
    alignments = [alignment(scene, line, vertices, vertices, 0.0)]
    alignments += [
        alignment(scene, name, copy, vertices, k * shift.every)
        for k, (name, copy) in enumerate(copies.items(), start=1)
        if name not in outside
    ]
    return scene.replace(case=case.replace(line=[*case.line, *drawn])), alignments


def drawn_scene(
    case: Case, scene: Scene, line: str, layer: Any, name: str | None, arrays: Mapping[str, Any]
) -> tuple[Scene, list[Alignment]]:
    """Scene with the lines of a layer (a file or GeoDataFrame) as evaluation lines, and these
    lines by distance; `scene` is without them. Raises a RockfallError for too many lines."""
    given = {"candidates": layer} if is_frame(layer) else {}
    with frame_files(given) as files:
        file = files.get("candidates", layer if is_frame(layer) else Path(layer).resolve())
        group = {"file": str(file)} | ({} if name is None else {"layer": name})
        both = read_scene(case.replace(line=[*case.line, group]), **arrays)
    names = {entry["name"] for entry in scene.case.lines}
    before = vertices_of(scene.case, line)
    alignments = []
    for entry in both.case.line:
        if entry["name"] not in names:
            vertices = np.array(entry["x"]) + 1j * np.array(entry["y"])
            alignments.append(alignment(both, entry["name"], vertices, before))
    if len(alignments) > MAX_ALIGNMENTS:
        raise RockfallError(
            f"candidates: {len(alignments):,} lines: must be at most {MAX_ALIGNMENTS} alignments"
        )
    return both, sorted(alignments, key=lambda candidate: candidate.distance)


def vertices_of(case: Case, line: str) -> np.ndarray:
    """Vertices x + iy [m] of an evaluation line or barrier in a case. Refuses unknown names."""
    for entry in case.lines:
        if entry["name"] == line:
            return np.array(entry["x"]) + 1j * np.array(entry["y"])
    names = ", ".join(entry["name"] for entry in case.lines) or "none"
    raise RockfallError(f"{case.name}: line = '{line}': no such line (lines: {names})")


def alignment(
    scene: Scene, name: str, vertices: np.ndarray, line: np.ndarray, shift: float | None = None
) -> Alignment:
    """Shifted or drawn alignment above a line, with its elevation (NaN without terrain)."""
    apart = beside(spaced(vertices, SAMPLES), line)[0]
    distance = float(apart.mean()) if shift is None else shift
    z, grid, places = scene.rasters.z, scene.grid, spaced(vertices, SAMPLES)
    places = places[inside(grid, places.real, places.imag)]
    above = height(z, grid, places.real, places.imag)
    above = above[np.isfinite(above)]
    elevation = float(above.mean()) if above.size else math.nan
    length = float(lengths(vertices)[-1])
    return Alignment(
        name, vertices.real.tolist(), vertices.imag.tolist(), distance, float(apart.min()),
        elevation, length,
    )  # fmt: skip


def _steps(shift: Shift) -> int:
    """Number of copies of the line; refuse an invalid shift."""
    for name in ("every", "to"):
        if not 0 < getattr(shift, name) < math.inf:
            raise RockfallError(f"{name} = {getattr(shift, name)}: must be > 0 m")
    if shift.direction is not None and not 0 <= shift.direction <= 360:
        raise RockfallError(f"direction = {shift.direction}: must be 0 to 360 degrees")
    number = math.floor(shift.to / shift.every * (1 + 1e-9))
    if not 1 <= number < MAX_ALIGNMENTS:
        raise RockfallError(
            f"every = {shift.every}: gives {number:,} alignments up to {shift.to:g} m: must be 1 "
            f"to {MAX_ALIGNMENTS - 1}"
        )
    return number


def _direction(scene: Scene, line: str, vertices: np.ndarray, azimuth: float | None) -> complex:
    """Unit vector of the shift: along its azimuth, or perpendicular to the line's chord towards the
    mean source position. Refuses closed lines, and sources whose mean is on neither side."""
    if azimuth is not None:
        return complex(1j * np.exp(-1j * math.radians(azimuth)))
    chord = vertices[-1] - vertices[0]
    to_sources = np.mean(scene.x + 1j * scene.y) - spaced(vertices, SAMPLES).mean()
    normal = 1j * chord
    side = (to_sources * np.conj(normal)).real
    if abs(chord) < 1e-6 * lengths(vertices)[-1] or side == 0:
        raise RockfallError(
            f"{scene.case.name}: line '{line}' has sources on both sides: give "
            "the direction [degree from north] of its shift"
        )
    return complex(normal / abs(normal) * np.sign(side))
