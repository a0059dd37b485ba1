# SPDX-License-Identifier: BSD-3-Clause
"""First case for a DEM and layers, which runs unchanged and mentions further options."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from rockfall.case import read_case
from rockfall.draft.groups import New, new_text
from rockfall.draft.recognise import (
    OBJECTS,
    SEVERAL,
    STANDS,
    TREES,
    ZONES,
    Layer,
    kind_of,
    read_layers,
)
from rockfall.draft.zones import zones_of
from rockfall.errors import RockfallError
from rockfall.io.output_files import atomic_folder
from rockfall.io.raster import read_dem
from rockfall.scene.plausible import implausible
from rockfall.scene.read import read_scene
from rockfall.scene.sources import threshold
from rockfall.simulation.memory import machine_memory

TOTAL = 100_000  # boulders in a first run


def new_case(dem: str | Path, layers: Iterable[str | Path], out: str | Path) -> New:
    """Write a commented case for a DEM and the layers of some files, with a table of zones next to
    it if there are any, without overwriting files; returns its contents.

    >>> import rockfall
    >>> new = rockfall.new_case("dem.tif", ["cliff.gpkg"], "new.nml")
    >>> new.sources
    4
    """
    dem, out, files = Path(dem), Path(out), [Path(path) for path in layers]
    if out.suffix.lower() != ".nml":
        raise RockfallError(f"{out}: output name must end in .nml")
    for path in out, *(out.with_name(f"{out.stem}_zones.{ending}") for ending in ("csv", "gpkg")):
        if os.path.lexists(path):
            raise RockfallError(f"{path}: already exists; not overwritten")
    z, grid = read_dem(dem)
    new = New(dem, out, grid)
    for file in files:
        for layer in read_layers(file, grid, new.remarks):
            _take(new, layer)
    with atomic_folder(out.parent, [dem, *files], last=out.name) as place:
        if ZONES in new.used:
            new.zones = zones_of(new.used[ZONES][0], grid, z, out.stem, place)
        _write(new, place)
    return new


def _take(new: New, layer: Layer) -> None:
    """Record the use of a layer; only one is allowed for zones, sources and trees."""
    kind, why = kind_of(layer)
    if kind in new.used and kind not in SEVERAL:
        kind, why = "", f"{kind} are already those of {new.used[kind][0]}"
    if {kind, *new.used} >= {TREES, STANDS}:
        kind, why = "", "a forest is made of trees or of stands, and one of them came before"
    if kind == TREES and not layer.alone and not new.has_key("forest", "trees_layer"):
        kind, why = "", "trees must be alone in their file"
    if kind and kind != OBJECTS:
        new.used.setdefault(kind, []).append(layer)
    new.notes.append(f"{layer}: {kind or 'left out'} ({why})")


def _write(new: New, place: Path) -> None:
    """Write the case to a folder, and read everything that it names. Its text depends on the
    sources found, so it is written twice."""
    path = place / new.out.name
    path.write_text(new_text(new, place), encoding="utf-8")
    try:
        scene = read_scene(read_case(path), memory=machine_memory())
    except RockfallError as error:
        if new.zones and str(new.zones.table) in str(error):
            raise RockfallError(f"{error} (made of {new.used[ZONES][0]})") from error
        raise
    new.sources, new.threshold = scene.x.size, threshold(scene.case, scene.grid)
    new.boulders = max(TOTAL, new.sources)
    if scene.features is not None and scene.features.law is not None:
        new.volumes = int(np.count_nonzero(scene.features.law[scene.features.number - 1]))
    new.remarks += [remark for remark in implausible(scene) if remark not in new.remarks]
    path.write_text(new_text(new, new.out.parent), encoding="utf-8")
    read_case(path)
