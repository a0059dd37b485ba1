# SPDX-License-Identifier: BSD-3-Clause
"""Numbers at evaluation lines as tables, with 95 % confidence intervals: statistics, return
levels, groups, windows along a line, precision."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.analysis.line_statistics import line_statistics, row_name
from rockfall.analysis.precision.history import NUMBERS
from rockfall.analysis.precision.intervals import TARGETS, boulders_needed, half_width, rounded_up
from rockfall.language import Number, say
from rockfall.quantities import DESIGN, QUANTITIES, number, percent, statistic, worst_first
from rockfall.table import TOO_FEW, Column, Estimate, Table, stacked

if TYPE_CHECKING:
    import pandas as pd

    from rockfall.result.contents import Held

Row = Mapping[str, float]  # a row of line_statistics
Numbers = Mapping[str, Row]  # rows by quantity
Rows = Mapping[str, Numbers]  # rows by line and quantity

STATISTICS = ("mean", "std", "q50", "q90", "q95", "q98", "q99")
HEADLINE = {  # quantity and number of each column of the table on page 1
    "summary.boulders_that_pass": ("fraction", "fraction"),
    "summary.total_kinetic_energy_quantile_kj": ("energy_total", "q95"),
    "summary.passing_height_quantile_m": ("passing_height", "q95"),
    "summary.speed_quantile_m_s": ("speed", "q95"),
}
OF_GROUPS = (
    ("speed", "mean"), ("energy_total", "mean"), ("energy_total", "q95"),
    ("passing_height", "q95"), ("upper_edge", "q95"), ("normal_height", "q95"),
)  # fmt: skip
ALONG = (("energy_total", "mean"), ("energy_total", "q95"), ("passing_height", "q95"))


def rows_of(result: Held, lines: Sequence[int] | None = None) -> Rows:
    """`line_statistics` by line and quantity, for all lines or for those with these indices."""
    return rows_in(line_statistics(result, lines=lines))


def key_rows(result: Held) -> Rows:
    """Rows of all lines with the quantities of `headline` only."""
    quantities = dict.fromkeys(row_name(name) for name, _ in HEADLINE.values())
    return rows_in(line_statistics(result, quantities=list(quantities)))


def worst_of(rows: Rows) -> list[str]:
    """Names of the lines, worst first: by passing boulders, largest energy and passing height."""
    lines = list(rows)
    loads = [
        [rows[line][name][number] for line in lines]
        for name, number in (("speed", "n"), ("energy_total", "max"), ("passing_height", "max"))
    ]
    return [lines[k] for k in worst_first(*loads)]


def rows_in(statistics: pd.DataFrame) -> Rows:
    """Rows of `line_statistics` by line and quantity."""
    rows: dict[str, dict[str, Row]] = {}
    for row in statistics.to_dict("records"):
        rows.setdefault(str(row["line"]), {})[row["quantity"]] = row
    return rows


def in_unit(value: float, quantity: str) -> Number:
    """Convert a number to the display unit of the quantity."""
    return number(QUANTITIES[quantity].factor * value)


def estimate(row: Mapping[Any, Any], name: str, quantity: str, **how: Any) -> Estimate:
    """Cell with a number of a quantity and its interval, in the display unit."""
    return Estimate.of(row, name, QUANTITIES[quantity].factor, **how)


def rising_estimates(row: Row, names: Sequence[str], quantity: str) -> Iterator[Estimate]:
    """Cells of non-decreasing numbers, rounded so that none is below its predecessor."""
    before, decimals = -math.inf, 0
    for name in names:
        cell = estimate(row, name, quantity)
        if cell.has_interval:
            digits = cell.justified
            if round(cell.value, digits) < before:
                digits = decimals
            before, decimals = round(cell.value, digits), digits
            cell = cell._replace(decimals=digits)
        yield cell


def headline(rows: Rows) -> Table:
    """Table of the key numbers (`HEADLINE`) at each line."""
    shown = [(line, *key_numbers(numbers)) for line, numbers in rows.items()]
    heads = say("label.line_or_barrier"), *map(say, HEADLINE)
    return Table.of(say("summary.headline_caption"), heads, shown)


def key_numbers(numbers: Numbers) -> Iterator[Estimate]:
    """Cells with the key numbers (`HEADLINE`) of a line."""
    for quantity, name in HEADLINE.values():
        yield estimate(numbers[row_name(quantity)], name, quantity)


def line_tables(rows: Rows, *, short: bool = False) -> Iterator[Table]:
    """Tables with mean, deviation, quantiles and maximum at each line that boulders cross. If
    `short`, quantities and statistics have their short names, else titles."""
    for line, numbers in rows.items():
        if n := numbers["speed"]["n"]:
            names = STATISTICS if short else map(statistic, STATISTICS)
            shown = [
                (
                    QUANTITIES[name].short if short else QUANTITIES[name].title,
                    *(estimate(row, number_name, name) for number_name in STATISTICS),
                    in_unit(row["max"], name),
                )
                for name, row in numbers.items()
            ]
            has_dash = any(TOO_FEW in str(cell) for row in shown for cell in row)
            key = "tables.line_caption_with_dashes" if has_dash else "tables.line_caption"
            maximum = say("tables.max_of", n=n)
            yield Table.of(say(key, line=line, n=n), ("", *names, maximum), shown)


def level_table(levels: pd.DataFrame, *, short: bool = False) -> Table:
    """Table of return levels of passing boulders. The short form omits line names, and the
    reasons for missing levels."""
    names = [n for n in levels.columns if n.startswith("level_") and n.count("_") == 1]
    shown = []
    for row in levels[levels["n"] > 0].to_dict("records"):
        quantity = row["quantity"]
        over = say("tables.exceedances", n=row["exceedances"])
        tail = (stacked(in_unit(row["threshold"], quantity), over),
                Estimate.of(row, "shape", digits=3))  # fmt: skip
        is_fitted = np.isfinite(row["shape"])
        title = QUANTITIES[quantity].title
        name = (
            QUANTITIES[quantity].short
            if short
            else say("join.colon", before=row["line"], after=title)
        )
        shown.append(
            (name, in_unit(row["max"], quantity), *rising_estimates(row, names, quantity),
             *(tail if is_fitted else ("-", "-")),
             *([] if short else [row["refused"].replace("; ", "\n")]))
        )  # fmt: skip
    heads = ["", say("tables.max"), *(say("tables.one_in_n", n=int(n[6:])) for n in names)]
    heads += map(say, ("tables.threshold", "tables.shape", "tables.refused")[: 2 if short else 3])
    return Table.of(say("tables.level_caption"), heads, shown, "numbers noted")


def precision_table(line: str, numbers: Numbers, boulders: int) -> Table:
    """Table of the precision at a line, and of the boulders needed for higher precision."""
    shown = []
    for quantity, name in NUMBERS:
        row = numbers[row_name(quantity)]
        display, half = QUANTITIES[quantity], half_width(row, name)
        label = f"{display.label}, {statistic(name)}" if name in STATISTICS else display.label
        cells: list[object] = ["-"] * (1 + len(TARGETS))
        crossed = np.inf if name == "fraction" else row["n"]
        if np.isfinite(half):
            more = (boulders_needed(boulders, half, target, crossed) for target in TARGETS)
            cells = [Number(f"± {percent(half)}"), *map(rounded_up, more)]
        value = in_unit(row.get(name, np.nan), quantity)
        shown.append((label, Number(f"{value} {display.unit}"), *cells))
    targets = (say("tables.boulders_for_precision", target=100 * target) for target in TARGETS)
    heads = "", say("tables.now"), say("tables.half_width"), *targets
    return Table.of(say("tables.precision_caption", line=line), heads, shown)


def group_tables(statistics: pd.DataFrame, by: str) -> Iterator[Table]:
    """Table for each line, with a row for each group of boulders."""
    for line, rows in statistics.groupby("line", sort=False):
        shown = []
        for group, of_group in rows.groupby(by, sort=False):
            row = {f"{record['quantity']}": record for record in of_group.to_dict("records")}
            first = row["speed"]
            numbers = (estimate(row[key], name, key, digits=3) for key, name in OF_GROUPS)
            fraction = estimate(first, "fraction", "fraction", digits=3)
            shown.append((str(group), int(first["boulders"]), int(first["n"]), fraction, *numbers))
        heads = Column(by), Column("boulders"), Column("pass"), Column("fraction", "%")
        yield Table.of(str(line), [*heads, *_columns(OF_GROUPS)], shown)


def profile_table(profile: pd.DataFrame) -> Table:
    """Table of the boulders that pass each window of a line."""
    shown = [
        (number(row["start"], 4), number(row["end"], 4), int(row["n"]),
         Estimate.of(row, "per_metre", 100.0, digits=3),
         *(estimate(row, f"{key}_{name}", key, digits=3) for key, name in ALONG))
        for row in profile.to_dict("records")
    ]  # fmt: skip
    heads = Column("from", "m"), Column("to", "m"), Column("pass"), Column("passing per metre", "%")
    return Table.of("", [*heads, *_columns(ALONG)], shown)


def _columns(numbers: Iterable[tuple[str, str]]) -> list[Column]:
    return [Column.of(DESIGN[key], name, short=True) for key, name in numbers]
