# SPDX-License-Identifier: BSD-3-Clause
"""Page 1 of a report: the question, the answer from the numbers at the lines, and its certainty."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.lines.samples import LineSamples
from rockfall.analysis.observed.run_out import mean_slopes
from rockfall.analysis.precision.intervals import half_width
from rockfall.html_report.intervals import ONE_SIDED, TOO_FEW, estimate, in_lines, in_unit
from rockfall.html_report.tables import Table
from rockfall.language import Number, Text, say, say_count
from rockfall.protection.barriers import barriers_of
from rockfall.quantities import number, percent
from rockfall.result.crossings import line_names
from rockfall.result.samples import has_rows, simulated
from rockfall.result.trajectories import ended
from rockfall.studies.ensemble.study import is_ensemble
from rockfall.studies.run_until import verdicts_of

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.html_report.intervals import Numbers, Rows

HEADLINE = {  # of the table on page 1: quantity and number
    "summary.boulders_that_pass": ("fraction", "fraction"),
    "summary.total_kinetic_energy_quantile_kj": ("energy_total", "q95"),
    "summary.passing_height_quantile_m": ("passing_height", "q95"),
    "summary.speed_quantile_m_s": ("speed", "q95"),
}
ENDED = {  # of the statuses
    "stopped": "summary.came_to_rest_on_the_slope",
    "absorbed": "summary.ended_where_the_ground_absorbs_boulders",
    "left_domain": "summary.left_the_terrain_model",
    "hit_nodata": "summary.met_terrain_without_elevation",
    "impact_limit": "summary.reached_the_limit_of_contacts_and",
    "stopped_by_tree": "summary.were_stopped_by_trees",
    "stopped_by_barrier": "summary.were_stopped_by_barriers",
}


def question(rows: Rows, has_hazard: bool) -> str:
    """Question that the report answers."""
    if has_hazard:
        return say("summary.which_areas_and_objects_are_endangered")
    if rows:
        return say("summary.how_many_of_the_released_boulders")
    return say("summary.how_far_do_the_released_boulders")


def answers(result: xr.Dataset, rows: Rows) -> list[str]:
    """A sentence for each line; the run-out if there is none."""
    nets = {line_names(result)[k] for k in barriers_of(result)}
    return [*(_line(line, rows[line], line in nets) for line in rows), *run_out(result)]


def _line(line: str, numbers: Numbers, is_barrier: bool) -> str:
    """Sentence on the boulders that pass a line, or reach a barrier."""
    row, kind = numbers["speed"], "barrier" if is_barrier else "line"
    if not row["n"]:
        high = in_unit(row["fraction_high"], "fraction")
        return say(f"summary.{kind}_none", line=line, high=high)
    fraction = estimate(row, "fraction", "fraction")[0]
    energy, height = (
        estimate(numbers[quantity], "q95", quantity)[0]
        for quantity in ("energy_total", "passing_height")
    )
    if row["n"] == 1 or "-" in (energy, height):
        return say(f"summary.{kind}_fraction", line=line, fraction=fraction)
    values = {"fraction": fraction, "energy": energy, "height": height}
    return say(f"summary.{kind}_values", line=line, **values)


def headline(rows: Rows) -> Table:
    """Key numbers at the lines for decisions, with their intervals."""
    shown = [
        (line, *(in_lines(*cell).strip() for cell in _estimates(numbers)))
        for line, numbers in rows.items()
    ]
    caption = say("summary.headline_caption")
    return Table(caption, (say("label.line_or_barrier"), *map(say, HEADLINE)), shown)


def _estimates(numbers: Numbers) -> Iterator[tuple[str, str]]:
    """Key numbers at a line, and their intervals."""
    for quantity, name in HEADLINE.values():
        yield estimate(numbers["speed" if quantity == "fraction" else quantity], name, quantity)


def run_out(result: xr.Dataset) -> Iterator[str]:
    """Sentences on the run-out in plan."""
    distance = LineSamples(result).ends("plan_distance")
    if not distance.max():
        yield say("summary.no_boulder_left_its_place")
    elif distance.n == 1:
        yield say("summary.run_out_of_one", max=number(distance.max()))
    else:
        half, far = (number(metres) for metres in distance.quantile([0.5, 0.95]))
        yield say("summary.run_out", half=half, far=far, max=number(distance.max()))


def certainty(result: xr.Dataset, rows: Rows, is_inside: bool) -> Iterator[str]:
    """Sentences on the certainty of the answer: the Monte Carlo error, and what it does not
    include."""
    boulders, samples = simulated(result), LineSamples(result)
    limits = [limits for numbers in rows.values() for _, limits in _estimates(numbers)]
    if is_ensemble(result):  # the answer is the range of the draws
        yield say_count("summary.simulated_in_each_run", samples.sources, boulders=boulders)
        yield say("summary.the_ranges_of_the_draws_hold")
        return
    if boulders == 1:
        yield say("summary.one_boulder_is_an_example_it")
    else:
        yield say_count("summary.simulated", samples.sources, boulders=boulders)
        if any(isinstance(limit, Text) and limit.key in ONE_SIDED for limit in limits):
            yield say("summary.where_only_one_limit_is_given")
        if TOO_FEW in limits:
            yield say("summary.a_dash_in_brackets_too_few")
        if samples.sampled:
            yield say("summary.the_sources_are_taken_for_a")
    crossed = [numbers["speed"] for numbers in rows.values() if numbers["speed"]["n"]]
    widths = [half_width(row, "fraction") for row in crossed]
    if widths and np.isfinite(worst := max(widths)) and boulders > 1:
        yield say("summary.precision", fraction=percent(worst))
    yield say("summary.the_brackets_hold_no_error_of")
    if is_inside:
        yield say("summary.no_large_part_of_the_run")


def ends_table(result: xr.Dataset) -> Table:
    """Table of the outcomes of boulders."""
    boulders = simulated(result)
    rows = [
        (say(ENDED[name]), Number(f"{n:,}"), percent(n / boulders))
        for name, n in ended(result).items()
        if n
    ]
    heads = "", say("label.boulders"), say("label.fraction")
    return Table(say("summary.how_boulders_ended"), heads, rows)


def angle(result: xr.Dataset) -> Iterator[str]:
    """Sentences on the slope of straight lines from release to end."""
    if not has_rows(result):
        return
    angles = mean_slopes(result)[result["plan_distance"].values > 0]
    if angles.size:
        median, least = number(np.median(angles)), number(angles.min())
        yield say("summary.angle", angles=median, min=least)


def technical(result: xr.Dataset) -> Iterator[str]:
    """Technical details of the random numbers, for repeating the run."""
    rebounds, redrawn, forced = (
        int(result[f"rebounds{suffix}"]) for suffix in ("", "_redrawn", "_forced")
    )
    if redrawn:
        fraction = percent(redrawn / rebounds)
        yield say_count("summary.redrawn", rebounds, redrawn=redrawn, fraction=fraction)
    if forced:
        fraction = percent(forced / rebounds)
        yield say_count("summary.limited", rebounds, forced=forced, fraction=fraction)


def requested(result: xr.Dataset) -> list[str]:
    """Requested precision of `run --until`, and whether it was reached."""
    return [str(verdict) for verdict in verdicts_of(result)]
