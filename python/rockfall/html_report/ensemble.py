# SPDX-License-Identifier: BSD-3-Clause
"""Input uncertainty in addition to the Monte Carlo error: tables and a sentence."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rockfall.analysis.ensemble.study import RESULTS, is_ensemble
from rockfall.html_report.intervals import STATISTICS, in_unit, interval
from rockfall.html_report.summary import HEADLINE, run_out
from rockfall.html_report.tables import Table
from rockfall.quantities import QUANTITIES, with_unit
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
    found = []
    for line in map(str, result["line"].values) if "line" in result else ():
        ranges, cases = zip(*_headline_numbers(result, line), strict=True)
        fraction, energy, height, _ = ranges
        text = f"{line}: {fraction} % of the boulders pass in 90 % of the draws"
        if "-" not in (fraction, energy, height):
            text += (
                f"; of these one in 20 has more than {energy} kJ, and one in 20 is higher than "
                f"{height} m above the ground; the case as it is has {cases[0]} %, {cases[1]} kJ "
                f"and {cases[2]} m"
            )
        found.append(f"{text}.")
    return [*found, *run_out(result)]


def range_headline(result: xr.Dataset) -> Table:
    """Ranges of the draws at the lines, with the unchanged case in brackets."""
    rows = []
    for line in map(str, result["line"].values):
        cells = (f"{of}\n({case})" for of, case in _headline_numbers(result, line))
        rows.append((line, *cells))
    caption = (
        "Boulders at the lines and barriers: 90 % of the draws of the uncertain inputs; in "
        "brackets the case as it is"
    )
    return Table(caption, ("line or barrier", *HEADLINE), rows)


def _headline_numbers(result: xr.Dataset, line: str) -> Iterator[tuple[str, str]]:
    """Range of the draws and value of the unchanged case for each column of the headline; "-" if
    too few boulders pass in some draw."""
    for quantity, number in HEADLINE.values():
        name = "fraction" if quantity == "fraction" else f"{quantity}.{number}"
        one = result.sel(line=line, result=name)
        low, high, case = (
            in_unit(one[key].item(), quantity) for key in ("q05", "q95", "case_value")
        )
        yield ("-" if "-" in (low, high) else f"{low} to {high}"), case


def range_tables(result: xr.Dataset, rows: Rows) -> list[Table]:
    """Tables of an ensemble for each line: both uncertainties of its numbers, and the inputs behind
    the epistemic one. None for other results."""
    if not is_ensemble(result):
        return []
    found = []
    for line, numbers in rows.items():
        at = result.sel(line=line)
        head = ("", "the case as it is", "Monte Carlo, 95 % interval",
                "uncertain inputs, 90 % of the draws", "standard deviations: Monte Carlo",
                "epistemic")  # fmt: skip
        shown = []
        for name, (quantity, number) in RESULTS.items():
            about = "fraction" if number == "fraction" else quantity
            one = at.sel(result=name)
            value, low, high, chance, epistemic = (
                in_unit(one[key].item(), about)
                for key in ("case_value", "q05", "q95", "monte_carlo_std", "epistemic_std")
            )
            limits = interval(numbers[quantity], number, about)
            shown.append((_label(name), value, limits, f"({low} to {high})", chance, epistemic))
        caption = f"{line}: what more boulders would make certain, and what they would not"
        found += [Table(caption, head, shown), *_indices(at, line)]
    return found


def _indices(at: xr.Dataset, line: str) -> Iterator[Table]:
    for kind, label in INDICES.items():
        rows = [(name, *indices_of(at.sel(input=name), kind)) for name in sorted_inputs(at)]
        caption = f"{line}: fraction of the epistemic variance {label} [%], with 95 % intervals"
        yield Table(caption, ("", *map(_label, RESULTS)), rows)


def _label(name: str) -> str:
    """Label of a result."""
    quantity, number = RESULTS[name]
    if number == "fraction":
        return QUANTITIES["fraction"].title
    about = QUANTITIES[quantity]
    return with_unit(f"{about.label}, {STATISTICS[number]}", about.unit)


def range_words(result: xr.Dataset, tables: list[Table]) -> list[str]:
    """Explanations of the tables."""
    if not tables:
        return []
    words = [
        f"The inputs that the case calls uncertain were drawn {result.sizes['run']:,} times: "
        f"{'; '.join(result['input'].values)}. The range of these draws is the epistemic "
        "uncertainty: more boulders do not make it smaller, better knowledge of the slope does.",
        *(f"{one}." for one in orders_reversed(result)),
    ]
    undecided = any(UNDECIDED in str(cell) for one in tables for row in one.rows for cell in row)
    return [*words, f"{more_needed(result).capitalize()}."] if undecided else words
