# SPDX-License-Identifier: BSD-3-Clause
"""Page 1 of a report: the question, the answer from the numbers at the lines, and its certainty."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr

from rockfall.analysis.lines.around import around_by_line
from rockfall.analysis.lines.samples import LineSamples
from rockfall.analysis.observed.run_out import mean_slopes
from rockfall.analysis.precision.intervals import half_width
from rockfall.language import Text, say, say_count
from rockfall.plots.style import capital
from rockfall.protection.barriers import barriers_of
from rockfall.quantities import number, part_of_boulders, percent
from rockfall.result.crossings import line_names
from rockfall.result.samples import has_rows, is_ensemble, simulated
from rockfall.result.trajectories import ended_moving
from rockfall.result.variables import ENDS
from rockfall.studies.run_until import verdicts_of
from rockfall.table import Estimate, Table, open_limits
from rockfall.tables.ensemble import (
    are_undecided,
    cases_outside,
    headline_numbers,
    more_needed,
    orders_reversed,
)
from rockfall.tables.hazard import places_of
from rockfall.tables.lines import Numbers, Rows, estimate, in_unit, key_numbers, worst_of

YEARS = 100.0  # return period on page 1
MOST_LINES = 3  # maximum lines with a sentence


def question(rows: Rows, has_hazard: bool) -> str:
    """The question that the report answers."""
    if has_hazard:
        return say("summary.which_areas_and_objects_are_endangered")
    if rows:
        return say("summary.how_many_of_the_released_boulders")
    return say("summary.how_far_do_the_released_boulders")


def answers(result: xr.Dataset, rows: Rows) -> list[str]:
    """A sentence for each line, the worst first; then boulders that pass around barriers, and
    the run-out."""
    nets = {line_names(result)[k] for k in barriers_of(result)}
    lines = (_line(line, rows[line], line in nets) for line in worst_of(rows))
    return [*lines, *around_ends(result, rows), *run_out(result)]


def around_ends(result: xr.Dataset, rows: Rows) -> Iterator[Text]:
    """Sentences on the lines where boulders pass around the ends of barriers; none if not all
    boulders have rows."""
    names, boulders = line_names(result), simulated(result)
    if not barriers_of(result) or result.sizes["boulder"] < boulders:
        return
    nets = barriers_of(result)
    lines = [k for k, name in enumerate(names) if name in rows and k not in nets]
    for line, barriers, around in around_by_line(result, lines):
        part = part_of_boulders(int(around.sum()), boulders)
        shown = [names[k] for k in barriers]
        yield say("summary.around", line=names[line], part=part, nets=shown)


def _line(line: str, numbers: Numbers, is_barrier: bool) -> str:
    """Sentence on the boulders that pass a line or reach a barrier."""
    row, kind = numbers["speed"], "barrier" if is_barrier else "line"
    if not row["n"]:
        high = in_unit(row["fraction_high"], "fraction")
        return say(f"summary.{kind}_none", line=line, high=high)
    fraction = estimate(row, "fraction", "fraction").number
    energy, height = (
        estimate(numbers[quantity], "q95", quantity).number
        for quantity in ("energy_total", "passing_height")
    )
    if row["n"] == 1 or "-" in (energy, height):
        return say(f"summary.{kind}_fraction", line=line, fraction=fraction)
    values = {"fraction": fraction, "energy": energy, "height": height}
    return say(f"summary.{kind}_values", line=line, **values)


def yearly_answers(hazard: xr.Dataset | None, years: float = YEARS) -> Iterator[str]:
    """Sentences on the energy reached once in `years` at the lines of a hazard."""
    if hazard is None or "line_energy_by_period" not in hazard:
        return
    period = hazard["event_period"].values.tolist().index(years)
    lines = [place for place in places_of(hazard) if place.kind == "line"]
    for _, k, line in lines[:MOST_LINES]:
        value, low, high = (
            1e-3 * float(hazard[f"line_energy_by_period{end}"].values[k, period]) for end in ENDS
        )
        if not value:
            key = "summary.not_excluded" if high else "summary.rarer"
            yield say(key, line=line, years=years)
            continue
        energy = Estimate(value, low, high if np.isfinite(high) else np.nan, digits=2)
        words = {"energy": energy.number, "limits": energy.interval}
        yield say("summary.once_in", line=line, years=years, **words)


def range_answers(result: xr.Dataset, rows: Rows) -> list[str]:
    """A sentence for each line (range over the draws, value of the unchanged case), the worst
    first; then the run-out."""
    answers = []
    for line in worst_of(rows):
        passing, energy, height, _ = headline_numbers(result, line)
        values = dict(zip(("low", "high", "fraction"), passing, strict=True))
        values |= zip(("e_low", "e_high", "energy"), energy, strict=True)
        values |= zip(("h_low", "h_high", "height"), height, strict=True)
        is_known = "-" not in [
            value for name, value in values.items() if name.endswith(("low", "high"))
        ]
        key = "ensemble.line_values" if is_known else "ensemble.line_fraction"
        answers.append(say(key, line=line, **values))
    return [*answers, *run_out(result)]


def run_out(result: xr.Dataset) -> Iterator[str]:
    """Sentences on the run-out in plan view."""
    distance = LineSamples(result).ends("plan_distance")
    if not distance.max():
        yield say("summary.no_boulder_left_its_place")
    elif distance.n == 1:
        yield say("summary.run_out_of_one", max=number(distance.max()))
    else:
        half, far = (number(metres) for metres in distance.quantile([0.5, 0.95]))
        yield say("summary.run_out", half=half, far=far, max=number(distance.max()))


def certainty(result: xr.Dataset, rows: Rows, is_inside: bool) -> Iterator[str]:
    """Sentences on Monte Carlo and other errors; with `is_inside`, on the range of the model."""
    boulders, samples = simulated(result), LineSamples(result)
    if is_ensemble(result):  # its answer is the range over the draws
        yield say_count("summary.simulated_in_each_run", samples.sources, boulders=boulders)
        yield say("summary.the_ranges_of_the_draws_hold")
        return
    if boulders == 1:
        yield say("summary.one_boulder_is_an_example_it")
    else:
        yield say_count("summary.simulated", samples.sources, boulders=boulders)
        yield from open_limits(cell for row in rows.values() for cell in key_numbers(row))
        if samples.sampled:
            yield say("summary.the_sources_are_taken_for_a")
    crossed = [numbers["speed"] for numbers in rows.values() if numbers["speed"]["n"]]
    widths = [half_width(row, "fraction") for row in crossed]
    if widths and np.isfinite(worst := max(widths)) and boulders > 1:
        yield say("summary.precision", fraction=percent(worst))
    yield say("summary.the_brackets_hold_no_error_of")
    if is_inside:
        yield say("summary.no_large_part_of_the_run")


def range_words(result: xr.Dataset, tables: list[Table]) -> list[str]:
    """Sentences that explain the tables of ranges."""
    if not tables:
        return []
    words = [
        say(
            "ensemble.draws",
            run=result.sizes["run"],
            join=[say(f"uncertain.{name}") for name in result["input"].values],
        ),
        *cases_outside(result),
        *(f"{sentence}." for sentence in orders_reversed(result)),
    ]
    return [*words, f"{capital(more_needed(result))}."] if are_undecided(tables) else words


def angle(result: xr.Dataset) -> Iterator[str]:
    """Sentences on the angle of the straight line from release to end."""
    if not has_rows(result):
        return
    angles = mean_slopes(result)[result["plan_distance"].values > 0]
    if angles.size:
        median, least = number(np.median(angles)), number(angles.min())
        yield say("summary.angle", angles=median, min=least)
        if (moving := ended_moving(result)).any():
            part = part_of_boulders(int(moving.sum()), moving.size)
            yield f"{capital(say('model.angle_left', part=part))}."


def technical(result: xr.Dataset) -> Iterator[str]:
    """Sentences on rebounds that were redrawn, and on those limited after too many draws."""
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
    """Precision requested by `run --until`, and whether it was reached."""
    return [str(verdict) for verdict in verdicts_of(result)]
