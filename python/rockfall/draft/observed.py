# SPDX-License-Identifier: BSD-3-Clause
"""Observations of a first case: blocks at rest and scars, and the lowest energy line."""

import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from rockfall.case import key_table
from rockfall.draft.recognise import BLOCKS, SCARS, Layer
from rockfall.errors import RockfallError
from rockfall.files.export import write_geopackage
from rockfall.io.coordinates.crs import plan_wkt
from rockfall.io.rasters.grid import Grid

COPIES = {BLOCKS: "blocks", SCARS: "scars"}  # words in file names
AskAngle = Callable[[], "float | None"]


class Observed(NamedTuple):
    """Observations: files named in a case, with their layers; copies of layers from files with
    several layers; and the lowest energy-line angle [degree], None if unknown.
    """

    files: dict[Path, Layer]
    copies: list[Path]
    angle: float | None


def copy_names(out: Path) -> Iterator[Path]:
    """Files that may be written next to a case."""
    return (out.with_name(f"{out.stem}_{name}.gpkg") for name in COPIES.values())


def observed_of(
    layers: Iterable[tuple[str, Layer]],
    grid: Grid,
    out: Path,
    place: Path,
    angle: float | None,
    ask: AskAngle | None,
) -> Observed:
    """Select the observations from layers with their kinds, and write copies to a folder. `ask`
    returns the angle if there are observations but no angle is given.
    """
    files, copies = {}, []
    for kind, layer in layers:
        path = layer.path
        if not layer.alone:
            path = place / f"{out.stem}_{COPIES[kind]}.gpkg"
            fields = {layer.own_names[name]: values for name, values in layer.columns.items()}
            crs = plan_wkt(grid.crs) if grid.crs else None
            write_geopackage(path, {COPIES[kind]: ("Point", [(layer.shapes, fields)])}, crs)
            copies.append(path)
        files[path] = layer
    if angle is None and files and ask is not None:
        angle = ask()
    if angle is not None:
        check_angle(angle)
    return Observed(files, copies, angle)


def check_angle(angle: float) -> None:
    """Refuse an energy-line angle [degree] that a case does not allow."""
    key = next(key for key in key_table() if key.name == "energy_line_angle")
    assert key.low is not None and key.high is not None
    if not (math.isfinite(angle) and key.low <= angle <= key.high):
        raise RockfallError(f"energy-line angle = {angle:g}: must be {key.allowed} degrees")
