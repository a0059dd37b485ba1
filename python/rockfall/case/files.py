# SPDX-License-Identifier: BSD-3-Clause
"""Input files of a case, which commands must not overwrite."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from rockfall.case.case import FROM_ARRAY, Case, case_of
from rockfall.case.keys import REPEATABLE
from rockfall.case.zones import case_zones
from rockfall.errors import RockfallError
from rockfall.grounds import find_operator
from rockfall.grounds.impact_tables import own_table
from rockfall.io.rasters.raster_file import raster_file, raster_files

if TYPE_CHECKING:
    from rockfall.result.contents import Held

#: Extensions of companion files of a layer (GDAL drivers for shapefiles and GeoPackages).
BESIDE = (
    ".shp", ".shx", ".dbf", ".prj", ".cpg", ".qpj", ".cst", ".qix", ".sbn", ".sbx", ".idm", ".ind",
)  # fmt: skip
APPENDED = (".xml", ".aux.xml", "-wal", "-shm", "-journal")


def input_files(case: Case) -> Iterator[Path]:
    """Yield all files that a case may read, starting with the case file; some may not exist."""
    yield Path(case.name)
    for key, name in case.files():
        if name != FROM_ARRAY:
            yield from _files_of(case, key.file, name)
    for name in _named_grounds(case):
        if path := find_operator(case, name)[0]:
            yield path


def read_names(case: Case) -> list[str]:
    """Names (without folders) of a case's files, except impact sets and tables (may be unused)."""
    names = (
        name
        for key, name in case.files()
        if name != FROM_ARRAY and key.file not in ("sets", "impact_table")
    )
    return list(dict.fromkeys(Path(name).name for name in names))


def group_files(case: Case, group: str) -> Iterator[Path]:
    """Yield all files that a group of a case refers to, with possible companion files."""
    for key, name in case.files():
        if key.group != group or name == FROM_ARRAY:
            continue
        yield from _files_of(case, key.file, name)
        if "raster" in key.file:
            path = Path(raster_file(str(case.path(name))))
            yield from (path.with_name(f"{path.name}{end}") for end in APPENDED)
    if group == "surface":
        for name in _named_grounds(case):
            if used := find_operator(case, name)[0]:
                yield used


def _named_grounds(case: Case) -> set[str]:
    """Names of grounds in the case and its zone table; some are impact sets."""
    names = {case.surface.get("ground", "")}
    with suppress(RockfallError):
        names |= {zone.ground for zone in case_zones(case).values()}
    return names - {""}


def _files_of(case: Case, kind: str, name: str) -> Iterator[Path]:
    """Yield the files that a value of a key refers to."""
    path = case.path(name)
    if kind == "sets":
        if operator := find_operator(case, name)[0]:  # its reader will report missing files
            yield operator
    elif kind == "impact_table":
        if case.impact["form"] == "table" and (operator := own_table(case, name)):
            yield operator
    elif kind == "table":
        yield path
    if kind == "points" or "layer" in kind:
        yield from _layer_files(path)
    if "raster" in kind:
        yield from map(Path, raster_files(path))


def files_behind(result: Held) -> Iterator[Path]:
    """Yield the files that the case of a result reads, relative to the folder of the run; none if
    the case cannot be read."""
    if {"case", "case_file"} <= result.attrs.keys():
        try:
            case = case_of(result)
        except RockfallError:
            return
        yield from input_files(case)
        for key in json.loads(result.attrs.get("input_checksums", "{}")):
            group, _, name = key.partition(" ")
            if group in REPEATABLE:  # layer coordinates are stored in the case
                yield from _layer_files(case.path(name))


def _layer_files(path: Path) -> Iterator[Path]:
    """Files of a vector layer, with its possible companion files."""
    yield path
    yield from (path.with_name(f"{path.name}{end}") for end in APPENDED)
    if path.suffix.lower() == ".shp":
        for end in BESIDE:
            yield from (path.with_suffix(suffix) for suffix in (end, end.upper()))
