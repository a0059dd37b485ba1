# SPDX-License-Identifier: BSD-3-Clause
"""Barriers designed for the annual frequency of passing boulders, as tables, sentences and text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from rockfall.language import Text, say, word
from rockfall.protection.yearly import HIGHEST, YearlyDesign
from rockfall.quantities import DESIGN, number
from rockfall.result.variables import ENDS
from rockfall.table import Column, Estimate, Table, as_text
from rockfall.tables.hazard import FACTORS, level_cell

Row = Mapping[Any, Any]
MOST_TIMES = 1000  # larger factors are not worth a run


def yearly_design_text(sheet: YearlyDesign) -> str:
    """Text with the advice and all tables."""
    parts: list[str] = [say("yearly.about", years=sheet.period), say("yearly.criterion")]
    parts += [*advice(sheet), *verdicts(sheet)]
    for table in yearly_design_tables(sheet):
        parts += ["", table.caption, as_text(table)]
    return "\n".join(parts)


def yearly_design_tables(sheet: YearlyDesign) -> Iterator[Table]:
    """Tables of the loads at all lines, the choices for each line, and the barriers of the case."""
    yield loads_table(sheet)
    yield from check_tables(sheet)
    yield from choice_tables(sheet)


def loads_table(sheet: YearlyDesign) -> Table:
    """Table of boulders per year, and energy and height by return period, at lines and barriers."""
    rows = []
    for row in sheet.loads.to_dict("records"):
        energy, height = (
            level_cell(*(factor * row[f"{name}{end}"] for end in ENDS))
            for name, factor in FACTORS.items()
        )
        rows.append((row["line"], Estimate.of(row, "frequency", digits=2), energy, height))
    titles = (DESIGN[name].title for name in ("energy_total", "passing_height"))
    heads = say("label.line_or_barrier"), say("hazard.boulders_a_year"), *titles
    return Table.of(say("yearly.loads_caption", years=sheet.period), heads, rows)


def choice_tables(sheet: YearlyDesign) -> Iterator[Table]:
    """Tables of barriers by class, for the lines with an advised barrier, the strongest first."""
    heads = (
        say("yearly.class"), Column(say("yearly.capacity"), "kJ", 0),
        Column(say("yearly.least_height"), "m", 1), say("yearly.behind"), say("yearly.through"), "",
    )  # fmt: skip
    for line in _strongest(sheet):
        rows = sheet.choices[sheet.choices["line"] == line]
        if rows["advised"].any():
            cells = [
                (f"{row['ead_class']:.0f}", row["capacity"] / 1000, row["height"],
                 Estimate.of(row, "behind", digits=2), Estimate.of(row, "through", digits=2),
                 say("yearly.advised") if row["advised"] else "")
                for row in rows.to_dict("records")
            ]  # fmt: skip
            yield Table.of(
                say("yearly.choices_caption", line=line, years=sheet.period), heads, cells
            )


def check_tables(sheet: YearlyDesign) -> Iterator[Table]:
    """Table of the case's barriers; none without barriers."""
    if len(sheet.checks):
        came = sheet.loads.set_index("line")
        rows = [
            (row["line"], row["height"], row["capacity"] / 1000,
             Estimate.of(came.loc[row["line"]], "frequency", digits=2),
             Estimate.of(row, "behind", digits=2), verdict(row))
            for row in sheet.checks.to_dict("records")
        ]  # fmt: skip
        heads = (
            say("tables.barrier"), Column(say("yearly.height"), "m", 1),
            Column(say("yearly.capacity"), "kJ", 0), say("yearly.come"), say("yearly.behind"),
            say("yearly.enough", years=sheet.period),
        )  # fmt: skip
        yield Table.of(say("yearly.checks_caption"), heads, rows)


def verdict(row: Row) -> Text | str:
    """Verdict on a barrier: whether at most one boulder per return period passes it."""
    return word(("yes" if row["holds"] else "no") if row["certain"] else "undecided")


def verdicts(sheet: YearlyDesign) -> Iterator[Text]:
    """A sentence on each barrier of the case."""
    for row in sheet.checks.to_dict("records"):
        behind = Estimate.of(row, "behind", digits=2)
        answer = "undecided" if not row["certain"] else "holds" if row["holds"] else "fails"
        more = {"times": times_more(behind, 1 / sheet.period)} if answer == "undecided" else {}
        yield say(
            f"yearly.{answer}", line=row["line"], height=row["height"],
            capacity=row["capacity"] / 1000, behind=behind.number, limits=behind.interval,
            years=sheet.period, **more,
        )  # fmt: skip


def times_more(rate: Estimate, most: float) -> str:
    """Factor, rounded up, by which more boulders make the interval of a frequency exclude the
    frequency `most`, if the frequency stays. The width of the interval decreases with the square
    root of their number."""
    end = rate.high if rate.value < most else rate.low
    apart = abs(rate.value - most)
    factor = ((end - rate.value) / apart) ** 2 if apart else np.inf
    return number(factor, 1, up=True) if factor < MOST_TIMES else say("yearly.over", n=MOST_TIMES)


def advice(sheet: YearlyDesign) -> Iterator[Text]:
    """Sentences for lines without a barrier, the strongest first: the advised barrier, and the
    reason why no weaker barrier suffices."""
    loads = {load["line"]: load for load in sheet.loads.to_dict("records")}
    for line in _strongest(sheet):
        rows = sheet.choices[sheet.choices["line"] == line]
        yield from _advice(line, loads[line], rows.to_dict("records"), sheet.period)


def _strongest(sheet: YearlyDesign) -> list[str]:
    """Lines without a barrier, by decreasing class and height of their advised barriers."""
    held, levels = {*sheet.checks["line"]}, demands(sheet)
    lines = [line for line in levels if line not in held]
    return sorted(lines, key=lambda line: levels[line].levels, reverse=True)


class Demand(NamedTuple):
    """Demand of a line or barrier, as levels: class and height of the advised barrier (-1: none is
    needed, inf: none suffices), or 0, 1, 2: the case's barrier holds, is undecided, fails."""

    levels: tuple[float, ...]
    text: Text  # sentence on it

    def exceeds(self, other: Demand) -> bool:
        """Return True if any level is higher than the same level of `other`."""
        return any(own > level for own, level in zip(self.levels, other.levels, strict=True))


def demands(sheet: YearlyDesign) -> dict[str, Demand]:
    """Demand of each line and barrier, by name."""
    by_name = {}
    for load in sheet.loads.to_dict("records"):
        line = load["line"]
        rows = sheet.choices[sheet.choices["line"] == line].to_dict("records")
        none = np.inf if load["frequency_high"] > 1 / sheet.period else -1
        advised = next(((row["ead_class"], row["height"]) for row in rows if row["advised"]),
                       (none, none))  # fmt: skip
        by_name[line] = Demand(advised, next(_advice(line, load, rows, sheet.period)))
    for row, text in zip(sheet.checks.to_dict("records"), verdicts(sheet), strict=True):
        by_name[row["line"]] = Demand(((2 - 2 * row["holds"]) if row["certain"] else 1,), text)
    return by_name


def _advice(line: str, load: Row, rows: list[dict[Any, Any]], years: float) -> Iterator[Text]:
    advised = next((row for row in rows if row["advised"]), None)
    if advised is None:
        if load["frequency_high"] > 1 / years:
            yield say("yearly.none_enough", line=line, years=years, highest=HIGHEST)
        else:
            yield say("yearly.no_barrier", line=line, years=years)
        return
    behind = Estimate.of(advised, "behind", digits=2)
    values = {"line": line, "ead_class": f"{advised['ead_class']:.0f}", "years": years}
    yield say(
        "yearly.advice", **values, capacity=advised["capacity"] / 1000, height=advised["height"],
        behind=behind.number, limits=behind.interval,
    )  # fmt: skip
    weaker = [row for row in rows if row["ead_class"] < advised["ead_class"]]
    if not weaker:
        return
    nearest = weaker[-1]
    weak = f"{nearest['ead_class']:.0f}"
    if not np.isnan(nearest["height"]):
        yield say("yearly.higher", weak=weak, height=nearest["height"])
    elif nearest["through_high"] > 1 / years:
        through = Estimate.of(nearest, "through", digits=2)
        limits = through.interval
        yield say("yearly.too_weak", weak=weak, through=through.number, limits=limits)
