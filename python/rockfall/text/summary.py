# SPDX-License-Identifier: BSD-3-Clause
"""Short summary of a run."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from rockfall.analysis.line_statistics import numbers
from rockfall.analysis.lines.samples import LineSamples
from rockfall.analysis.precision.intervals import longer_side
from rockfall.analysis.validity.remarks import model_remarks
from rockfall.case import case_of
from rockfall.protection.barriers import barrier_rows, barriers_of
from rockfall.protection.dams import dams_of
from rockfall.protection.stands import stands_of
from rockfall.quantities import QUANTITIES, TOO_FEW, Quantity, percent
from rockfall.result.crossings import line_names
from rockfall.result.grounds import GroundRebounds, rebounds_by_ground
from rockfall.result.samples import kept_note, simulated
from rockfall.result.trajectories import ended
from rockfall.studies.run_until import verdicts_of
from rockfall.text.dams import dam_lines
from rockfall.text.stands import stand_lines
from rockfall.text.table import MOST_LINES, more_lines, table

if TYPE_CHECKING:
    from rockfall.result.contents import Held


def summary(result: Held) -> str:
    """Number of boulders, outcomes, passages at the lines, and warnings."""
    boulders, rows = simulated(result), result.sizes["boulder"]
    lines = [f"{result.attrs['title'] or 'rockfall'}: {boulders:,} boulders"]
    if rows < boulders:
        lines[0] += f", rows of {rows:,} kept"
    lines.append(table(_ends(result)))
    if "line" in result:
        lines += [table(_passages(result)), *more_lines(result.sizes["line"])]
    if barriers_of(result) and rows:
        lines.append(table(_barriers(result)))
        lines += [f"  {note}" for note in filter(None, [kept_note(result)])]
    elif barriers_of(result):
        lines.append("  barriers: outcomes need rows, and &output kept = 'none' keeps none")
    lines += [f"  {name}: {line}" for name, line in dam_lines(dams_of(result))]
    lines += [f"  {line}" for line in stand_lines(stands_of(result))]
    lines += [f"  until {verdict}" for verdict in verdicts_of(result)]
    lines += _rebounds(result)
    if grounds := rebounds_by_ground(result):
        lines.append(table(_grounds(grounds)))
    wall, cpu = (result.attrs[f"{clock}_seconds"] for clock in ("wall", "cpu"))
    lines.append(f"  {wall:.1f} s, {cpu:.1f} s of CPU")
    return "\n".join(lines)


def _ends(result: Held) -> Iterator[list[str]]:
    """Fraction of the boulders with each status."""
    boulders = simulated(result)
    for word, n in ended(result).items():
        if n:
            yield [f"  {word.replace('_', ' ')}", f"{n:,}", f"{n / boulders:.1%}"]


def _passages(result: Held) -> Iterator[list[str]]:
    """Boulders at the first lines, their mean speed and passing height, with 95 % intervals."""
    shown = "speed", "passing_height"
    yield [
        "  line (95 %)",
        "boulders",
        "fraction",
        *(f"mean {key.replace('_', ' ')}" for key in shown),
    ]
    samples = LineSamples(result)
    for k, name in enumerate(line_names(result)[:MOST_LINES]):
        rows = {key: numbers(samples.sample(k, key), key) for key in shown}
        passed = rows["speed"]
        if not passed["n"]:
            yield [f"  {name}", "0", f"0 to {100 * passed['fraction_high']:.2g} %", "", ""]
            continue
        means = (_within(row, "mean", QUANTITIES[key]) for key, row in rows.items())
        fraction = _within(passed, "fraction", QUANTITIES["fraction"])
        yield [f"  {name}", f"{passed['n']:,}", fraction, *means]


def _barriers(result: Held) -> Iterator[list[str]]:
    """Performance of each barrier on the boulders that reached it, with 95 % intervals."""
    yield ["  barrier (95 %)", "outcome", "boulders", "fraction"]
    for row in barrier_rows(result):
        outcome, fraction = row["outcome"].replace("_", " "), QUANTITIES["fraction"]
        yield [f"  {row['barrier']}", outcome, f"{row['n']:,}", _within(row, "fraction", fraction)]


def _within(row: dict[str, float], name: str, display: Quantity) -> str:
    """Number and the longer side of its interval, or a note that it has none."""
    value, decimals = display.factor * row[name], display.decimals
    half = display.factor * longer_side(row, name)
    if math.isnan(half):
        return f"{value:.{decimals}f} {display.unit} ({TOO_FEW})"
    if 0 < half < 10**-decimals:  # two digits instead of +- 0.0
        decimals = 1 - math.floor(math.log10(half))
    return f"{value:.{decimals}f} +- {half:.{decimals}f} {display.unit}"


def _grounds(grounds: list[GroundRebounds]) -> Iterator[list[str]]:
    """Rebounds by ground."""
    yield ["  ground", "rebounds", "fraction", "model"]
    for name, model, rebounds, fraction, _ in grounds:
        yield [f"  {name}", f"{rebounds:,}", percent(fraction), model.replace("_", " ")]


def _rebounds(result: Held) -> Iterator[str]:
    """Statistics of the draws of the impact model, and extrapolation."""
    rebounds, redrawn, forced = (
        int(result[f"rebounds{suffix}"].values) for suffix in ("", "_redrawn", "_forced")
    )
    yield f"  {rebounds:,} rebounds" + (f", {redrawn / rebounds:.1%} redrawn" if redrawn else "")
    if forced:
        yield f"  {forced:,} rebounds limited: they would gain energy or enter the ground"
    yield from remark_lines(result)


def remark_lines(result: Held) -> Iterator[str]:
    """Remarks on the model of a run, warnings marked."""
    for remark in model_remarks(result, case_of(result)):
        yield f"  {'warning: ' if remark.is_warning else ''}{remark.text}"
