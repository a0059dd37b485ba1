# SPDX-License-Identifier: BSD-3-Clause
"""Input uncertainty in addition to the Monte Carlo error: tables and a sentence."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rockfall.html_report.intervals import in_unit, interval, interval_text
from rockfall.html_report.summary import HEADLINE, run_out
from rockfall.html_report.tables import Table
from rockfall.language import Text, say, translated
from rockfall.plots.style import capital
from rockfall.quantities import QUANTITIES, statistic, with_unit
from rockfall.result.crossings import line_index, line_names
from rockfall.studies.ensemble.study import RESULTS, is_ensemble
from rockfall.text.ensemble import (
    INDICES,
    UNDECIDED,
    indices_of,
    more_needed,
    orders_reversed,
    sorted_inputs,
)

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.html_report.intervals import Rows

PER_LINE = 1 + len(INDICES)  # tables


def range_answers(result: xr.Dataset) -> list[str]:
    """A sentence for each line: range of the draws, then value of the unchanged case."""
    answers = []
    for line in line_names(result):
        passing, energy, height, _ = _headline_numbers(result, line)
        values = dict(zip(("low", "high", "fraction"), passing, strict=True))
        values |= zip(("e_low", "e_high", "energy"), energy, strict=True)
        values |= zip(("h_low", "h_high", "height"), height, strict=True)
        is_known = "-" not in [
            value for name, value in values.items() if name.endswith(("low", "high"))
        ]
        key = "ensemble.line_values" if is_known else "ensemble.line_fraction"
        answers.append(say(key, line=line, **values))
    return [*answers, *run_out(result)]


def range_headline(result: xr.Dataset) -> Table:
    """Ranges of the draws at the lines, with the unchanged case in brackets."""
    rows = []
    for line in line_names(result):
        cells = (
            f"{'-' if '-' in (low, high) else say('interval.range', low=low, high=high)}\n"
            f"({translated(case)})"
            for low, high, case in _headline_numbers(result, line)
        )
        rows.append((line, *cells))
    caption = say("ensemble.headline_caption")
    return Table(caption, (say("label.line_or_barrier"), *map(say, HEADLINE)), rows)


def _headline_numbers(result: xr.Dataset, line: str) -> Iterator[list[str]]:
    """Ends of the range of the draws, and value of the unchanged case, for each column of the
    headline; "-" if too few boulders pass in some draw."""
    for quantity, number in HEADLINE.values():
        name = "fraction" if quantity == "fraction" else f"{quantity}.{number}"
        of_number = result.isel(line=line_index(result, line)).sel(result=name)
        yield [in_unit(of_number[key].item(), quantity) for key in ("q05", "q95", "case_value")]


def range_tables(result: xr.Dataset, rows: Rows) -> list[Table]:
    """Tables of an ensemble for each line: both uncertainties of its numbers, and the inputs behind
    the epistemic one. None for other results."""
    if not is_ensemble(result):
        return []
    tables = []
    for line, numbers in rows.items():
        at = result.isel(line=line_index(result, line))
        head = ("", say("ensemble.the_case_as_it_is"), say("ensemble.monte_carlo_interval"),
                say("ensemble.uncertain_inputs_of_the_draws"),
                say("ensemble.standard_deviations_monte_carlo"),
                say("ensemble.epistemic"))  # fmt: skip
        shown = []
        for name, (quantity, number) in RESULTS.items():
            text = "fraction" if number == "fraction" else quantity
            of_number = at.sel(result=name)
            value, low, high, chance, epistemic = (
                in_unit(of_number[key].item(), text)
                for key in ("case_value", "q05", "q95", "monte_carlo_std", "epistemic_std")
            )
            limits = interval(numbers[quantity], number, text)
            shown.append((_label(name), value, limits, interval_text(low, high), chance, epistemic))
        caption = say("ensemble.both_uncertainties", line=line)
        tables += [Table(caption, head, shown), *_indices(at, line)]
    return tables


def _indices(at: xr.Dataset, line: str) -> Iterator[Table]:
    for kind, caption in (
        ("first_order", say("ensemble.first_order_caption", line=line)),
        ("total", say("ensemble.total_caption", line=line)),
    ):
        rows = [
            (say(f"uncertain.{name}"), *indices_of(at.sel(input=name), kind))
            for name in sorted_inputs(at)
        ]
        yield Table(caption, ("", *map(_label, RESULTS)), rows)


def _label(name: str) -> str:
    """Label of a result."""
    quantity, number = RESULTS[name]
    if number == "fraction":
        return QUANTITIES["fraction"].title
    display = QUANTITIES[quantity]
    return with_unit(f"{display.label}, {statistic(number)}", display.unit)


def range_words(result: xr.Dataset, tables: list[Table]) -> list[str]:
    """Explanations of the tables."""
    if not tables:
        return []
    words = [
        say(
            "ensemble.draws",
            run=result.sizes["run"],
            join=[say(f"uncertain.{name}") for name in result["input"].values],
        ),
        *(f"{sentence}." for sentence in orders_reversed(result)),
    ]
    cells = (cell for table in tables for row in table.rows for cell in row)
    undecided = any(isinstance(cell, Text) and cell.key == UNDECIDED for cell in cells)
    return [*words, f"{capital(more_needed(result))}."] if undecided else words
