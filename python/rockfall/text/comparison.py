# SPDX-License-Identifier: BSD-3-Clause
"""Text output of a comparison for a terminal; +- is half of a 95 % interval."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.analysis.compare import STATISTICS, Comparison
from rockfall.analysis.contacts import VALUES
from rockfall.analysis.precision.intervals import longer_side
from rockfall.quantities import QUANTITIES, TOO_FEW, number
from rockfall.text.table import table as aligned

if TYPE_CHECKING:
    import pandas as pd

LEVEL = 0.05  # a smaller p rejects that two samples have one distribution
MAX_ROWS = 12  # of a long table
EXACT = "* significant at 5 %; a printed number without n is taken as exact"


def text(comparison: Comparison) -> str:
    """Title, the tables that are not empty, notes."""
    parts = [aligned(rows) for _, rows in tables(comparison)]
    return "\n\n".join([comparison.title, *parts, *notes(comparison)])


def tables(comparison: Comparison) -> Iterator[tuple[str, list[list[str]]]]:
    """Non-empty tables: a caption, and rows, the first of which is the header."""
    errors = comparison.errors
    for caption, table, rows in (
        ("Numbers at the lines", errors, _errors),
        ("Errors as printed", errors[errors["printed_error_percent"].notna()], _printed_errors),
        ("Samples at the lines", comparison.ks, _ks),
        ("Boulders that pass a distance", comparison.passing, _passing),
        ("Run-out", comparison.run_out, _run_out),
        ("Blocks at rest", comparison.at_rest, _at_rest),
        ("Stopping places", comparison.stops, _stops),
        ("Impacts", comparison.contacts, _contacts),
    ):
        if len(table):
            yield caption, list(rows(table))


def notes(comparison: Comparison) -> list[str]:
    """Notes for readers of the tables."""
    judged = comparison.errors["consistent"], comparison.passing["consistent"]
    marked = any(consistent.eq(False).any() for consistent in judged)
    return [*([EXACT] if marked else []), *comparison.notes]


def _errors(table: pd.DataFrame) -> Iterable[list[str]]:
    _, *rest = STATISTICS
    yield ["", "this run: mean", *rest, "", *STATISTICS, "error [%]: mean", *rest]
    shown = ""
    for (line, quantity, against), rows in table.groupby(
        ["line", "quantity", "against"], sort=False
    ):
        name = _name(line, quantity)
        row = rows.set_index("statistic").loc[list(STATISTICS)]
        ours, theirs = (_three(row, whose, quantity) for whose in ("simulated", "observed"))
        who = against if against in ("observed", "sample") else f"method {against}"
        errors = (_error(row.loc[one]) for one in STATISTICS)
        first = ["", "", "", ""] if name == shown else [name, *ours]
        yield [*first, who, *theirs, *errors]
        shown = name


def _printed_errors(table: pd.DataFrame) -> Iterable[list[str]]:
    """Errors of a paper's own method relative to the observations (its table 3)."""
    yield [f"error of method {table['against'].iloc[0]} as printed [%]", *STATISTICS]
    for (line, quantity), rows in table.groupby(["line", "quantity"], sort=False):
        errors = rows.set_index("statistic")["printed_error_percent"].reindex(STATISTICS)
        yield [_name(line, quantity), *(_number(error, "+z.0f") for error in errors)]


def _three(row: pd.DataFrame, whose: str, quantity: str) -> list[str]:
    """Mean with the longer side of its interval, standard deviation, maximum."""
    about = QUANTITIES[quantity]
    numbers = (_rounded(about.factor * value, about.decimals, whose) for value in row[whose])
    mean, *rest = numbers
    half = about.factor * longer_side(row.loc["mean"], whose)
    if not np.isnan(half):
        mean += f" +- {half:.{about.decimals}f}"
    elif whose == "simulated" and mean != "-":
        mean += f" ({TOO_FEW})"
    return [mean, *rest]


def _error(row: pd.Series) -> str:
    return _number(row["error_percent"], "+z.0f") + _mark(row)


def _mark(row: Mapping[str, Any]) -> str:
    import pandas as pd

    return " " if pd.isna(row["consistent"]) or row["consistent"] else "*"


def _ks(table: pd.DataFrame) -> Iterable[list[str]]:
    level = f"at {100 * LEVEL:.0f} %"
    ours, printed = (table[name].notna().any() for name in ("n_observed", "printed_p"))
    yield [
        "Kolmogorov-Smirnov",
        *(["n observed", "n this run", "D", "p", level] if ours else []),
        *(["printed p", level] if printed else []),
    ]
    for row in table.to_dict("records"):
        sizes = [_number(row[f"n_{whose}"], ",d") for whose in ("observed", "simulated")]
        tested = [*sizes, _number(row["ks_statistic"], ".3f"), *_verdict(row["p"])]
        theirs = _verdict(row["printed_p"]) if printed else ()
        yield [_name(row["line"], row["quantity"]), *(tested if ours else []), *theirs]


def _verdict(p: float) -> tuple[str, str]:
    verdict = "rejected" if p < LEVEL else "not rejected"
    return _number(p, ".4f"), "-" if np.isnan(p) else verdict


def _passing(table: pd.DataFrame) -> Iterable[list[str]]:
    yield ["distance [m]", "observed [%]", "this run [%]", "difference"]
    chosen = np.linspace(0, len(table) - 1, min(MAX_ROWS, len(table))).round().astype(int)
    for row in table.iloc[chosen].to_dict("records"):
        fractions = []
        for whose in "observed", "simulated":
            half = 100 * longer_side(row, whose)
            fraction = f"{100 * row[whose]:.1f}"
            fractions.append(fraction if np.isnan(half) else f"{fraction} +- {half:.1f}")
        difference = f"{row['difference_percent']:+z.1f}{_mark(row)}"
        yield [f"{row['distance']:.1f} or more", *fractions, difference]
    if chosen.size < len(table):
        yield [f"({chosen.size} of {len(table)} distances)"]


LABELS = {
    "mean": "mean stopping distance [m]",
    "std": "its standard deviation [m]",
    "wasserstein": "Wasserstein distance [m]",
    "lateral_spread": "lateral spread, std [m]",
    "lateral_offset": "lateral offset, mean [m]",
}


def _run_out(table: pd.DataFrame) -> Iterable[list[str]]:
    several = table["source"].nunique() > 1
    yield ["run-out", "n observed", "n this run", "observed", "this run", "difference", "verdict"]
    for row in table.to_dict("records"):
        name = LABELS[row["statistic"]]
        name = f"source {row['source']}: {name}" if several else name
        sizes = [_number(row[f"n_{whose}"], ",d") for whose in ("observed", "simulated")]
        three = [_within(row, whose) for whose in ("observed", "simulated", "difference")]
        verdict = row["verdict"]
        if np.isfinite(row["by_chance"]):
            verdict += f" (up to {row['by_chance']:.1f} by chance)"
        yield [name, *sizes, *three, verdict]


def _at_rest(table: pd.DataFrame) -> Iterable[list[str]]:
    """Density of simulated boulders at the blocks."""
    yield ["blocks at rest", "n observed", "n this run", "outside of all deposits",
           "density of this run there [1/ha]", "at its own boulders", "verdict"]  # fmt: skip
    for row in table.to_dict("records"):
        name = "all sources" if row["source"] == "all" else f"source {row['source']}"
        here, own, low = (number(1e4 * row[of]) for of in
                          ("density", "own_density", "own_density_low"))  # fmt: skip
        verdict = f"{row['verdict']} (down to {low} by chance)"
        yield [name, *(f"{row[of]:,}" for of in ("n_observed", "n_simulated", "outside")), here,
               own, verdict]  # fmt: skip


def _within(row: Mapping[str, Any], name: str) -> str:
    """A number with its interval."""
    value, low, high = (row[f"{name}{end}"] for end in ("", "_low", "_high"))
    if np.isnan(value):
        return "-"
    return f"{value:.1f} ({TOO_FEW if np.isnan(low) else f'{low:.1f} to {high:.1f}'})"


def ranks_text(table: pd.DataFrame) -> str:
    """Results by their distance from the observations."""
    return aligned(_ranks(table))


def _ranks(table: pd.DataFrame) -> Iterable[list[str]]:
    yield ["distance from what was observed", "result", "distance", "95 % interval", "rank"]
    shown = ""
    for row in table.to_dict("records"):
        value, low, high = (number(row[f"distance{end}"]) for end in ("", "_low", "_high"))
        first, last = row["rank_low"], row["rank_high"]
        rank = str(row["rank"]) if first == last else f"undecided: {first} to {last}"
        measure = "" if row["measure"] == shown else row["measure"]
        yield [measure, row["result"], value, f"{low} to {high}", rank]
        shown = row["measure"]


def _contacts(table: pd.DataFrame) -> Iterable[list[str]]:
    """Observed impacts by reach; speeds and heights with the maxima of their cells."""
    yield from _stops(table, "observed impacts in cells that")
    for name, maps in VALUES.items():
        maximum = maps[-1]
        if {name, maximum} <= {*table.columns}:
            known = table[table[name].notna() & (table["reach_probability"] > 0)]
            above = (known[name] > known[maximum]).sum()
            label = f"{name} above the maximum of all that pass, of {len(known):,} known"
            yield [label, f"{above:,}"]


def _stops(
    table: pd.DataFrame, title: str = "observed stopping places in cells that"
) -> Iterable[list[str]]:
    """Observed places by the fraction of the boulders that reach their cell."""
    reach = table["reach_probability"].to_numpy(float)
    yield [title, "places"]
    for label, inside in (
        ("10 % of the boulders or more pass", reach >= 0.1),
        ("1 to 10 % pass", (reach >= 0.01) & (reach < 0.1)),
        ("less than 1 % pass", (reach > 0) & (reach < 0.01)),
        ("none passes", reach == 0),
        ("lie outside of the map", np.isnan(reach)),
    ):
        yield [label, f"{inside.sum():,}"]


def _rounded(value: float, digits: int, whose: str) -> str:
    """Number rounded to its given digits if observed, else to `digits`."""
    text = _number(value, f".{digits}f")
    return text.rstrip("0").rstrip(".") if whose == "observed" and "." in text else text


def _name(line: str, quantity: str) -> str:
    short = QUANTITIES[quantity].short
    return f"{line}: {short}" if line else short


def _number(value: float, digits: str) -> str:
    import pandas as pd

    return "-" if pd.isna(value) else format(value, digits)
