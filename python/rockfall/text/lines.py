# SPDX-License-Identifier: BSD-3-Clause
"""Line tables of a result as text."""

from collections.abc import Iterator

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.lines.samples import worst_lines
from rockfall.analysis.population import scenario_note
from rockfall.case import case_of
from rockfall.language import say
from rockfall.protection.yearly import YEARS
from rockfall.quantities import QUANTITIES, number
from rockfall.result.crossings import MOST_LINES, line_names
from rockfall.result.samples import is_ensemble, kept_note, simulated
from rockfall.table import as_text
from rockfall.tables.dossier import answer_table
from rockfall.tables.ensemble import ensemble_summary
from rockfall.tables.hazard import period_tables
from rockfall.tables.lines import (
    estimate,
    group_tables,
    level_table,
    line_tables,
    profile_table,
    rows_in,
)
from rockfall.text.summary import more_lines

ABOUT = """\
Below each value: its 95 % confidence interval; (–): too few boulders pass for a valid interval. The
std of the position along the line is the lateral spread. The maximum grows with the number of
boulders. 1 in N: level that one in N passing boulders exceeds, from the sample if 25 or more
boulders exceed it, else from a generalised Pareto tail of the boulders above the threshold."""
BY_GROUP = "Brackets: 95 % confidence intervals. Fractions refer to the boulders of the group."
ALONG = """\
Brackets: 95 % confidence intervals. Fractions refer to all boulders; each counts where it first
crosses the line; per metre of the line on the terrain."""

UNCHECKED = (
    "The line was not checked by the run, so the passing per metre is unknown: run it again."
)


def lines_text(statistics: pd.DataFrame, levels: pd.DataFrame, result: xr.Dataset) -> str:
    """Text with statistics and return levels for the worst lines of a result."""
    shown = [*scenario_note(case_of(result)), ABOUT, *_by_line(statistics, levels, result)]
    if is_ensemble(result):
        shown += ["", ensemble_summary(result)]
    return "\n".join(shown)


def hazard_text(hazard: xr.Dataset) -> str:
    """Text lines with frequencies, energies and heights by return period at places of a hazard."""
    tables = (answer_table(hazard, YEARS), *period_tables(hazard))
    blocks = [f"\n{table.caption}\n{as_text(table)}" for table in tables]
    return "\n".join([say("hazard.population"), *blocks])


def groups_text(statistics: pd.DataFrame, by: str, result: xr.Dataset) -> str:
    """Text lines on boulders that pass the lines of a result, grouped by source, volume class or
    block shape."""
    blocks = [f"\n{group.caption}\n{as_text(group)}" for group in group_tables(statistics, by)]
    return "\n".join([*scenario_note(case_of(result)), BY_GROUP, *blocks])


def profile_text(profile: pd.DataFrame, line: str, result: xr.Dataset) -> str:
    """Text lines on boulders that pass each window of a line."""
    unknown = UNCHECKED if profile["length"].isna().any() else ""
    notes = [*scenario_note(case_of(result)), ALONG, *filter(None, [unknown, kept_note(result)])]
    return "\n".join([*notes, "", line, as_text(profile_table(profile))])


def _by_line(statistics: pd.DataFrame, levels: pd.DataFrame, result: xr.Dataset) -> Iterator[str]:
    boulders = simulated(result)
    rows = rows_in(statistics)
    names = line_names(result)
    for line in (names[k] for k in worst_lines(result, MOST_LINES)):
        numbers = rows[line]
        first = numbers["speed"]
        fraction = estimate(first, "fraction", "fraction")
        of_all = f"{first['n']:,} of {boulders:,} boulders, {fraction.number} % {fraction.interval}"
        yield f"\n{line}: {of_all}"
        for table in line_tables({line: numbers}, short=True):
            tails = levels[levels["line"] == line]
            yield from (as_text(table), as_text(level_table(tails, short=True)))
            yield from _bounded(tails)
            yield from _refused(tails)
    yield from more_lines(len(names))


def _bounded(tails: pd.DataFrame) -> Iterator[str]:
    """Sentence on tails with an upper end point."""
    for _, row in tails[np.isfinite(tails["end"])].iterrows():
        display = QUANTITIES[row["quantity"]]
        end, high = (number(display.factor * row[limit], 4) for limit in ("end", "end_high"))
        yield f"  bounded: {display.label} ends at {end} {display.unit}, 95 % interval up to {high}"


def _refused(tails: pd.DataFrame) -> Iterator[str]:
    """Reasons for missing return levels, each with its quantities."""
    for reason, rows in tails[tails["refused"] != ""].groupby("refused", sort=False):
        names = ", ".join(QUANTITIES[quantity].name for quantity in rows["quantity"])
        yield f"  refused: {reason} ({'all' if len(rows) == len(tails) else names})"
