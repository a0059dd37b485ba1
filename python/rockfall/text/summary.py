# SPDX-License-Identifier: BSD-3-Clause
"""Short summary of a run."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rockfall.analysis.line_statistics import numbers as line_row
from rockfall.analysis.lines.samples import LineSamples, worst_lines
from rockfall.analysis.population import scenario_note
from rockfall.analysis.validity.remarks import model_remarks
from rockfall.case import case_of
from rockfall.protection.barriers import barriers_of
from rockfall.protection.recorded import dams_of, stands_of
from rockfall.quantities import QUANTITIES
from rockfall.result.crossings import MOST_LINES, line_names
from rockfall.result.samples import kept_note, simulated
from rockfall.studies.run_until import verdicts_of
from rockfall.table import Column, Table, as_text
from rockfall.tables.lines import estimate
from rockfall.tables.run import (
    barrier_table,
    dam_tables,
    ends_table,
    ground_table,
    stand_tables,
)

if TYPE_CHECKING:
    from rockfall.result.contents import Held

MOST_STANDS = 12
#: Note on a terrain without a CRS.
NO_CRS = (
    "the DEM has no CRS: layers are read in its coordinates, results have none: set it with "
    "rockfall dem DEM --crs EPSG:2056 -o NEW"
)
AT_LINES = "speed", "passing_height"


def summary(result: Held) -> str:
    """Number of boulders, outcomes, passages at lines, and warnings."""
    boulders, rows = simulated(result), result.sizes["boulder"]
    lines = [f"{result.attrs['title'] or 'rockfall'}: {boulders:,} boulders"]
    if rows < boulders:
        lines[0] += f", rows of {rows:,} kept"
    lines += [f"  {note}" for note in scenario_note(case_of(result))]
    lines.append(as_text(ends_table(result)))
    if "line" in result:
        lines += [as_text(_passages(result)), *more_lines(result.sizes["line"])]
    if barriers_of(result) and rows:
        lines.append(as_text(barrier_table(result)))
        lines += [f"  {note}" for note in filter(None, [kept_note(result)])]
    elif barriers_of(result):
        lines.append("  barriers: outcomes require rows, but &output kept = 'none' keeps none")
    shown = (*dam_tables(dams_of(result)), *stand_tables(stands_of(result), MOST_STANDS))
    lines += map(as_text, shown)
    lines += [f"  until {verdict}" for verdict in verdicts_of(result)]
    lines += _rebounds(result)
    if "rebounds_by_ground" in result:
        lines.append(as_text(ground_table(result)))
    wall, cpu = (result.attrs[f"{clock}_seconds"] for clock in ("wall", "cpu"))
    lines.append(f"  {wall:.1f} s, {cpu:.1f} s of CPU")
    return "\n".join(lines)


def _passages(result: Held) -> Table:
    """Table of the boulders at the worst lines, with mean speed and passing height."""
    samples, rows, names = LineSamples(result), [], line_names(result)
    for k in worst_lines(result, MOST_LINES):
        numbers = {key: line_row(samples.sample(k, key), key) for key in AT_LINES}
        passed = numbers["speed"]
        fraction = estimate(passed, "fraction", "fraction")
        means = (estimate(row, "mean", key) if row["n"] else "" for key, row in numbers.items())
        rows.append((names[k], int(passed["n"]), fraction, *means))
    heads = (Column.of(QUANTITIES[key], "mean") for key in AT_LINES)
    fraction_head = QUANTITIES["fraction"].title
    return Table.of("", ("line (95 %)", "boulders", fraction_head, *heads), rows)


def more_lines(lines: int) -> list[str]:
    """Note on the number of omitted lines, and where to find them; empty if none are omitted."""
    more = lines - MOST_LINES
    return [f"  and {more:,} more: `rockfall lines OUT.nc -o FILE.csv` writes all"] * (more > 0)


def _rebounds(result: Held) -> Iterator[str]:
    """Text lines on rebounds, model remarks, and a missing CRS."""
    rebounds, redrawn, forced = (
        int(result[f"rebounds{suffix}"].values) for suffix in ("", "_redrawn", "_forced")
    )
    yield f"  {rebounds:,} rebounds" + (f", {redrawn / rebounds:.1%} redrawn" if redrawn else "")
    if forced:
        yield f"  {forced:,} rebounds limited: they would gain energy or enter the ground"
    yield from remark_lines(result)
    if not result["crs"].attrs.get("crs_wkt"):
        yield f"  note: {NO_CRS}"


def remark_lines(result: Held) -> Iterator[str]:
    """Model remarks of a run, with their grades."""
    for remark in model_remarks(result, case_of(result)):
        yield f"  {remark.grade}: {remark.text}"
