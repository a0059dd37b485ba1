# SPDX-License-Identifier: BSD-3-Clause
"""First case for a DEM and layers; it runs unchanged and lists further options."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from rockfall.analysis.observed.compare import site_observations
from rockfall.case import read_case
from rockfall.draft.grounds import Ask, Grounds
from rockfall.draft.groups import New, new_text
from rockfall.draft.observed import ANGLES, AskAngle, copy_names, observed_of
from rockfall.draft.recognise import (
    BLOCKS,
    OBJECTS,
    SCARS,
    SEVERAL,
    SOURCES,
    STANDS,
    TREES,
    ZONES,
    Layer,
    kind_of,
    may_be_sources,
    read_layers,
)
from rockfall.draft.zones import Zones, zones_of
from rockfall.errors import FAULT_MARK, RockfallError
from rockfall.io.atomic import atomic_folder
from rockfall.io.files import relative_name
from rockfall.io.rasters.dem import read_dem
from rockfall.io.rasters.grid import Grid
from rockfall.scene.read import read_scene
from rockfall.scene.releases.sources import threshold
from rockfall.scene.rules.plausible import implausible
from rockfall.scene.scene import Scene
from rockfall.simulation.memory import machine_memory

TOTAL = 100_000  # boulders in the first run


def new_case(
    dem: str | Path,
    layers: Iterable[str | Path],
    out: str | Path,
    ground: str = "",
    grounds: Mapping[str, str] | None = None,
    ask: Ask | None = None,
    energy_line_angle: float | None = None,
    shadow_angle: float | None = None,
    ask_angle: AskAngle | None = None,
) -> New:
    """Write a commented case for a DEM and layers in files, with a zone table if there are zones.
    No files are overwritten. Return the contents of the case.

    `grounds` sets the ground of zones by name or id; `ground` applies to zones without a ground in
    their attributes or names, or to a case without zones. `ask` returns the ground of a zone that
    is still unknown; without `ask`, or if it returns "", a RockfallError is raised. Layers of
    blocks at rest and scars become observations (`&observed`), with the lowest `energy_line_angle`
    and `shadow_angle` [degree] observed at the site or in the region; `ask_angle` returns the
    angle for a key, or None if it is not known.

    >>> import rockfall
    >>> new = rockfall.new_case("dem.tif", ["cliff.gpkg"], "new.nml", ground="talus")
    >>> new.sources
    4
    """
    dem, out, files = Path(dem), Path(out), [Path(path) for path in layers]
    if out.suffix.lower() != ".nml":
        raise RockfallError(f"{out}: output name must end in .nml")
    of_zones = (out.with_name(f"{out.stem}_zones.{ending}") for ending in ("csv", "gpkg"))
    for path in out, *of_zones, *copy_names(out):
        if os.path.lexists(path):
            raise RockfallError(f"{path}: already exists; not overwritten")
    z, grid = read_dem(dem)
    new = New(dem, out, grid)
    doubtful = [layer for layer in _layers(files, grid) if not _take(new, layer)]
    if doubtful and SOURCES not in new.used:
        _check_steep(new, doubtful)
    chosen = Grounds(ground, grounds or {}, ask)
    if ZONES not in new.used:
        chosen.check_used(None)
        new.ground = chosen.of_case(str(dem))
    with atomic_folder(out.parent, [dem, *files], last=out.name) as place:
        if ZONES in new.used:
            new.zones = zones_of(new.used[ZONES][0], grid, z, out.stem, place, chosen)
            new.notes += [*chosen.notes(), *_default_zone(new.zones)]
            new.remarks += new.used[ZONES][0].remarks if new.zones.copy else []
        seen = [(kind, layer) for kind in (BLOCKS, SCARS) for layer in new.used.get(kind, ())]
        angles = dict(zip(ANGLES, (energy_line_angle, shadow_angle), strict=True))
        new.observed = observed_of(seen, grid, out, place, angles, ask_angle)
        _write(new, place, files)
    return new


def _layers(files: Sequence[Path], grid: Grid) -> list[Layer]:
    """Layers of all files. The RockfallError for files that cannot be read has a line for each."""
    layers: list[Layer] = []
    faults: list[str] = []
    for file in files:
        try:
            layers += read_layers(file, grid)
        except RockfallError as error:
            faults += error.faults
    if faults:
        raise RockfallError(FAULT_MARK.join(faults))
    return layers


def _take(new: New, layer: Layer) -> bool:
    """Record the use of a layer; only a single layer of zones, sources or trees is allowed. Return
    False for a layer of unknown use that may contain sources."""
    kind, why = kind_of(layer)
    doubtful = may_be_sources(layer, kind)
    if kind in new.used and kind not in SEVERAL:
        kind, why = "", f"{kind} are already given by {new.used[kind][0]}"
    if {kind, *new.used} >= {TREES, STANDS}:
        kind, why = "", "give either trees or stands, not both"
    if kind == TREES and not layer.alone and not new.has_key("forest", "trees_layer"):
        kind, why = "", "trees must be alone in their file"
    if kind and kind != OBJECTS:
        new.used.setdefault(kind, []).append(layer)
    new.notes.append(f"{layer}: {kind or 'left out'} ({why})")
    return not doubtful


def _default_zone(zones: Zones) -> Iterator[str]:
    """Note on the zone of cells outside all polygons, if there are any."""
    if zones.rest is not None:
        yield (
            f"default_zone = {zones.rest}, the most frequent zone, for {zones.outside:,} cells in "
            "no polygon: check it, or draw polygons there"
        )


def _check_steep(new: New, doubtful: list[Layer]) -> None:
    """Raise a RockfallError for steep cells as sources if an unrecognised layer may contain
    sources; if its file also has layers of other uses, only add a remark."""
    for layer in doubtful:
        if layer.is_called(SOURCES):
            raise RockfallError(
                f"{layer}: is named as a source layer: sources must be all points or all polygons"
            )
    for layer in doubtful:
        if layer.alone:
            raise RockfallError(
                f"{layer}: its use is unknown and there are no sources: rename it source, or leave "
                "it out to release from steep cells"
            )
    names = ", ".join(layer.name for layer in doubtful)
    new.remarks.append(
        f"{doubtful[0].path}: no layer contains sources, so steep cells are used: otherwise rename "
        f"one of {names} to source"
    )


def _of_user(text: str, new: New, place: Path, files: Iterable[Path]) -> str:
    """Replace file names in the temporary folder by the user's file names."""
    names = {place / relative_name(file.resolve(), place): file for file in (new.dem, *files)}
    if new.zones:
        names |= dict.fromkeys([new.zones.copy] if new.zones.copy else [], new.used[ZONES][0].path)
    if new.observed:
        names |= {path: layer.path for path, layer in new.observed.files.items()}
    names |= {place / new.out.name: new.out, place: new.out.parent}
    for path, name in names.items():
        text = text.replace(str(path), str(name))
    return text


def _check_known(new: New, scene: Scene) -> None:
    """Raise a RockfallError for source points from which no boulder can start."""
    lost = np.flatnonzero(~scene.known_at(scene.x, scene.y))
    for k in lost[:1].tolist():
        raise RockfallError(
            f"{new.used[SOURCES][0]}: {lost.size:,} of {scene.x.size:,} points lie outside the DEM "
            f"or on cells without an elevation, such as {scene.x[k]:.10g}, {scene.y[k]:.10g}: move "
            "them, or fill the DEM"
        )


def _write(new: New, place: Path, files: Iterable[Path]) -> None:
    """Write the case to a folder and read all its inputs. It is written twice, because its text
    depends on the sources found. Raises its errors in the user's terms."""
    path = place / new.out.name
    path.write_text(new_text(new, place), encoding="utf-8")
    try:
        scene = read_scene(read_case(path), memory=machine_memory())
        site_observations(scene)
    except RockfallError as error:
        if new.zones and str(new.zones.table) in str(error):
            text = f"{error} (made of {new.used[ZONES][0]})"
            raise RockfallError(_of_user(text, new, place, files)) from error
        raise RockfallError(_of_user(str(error), new, place, files), error.code) from error
    if scene.windows is None:
        _check_known(new, scene)
    new.sources, new.threshold = scene.x.size, threshold(scene.case, scene.grid)
    new.boulders = max(TOTAL, new.sources)
    if scene.features is not None and scene.features.law is not None:
        new.volumes = int(np.count_nonzero(scene.features.law[scene.features.number - 1]))
    lines = [_of_user(line, new, place, files) for line in implausible(scene)]
    new.remarks += [line for line in dict.fromkeys(lines) if line not in new.remarks]
    path.write_text(new_text(new, new.out.parent), encoding="utf-8")
    read_case(path)
