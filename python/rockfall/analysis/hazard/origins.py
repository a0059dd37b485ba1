# SPDX-License-Identifier: BSD-3-Clause
"""Origins of the boulders that reach a line or object: annual number from each cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.analysis.hazard.levels import find_place

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from rockfall.io.rasters.grid import Grid

SOURCES = ("line", "object")  # kinds of places with sources


class Starts(NamedTuple):
    """Cells where boulders start, by ascending grid number, and their numbers of boulders."""

    cells: np.ndarray
    boulders: np.ndarray

    def among(self, cells: np.ndarray) -> np.ndarray:
        """Number of boulders from each of these ascending cells, which include all of `self`."""
        numbers = np.zeros(cells.size, "i8")
        numbers[np.searchsorted(cells, self.cells)] = self.boulders
        return numbers


class Origins(NamedTuple):
    """Start cells of all boulders and of boulders that reach each place, by its kind."""

    released: Starts
    at: Mapping[str, Sequence[Starts]]

    @classmethod
    def of(cls, result: xr.Dataset, grid: Grid, at: Mapping[str, Sequence[np.ndarray]]) -> Origins:
        """Origins of the boulders of a result; `at`: those that reach each place, by index."""
        rows, columns = grid.cells(*(result[f"start_{axis}"].values for axis in "xy"))
        cells = rows * grid.nx + columns
        places = {kind: [_starts(cells[here]) for here in each] for kind, each in at.items()}
        return cls(_starts(cells), places)


def _starts(cells: np.ndarray) -> Starts:
    return Starts(*np.unique(cells, return_counts=True))


def origin_numbers(
    runs: Sequence[Origins], weights: Sequence[float], grid: Grid
) -> dict[str, np.ndarray]:
    """Variables of a hazard for its origins, from the runs and the frequency [1/year] that a
    boulder of each represents: cell centres, boulders a year that start in each cell, and boulders
    a year from there that reach each place.
    """
    cells = np.unique(np.concatenate([run.released.cells for run in runs]))
    rows, columns = np.divmod(cells, grid.nx)
    numbers = {"source_x": grid.x[columns], "source_y": grid.y[rows]}
    each = list(zip(runs, weights, strict=True))
    numbers["source_frequency"] = sum(
        (weight * run.released.among(cells) for run, weight in each), np.zeros(cells.size)
    )
    for kind, places in runs[0].at.items():
        if places:
            rates = np.zeros((len(places), cells.size))
            for run, weight in each:
                for row, starts in zip(rates, run.at[kind], strict=True):
                    row += weight * starts.among(cells)
            numbers[f"{kind}_source_frequency"] = rates
    return numbers


def origins(hazard: xr.Dataset, place: str) -> pd.DataFrame:
    """Origins of the boulders that reach a line or object of a hazard, most frequent first: cell
    centre `x`, `y` [m], `frequency` [1/year] of its boulders that arrive, their `share` of all
    arriving boulders, and the fraction `reach` of the cell's boulders that arrive. A RockfallError
    lists the names if there is no such place.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> case = case.replace(scenario=[{"name": "small", "return_period": 10.0}])
    >>> found = rockfall.origins(rockfall.hazard(case), "L")
    >>> float(found["share"].sum().round(9))
    1.0
    """
    import pandas as pd

    kind, k = find_place(hazard, place, SOURCES)
    rates = hazard[f"{kind}_source_frequency"].values[k]
    order = np.argsort(-rates, kind="stable")[: np.count_nonzero(rates)]
    columns = {axis: hazard[f"source_{axis}"].values[order] for axis in "xy"}
    columns["frequency"] = rates[order]
    columns["share"] = rates[order] / rates.sum() if order.size else rates[order]
    columns["reach"] = rates[order] / hazard["source_frequency"].values[order]
    return pd.DataFrame(columns)
