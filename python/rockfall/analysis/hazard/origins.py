# SPDX-License-Identifier: BSD-3-Clause
"""Origins of boulders that reach a line or object: annual number and energy from each cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.analysis.hazard.classes import frequencies
from rockfall.analysis.hazard.levels import find_place
from rockfall.analysis.precision.weighted import quantile_interval
from rockfall.case import case_in
from rockfall.errors import RockfallError
from rockfall.result.variables import ENDS

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from rockfall.io.rasters.grid import Grid

SOURCES = ("line", "object")  # kinds of places for which sources are known
LEVEL = 0.95
#: Variables with the energies [J] of arriving boulders.
ENERGIES = ("energy_mean", *(f"energy_q95{end}" for end in ENDS))


class Arrivals(NamedTuple):
    """Boulders that reach a place."""

    start: np.ndarray  # start cell of each boulder; in the argument of `of`, the boulder's index
    energy: np.ndarray  # kinetic energy [J]


class Origins(NamedTuple):
    """Start cells of a run's boulders, and the boulders that reach each place, by kind of place;
    None where only counts are known."""

    cells: np.ndarray  # grid indices, ascending
    boulders: np.ndarray  # number of boulders from each cell
    at: Mapping[str, Sequence[Arrivals | None]]

    @classmethod
    def of(
        cls, result: xr.Dataset, grid: Grid, at: Mapping[str, Sequence[Arrivals | None]]
    ) -> Origins:
        """Origins of a result's boulders; `at` has the boulders that reach each place, by index."""
        rows, columns = grid.cells(*(result[f"start_{axis}"].values for axis in "xy"))
        cells = rows * grid.nx + columns
        places = {
            kind: [each and Arrivals(cells[each.start], each.energy) for each in arrivals]
            for kind, arrivals in at.items()
        }
        return cls(*np.unique(cells, return_counts=True), places)


def origin_numbers(
    runs: Sequence[Origins], weights: Sequence[float], unit: float, grid: Grid
) -> dict[str, np.ndarray]:
    """Origin variables of a hazard: cell centres, annual number of boulders that start in each
    cell, and for each place the annual number and energies [J] of the boulders that arrive from
    each cell. `weights` are the frequencies [1/year] that a boulder of each run represents;
    `unit` [1/year] is the weight of an independent boulder in the limits of the energies."""
    cells = np.unique(np.concatenate([run.cells for run in runs]))
    rows, columns = np.divmod(cells, grid.nx)
    numbers = {"source_x": grid.x[columns], "source_y": grid.y[rows]}
    numbers["source_boulders"] = boulders = np.zeros((len(runs), cells.size), "i4")
    numbers["source_frequency"] = np.zeros(cells.size)
    for released, run, weight in zip(boulders, runs, weights, strict=True):
        released[np.searchsorted(cells, run.cells)] = run.boulders
        numbers["source_frequency"] += weight * released
    for kind, places in runs[0].at.items():
        each = [
            _arriving([run.at[kind][k] for run in runs], weights, unit, cells)
            for k in range(len(places))
        ]  # fmt: skip
        if each:
            numbers |= {f"{kind}_source_{name}": np.stack([at[name] for at in each], axis=-2)
                        for name in each[0]}  # fmt: skip
    return numbers


def _arriving(
    runs: Sequence[Arrivals | None], weights: Sequence[float], unit: float, cells: np.ndarray
) -> dict[str, np.ndarray]:
    """Boulders that reach a place from each cell: number in each run, annual frequency, mean
    energy, and 95 % quantile of energy with its interval. Energies are NaN for cells without
    arrivals. If only counts are known, numbers are 0 and all other values NaN."""
    arrivals = [run for run in runs if run is not None]
    boulders = np.zeros((len(runs), cells.size), "i4")
    if len(arrivals) < len(runs):
        unknown = dict.fromkeys(("frequency", *ENERGIES), np.full(cells.size, np.nan))
        return {"boulders": boulders} | unknown
    index = [np.searchsorted(cells, run.start) for run in arrivals]
    frequency = np.zeros(cells.size)
    for came, of_run, weight in zip(boulders, index, weights, strict=True):
        came[:] = np.bincount(of_run, minlength=cells.size)
        frequency += weight * came
    energy = np.concatenate([run.energy for run in arrivals])
    weight = np.repeat(weights, [run.energy.size for run in arrivals])
    cell = np.concatenate(index)
    order = np.argsort(cell, kind="stable")
    reached, first = np.unique(cell[order], return_index=True)
    energies = np.full((len(ENERGIES), cells.size), np.nan)
    for k, part in zip(reached, np.split(order, first)[1:], strict=True):
        mean = weight[part] @ energy[part] / weight[part].sum()
        energies[:, k] = mean, *quantile_interval(energy[part], weight[part], LEVEL, unit)
    return {"boulders": boulders, "frequency": frequency} | dict(
        zip(ENERGIES, energies, strict=True)
    )


def with_origins(hazard: xr.Dataset, place: str, among: Sequence[str] = SOURCES) -> tuple[str, int]:
    """Kind (one of `among`) and index of a place; raises a RockfallError if its sources are
    unknown."""
    kind, k = find_place(hazard, place, among)
    if np.isnan(hazard[f"{kind}_source_frequency"].values[k]).any():
        raise RockfallError(
            f"{place}: is a point without a width, whose sources are unknown: give it a width"
        )
    return kind, k


def origins_at(hazard: xr.Dataset, kind: str, k: int) -> pd.DataFrame:
    """Table of `rockfall.origins` at the line or object (`kind`) with index k."""
    import pandas as pd

    rates = hazard[f"{kind}_source_frequency"].values[k]
    order = np.argsort(-rates, kind="stable")[: np.count_nonzero(rates > 0)]
    columns = {axis: hazard[f"source_{axis}"].values[order] for axis in "xy"}
    columns["frequency"] = rates[order]
    limits = _limits(hazard, kind, k, np.arange(rates.size))
    columns |= {name: values[order] for name, values in limits.items()}
    columns["share"] = rates[order] / rates.sum() if order.size else rates[order]
    columns["reach"] = rates[order] / hazard["source_frequency"].values[order]
    for name in ENERGIES:
        columns[name] = hazard[f"{kind}_source_{name}"].values[k][order]
    return pd.DataFrame(columns)


def _limits(hazard: xr.Dataset, kind: str, k: int, part: np.ndarray) -> dict[str, np.ndarray]:
    """Limits of the annual number of boulders that reach a place from each part of the source
    cells; `part` has the number of each cell's part. With fixed sources, the sample is the boulders
    of the part, because their number is known; with sampled sources, it is all boulders."""
    case = case_in(hazard.attrs)
    is_sample, factor = case.release["sources"] == "sample", case.hazard["frequency_factor"]
    released, came = (hazard[f"{name}source_boulders"].values for name in ("", f"{kind}_"))
    runs = []
    for s, (n, per_cluster) in enumerate(
        zip(hazard["boulders"].values, hazard["boulders_per_cluster"].values, strict=True)
    ):
        of_part = np.bincount(part, released[s]).clip(1)
        boulders = np.full(of_part.size, n) if is_sample else of_part
        yearly = hazard["frequency"].values[s] / n * boulders
        runs.append((np.bincount(part, came[s, k]), boulders, per_cluster, yearly))
    rates = frequencies(runs, factor)
    return {"frequency_low": rates.low, "frequency_high": rates.high}


def origin_areas(hazard: xr.Dataset, kind: str, k: int, side: float) -> pd.DataFrame:
    """Table of `origins_at`, summed over squares of `side` [m]: centre and number (`cells`) of the
    source cells, frequency of the square with its limits, and the highest of the cells'
    `energy_q95` and `energy_q95_high`; the latter is NaN if too few boulders arrive from a cell.
    Squares without arrivals are omitted."""
    import pandas as pd

    x, y, released = (hazard[f"source_{name}"].values for name in ("x", "y", "frequency"))
    rates = hazard[f"{kind}_source_frequency"].values[k]
    squares = np.floor(np.column_stack([x, y]) / side)
    part = np.unique(squares, axis=0, return_inverse=True)[1].ravel()
    cells, frequency = np.bincount(part), np.bincount(part, rates)
    energies = {name: hazard[f"{kind}_source_{name}"].values[k] for name in ENERGIES}
    mean, highest = energies["energy_mean"], np.full((2, cells.size), -np.inf)
    with np.errstate(invalid="ignore"):
        for row, name in zip(highest, ("energy_q95", "energy_q95_high"), strict=True):
            np.maximum.at(row, part[rates > 0], energies[name][rates > 0])
        columns = {
            "x": np.bincount(part, x) / cells, "y": np.bincount(part, y) / cells, "cells": cells,
            "frequency": frequency, **_limits(hazard, kind, k, part),
            "share": frequency / rates.sum(), "reach": frequency / np.bincount(part, released),
            "energy_mean": np.bincount(part, np.nan_to_num(mean) * rates) / frequency,
            "energy_q95": highest[0], "energy_q95_high": highest[1],
        }  # fmt: skip
    table = pd.DataFrame(columns)[frequency > 0]
    return table.sort_values("frequency", ascending=False, kind="stable", ignore_index=True)
