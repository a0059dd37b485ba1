# SPDX-License-Identifier: BSD-3-Clause
"""Spread over rebound models on the page, from the result of `rockfall models` for the same
case."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from rockfall.case import case_in
from rockfall.errors import RockfallError
from rockfall.html_report.intervals import estimate, in_lines, in_unit
from rockfall.html_report.summary import HEADLINE
from rockfall.html_report.tables import Table
from rockfall.language import say, word
from rockfall.result.grounds import classical_grounds
from rockfall.result.same_case import check_same_case
from rockfall.studies.models import RUN_OUT, Models

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


def check_models(result: xr.Dataset, models: Models, what: str) -> None:
    """Refuse models of another case, or of other lines."""
    check_same_case(result, models.case, what)
    ours, theirs = (
        {line["name"]: (line["x"], line["y"]) for line in case_in(values.attrs).lines}
        for values in (result, models.case)
    )
    if other := [name for name, place in ours.items() if theirs.get(name) != place]:
        raise RockfallError(
            f"{what}: has no line '{other[0]}', or elsewhere: run `rockfall models` again"
        )


def missing_spread(result: xr.Dataset, models: Models | None) -> list[str]:
    """Note that the spread belongs on the page and is missing."""
    if models is not None or not classical_grounds(result):
        return []
    return [say("spread.missing", case_file=result.attrs["case_file"])]


def spread_table(models: Models | None) -> list[Table]:
    """Minimum and maximum over all models for each line, in the columns of the headline."""
    if models is None or not (lines := _lines(models)):
        return []
    rows = [
        (line, *(_ends(_at(models, line, number), number[0]) for number in _columns()))
        for line in lines
    ]
    number = len(models.names)
    caption = say("spread.caption", number=number, boulders=models.boulders)
    return [Table(caption, (say("label.line_or_barrier"), *map(say, HEADLINE)), rows)]


def spread_words(models: Models | None) -> Iterator[str]:
    """Run-out by all models, and their names."""
    if models is None:
        return
    far = _at(models, "", (RUN_OUT, "q95"))["value"].to_numpy(float)
    low, high = (in_unit(end, RUN_OUT) for end in (far.min(), far.max()))
    yield say("spread.run_out", low=low, high=high)
    yield from (f"{note}." for note in models.notes)


def model_tables(models: Models | None) -> Iterator[Table]:
    """Tables for each line with a row for each model, with 95 % confidence intervals."""
    for line in [] if models is None else _lines(models):
        assert models is not None
        columns = {number: _at(models, line, number).set_index("model") for number in _columns()}
        rows = []
        for name in models.names:
            cells = (in_lines(*_cell(number, table.loc[name])) for number, table in columns.items())
            rows.append((word(name), *cells))
        yield Table(say("spread.by_each_rebound_model", line=line), ("", *map(say, HEADLINE)), rows)


def _columns() -> list[tuple[str, str]]:
    """Quantity and statistic of the columns of the headline, as named in models."""
    return [
        ("boulders" if quantity == "fraction" else quantity, name)
        for quantity, name in HEADLINE.values()
    ]


def _lines(models: Models) -> list[str]:
    return [line for line in dict.fromkeys(models.table["line"]) if line]


def _at(models: Models, line: str, number: tuple[str, str]) -> pd.DataFrame:
    table = models.table
    here = (
        (table["line"] == line)
        & (table["quantity"] == number[0])
        & (table["statistic"] == number[1])
    )
    return table[here]


def _cell(number: tuple[str, str], row: pd.Series) -> tuple[str, str]:
    quantity, name = ("fraction", "fraction") if number[0] == "boulders" else number
    return estimate(
        {f"{name}{end}": row[f"{end[1:] or 'value'}"] for end in ("", "_low", "_high")},
        name,
        quantity,
    )


def _ends(rows: pd.DataFrame, quantity: str) -> str:
    values = rows["value"].to_numpy(float)
    if np.isnan(values).all():
        return "-"
    text = "fraction" if quantity == "boulders" else quantity
    low, high = (in_unit(end(values), text) for end in (np.nanmin, np.nanmax))
    return low if low == high else say("interval.range", low=low, high=high)
