# SPDX-License-Identifier: BSD-3-Clause
"""Observations in a first case: blocks at rest, scars, lowest energy-line and shadow angles."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from rockfall.case import key_table
from rockfall.draft.recognise import BLOCKS, SCARS, Layer
from rockfall.errors import RockfallError
from rockfall.files.export import write_geopackage
from rockfall.io.coordinates.crs import plan_wkt
from rockfall.io.rasters.grid import Grid

COPIES = {BLOCKS: "blocks", SCARS: "scars"}  # words in file names
ANGLES = {"energy_line_angle": 31.0, "shadow_angle": 27.5}  # key -> example value [degree]
AskAngle = Callable[[str], "float | None"]  # returns the angle for a key


class Observed(NamedTuple):
    """Observations: files for the case, with their layers; copies of layers that share a file with
    other layers; and known lowest angles [degree] by key."""

    files: dict[Path, Layer]
    copies: list[Path]
    angles: dict[str, float]


def copy_names(out: Path) -> Iterator[Path]:
    """Names of files that may be written next to a case."""
    return (out.with_name(f"{out.stem}_{name}.gpkg") for name in COPIES.values())


def observed_of(
    layers: Iterable[tuple[str, Layer]],
    grid: Grid,
    out: Path,
    place: Path,
    angles: Mapping[str, float | None],
    ask: AskAngle | None,
) -> Observed:
    """Observations in `layers` (kind, layer); copies go to the folder `place`. `ask` returns an
    angle that was not given, if there are observations."""
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
    if files and ask is not None:
        angles = {key: ask(key) if angle is None else angle for key, angle in angles.items()}
    given = {key: angle for key, angle in angles.items() if angle is not None}
    for key, angle in given.items():
        check_angle(key, angle)
    return Observed(files, copies, given)


def check_angle(name: str, angle: float) -> None:
    """Raise a RockfallError for an angle [degree] that is not allowed in a case."""
    key = next(key for key in key_table() if key.name == name)
    assert key.low is not None and key.high is not None
    if not (math.isfinite(angle) and key.low <= angle <= key.high):
        raise RockfallError(f"{name} = {angle:g}: must be {key.allowed} degrees")
