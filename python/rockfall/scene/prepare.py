# SPDX-License-Identifier: BSD-3-Clause
"""Any case as one that `rockfall-batch` reads alone: ESRI ASCII, one table, nothing elsewhere."""

from __future__ import annotations

import os
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from rockfall.case import Case, read_case
from rockfall.case_files import input_files
from rockfall.errors import RockfallError
from rockfall.impact_sets import set_path
from rockfall.io.output_files import atomic_folder, check_outputs
from rockfall.scene.reach import survey
from rockfall.scene.read import read_scene
from rockfall.scene.scene import Scene

MARK = "! Prepared by rockfall"  # first words of a prepared case.nml
RASTERS = ("dem", "zones", "mean_radius", "rg70", "rg20", "rg10", "cells")
#: Files of a prepared case, beside its impact sets.
OWN = ("case.nml", "zones.csv", *(f"{name}{end}" for name in RASTERS for end in (".asc", ".prj")))
NODATA = (-9999, -99999, -999999)  # the first that is no value of the raster


def prepare(case: Case, folder: str | Path, **arrays: Any) -> list[Path]:
    """Write the case and what it reads to `folder`; returns the files, `case.nml` last.

    Every number reads back to the same bits, so both programs give the same results as the
    original. `arrays` are as in `rockfall.scene.read.read_scene`. A folder that holds something
    else than a prepared case is refused.
    """
    folder, inputs = Path(folder), list(input_files(case))
    sets = set_path(case)
    name = sets.name if sets.suffix == ".nml" and sets.stem != "case" else "impact_set.nml"
    former = _prepared_files(folder, {*OWN, name})
    check_outputs(dict.fromkeys(former), inputs, former)
    scene = read_scene(case, **arrays)
    survey(scene)
    coefficients = sets.read_bytes()
    with atomic_folder(folder, inputs, former, last="case.nml") as part:
        changes = {"terrain": {"dem": _raster(part, "dem", scene.z, scene)}}
        changes["surface"] = _surface(part, scene)
        changes["release"] = _sources(part, scene)
        (part / name).write_bytes(coefficients)
        changes["impact"] = {"sets": name}
        head = f"{MARK} from {case.name}; impact sets '{case.impact['sets']}'."
        text = f"{' '.join(head.splitlines())}\n{case.replace(**changes).text()}"
        (part / "case.nml").write_text(text, encoding="utf-8")
        names = sorted(path.name for path in part.iterdir() if path.name != "case.nml")
    return [folder / name for name in (*names, "case.nml")]


def _surface(part: Path, scene: Scene) -> dict[str, Any]:
    """Write what the ground is made of; returns what changes in &surface."""
    surface = scene.case.surface
    if scene.zone is not None:
        return _zones(part, scene)
    if scene.values is None:
        return {}
    names = ("mean_radius",) if surface["method"] == "B" else ("rg70", "rg20", "rg10")
    unused = {name: None for name in RASTERS if name in surface}
    layers = zip(names, scene.values, strict=True)
    return unused | {name: _raster(part, name, layer, scene) for name, layer in layers}


def _zones(part: Path, scene: Scene) -> dict[str, Any]:
    """The zones burnt into a raster, and the columns of the table that count."""
    from rockfall.io.raster import NO_ID, read_zone_table
    from rockfall.io.zone_table import RADII

    table = read_zone_table(scene.case.path(scene.case.surface["table"]))
    radii = np.array(list(table.values()))
    columns = [k for k in range(len(RADII)) if not np.isnan(radii[:, k]).any()]
    lines = [",".join(["zone", *(RADII[k] for k in columns)])]
    for zone, row in table.items():
        lines.append(",".join([str(zone), *(repr(row[k]) for k in columns)]))
    (part / "zones.csv").write_text("\n".join(lines) + "\n", encoding="ascii")
    ids = np.array([NO_ID, *table], np.int32)[scene.zone]
    name = _raster(part, "zones", ids, scene)
    return {"zones": name, "table": "zones.csv", "default_zone": None, "zone_field": None}


def _sources(part: Path, scene: Scene) -> dict[str, Any]:
    """Source cells as a raster; points stay in the case."""
    if "x" in scene.case.release:
        return {}
    grid = scene.grid
    cells = np.zeros(grid.shape, np.uint8)
    cells[
        ((grid.north - scene.y) / grid.cell).astype(int),
        ((scene.x - grid.west) / grid.cell).astype(int),
    ] = 1
    others = {"polygons": None, "steep_cells": None, "slope_threshold": None}
    return {"cells": _raster(part, "cells", cells, scene)} | others


def _raster(part: Path, name: str, array: np.ndarray, scene: Scene) -> str:
    from rockfall.io.raster import write_ascii

    nodata = next((mark for mark in NODATA if not (array == mark).any()), NODATA[0])
    write_ascii(part / f"{name}.asc", array, scene.grid, nodata)
    return f"{name}.asc"


def _prepared_files(folder: Path, own: Collection[str]) -> list[Path]:
    """The files of these names that the prepared case in a folder reads; a folder that holds
    something else is refused."""
    if folder.exists() and not folder.is_dir():
        raise RockfallError(f"{folder}: is a file, a folder is needed")
    if not folder.exists() or not any(folder.iterdir()):
        return []
    case = folder / "case.nml"
    if not (case.is_file() and case.read_bytes().startswith(MARK.encode())):
        raise RockfallError(f"{folder}: is not empty and holds no prepared case; take another")
    read = {os.path.abspath(path) for path in input_files(read_case(case))}
    return [folder / name for name in sorted(own) if os.path.abspath(folder / name) in read]
