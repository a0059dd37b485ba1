# SPDX-License-Identifier: BSD-3-Clause
"""Tables of the lines of a result on a terminal, and as files."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.analysis.hazard.levels import period_table
from rockfall.analysis.line_statistics import line_statistics
from rockfall.analysis.lines.profile import line_profile
from rockfall.analysis.population import scenario_note
from rockfall.analysis.return_levels import return_levels
from rockfall.case import case_of
from rockfall.case.files import files_behind
from rockfall.errors import RockfallError
from rockfall.files.hazard_files import read_hazard
from rockfall.io.output_files import atomic_folder, check_output
from rockfall.io.tables import write_csv
from rockfall.language import say
from rockfall.plots.along_figures import line_profile_figure
from rockfall.plots.style import save
from rockfall.protection.yearly import YEARS
from rockfall.quantities import QUANTITIES, number
from rockfall.result.crossings import line_names
from rockfall.result.dataset import read_result
from rockfall.result.samples import is_ensemble, kept_note, simulated
from rockfall.simulation.progress import add_steps
from rockfall.table import as_text
from rockfall.tables.dossier import answer_table, places_of
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
from rockfall.text.summary import MOST_LINES, more_lines

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

ABOUT = """\
Below each number its 95 % confidence interval; (–) where too few boulders pass for one that holds.
The std of the position along the line is the lateral spread. The maximum grows with the number of
boulders. 1 in N: the level that one in N of the boulders that pass exceeds, from the sample where
25 or more boulders exceed it, else from a generalised Pareto tail of the boulders above the
threshold."""
BY_GROUP = "In brackets 95 % confidence intervals; fractions are of the boulders of the group."
ALONG = """\
In brackets 95 % confidence intervals. Fractions are of all boulders; each counts where it first
crosses the line."""


def print_lines(path: str | Path, table: str | Path | None = None) -> None:
    """Print both tables of a result; with `table`, a CSV file, write line_statistics to it and
    return_levels next to it as NAME_levels.csv, in the units of the result."""
    result, places = open_lines(path, table, "", "_levels.csv")
    shown = None if table else range(min(MOST_LINES, len(line_names(result))))
    add_steps(2 * len(line_names(result) if shown is None else shown))
    statistics, levels = line_statistics(result, lines=shown), return_levels(result, lines=shown)
    print("\n".join([*scenario_note(case_of(result)), *_text(statistics, levels, result)]))
    if is_ensemble(result):
        print("", ensemble_summary(result), sep="\n")
    write_tables(path, result, dict(zip(places, [statistics, levels], strict=False)))


def print_hazard(path: str | Path, table: str | Path | None = None) -> None:
    """Print frequencies, energies and heights by return period at the lines, objects and segments
    of a hazard; with `table`, a CSV file, write them to it."""
    place, hazard = table and _csv(Path(table)), read_hazard(path)
    if not places_of(hazard):
        raise RockfallError(f"{path}: has no lines, objects or segments")
    if place:
        check_output(place, [Path(path), *files_behind(hazard)])
    print(say("hazard.population"))
    for shown in (answer_table(hazard, YEARS), *period_tables(hazard)):
        print("", shown.caption, as_text(shown), sep="\n")
    if place:
        write_csv(period_table(hazard), place)
        print(place)


def print_groups(
    path: str | Path,
    by: str,
    classes: Sequence[float] | None = None,
    table: str | Path | None = None,
) -> None:
    """Print the boulders that pass the lines of a result by source, class of volume or block
    shape; with `table`, a CSV file, write line_statistics of these groups to it."""
    result, places = open_lines(path, table, "")
    statistics = line_statistics(result, by, classes)
    print(*scenario_note(case_of(result)), BY_GROUP, sep="\n")
    for group in group_tables(statistics, by):
        print("", group.caption, as_text(group), sep="\n")
    write_tables(path, result, dict(zip(places, [statistics], strict=False)))


def print_profile(
    path: str | Path, line: str, width: float | None = None, table: str | Path | None = None
) -> None:
    """Print the boulders that pass each window of a line of a result; with `table`, a CSV file,
    write them to it, and a figure next to it as NAME.png."""
    result, places = open_lines(path, table, "", ".png")
    profile = line_profile(result, line, width)
    head = [*scenario_note(case_of(result)), ALONG, *filter(None, [kept_note(result)])]
    print("\n".join([*head, "", line, as_text(profile_table(profile))]))
    made = [profile, lambda part: save(line_profile_figure(profile), part)]
    write_tables(path, result, dict(zip(places, made, strict=False)))


def open_lines(
    path: str | Path, table: str | Path | None, *endings: str
) -> tuple[xr.Dataset, list[Path]]:
    """Result with lines, and the paths of its tables: `table` for the ending "", and files with the
    same name and other endings; refused before the work if they may not be written. No paths
    without `table`."""
    first = table and _csv(Path(table))
    result = read_result(path)
    if not line_names(result):
        raise RockfallError(f"{path}: has no evaluation lines")
    if not first:
        return result, []
    places = [first.with_name(first.stem + (end or first.suffix)) for end in endings]
    for place in places:
        check_output(place, [Path(path), *files_behind(result)])
    return result, places


def write_tables(path: str | Path, result: xr.Dataset, made: Mapping[Path, Any]) -> None:
    """Write tables, or objects that write themselves to a path, all or none, and print the
    paths."""
    if not made:
        return
    with atomic_folder(next(iter(made)).parent, [Path(path), *files_behind(result)]) as part:
        for place, table in made.items():
            table(part / place.name) if callable(table) else write_csv(table, part / place.name)
    print(*made, sep="\n")


def _csv(path: Path) -> Path:
    if path.suffix.lower() != ".csv":
        raise RockfallError(f"{path}: must be a file name that ends in .csv")
    return path


def _text(statistics: pd.DataFrame, levels: pd.DataFrame, result: xr.Dataset) -> Iterator[str]:
    """Both tables, line after line, of the first ones."""
    boulders = simulated(result)
    yield ABOUT
    rows = rows_in(statistics)
    for line, numbers in itertools.islice(rows.items(), MOST_LINES):
        first = numbers["speed"]
        fraction = estimate(first, "fraction", "fraction")
        of_all = f"{first['n']:,} of {boulders:,} boulders, {fraction.number} % {fraction.interval}"
        yield f"\n{line}: {of_all}"
        for table in line_tables({line: numbers}, short=True):
            tails = levels[levels["line"] == line]
            yield from (as_text(table), as_text(level_table(tails, short=True)))
            yield from _bounded(tails)
            yield from _refused(tails)
    yield from more_lines(len(line_names(result)))


def _bounded(tails: pd.DataFrame) -> Iterator[str]:
    """Upper end points of tails."""
    for _, row in tails[np.isfinite(tails["end"])].iterrows():
        display = QUANTITIES[row["quantity"]]
        end, high = (number(display.factor * row[limit], 4) for limit in ("end", "end_high"))
        yield f"  bounded: {display.label} ends at {end} {display.unit}, 95 % interval up to {high}"


def _refused(tails: pd.DataFrame) -> Iterator[str]:
    """Reasons for refusal, each with its quantities."""
    for reason, rows in tails[tails["refused"] != ""].groupby("refused", sort=False):
        names = ", ".join(QUANTITIES[quantity].name for quantity in rows["quantity"])
        yield f"  refused: {reason} ({'all' if len(rows) == len(tails) else names})"
