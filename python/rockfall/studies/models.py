# SPDX-License-Identifier: BSD-3-Clause
"""Runs of a case with each rebound model, with equal boulders, release points and random
numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.line_statistics import limited, line_numbers, sample_numbers
from rockfall.analysis.precision.intervals import sources
from rockfall.analysis.precision.paired import (
    NONE,
    Difference,
    changed_sides,
    difference_of_means,
    mean_difference,
)
from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.io.netcdf import load_exact
from rockfall.language import packed_texts, say, unpacked_texts
from rockfall.quantities import AT_LINES, percent
from rockfall.result.contents import Contents
from rockfall.result.crossings import has_crossed, line_names, line_values
from rockfall.result.dataset import put_netcdf
from rockfall.result.trajectories import left_terrain
from rockfall.studies.model_scenes import by_tables, named_notes, variants
from rockfall.studies.study import ROWS_ONLY, Study

LAYOUT = 1  # version of the file layout
RUN_OUT = "stopping_distance"
COLUMNS = ["model", "line", "quantity", "statistic", "n", "value", "low", "high",
           "difference", "difference_low", "difference_high"]  # fmt: skip
TEXTS = COLUMNS[:4]  # text columns; the others are numeric


@dataclass(frozen=True)
class Models:
    """Results of a case by each model, in SI units.

    `low` and `high` are 95 % limits. `difference` is the difference from the first model, computed
    boulder by boulder, so its interval excludes common random variation.
    """

    title: str
    boulders: int
    names: tuple[str, ...]  # model names
    table: pd.DataFrame  # by model, line, quantity and statistic; `line` is "" for run-outs
    notes: tuple[str, ...]
    case: xr.Dataset  # first result without boulders, for attributes and CRS
    warnings: tuple[str, ...] = ()  # model warnings of all runs, each once


def run_models(
    case: Case, grounds: Sequence[str] = (), progress: bool = False, tables: Sequence[str] = ()
) -> Models:
    """Run a case with its impact sets by methods A and B, if the sizes are known; with each
    classical model, or the given `grounds` (rows of the ground table, impact sets); and with the
    impact `tables`.

    Ground that the case assigns to zones or cells by name is the same for all models. Models differ
    where the case's impact sets or table, or `&surface ground`, apply. There classical models use
    the shipped grounds in `ROCKS`, selected by rock size. Without rock sizes, both grounds are run;
    models that need a size are omitted, or raise a RockfallError if they are among `grounds`. If
    every place has a named ground, all grounds except absorbing ones vary.
    """
    case = case.replace(output=ROWS_ONLY)
    notes: list[str] = []
    scenes = dict(variants(case, grounds, notes))
    if tables:
        scenes |= by_tables(case, next(iter(scenes.values())), tables, notes)
    first: xr.Dataset | None = None

    def numbers(name: str, result: xr.Dataset) -> list[dict[str, Any]]:
        nonlocal first
        first = result if first is None else first
        if (gone := left_terrain(result).mean()) > 0:
            notes.append(say("models.left", name=name, fraction=percent(gone)))
        return [{"model": name, **row} for row in _rows(result, first)]

    total = sum(scene.boulders for scene in scenes.values())
    with Study(total, progress=progress) as study:
        rows = [row for _, own in study.run(scenes.items(), numbers) for row in own]
    own = next(iter(scenes.values()))
    notes += named_notes(own)
    assert first is not None
    maps = first.drop_vars([name for name in first.variables if name != "crs"])
    return Models(
        case.case["title"] or case.name, own.boulders, tuple(scenes),
        pd.DataFrame(rows, columns=COLUMNS), tuple(notes), maps, study.warnings,
    )  # fmt: skip


def write_models(models: Models, path: str | Path) -> None:
    """Write models as netCDF with their case, for use in a report."""
    columns: dict[str, tuple] = {
        name: ("row", models.table[name].to_numpy(object if name in TEXTS else float), {})
        for name in COLUMNS
    }
    crs = {"crs": ((), np.int32(0), models.case["crs"].attrs)}
    own: dict[str, Any] = {"models_layout": LAYOUT, "model_boulders": models.boulders}
    own["models"] = "\n".join(models.names)
    own["notes"], own["note_messages"] = packed_texts(models.notes)
    put_netcdf(Contents(columns | crs, models.case.attrs | own), path, path)


def read_models(path: str | Path) -> Models:
    """Read models from a file written by `write_models`. Raises a RockfallError for other files."""
    dataset = load_exact(path, "models")
    if "models_layout" not in dataset.attrs:
        raise RockfallError(f"{path}: is not a models.nc of `rockfall models`")
    table = dataset[COLUMNS].to_dataframe().reset_index(drop=True)[COLUMNS]
    names = tuple(str(dataset.attrs["models"]).split("\n"))
    notes = tuple(unpacked_texts(dataset.attrs["notes"], dataset.attrs["note_messages"]))
    boulders = int(dataset.attrs["model_boulders"])
    title = str(dataset.attrs["title"]) or str(dataset.attrs["case_file"])
    return Models(title, boulders, names, table, notes, dataset[["crs"]])


def _rows(result: xr.Dataset, first: xr.Dataset) -> Iterator[dict[str, Any]]:
    """Statistics of a result, with differences from the first result."""
    source = sources(result)
    for k, line in enumerate(line_names(result)):
        crossed, before = (has_crossed(run, k) for run in (result, first))
        apart = NONE if result is first else changed_sides(crossed, before, source)
        speeds = line_numbers(result, k, "speed", source)
        yield _row(line, "boulders", "fraction", speeds, apart)
        for quantity in AT_LINES:
            numbers = line_numbers(result, k, quantity, source)
            value, other = (line_values(run, quantity, k) for run in (result, first))
            apart = difference_of_means(value, other, source)
            yield _row(line, quantity, "mean", numbers, apart)
            yield _row(line, quantity, "q95", numbers)
    distance, other = (run["plan_distance"].values for run in (result, first))
    numbers = {"n": distance.size, **sample_numbers(distance, source)}
    yield _row("", RUN_OUT, "mean", numbers, mean_difference(distance - other, source))
    yield _row("", RUN_OUT, "q95", numbers)


def _row(
    line: str,
    quantity: str,
    statistic: str,
    numbers: Mapping[str, float],
    apart: Difference | tuple[()] = (),
) -> dict[str, Any]:
    values = [line, quantity, statistic, numbers["n"], *limited(numbers, statistic), *apart]
    # quantiles have no difference
    return dict(zip(COLUMNS[1:], values, strict=False))
