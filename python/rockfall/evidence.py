# SPDX-License-Identifier: BSD-3-Clause
"""Evidence on the validity of the models: `data/field_evidence.csv`, the single table of observed
and simulated numbers. Messages read it here, pages through `tools/document.py`."""

import importlib.resources
from collections.abc import Iterable
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path

import numpy as np

from rockfall.io.tables import read_table

TABLE = Path(str(importlib.resources.files("rockfall") / "data" / "field_evidence.csv"))


@dataclass(frozen=True)
class Evidence:
    """An observed quantity at a site, and the error of a model.

    `place` is a line, one half of the data, or a slope. `observed` is in `unit`; `error` and its
    standard error are in % of `observed`. If `observed` is NaN (distances between distributions,
    results on a synthetic slope), `error` is the simulated value. `command` produced it with
    program `version` (and commit).
    """

    site: str
    place: str
    quantity: str
    model: str
    unit: str
    observed: float
    error: float
    standard_error: float
    command: str
    version: str
    date: str

    @property
    def key(self) -> tuple[str, str, str, str]:
        """Columns that identify a row."""
        return self.site, self.place, self.quantity, self.model

    @property
    def simulated(self) -> float:
        """Simulated value, in `unit`."""
        return self.error if np.isnan(self.observed) else self.observed * (1 + self.error / 100)

    @property
    def simulated_error(self) -> float:
        """Standard error of `simulated`, in `unit`."""
        scale = 1.0 if np.isnan(self.observed) else abs(self.observed) / 100
        return self.standard_error * scale


def evidence(
    site: str = "*", place: str = "*", quantity: str = "*", model: str = "*"
) -> list[Evidence]:
    """Rows of the table whose columns match `fnmatch` patterns, in table order."""
    patterns = site, place, quantity, model
    return [row for row in table() if all(map(fnmatchcase, row.key, patterns))]


def only(site: str, place: str, quantity: str, model: str) -> Evidence:
    """Return the row with these columns; raise LookupError if none or several match."""
    rows = evidence(site, place, quantity, model)
    if len(rows) != 1:
        raise LookupError(f"{len(rows)} rows of {site}, {place}, {quantity}, {model}")
    return rows[0]


def largest_error(rows: Iterable[Evidence]) -> int:
    """Largest absolute error [%] of rows that must all have observations, rounded."""
    return round(max(abs(row.error) for row in rows))


def error_range(rows: Iterable[Evidence]) -> tuple[int, int]:
    """Lowest and highest error [%] of rows that must all have observations, rounded."""
    errors = [round(row.error) for row in rows]
    return min(errors), max(errors)


@cache
def table() -> tuple[Evidence, ...]:
    """All rows of the table, read once."""
    _, _, rows = read_table(TABLE)
    return tuple(
        Evidence(
            site=row.text("site"),
            place=row.text("place"),
            quantity=row.text("quantity"),
            model=row.text("model"),
            unit=row.cells["unit"],
            observed=row.maybe("observed"),
            error=row.number("error"),
            standard_error=row.maybe("standard_error"),
            command=row.text("command"),
            version=row.text("version"),
            date=row.text("date"),
        )
        for row in rows
    )
