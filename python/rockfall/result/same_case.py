# SPDX-License-Identifier: BSD-3-Clause
"""Checks of metadata (case, input checksums, CRS, extent): compared results must have the same
case, or be variants at the same site.
"""

import json
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import xarray as xr
from rasterio.crs import CRS

from rockfall.case import REPEATABLE, Case, case_in, file_keys
from rockfall.errors import RockfallError
from rockfall.io.coordinates.crs import same_crs
from rockfall.io.rasters.arrays import corner_of
from rockfall.result.samples import has_rows

#: Groups that must be equal; seeds, numbers and volumes of boulders, lines and outputs may differ.
GROUPS = (
    "terrain", "surface", "impact", "release", "breakage", "flight", "forest", "barrier", "dam",
)  # fmt: skip
DECODED = {"dem": "terrain", "surface": "ground", "trees": "trees"}  # checksums of decoded inputs
FILES = {  # checksums of files
    "sets": "impact sets", "cells": "sources", "polygons": "sources", "points": "sources",
}  # fmt: skip


def check_same_case(first: xr.Dataset, other: xr.Dataset, what: str) -> None:
    """Refuse a result (called `what`) whose case differs from the first case: CRS, terrain,
    ground, forest, sources, impact sets, or keys."""
    _check_crs(first, other, what)
    for attribute, names in (("decoded_checksums", DECODED), ("input_checksums", FILES)):
        ours, theirs = (json.loads(data.attrs[attribute]) for data in (first, other))
        for key, name in names.items():
            if ours.get(key) != theirs.get(key):
                raise RockfallError(f"{what}: belongs to another case: different {name}")
    for place in _differences(case_in(first.attrs), case_in(other.attrs)):
        raise RockfallError(f"{what}: belongs to another case: different {place}")


def check_same_site(results: Mapping[str, xr.Dataset]) -> None:
    """Refuse results (by file name) if two in succession differ in CRS, or do not overlap."""
    for (name, data), (next_name, other) in pairwise(results.items()):
        _check_crs(data, other, next_name)
        if not _overlap(_extent(data), _extent(other)):
            raise RockfallError(f"{next_name}: does not overlap {name}")


def _check_crs(first: xr.Dataset, other: xr.Dataset, what: str) -> None:
    ours, theirs = (data["crs"].attrs.get("crs_wkt", "") for data in (first, other))
    if ours == theirs:
        return
    if not (ours and theirs and same_crs(_crs(ours), _crs(theirs))):
        names = (_crs_name(data) for data in (other, first))
        raise RockfallError(
            f"{what}: has a different coordinate system: {' instead of '.join(names)}"
        )


def _crs(wkt: str) -> CRS:
    from rasterio.crs import CRS

    return CRS.from_wkt(wkt)


def _crs_name(data: xr.Dataset) -> str:
    keys = ("projected_crs_name", "geographic_crs_name")
    attrs = data["crs"].attrs
    return str(next((attrs[key] for key in keys if key in attrs), attrs.get("crs_wkt", "none")))


def _extent(result: xr.Dataset) -> np.ndarray:
    """Extent [m] of the maps, else of the boulders, (2, 2): minimum x and y, maximum x and y;
    unlimited without maps and rows."""
    if "x" in result.sizes:
        half = corner_of(result["crs"].attrs)[2] / 2
        ends = [
            (result[axis].values.min() - half, result[axis].values.max() + half) for axis in "xy"
        ]
        return np.array(ends).T
    if not has_rows(result):
        return np.array([[-np.inf] * 2, [np.inf] * 2])
    extremes = [[result[f"{end}_{axis}"].values for end in ("start", "stop")] for axis in "xy"]
    return np.array([[np.nanmin(values), np.nanmax(values)] for values in extremes]).T


def _overlap(ours: np.ndarray, other: np.ndarray) -> bool:
    return bool((ours[0] <= other[1]).all() and (other[0] <= ours[1]).all())


def _differences(first: Case, other: Case) -> Iterator[str]:
    """Keys whose values differ between two cases, except file names."""
    files = {(key.group, key.name) for key in file_keys()}
    for group in GROUPS:
        ours, theirs = (_values(case, group) for case in (first, other))
        if len(ours) != len(theirs):
            yield f"the number of &{group} groups"
        for own, another in zip(ours, theirs, strict=False):
            for key in sorted({*own, *another}):
                if (group, key) not in files and own.get(key) != another.get(key):
                    yield f"&{group} {key}"


def _values(case: Case, group: str) -> list[dict[str, Any]]:
    values = getattr(case, group)
    return values if group in REPEATABLE else [values]
