# SPDX-License-Identifier: BSD-3-Clause
"""A comparison with observations as tables and text, with 95 % intervals in brackets."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from rockfall.analysis.observed.compare import LEVEL, STATISTICS, Comparison
from rockfall.analysis.observed.contacts import VALUES
from rockfall.language import Number, say, word
from rockfall.quantities import QUANTITIES, number, with_unit
from rockfall.table import Estimate, Table, as_text

MAX_ROWS = 12  # maximum rows of a long table


def comparison_text(comparison: Comparison) -> str:
    """Title, non-empty tables, and notes as text."""
    parts = [as_text(table, "") for table in comparison_tables(comparison)]
    return "\n\n".join([comparison.title, *parts, *notes(comparison)])


def comparison_tables(comparison: Comparison) -> Iterator[Table]:
    """Non-empty tables of the comparison."""
    errors = comparison.errors
    for caption, table, rows in (
        ("compare.lines", errors, _errors),
        ("compare.printed", errors[errors["printed_error_percent"].notna()], _printed_errors),
        ("compare.samples", comparison.ks, _ks),
        ("figures.passing_title", comparison.passing, _passing),
        ("compare.run_out", comparison.run_out, _run_out),
        ("compare.at_rest", comparison.at_rest, _at_rest),
        ("compare.stops", comparison.stops, _stops),
        ("compare.impacts", comparison.contacts, _contacts),
    ):
        if len(table):
            head, *cells = rows(table)
            yield Table.of(say(caption), head, cells)


def notes(comparison: Comparison) -> list[str]:
    """Notes below the tables."""
    judged = comparison.errors["consistent"], comparison.passing["consistent"]
    marked = any(consistent.eq(False).any() for consistent in judged)
    return [*([say("compare.exact")] if marked else []), *comparison.notes]


def _errors(table: pd.DataFrame) -> Iterable[list[Any]]:
    mean, *rest = map(word, STATISTICS)
    ours, error = (
        say("join.colon", before=before, after=mean)
        for before in (say("compare.this_run"), with_unit(say("compare.error"), "%"))
    )
    yield ["", ours, *rest, "", mean, *rest, error, *rest]
    shown = ""
    for (line, quantity, against), rows in table.groupby(
        ["line", "quantity", "against"], sort=False
    ):
        name = _name(line, quantity)
        row = rows.set_index("statistic").loc[list(STATISTICS)]
        ours, theirs = (_three(row, whose, quantity) for whose in ("simulated", "observed"))
        is_method = against not in ("observed", "sample")
        who = say("compare.method", method=against) if is_method else word(against)
        errors = (_error(row.loc[statistic]) for statistic in STATISTICS)
        first = ["", "", "", ""] if name == shown else [name, *ours]
        yield [*first, who, *theirs, *errors]
        shown = name


def _printed_errors(table: pd.DataFrame) -> Iterable[list[Any]]:
    """Published errors of the method relative to the observations (paper, table 3)."""
    head = say("compare.printed_error", method=table["against"].iloc[0])
    yield [head, *map(word, STATISTICS)]
    for (line, quantity), rows in table.groupby(["line", "quantity"], sort=False):
        errors = rows.set_index("statistic")["printed_error_percent"].reindex(STATISTICS)
        yield [_name(line, quantity), *(_number(error, "+z.0f") for error in errors)]


def _three(row: pd.DataFrame, whose: str, quantity: str) -> list[object]:
    """Cells for mean with interval, standard deviation and maximum."""
    display = QUANTITIES[quantity]
    numbers = (_rounded(display.factor * value, display.decimals, whose) for value in row[whose])
    given, *rest = numbers
    mean = Estimate.of(row.loc["mean"], whose, display.factor, decimals=display.decimals)
    return [mean if mean.has_interval or whose == "simulated" else given, *rest]


def _error(row: pd.Series) -> str:
    return Number(_number(row["error_percent"], "+z.0f") + _mark(row))


def _mark(row: Mapping[str, Any]) -> str:
    return " " if pd.isna(row["consistent"]) or row["consistent"] else "*"


def _ks(table: pd.DataFrame) -> Iterable[list[Any]]:
    level = say("compare.level", level=100 * LEVEL)
    ours, printed = (table[name].notna().any() for name in ("n_observed", "printed_p"))
    yield [
        say("compare.ks"),
        *([*map(say, SIZES), "D", "p", level] if ours else []),
        *([say("compare.printed_p"), level] if printed else []),
    ]
    for row in table.to_dict("records"):
        sizes = [_number(row[f"n_{whose}"], ",d") for whose in ("observed", "simulated")]
        tested = [*sizes, _number(row["ks_statistic"], ".3f"), *_verdict(row["p"])]
        theirs = _verdict(row["printed_p"]) if printed else ()
        yield [_name(row["line"], row["quantity"]), *(tested if ours else []), *theirs]


def _verdict(p: float) -> tuple[str, str]:
    verdict = "compare.rejected" if p < LEVEL else "compare.not_rejected"
    return _number(p, ".4f"), "-" if np.isnan(p) else say(verdict)


def _passing(table: pd.DataFrame) -> Iterable[list[Any]]:
    yield [
        with_unit(say("compare.distance"), "m"), with_unit(word("observed"), "%"),
        with_unit(say("compare.this_run"), "%"), say("compare.difference"),
    ]  # fmt: skip
    chosen = np.linspace(0, len(table) - 1, min(MAX_ROWS, len(table))).round().astype(int)
    for row in table.iloc[chosen].to_dict("records"):
        fractions = (
            Estimate.of(row, whose, 100.0, decimals=1) if np.isfinite(row[f"{whose}_high"])
            else Number(f"{100 * row[whose]:.1f}") for whose in ("observed", "simulated")
        )  # fmt: skip
        difference = Number(f"{row['difference_percent']:+z.1f}{_mark(row)}")
        yield [say("compare.or_more", distance=row["distance"]), *fractions, difference]
    if chosen.size < len(table):
        yield [say("compare.some_distances", part=chosen.size, n=len(table))]


LABELS = {  # message ids
    "mean": "compare.mean_distance",
    "std": "compare.std_of_it",
    "wasserstein": "compare.wasserstein",
    "lateral_spread": "compare.lateral_spread",
    "lateral_offset": "compare.lateral_offset",
}
SIZES = "compare.n_observed", "compare.n_this_run"


def _run_out(table: pd.DataFrame) -> Iterable[list[Any]]:
    several = table["source"].nunique() > 1
    heads = "compare.observed", "compare.this_run", "compare.difference", "compare.verdict"
    yield [say("compare.run_out_head"), *map(say, SIZES), *map(say, heads)]
    for row in table.to_dict("records"):
        name: str = say(LABELS[row["statistic"]])
        if several:
            name = say("join.colon", before=say("compare.source", name=row["source"]), after=name)
        sizes = [_number(row[f"n_{whose}"], ",d") for whose in ("observed", "simulated")]
        whose = "observed", "simulated", "difference"
        three = (Estimate.of(row, name, decimals=1) for name in whose)
        verdict = word(row["verdict"])
        if np.isfinite(row["by_chance"]):
            verdict = say("compare.up_to_by_chance", verdict=verdict, high=row["by_chance"])
        yield [name, *sizes, *three, verdict]


def _at_rest(table: pd.DataFrame) -> Iterable[list[Any]]:
    """Table of the density of simulated boulders at the observed blocks."""
    heads = "compare.outside", "compare.density", "compare.own_density", "compare.verdict"
    yield [say("compare.at_rest_head"), *map(say, SIZES), *map(say, heads)]
    for row in table.to_dict("records"):
        is_all = row["source"] == "all"
        name = say("compare.all_sources") if is_all else say("compare.source", name=row["source"])
        here, own, low = (number(1e4 * row[name]) for name in
                          ("density", "own_density", "own_density_low"))  # fmt: skip
        verdict = say("compare.down_to_by_chance", verdict=word(row["verdict"]), low=low)
        numbers = (Number(f"{row[name]:,}") for name in ("n_observed", "n_simulated", "outside"))
        yield [name, *numbers, here, own, verdict]


def ranks_text(table: pd.DataFrame) -> str:
    """Text with results ranked by their distance from the observations."""
    rows, shown = [], ""
    for row in table.to_dict("records"):
        first, last = row["rank_low"], row["rank_high"]
        rank = str(row["rank"]) if first == last else f"undecided: {first} to {last}"
        measure = "" if row["measure"] == shown else row["measure"]
        rows.append((measure, row["result"], Estimate.of(row, "distance", digits=3), rank))
        shown = row["measure"]
    heads = "distance from what was observed", "result", "distance", "rank"
    return as_text(Table.of("", heads, rows), "")


def _contacts(table: pd.DataFrame) -> Iterable[list[Any]]:
    """Count the observed impacts by the reach probability of their cells, and the speeds and
    heights above the simulated maxima there."""
    yield from _stops(table, say("compare.impacts_head"))
    for name, maps in VALUES.items():
        maximum = maps[-1]
        if {name, maximum} <= {*table.columns}:
            known_cells = table[table[name].notna() & (table["reach_probability"] > 0)]
            above = (known_cells[name] > known_cells[maximum]).sum()
            label = say("compare.above_maximum", name=word(name), n=len(known_cells))
            yield [label, Number(f"{above:,}")]


def _stops(table: pd.DataFrame, title: str = "") -> Iterable[list[Any]]:
    """Count the observed stopping places by the fraction of boulders that reach their cell."""
    reach = table["reach_probability"].to_numpy(float)
    yield [title or say("compare.stops_head"), say("compare.places")]
    for label, inside in (
        ("compare.many_pass", reach >= 0.1),
        ("compare.some_pass", (reach >= 0.01) & (reach < 0.1)),
        ("compare.few_pass", (reach > 0) & (reach < 0.01)),
        ("compare.none_passes", reach == 0),
        ("compare.off_map", np.isnan(reach)),
    ):
        yield [say(label), Number(f"{inside.sum():,}")]


def _rounded(value: float, digits: int, whose: str) -> Number:
    """Format a number with `digits` decimals; observed values lose trailing zeros."""
    text = _number(value, f".{digits}f")
    return Number(text.rstrip("0").rstrip(".")) if whose == "observed" and "." in text else text


def _name(line: str, quantity: str) -> str:
    short = QUANTITIES[quantity].short
    return say("join.colon", before=line, after=short) if line else short


def _number(value: float, digits: str) -> Number:
    return Number("-" if pd.isna(value) else format(value, digits))
