# SPDX-License-Identifier: BSD-3-Clause
"""Text output of the design sheet."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.language import Number, Text, localised, say, word
from rockfall.protection.demand import ABOVE, ENDS
from rockfall.protection.design import Design, verdict_of
from rockfall.protection.factors import Factors
from rockfall.quantities import DESIGN, number, within
from rockfall.text.table import table as aligned

if TYPE_CHECKING:
    import pandas as pd

CHECKED = (  # messages
    "design.height", "design.height_needed", "design.energy_allowed", "E_d [kJ]",
    "design.passing", "design.holds",
)  # fmt: skip
ABOUT = """\
Of the boulders that come to each line, in brackets 95 % confidence intervals. Heights are above the
ground, vertical (as that of &barrier) and normal to the slope. A sheet is no design: see
docs/design.md for what it leaves out."""


def design_text(design: Design) -> str:
    """The tables of a design, line after line."""
    warnings = [*([design.kept] if design.kept else []), *design.warnings]
    parts = [ABOUT, *design.population, *(f"Warning: {text}" for text in warnings), *_lines(design)]
    if len(design.checks):
        parts += ["", "Barriers", aligned(_checks(design.checks))]
    if design.along is not None:
        parts += ["", f"Along {design.along['line'][0]}", aligned(_along(design.along))]
    return "\n".join([*parts, "", *factor_lines(design.factors)])


def _lines(design: Design) -> Iterator[str]:
    for asked in design.demand.to_dict("records"):
        line = asked["line"]
        most = number(100 * asked["fraction_high"], up=True)
        none = "" if asked["n"] else f", but the interval of the fraction is 0 to {most} %"
        yield f"\n{line}: {asked['n']:,} boulders come{none}"
        if asked["n"]:
            loads, choices = (
                table[table["line"] == line].to_dict("records")
                for table in (design.loads, design.choices)
            )
            yield aligned(load_rows(loads))
            if not design.factors.open:
                yield aligned(demand_rows(asked, design.factors.conditions.standard))
            yield aligned(choice_rows(choices, design.residual))


def load_rows(loads: Iterable[Mapping[str, Any]]) -> Iterator[list[str]]:
    """Quantiles of loads, with intervals, and the level that one in 1,000 exceeds."""
    heads = Number("95 %"), Number("99 %"), say("design.one_in", n=1000)
    yield [f"  {say('design.loads')}", *heads]
    for row in loads:
        display = DESIGN[row["quantity"]]
        cells = (shown(row, name, display.factor) for name in ("q95", "q99", "level_1000"))
        yield [f"  {display.title}", *cells]


def demand_rows(asked: Mapping[str, Any], standard: str) -> Iterator[list[str]]:
    """Requirements of the standard."""
    yield [f"  {standard}", say("design.value")]
    yield ["  m_d [t]", number(asked["m_d"] / 1000, up=True)]
    for name, title, factor in (
        ("v_d", "v_d [m/s]", 1.0),
        ("E_d", "E_d [kJ]", 1e-3),
        ("h_d", "design.h_d", 1.0),
        ("height_needed", "design.height_needed_vertical", 1.0),
        ("normal_height_needed", "design.height_needed_normal", 1.0),
    ):
        yield [f"  {say(title)}", needed(asked, name, factor)]
    yield [f"  {say('design.class')}", class_name(asked) + unconfirmed(asked)]


def choice_rows(choices: Iterable[Mapping[str, Any]], residual: float) -> Iterator[list[str]]:
    """Height that leaves the residual for each class, with the cheapest marked."""
    yield [f"  at most {100 * residual:g} % pass", "height [m]", "passing [%]", "cost of 1 m"]
    for row in choices:
        energy = f"{row['capacity'] / 1000:,.0f} kJ"
        cells = [number(row["height"], up=True), shown(row, "residual", 100.0), number(row["cost"])]
        mark = "  <- cheapest" if row["cheapest"] else ""
        yield [f"  class {row['ead_class']}, {energy}", *cells[:-1], cells[-1] + mark]


def _checks(checks: pd.DataFrame) -> Iterator[list[str]]:
    yield check_head()
    for row in checks.to_dict("records"):
        yield check_row(row)


def check_head() -> list[str]:
    """Head of the table of barriers."""
    return ["", *map(say, CHECKED)]


def check_row(row: Mapping[str, Any]) -> list[str]:
    """A barrier and the requirements for it."""
    if not row["n"]:
        blank = ["-"] * (len(CHECKED) - 2)
        return [f"  {row['line']}", number(row["height"]), *blank, say("design.none_comes")]
    return [
        f"  {row['line']}", number(row["height"]), number(row["height_needed"], up=True),
        number(row["energy_allowed"] / 1000), number(row["E_d"] / 1000, up=True),
        shown(row, "residual", 100.0),
        verdict_of(row),
    ]  # fmt: skip


def unconfirmed(row: Mapping[str, Any]) -> str:
    """Unconfirmed assumptions of a verdict."""
    doubts = (row.get("unconfirmed") or "").split("; ")
    return f"; {word('unconfirmed')}: {'; '.join(map(word, doubts))}" if doubts != [""] else ""


def _along(along: pd.DataFrame) -> Iterator[list[str]]:
    yield ["  from, to [m]", "boulders", "E_d [kJ]", "height needed [m]", "class"]
    for row in along.to_dict("records"):
        place = f"  {row['start']:g}, {row['end']:g}"
        if np.isnan(row["E_d"]):
            yield [place, f"{row['n']:,}", "", "", ""]
            continue
        energy, height = needed(row, "E_d", 1e-3), needed(row, "height_needed")
        yield [place, f"{row['n']:,}", energy, height, class_name(row)]


def factor_lines(factors: Factors) -> Iterator[Text]:
    """Partial factors, or which ones are to be filled in."""
    if factors.open:
        yield say("design.open", standard=factors.conditions.standard, names=factors.open)
        return
    values = (f"{name} {localised(f'{value:.4g}')}" for name, value in factors.values.items())
    yield say("design.factors", values=", ".join(values))


def shown(row: Mapping[str, Any], name: str, factor: float = 1.0, *, up: bool = False) -> str:
    """Number with its interval, if it has one."""
    value, low, high = (factor * row.get(name + end, np.nan) for end in ("", "_low", "_high"))
    if np.isnan(low) and np.isnan(high):
        return number(value, up=up)
    return within(number(value, up=up), number(low), number(high, up=up))


def needed(row: Mapping[str, Any], name: str, factor: float = 1.0) -> str:
    """Required value, rounded up."""
    return shown(row, name, factor, up=True)


def class_name(row: Mapping[str, Any]) -> str:
    """Sufficient class, and those at the ends of its interval if different."""
    value, low, high = (row[f"ead_class{end}"] for end in ENDS)
    text = f"{value:.0f}"
    if value == ABOVE:
        text = say("design.declared", value=value)
    if low == value == high:
        return text
    return within(text, number(low, 1), number(high, 1))
