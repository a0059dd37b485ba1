# SPDX-License-Identifier: BSD-3-Clause
"""Page 1 of a report: the question, the answer from the numbers at the lines, and its certainty."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.ensemble.study import is_ensemble
from rockfall.analysis.lines.samples import LineSamples
from rockfall.analysis.precision.intervals import half_width
from rockfall.analysis.run_until import verdicts_of
from rockfall.case import case_of
from rockfall.html_report.intervals import TOO_FEW, estimate, in_unit
from rockfall.html_report.tables import Table
from rockfall.protection.barriers import barriers_of
from rockfall.quantities import count, number, percent
from rockfall.result.samples import has_rows, simulated
from rockfall.result.trajectories import ended

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.html_report.intervals import Numbers, Rows

HEADLINE = {  # of the table on page 1: quantity and number
    "boulders that pass [%]": ("fraction", "fraction"),
    "total kinetic energy, 95 % quantile [kJ]": ("energy_total", "q95"),
    "passing height, 95 % quantile [m]": ("passing_height", "q95"),
    "speed, 95 % quantile [m/s]": ("speed", "q95"),
}
ENDED = {  # of the statuses
    "stopped": "came to rest on the slope",
    "absorbed": "ended where the ground absorbs boulders",
    "left_domain": "left the terrain model",
    "hit_nodata": "met terrain without elevation",
    "impact_limit": "reached the limit of contacts and were ended there",
    "stopped_by_tree": "were stopped by trees",
    "stopped_by_barrier": "were stopped by barriers",
}


def question(rows: Rows, has_hazard: bool) -> str:
    """Question that the report answers."""
    if has_hazard:
        return "Which areas and objects are endangered, how much, and how certain is that?"
    if rows:
        return (
            "How many of the released boulders reach the lines and barriers, and with which "
            "energy, height and speed?"
        )
    return "How far do the released boulders come?"


def answers(result: xr.Dataset, rows: Rows) -> list[str]:
    """A sentence for each line; the run-out if there is none."""
    nets = {str(result["line"].values[k]) for k in barriers_of(result)}
    return [*(_line(line, rows[line], line in nets) for line in rows), *run_out(result)]


def _line(line: str, numbers: Numbers, is_barrier: bool) -> str:
    """Sentence on the boulders that pass a line, or reach a barrier."""
    row = numbers["speed"]
    one, many = ("comes to it", "come to it") if is_barrier else ("passes", "pass")
    if not row["n"]:
        high = in_unit(row["fraction_high"], "fraction")
        return f"{line}: no boulder {one}; the fraction is below {high} %, with 95 % confidence."
    text = f"{line}: {estimate(row, 'fraction', 'fraction')[0]} % of the boulders {many}"
    energy, height = (
        estimate(numbers[of], "q95", of)[0] for of in ("energy_total", "passing_height")
    )
    if row["n"] == 1 or "-" in (energy, height):
        return f"{text}."
    return (
        f"{text}; of these one in 20 has more than {energy} kJ, and one in 20 is higher than "
        f"{height} m above the ground."
    )


def headline(rows: Rows) -> Table:
    """Key numbers at the lines for decisions, with their intervals."""
    shown = []
    for line, numbers in rows.items():
        cells = []
        for quantity, name in HEADLINE.values():
            row = numbers["speed" if quantity == "fraction" else quantity]
            cells.append("\n".join(estimate(row, name, quantity)).strip())
        shown.append((line, *cells))
    caption = "Boulders at the lines and barriers, with 95 % confidence intervals"
    return Table(caption, ("line or barrier", *HEADLINE), shown)


def run_out(result: xr.Dataset) -> Iterator[str]:
    """Sentences on the run-out in plan."""
    distance = LineSamples(result).ends("plan_distance")
    if not distance.max():
        yield "No boulder left its place."
    elif distance.n == 1:
        yield f"The run-out of the boulder in plan is {number(distance.max())} m."
    else:
        half, far = (number(one) for one in distance.quantile([0.5, 0.95]))
        yield (
            f"Run-out in plan: half of the boulders come farther than {half} m, one in 20 farther "
            f"than {far} m, the farthest {number(distance.max())} m."
        )


def certainty(result: xr.Dataset, rows: Rows, is_inside: bool) -> Iterator[str]:
    """Sentences on the certainty of the answer: the Monte Carlo error, and what it does not
    include."""
    boulders, known = simulated(result), LineSamples(result)
    shown = [[*map(str, row)] for row in headline(rows).rows]
    if is_ensemble(result):  # the answer is the range of the draws
        of = count(known.sources, "source")
        yield f"{boulders:,} boulders from {of} were simulated in each run."
        yield (
            "The ranges of the draws hold the uncertain inputs and the Monte Carlo error, and no "
            "error of the model."
        )
        return
    if boulders == 1:
        yield "One boulder is an example: it has no spread, and no intervals."
    else:
        of = count(known.sources, "source")
        yield (
            f"{boulders:,} boulders from {of} were simulated. Brackets are 95 % confidence "
            "intervals of the Monte Carlo error: what more boulders would change."
        )
        if any("(from" in cell or "(up to" in cell for row in shown for cell in row):
            yield "Where only one limit is given, too few boulders pass for the other."
        if any(TOO_FEW in cell for row in shown for cell in row):
            yield "A dash in brackets: too few boulders pass for an interval that holds."
        if known.sampled:
            yield "The sources are taken for a sample of others like them."
    crossed = [numbers["speed"] for numbers in rows.values() if numbers["speed"]["n"]]
    widths = [half_width(row, "fraction") for row in crossed]
    if widths and np.isfinite(worst := max(widths)) and boulders > 1:
        yield f"The fractions that pass are known to ± {percent(worst)} of themselves or better."
    yield "The brackets hold no error of the terrain, the ground, the volumes or the model."
    if is_inside:
        yield "No large part of the run lies outside the range of the model."


def ends_table(result: xr.Dataset) -> Table:
    """Table of the outcomes of boulders."""
    boulders = simulated(result)
    rows = [
        (ENDED[name], f"{n:,}", percent(n / boulders)) for name, n in ended(result).items() if n
    ]
    return Table("How boulders ended", ("", "boulders", "fraction"), rows)


def angle(result: xr.Dataset) -> Iterator[str]:
    """Sentences on the slope of straight lines from release to end."""
    if not has_rows(result):
        return
    drop = result["start_z"].values - result["stop_z"].values
    distance = result["plan_distance"].values
    moved = distance > 0
    if moved.any():
        angles = np.degrees(np.arctan2(drop[moved], distance[moved]))
        yield (
            f"The straight line from release to end falls by {number(np.median(angles))} degrees "
            f"in the median and by {number(angles.min())} degrees at least."
        )


def technical(result: xr.Dataset) -> Iterator[str]:
    """Technical details of the random numbers, for repeating the run."""
    if case_of(result).case["sampling"] == "sobol":
        yield (
            "Sobol' points spread the boulders more evenly than random numbers do: the intervals "
            "are those of as many random boulders, and too wide."
        )
    rebounds, redrawn, forced = (int(result[f"rebounds{of}"]) for of in ("", "_redrawn", "_forced"))
    if redrawn:
        yield (
            f"{redrawn:,} of {count(rebounds, 'rebound')} ({percent(redrawn / rebounds)}) needed "
            "more than one draw, since the first gained energy or did not rise."
        )
    if forced:
        yield (
            f"{forced:,} of {count(rebounds, 'rebound')} ({percent(forced / rebounds)}) had no "
            "admissible draw in 32: the last one was limited so as to be admissible."
        )


def requested(result: xr.Dataset) -> list[str]:
    """Requested precision of `run --until`, and whether it was reached."""
    return [str(verdict) for verdict in verdicts_of(result)]
