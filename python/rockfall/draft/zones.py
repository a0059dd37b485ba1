# SPDX-License-Identifier: BSD-3-Clause
"""Zone table of a case, made from polygons with ground attributes."""

import csv
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rockfall.draft.grounds import ID, Grounds
from rockfall.draft.recognise import Layer
from rockfall.errors import RockfallError
from rockfall.files.export import write_geopackage
from rockfall.io.coordinates.crs import plan_wkt
from rockfall.io.rasters.grid import NO_ID, Grid
from rockfall.io.tables import spreadsheet_text
from rockfall.io.vectors.layers import burn_polygons
from rockfall.io.zone_table import PAIR, RADII


class Zones(NamedTuple):
    """Zones in the form that a case uses."""

    copy: Path | None  # copy of the polygons with new ids, if necessary
    field: str  # attribute with the zone id
    table: Path
    method: str
    rest: int | None  # most frequent zone, for cells outside polygons; None: no such cells
    outside: int  # number of cells outside polygons


def zones_of(
    layer: Layer, grid: Grid, z: np.ndarray, stem: str, place: Path, grounds: Grounds
) -> Zones:
    """Write the zone table of a layer and, if `_own_ids` finds no ids, a copy with new ids."""
    radii, pair = ([key for key in keys if layer.attribute(key)] for keys in (RADII, PAIR))
    columns = [*radii, "ground", *pair]
    rows = [_row(layer, radii, pair, k, grounds) for k in range(len(layer.shapes))]
    grounds.check_used(layer)
    ids = _own_ids(layer, rows)
    copy, field = None, layer.own_names.get(ID, ID)
    if ids is None:
        numbers = {row: number for number, row in enumerate(dict.fromkeys(rows), start=1)}
        ids, field = [numbers[row] for row in rows], ID
        copy = place / f"{stem}_zones.gpkg"
        parts = [(layer.shapes, {ID: np.array(ids)})]
        write_geopackage(
            copy, {"zones": ("Unknown", parts)}, plan_wkt(grid.crs) if grid.crs else None
        )
    table = place / f"{stem}_zones.csv"
    with open(table, "w", encoding="utf-8", newline="") as file:
        of_ids = dict(zip(ids, rows, strict=True))
        names = _names(layer, ids)
        csv.writer(file, lineterminator="\n").writerows(
            [
                (ID, *columns, *(["name"] if names else [])),
                *(
                    (number, *of_ids[number], *([names[number]] if names else []))
                    for number in sorted(of_ids)
                ),
            ]
        )
    rest, outside = _rest(layer, grid, z, copy, field)
    method = "A" if "rg70" in columns and "mean_radius" not in columns else "B"
    return Zones(copy, field, table, method, rest, outside)


def _row(
    layer: Layer, radii: list[str], pair: list[str], k: int, grounds: Grounds
) -> tuple[str, ...]:
    """Table row of a polygon: rock sizes, ground, strength and relief; refuses a polygon without
    any of these."""
    sizes, own = ([layer.text(layer.attribute(key), k) for key in keys] for keys in (radii, pair))
    if not any((*sizes, *own)) and not layer.text(layer.attribute("ground"), k):
        keys = [*radii, *(["ground"] if layer.attribute("ground") else [])]
        raise RockfallError(f"{layer}: feature {k + 1}: must have {' or '.join(keys)}")
    return (*sizes, spreadsheet_text(grounds.of_zone(layer, k)), *own)


def _names(layer: Layer, ids: list[int]) -> dict[int, str]:
    """Name of each zone, if the layer's names are unambiguous."""
    if layer.name_column is None:
        return {}
    column = layer.columns[layer.name_column]
    called = {(number, name) for number, name in zip(ids, column, strict=True)}
    named = [(number, name) for number, name in called if isinstance(name, str)]
    texts = {number: spreadsheet_text(name) for number, name in named if name.isprintable()}
    return texts if len(texts) == len(called) == len(set(ids)) else {}


def _own_ids(layer: Layer, rows: list[tuple[str, ...]]) -> list[int] | None:
    """Ids of the polygons; None if they are no integers, or if different rows share an id."""
    values = layer.columns.get(ID)
    if values is None or values.dtype.kind not in "iu":
        return None
    ids = [int(value) for value in values]
    return ids if len(set(zip(ids, rows, strict=True))) == len(set(ids)) else None


def _rest(
    layer: Layer, grid: Grid, z: np.ndarray, copy: Path | None, field: str
) -> tuple[int | None, int]:
    """Most frequent zone, for cells outside polygons, and the number of these cells; (None, 0)
    without such cells. Refuses polygons that contain no cell with an elevation."""
    name, path = (None, copy) if copy else (layer.name, layer.path)
    try:
        numbers = burn_polygons(path, grid, field, [], layer=name)[~np.isnan(z)]
    except RockfallError as error:  # the message gives the layer, not its copy
        raise RockfallError(str(error).replace(str(path), str(layer))) from error
    zones, cells = np.unique(numbers[numbers != NO_ID], return_counts=True)
    outside = int(np.count_nonzero(numbers == NO_ID))
    if not zones.size:
        raise RockfallError(f"{layer}: no polygon contains a cell with an elevation")
    return (int(zones[cells.argmax()]), outside) if outside else (None, 0)
