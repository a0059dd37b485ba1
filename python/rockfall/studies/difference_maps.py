# SPDX-License-Identifier: BSD-3-Clause
"""Maps of differences between variants of a case, and files of a comparison."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.case import case_of
from rockfall.errors import RockfallError
from rockfall.files.export import write_map
from rockfall.io.atomic import atomic_folder
from rockfall.io.rasters.arrays import grid_of
from rockfall.io.tables import write_csv
from rockfall.kernel_rules import count_limits
from rockfall.result.maps.clusters import boulders_per_cluster
from rockfall.result.samples import simulated
from rockfall.studies.variants import check_variants

OF_A_CELL = 1e-6  # tolerance of positions, in cells
MAPS = re.compile(r"(energy|speed|jump_height|passing_height)_(mean|max|max_map|q\d+)")


def difference_maps(results: Mapping[str, xr.Dataset]) -> dict[str, xr.DataArray]:
    """Maps of the differences between each variant and the first, by name: the fraction of boulders
    that pass a cell, a verdict (-1 less, 1 more, 0 undecided), and the common maps of energy, speed
    and height where boulders pass in both variants. Raises a RockfallError for variants with
    different sites, boulders or cells, or without passage maps.

    Results do not record which boulders pass a cell, so the fractions are treated as independent.
    With common random numbers the intervals are then too wide: a cell may be undecided where a line
    shows a difference, but not the reverse.
    """
    check_variants(results)
    if not have_passages(results):
        raise RockfallError("difference maps require &output maps = 'passages' in all variants")
    (_, first), *others = results.items()
    maps: dict[str, xr.DataArray] = {}
    for name, other in others:
        _check_grid(first, other, name)
        keys = [
            key
            for key, of_first in first.data_vars.items()
            if of_first.dims == ("y", "x") and MAPS.fullmatch(str(key)) and key in other
        ]
        pair = xr.align(first[["passages", *keys]], other[["passages", *keys]], join="outer")
        (p, p_low, p_high), (q, q_low, q_high) = (
            _fractions(passages["passages"].fillna(0).values, result)
            for passages, result in zip(pair, (first, other), strict=True)
        )
        low = q - p - np.hypot(q - q_low, p_high - p)
        high = q - p + np.hypot(q_high - q, p - p_low)
        verdict = np.where(high < 0, -1, np.where(low > 0, 1, 0))
        of_variant = {
            "passing": (
                (q - p).astype("f4"),
                {
                    "units": "1",
                    "long_name": f"fraction of boulders that pass: {name} minus the first variant",
                },
            ),
            "verdict": (
                verdict.astype("i1"),
                {"units": "1", "long_name": f"{name}: -1 fewer boulders pass, 1 more, 0 undecided"},
            ),
        } | {key: ((pair[1][key] - pair[0][key]).values, dict(first[key].attrs)) for key in keys}
        for key, (values, attrs) in of_variant.items():
            like = pair[0]["passages"].assign_coords(crs=first["crs"]).drop_encoding()
            maps[f"{name}_{key}"] = like.copy(data=values)
            maps[f"{name}_{key}"].attrs = attrs | {"grid_mapping": "crs"}
    return maps


def have_passages(results: Mapping[str, xr.Dataset]) -> bool:
    """Return True if all variants have the map that difference maps require."""
    return all("passages" in result for result in results.values())


def on_same_cells(results: Mapping[str, xr.Dataset]) -> dict[str, xr.Dataset]:
    """First variant, and the variants whose maps have the same cells."""
    first = next(iter(results.values()))
    return {name: result for name, result in results.items() if _same_cells(first, result)}


def _same_cells(first: xr.Dataset, other: xr.Dataset) -> bool:
    """Return True if the maps of two results have the same cells; their extents may differ."""
    ours, theirs = (grid_of(data["passages"])[0] for data in (first, other))
    steps = np.array([theirs.west - ours.west, theirs.north - ours.north]) / ours.cell
    return theirs.cell == ours.cell and float(np.abs(steps - np.round(steps)).max()) <= OF_A_CELL


def _check_grid(first: xr.Dataset, other: xr.Dataset, name: str) -> None:
    """Raise a RockfallError if the maps have different cells."""
    if not _same_cells(first, other):
        ours, theirs = (grid_of(data["passages"])[0] for data in (first, other))
        raise RockfallError(
            f"{name}: difference maps require the cells of the first variant ({ours.cell:g} m), "
            f"not {theirs.cell:g} m: compare without maps"
        )


def _fractions(counts: np.ndarray, result: xr.Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fractions (y, x) of boulders that pass cells, with 95 % limits."""
    boulders = simulated(result)
    starts = (result[f"start_{axis}"].values for axis in "xy")
    per_cluster = boulders_per_cluster(case_of(result), *starts)
    low, high = count_limits(counts.astype("i4"), boulders, per_cluster)
    return counts / boulders, low, high


def write_variants(
    table: pd.DataFrame,
    maps: Mapping[str, xr.DataArray],
    folder: str | Path,
    inputs: Iterable[str | Path] = (),
) -> list[Path]:
    """Write the table as differences.csv, and the maps as GeoTIFF, to a folder: all files or, with
    a RockfallError, none. Return their paths. `inputs` are files that must not be overwritten."""
    folder = Path(folder)
    with atomic_folder(folder, inputs) as part:
        write_csv(table, part / "differences.csv")
        made = [write_map(part / f"{name}.tif", data) for name, data in maps.items()]
    return [folder / "differences.csv", *(folder / path.name for path in made)]
