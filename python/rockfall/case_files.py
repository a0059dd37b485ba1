# SPDX-License-Identifier: BSD-3-Clause
"""The files that a case reads: no command writes over one of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from rockfall.case import FROM_ARRAY, Case, case_of
from rockfall.errors import RockfallError
from rockfall.impact_sets import find_set, set_path
from rockfall.io.raster_file import raster_files
from rockfall.io.zone_table import read_zone_table

if TYPE_CHECKING:
    import xarray as xr

#: Keys that name a file; those of impact sets may also name a shipped one.
RASTERS = {
    "terrain": ("dem",),
    "surface": ("zones", "mean_radius", "rg70", "rg20", "rg10", "ground_map"),
    "release": ("cells",),
}
LAYERS = {"surface": ("zones",), "release": ("polygons",)}
#: Endings of what may lie beside a layer (GDAL's drivers of shapefiles and GeoPackages).
BESIDE = (
    ".shp", ".shx", ".dbf", ".prj", ".cpg", ".qpj", ".cst", ".qix", ".sbn", ".sbx", ".idm", ".ind",
)  # fmt: skip
APPENDED = (".xml", ".aux.xml", "-wal", "-shm", "-journal")


def input_files(case: Case) -> Iterator[Path]:
    """Every file that a case reads, the case file first; some may not be there."""
    yield Path(case.name)
    for keys, files_of in ((LAYERS, _layer_files), (RASTERS, raster_files)):
        for group, names in keys.items():
            for name in names:
                file = getattr(case, group).get(name, FROM_ARRAY)
                if file != FROM_ARRAY:
                    yield from map(Path, files_of(case.path(file)))
    for key in ("table", "ground_table"):
        if key in case.surface:
            yield case.path(case.surface[key])
    for name in (case.impact["sets"], *case.ensemble.get("sets", [])):
        with suppress(RockfallError):  # who reads it says that it is not there
            yield set_path(case, name)
    for name in _named_grounds(case):
        if path := find_set(case, name):
            yield path


def _named_grounds(case: Case) -> set[str]:
    """What the case and its table of zones call the grounds, some of them impact sets."""
    names = {case.surface.get("ground", "")}
    if "table" in case.surface:
        with suppress(RockfallError):
            zones = read_zone_table(case.path(case.surface["table"]))
            names |= {zone.ground for zone in zones.values()}
    return names - {""}


def files_behind(result: xr.Dataset) -> Iterator[Path]:
    """The files that the case of a result reads, seen from where it was run; none where it has no
    case that this version reads."""
    if {"case", "case_file"} <= result.attrs.keys():
        try:
            case = case_of(result)
        except RockfallError:
            return
        yield from input_files(case)


def _layer_files(path: Path) -> Iterator[Path]:
    """A layer of polygons and what lies beside it."""
    yield path
    yield from (path.with_name(f"{path.name}{end}") for end in APPENDED)
    if path.suffix.lower() == ".shp":
        for end in BESIDE:
            yield from (path.with_suffix(one) for one in (end, end.upper()))
