# SPDX-License-Identifier: BSD-3-Clause
"""Any case as one that `rockfall-batch` reads alone: ESRI ASCII, one table, nothing elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.files import whole_folder
from rockfall.reach import survey
from rockfall.scene import Scene, read_scene, set_path

MARK = "! Prepared by rockfall"  # first words of a prepared case.nml
RASTERS = ("dem", "zones", "mean_radius", "rg70", "rg20", "rg10", "cells")
NODATA = (-9999, -99999, -999999)  # the first that is no value of the raster


def prepare(case: Case, folder: str | Path, **arrays: Any) -> list[Path]:
    """Write the case and what it reads to `folder`; returns the files, `case.nml` last.

    Every number reads back to the same bits, so both programs give the same results as the
    original. `arrays` are as in `rockfall.scene.read_scene`. A folder that holds something else
    than a prepared case is refused.
    """
    folder = Path(folder)
    _check_folder(folder)
    scene = read_scene(case, **arrays)
    survey(scene)
    sets = set_path(case)
    coefficients = sets.read_bytes()
    with whole_folder(folder, last="case.nml") as part:
        changes = {"terrain": {"dem": _raster(part, "dem", scene.z, scene)}}
        changes["surface"] = _surface(part, scene)
        changes["release"] = _sources(part, scene)
        name = sets.name if sets.suffix == ".nml" and sets.stem != "case" else "impact_set.nml"
        (part / name).write_bytes(coefficients)
        changes["impact"] = {"sets": name}
        head = f"{MARK} from {case.name}; impact sets '{case.impact['sets']}'."
        text = f"{' '.join(head.splitlines())}\n{case.replace(**changes).text()}"
        (part / "case.nml").write_text(text, encoding="utf-8")
        names = sorted(path.name for path in part.iterdir() if path.name != "case.nml")
        _remove_prepared(folder)
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
    from rockfall.rasters import NO_ID, read_zone_table
    from rockfall.zones import RADII

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
    from rockfall.rasters import write_ascii

    nodata = next((mark for mark in NODATA if not (array == mark).any()), NODATA[0])
    write_ascii(part / f"{name}.asc", array, scene.grid, nodata)
    return f"{name}.asc"


def _check_folder(folder: Path) -> None:
    """Refuse to overwrite what is no prepared case."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise RockfallError(f"{folder}: is a file, a folder is needed")
    if any(folder.iterdir()) and not _is_prepared(folder):
        raise RockfallError(f"{folder}: is not empty and holds no prepared case; take another")


def _is_prepared(folder: Path) -> bool:
    case = folder / "case.nml"
    return case.is_file() and case.read_bytes().startswith(MARK.encode())


def _remove_prepared(folder: Path) -> None:
    """A folder without its `case.nml` holds no whole case; that leaves first and comes last."""
    rasters = (f"{name}{ending}" for name in RASTERS for ending in (".asc", ".prj"))
    for name in ("case.nml", "zones.csv", *rasters):
        (folder / name).unlink(missing_ok=True)
