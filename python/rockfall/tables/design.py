# SPDX-License-Identifier: BSD-3-Clause
"""Design sheet as tables and text."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from rockfall.language import Number, Text, localised, say, word
from rockfall.protection.demand import ABOVE
from rockfall.protection.design import Design, verdict_of
from rockfall.protection.factors import Factors
from rockfall.quantities import DESIGN, number
from rockfall.result.variables import ENDS
from rockfall.table import Column, Estimate, Table, as_text, between, stacked

CHECKED = (  # message ids
    "design.height", "design.height_needed", "design.energy_allowed", "E_d [kJ]",
    "design.passing", "design.holds",
)  # fmt: skip
ABOUT = """\
Boulders that reach each line; brackets: 95 % confidence intervals. Heights are above the ground,
vertical (as for &barrier) and normal to the slope. Barriers are judged by the fraction of arriving
boulders that pass; `rockfall dossier`, and `design` of a hazard, judge them by boulders that pass
per year. A sheet is not a complete design: see docs/design.md for what it omits."""


def design_text(design: Design) -> str:
    """Design tables as lines of text."""
    warnings = [*([design.kept] if design.kept else []), *design.warnings]
    parts = [ABOUT, *design.population, *(f"Warning: {note}" for note in warnings), *_lines(design)]
    for table in check_tables(design):
        parts += ["", "Barriers", as_text(table)]
    if design.along is not None:
        parts += ["", f"Along {design.along['line'][0]}", as_text(along_table(design.along))]
    return "\n".join([*parts, "", *factor_lines(design.factors)])


def _lines(design: Design) -> Iterator[str]:
    for asked in design.demand.to_dict("records"):
        most = number(100 * asked["fraction_high"], up=True)
        none = "" if asked["n"] else f", but the interval of the fraction is 0 to {most} %"
        yield f"\n{asked['line']}: {asked['n']:,} boulders arrive{none}"
        if asked["n"]:
            yield from (
                as_text(load_table(design, asked)),
                as_text(choice_table(design, asked["line"])),
            )


def load_tables(design: Design) -> Iterator[Table]:
    """Tables of barrier requirements, for each line that boulders reach."""
    for asked in design.demand.to_dict("records"):
        if asked["n"]:
            yield load_table(design, asked)


def load_table(design: Design, asked: Mapping[Any, Any]) -> Table:
    """Table of loads at a line: quantiles, the level exceeded by 1 in 1,000, and the requirements
    of a standard."""
    line, standard = asked["line"], design.factors.conditions.standard
    rows: list[list[object]] = []
    for row in design.loads[design.loads["line"] == line].to_dict("records"):
        display = DESIGN[row["quantity"]]
        cells = (shown(row, name, display.factor) for name in ("q95", "q99", "level_1000"))
        rows.append([display.title, *cells])
    caption = say("tables.loads_alone", line=line)
    if not design.factors.open:
        rows += demand_rows(asked)
        caption = say("tables.loads_caption", line=line, standard=standard)
    heads = say("design.loads"), Number("95 %"), Number("99 %"), say("design.one_in", n=1000)
    return Table.of(caption, heads, rows)


def demand_rows(asked: Mapping[Any, Any]) -> Iterator[list[object]]:
    """Rows with the requirements of a standard."""
    yield ["m_d [t]", number(asked["m_d"] / 1000, up=True), "", ""]
    for name, title, factor in (
        ("v_d", "v_d [m/s]", 1.0),
        ("E_d", "E_d [kJ]", 1e-3),
        ("h_d", "design.h_d", 1.0),
        ("height_needed", "design.height_needed_vertical", 1.0),
        ("normal_height_needed", "design.height_needed_normal", 1.0),
    ):
        yield [say(title), needed(asked, name, factor), "", ""]
    yield [say("design.class"), class_name(asked) + unconfirmed(asked), "", ""]


def choice_table(design: Design, line: str) -> Table:
    """Table of heights that meet the residual fraction, by class; the cheapest is marked."""
    rows = [
        (say("design.choice", ead_class=row["ead_class"], capacity=row["capacity"] / 1000),
         number(row["height"], up=True), shown(row, "residual", 100.0), row["cost"],
         say("design.cheapest") if row["cheapest"] else "")
        for row in design.choices[design.choices["line"] == line].to_dict("records")
    ]  # fmt: skip
    cost = "design.cost_of_metre" if design.priced else "design.energy_by_height"
    heads = (
        say("design.at_most", residual=100 * design.residual), Column(word("height"), "m"),
        Column(word("passing"), "%"), say(cost), "",
    )  # fmt: skip
    return Table.of("", heads, rows)


def check_tables(design: Design) -> Iterator[Table]:
    """Table of existing barriers and their requirements; none without barriers."""
    if len(design.checks):
        rows = [check_row(row) for row in design.checks.to_dict("records")]
        standard = design.factors.conditions.standard
        yield Table.of(
            say("tables.checks_caption", standard=standard), ["", *map(say, CHECKED)], rows
        )


def check_row(row: Mapping[Any, Any]) -> list[object]:
    """Row for a barrier and its requirements."""
    if not row["n"]:
        blank = ["-"] * (len(CHECKED) - 2)
        return [row["line"], row["height"], *blank, say("design.none_comes")]
    return [
        row["line"], row["height"], number(row["height_needed"], up=True),
        row["energy_allowed"] / 1000, number(row["E_d"] / 1000, up=True),
        shown(row, "residual", 100.0), verdict_of(row),
    ]  # fmt: skip


def along_table(along: pd.DataFrame) -> Table:
    """Table of requirements in windows along a line."""
    rows: list[list[object]] = []
    for row in along.to_dict("records"):
        asks = ["", "", ""] if np.isnan(row["E_d"]) else [
            needed(row, "E_d", 1e-3), needed(row, "height_needed"), class_name(row)
        ]  # fmt: skip
        rows.append([f"{row['start']:g}, {row['end']:g}", int(row["n"]), *asks])
    heads = "from, to [m]", "boulders", "E_d [kJ]", "height needed [m]", "class"
    return Table.of("", heads, rows)


def unconfirmed(row: Mapping[str, Any]) -> str:
    """Unconfirmed assumptions of a verdict; "" if there are none."""
    doubts = (row.get("unconfirmed") or "").split("; ")
    return f"; {word('unconfirmed')}: {'; '.join(map(word, doubts))}" if doubts != [""] else ""


def factor_lines(factors: Factors) -> Iterator[Text]:
    """Sentence with the partial factors, or with those that the user must provide."""
    if factors.open:
        yield say("design.open", standard=factors.conditions.standard, names=factors.open)
        return
    values = (f"{name} {localised(f'{value:.4g}')}" for name, value in factors.values.items())
    yield say("design.factors", values=", ".join(values))


def shown(row: Mapping[Any, Any], name: str, factor: float = 1.0, *, up: bool = False) -> Estimate:
    """Cell with a number and its interval, if any."""
    return Estimate.of(row, name, factor, digits=3, up=up)


def needed(row: Mapping[Any, Any], name: str, factor: float = 1.0) -> Estimate:
    """Cell with a required value and its interval, rounded up."""
    return shown(row, name, factor, up=True)


def class_name(row: Mapping[str, Any]) -> str:
    """Sufficient class, and the classes at the interval limits if different."""
    value, low, high = (row[f"ead_class{end}"] for end in ENDS)
    text = f"{value:.0f}"
    if value == ABOVE:
        text = say("design.declared", value=value)
    if low == value == high:
        return text
    return stacked(text, between(number(low, 1), number(high, 1)))
