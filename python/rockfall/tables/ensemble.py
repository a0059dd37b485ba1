# SPDX-License-Identifier: BSD-3-Clause
"""Ensemble as tables and text: input uncertainty in addition to the Monte Carlo error."""

from collections.abc import Iterator

import numpy as np
import xarray as xr

from rockfall.kernel_rules import Z
from rockfall.language import Text, say, translated
from rockfall.quantities import QUANTITIES, number
from rockfall.result.crossings import line_index, line_names
from rockfall.result.samples import is_ensemble
from rockfall.studies.ensemble.sobol_indices import limits, runs_needed
from rockfall.studies.ensemble.study import RESULTS
from rockfall.table import Column, Estimate, Table, as_text, between, stacked
from rockfall.tables.lines import HEADLINE, Numbers, Rows, estimate, in_unit, rows_of
from rockfall.text.summary import remark_lines

INDICES = ("first_order", "total")
PER_LINE = 1 + len(INDICES)  # number of tables for each line
UNDECIDED = "word.undecided"
LEAST_EXCESS = 0.005  # minimum difference of two indices that shows in whole per cent


def ensemble_summary(data: xr.Dataset) -> str:
    """Text with tables for each line, and the stored remarks on the model of the unchanged case."""
    blocks, variants = data.sizes["run"], data.sizes["variant"]
    parts = [
        f"{data.attrs['title'] or 'rockfall'}: {blocks} draws of {variants} runs, "
        f"{data.sizes['boulder']:,} boulders each"
    ]
    tables = range_tables(data, rows_of(data), detailed=True)
    parts += [f"  {table.caption}\n{as_text(table, '    ')}" for table in tables]
    if "drawn_source_redrawn" in data and data["drawn_source_redrawn"].any():
        redrawn = int(data["drawn_source_redrawn"].sum())
        parts.append(f"  shifts drawn again because a source left the terrain: {redrawn:,}")
    parts += [f"  {line}" for line in (*cases_outside(data), *orders_reversed(data))]
    if are_undecided(tables):
        parts.append(f"  {more_needed(data)}")
    if remarks := [*remark_lines(data)]:
        parts += ["  model remarks for the unchanged case:", *remarks]
    return "\n".join(parts)


def range_headline(result: xr.Dataset) -> Table:
    """Table of the ranges over the draws at each line, with the unchanged case in brackets."""
    rows = []
    for line in line_names(result):
        cells = (
            stacked("-" if "-" in (low, high) else say("interval.range", low=low, high=high),
                    f"({translated(case)})")
            for low, high, case in headline_numbers(result, line)
        )  # fmt: skip
        rows.append((line, *cells))
    heads = say("label.line_or_barrier"), *map(say, HEADLINE)
    return Table.of(say("ensemble.headline_caption"), heads, rows)


def headline_numbers(result: xr.Dataset, line: str) -> Iterator[list[str]]:
    """Range over the draws, and value of the unchanged case, for each column of the headline; "-"
    if too few boulders pass in any draw."""
    for quantity, number_name in HEADLINE.values():
        name = "fraction" if quantity == "fraction" else f"{quantity}.{number_name}"
        of_number = result.isel(line=line_index(result, line)).sel(result=name)
        yield [in_unit(of_number[key].item(), quantity) for key in ("q05", "q95", "case_value")]


def range_tables(result: xr.Dataset, rows: Rows, *, detailed: bool = False) -> list[Table]:
    """Tables of an ensemble for each line: both uncertainties of its numbers, and the inputs that
    cause the epistemic part. Empty for other results."""
    if not is_ensemble(result):
        return []
    tables = []
    for line, numbers in rows.items():
        at = result.isel(line=line_index(result, line))
        tables += [_uncertainties(at, line, numbers, detailed), *_indices(at, line)]
    return tables


def _uncertainties(at: xr.Dataset, line: str, numbers: Numbers, detailed: bool) -> Table:
    """Table of both uncertainties at a line. If `detailed`, it includes the mean over draws, and
    the number of runs with too few passing boulders."""
    keys = ["case_value", "q05", "q95", "monte_carlo_std", "epistemic_std", "mean"]
    rows = []
    for name, (quantity, number_name) in RESULTS.items():
        unit = "fraction" if number_name == "fraction" else quantity
        of_number = at.sel(result=name)
        value, low, high, chance, epistemic, mean = (
            in_unit(of_number[key].item(), unit) for key in keys
        )
        limits = estimate(numbers[quantity], number_name, unit).interval
        more = (mean, int(of_number["too_few"].item())) if detailed else ()
        rows.append(
            (_column(name).title, value, limits, between(low, high), chance, epistemic, *more)
        )
    words = ("the_case_as_it_is", "monte_carlo_interval", "uncertain_inputs_of_the_draws",
             "standard_deviations_monte_carlo", "epistemic")  # fmt: skip
    heads = ["", *(say(f"ensemble.{name}") for name in words)]
    heads += ["mean of the draws", "runs with too few passing"] if detailed else []
    return Table.of(say("ensemble.both_uncertainties", line=line), heads, rows)


def _indices(at: xr.Dataset, line: str) -> Iterator[Table]:
    for kind in INDICES:
        rows = [
            (say(f"uncertain.{name}"), *indices_of(at.sel(input=name), kind))
            for name in sorted_inputs(at)
        ]
        caption = say(f"ensemble.{kind}_caption", line=line)
        yield Table.of(caption, ("", *map(_column, RESULTS)), rows)


def _column(name: str) -> Column:
    quantity, number_name = RESULTS[name]
    passing = QUANTITIES["fraction"]
    if number_name == "fraction":
        return Column(passing.label, passing.unit)
    return Column.of(QUANTITIES[quantity], number_name)


def are_undecided(tables: list[Table]) -> bool:
    """Return True if an index in the tables is undecided."""
    cells = (cell for table in tables for row in table.rows for cell in row)
    return any(isinstance(cell, Text) and cell.key == UNDECIDED for cell in cells)


def more_needed(data: xr.Dataset) -> str:
    """Number of runs needed to resolve the undecided indices."""
    errors = np.stack([data[f"{kind}_error"].values for kind in INDICES])
    runs = runs_needed(errors, data.sizes["run"])
    return say("ensemble.more_draws", runs=number(runs, 1))


def cases_outside(data: xr.Dataset) -> Iterator[Text]:
    """Sentences on the lines where the unchanged case lies outside the range of the draws."""
    for index, line in enumerate(line_names(data)):
        at = data.isel(line=index).sel(result=list(RESULTS))
        case = at["case_value"].values
        is_outside = (case < at["q05"].values) | (case > at["q95"].values)
        names = [_column(name).title for name, out in zip(RESULTS, is_outside, strict=True) if out]
        if names:
            yield say("ensemble.outside", line=line, numbers=names)


def orders_reversed(data: xr.Dataset) -> Iterator[str]:
    """Warnings about first-order indices that exceed the total index, which is impossible in
    theory; for each line and input, only the result with the largest difference."""
    for index, line in enumerate(line_names(data)):
        within: list[str] = []
        beyond: list[str] = []
        for name in map(str, data["input"].values):
            at = data.isel(line=index).sel(input=name)
            errors = [at[f"{kind}_error"].values for kind in INDICES]
            first, total = (
                np.array([limits(*pair)[0] for pair in zip(at[kind].values, error, strict=True)])
                for kind, error in zip(INDICES, errors, strict=True)
            )
            k = int(np.argmax(excess := np.nan_to_num(first - total)))
            if excess[k] >= LEAST_EXCESS:
                kept = within if excess[k] <= Z * np.hypot(*errors)[k] else beyond
                both = {"first": 100 * first[k], "total": 100 * total[k]}
                display = say(f"uncertain.{name}")
                kept.append(say("ensemble.two_indices", name=display, **both))
        if within:
            yield say("ensemble.reversed_within", line=line, inputs=within)
        if beyond:
            yield say("ensemble.reversed_beyond", line=line, inputs=beyond)


def sorted_inputs(at: xr.Dataset) -> list[str]:
    """Names of the inputs, by decreasing sum of their total indices over the results."""
    total = np.nan_to_num(at["total"].values).clip(0, 1)
    order = np.argsort(-total.sum(axis=1), kind="stable")
    return [str(name) for name in at["input"].values[order]]


def indices_of(data: xr.Dataset, kind: str) -> Iterator[object]:
    """Cells with the indices of an input and their intervals [%]; "-" without a significant
    variance."""
    for value, error in zip(data[kind].values, data[f"{kind}_error"].values, strict=True):
        index, low, high = (100 * limit for limit in limits(value, error))
        if np.isnan(value):
            yield "-"
        else:
            undecided = np.isnan(index)
            yield say(UNDECIDED) if undecided else Estimate(index, low, high, decimals=0)
