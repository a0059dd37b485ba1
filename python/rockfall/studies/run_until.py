# SPDX-License-Identifier: BSD-3-Clause
"""Runs that add boulders until the confidence intervals at the lines reach a requested width."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rockfall.analysis.line_statistics import QUANTILES, QUANTITIES, numbers, quantile_name
from rockfall.analysis.lines.samples import LineSamples
from rockfall.analysis.precision.intervals import CROSSED, boulders_needed, half_width
from rockfall.analysis.precision.samples import Sample
from rockfall.analysis.validity.warnings import warned_of_model
from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.interrupts import interrupts
from rockfall.language import localised, say
from rockfall.limits import MIN_FOR_MEAN
from rockfall.result.crossings import line_names
from rockfall.scene.read import read_scene
from rockfall.scene.releases.sources import refuse_by_area
from rockfall.scene.rules.plausible import input_warnings, warn_of
from rockfall.scene.scene import Scene
from rockfall.simulation.map_plan import tells_sources
from rockfall.simulation.progress import progress_bar
from rockfall.simulation.simulate import Interrupted, check_overflow, run_chunks, start, trace
from rockfall.simulation.tally import Tally
from rockfall.simulation.tally_dataset import make_result
from rockfall.studies.study import with_numbers

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.result.contents import Contents, Held

FIRST = 1000  # boulders over all sources in the first stage
CAP = 1_000_000  # default limit, over all sources

# Minimum and maximum growth in a stage, and the growth that is small enough for a last stage.
MIN_GROWTH, MAX_GROWTH, NEAR = 1.05, 4.0, 1.25
#: Fraction of the required boulders to run, for a distant and for a near target.
SHORT, MARGIN = 0.8, 1.02
USELESS = 0.3  # error due to boulders / limit, below which more boulders do not help

LEVELS = {quantile_name(level): level for level in QUANTILES}
STATISTICS = ("mean", "std", *LEVELS)
FORM = "QUANTITY.STATISTIC@LINE<PERCENT% or fraction@LINE<PERCENT%"


class Rule(NamedTuple):
    """Criterion: the relative half-width of a 95 % interval must be at most a limit."""

    text: str
    line: int  # line index
    quantity: str
    statistic: str
    limit: float


class Verdict(NamedTuple):
    """Verdict on a rule for a result.

    `width` is the half-width relative to the statistic, NaN without an interval. `need` is the
    number of boulders required from each source: NaN if it cannot be estimated (too few
    cross the line), inf if no number suffices.
    """

    rule: Rule
    met: bool
    width: float
    need: float

    def __str__(self) -> str:
        text = f"{self.rule.text}: {say('until.met' if self.met else 'until.not_met')}"
        if np.isfinite(self.width):
            text += f", +- {localised(f'{self.width:.2%}')}"
        if self.met:
            return text
        if np.isnan(self.need):
            return f"{text}: {say('until.unknown')}"
        if np.isinf(self.need):
            return f"{text}: {say('until.never')}"
        return f"{text}: {say('until.needs', n=float(f'{self.need:.2g}'))}"


def run_until(
    case: Case, rules: str, cap: int | None = None, *, progress: bool = False, **arrays: Any
) -> xr.Dataset:
    """Run a case with as many boulders per source as `rules` require, at most `cap`.

    `rules` is text as in `read_rules`; `arrays` are as in `rockfall.scene.read.read_scene`. The
    result equals `run` with the final number of boulders instead of the case's number. Its
    attribute `until` contains the rules, and `until_met` is 1 if all are met, else 0. Without a
    `cap`, the limit is a million boulders over all sources. Invalid rules raise a RockfallError.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> result = rockfall.run_until(case, "speed.mean@L<20%")
    >>> result.attrs["until_met"]
    1
    """
    scene = read_scene(case, **arrays)
    warn_of(scene)
    return warned_of_model(run_scene_until(scene, rules, cap, progress=progress, keep=False))


def run_scene_until(scene: Scene, rules: str, cap: int | None = None, **how: Any) -> xr.Dataset:
    """Run a scene that has been read; see `run_until`, and for the arguments `simulate_until`."""
    return simulate_until(scene, rules, cap, **how).dataset()


def simulate_until(
    scene: Scene, rules: str, cap: int | None = None, *, progress: bool = False, keep: bool = True
) -> Contents:
    """Run until the rules are met; see `run_until`, also for errors. Unless `keep`, the rasters of
    the scene are freed.

    With a single source each stage continues the previous stage. With several sources each stage
    restarts, because the source of a boulder depends on its number and the total.
    """
    refuse_by_area(scene.case, scene, "--until")
    criteria = read_rules(rules, [line["name"] for line in scene.case.lines])
    if cap is not None and cap < 1:
        raise RockfallError(f"cap = {cap}: must be at least 1 boulder from each source")
    cap = cap or max(1, CAP // scene.x.size)
    input_warnings(scene)  # checked before its rasters are freed
    n, total, tally = min(cap, -(-FIRST // scene.x.size)), 0, None
    with interrupts() as interrupted, progress_bar(0, shown=progress) as advance:
        while True:
            tally = _next_tally(with_numbers(scene, boulders=n, boulders_total=None), tally)
            total += tally.scene.boulders - tally.done
            advance(0, total)
            run_chunks(tally, None, interrupted, advance)
            verdicts = evaluate(criteria, make_result(tally, maps=False))
            larger = next_stage(verdicts, n, cap)
            if interrupted() or larger == n:
                break
            n = larger
        trace(tally)
        if not keep:
            scene.forget_rasters()
            assert isinstance(tally.scene, Scene)
            tally.scene.forget_rasters()
        tally.settle()
        result = make_result(tally)
    result.attrs |= {"until": rules, "until_met": int(all(verdict.met for verdict in verdicts))}
    if interrupted():
        raise Interrupted(result)
    return result


def _next_tally(scene: Scene, last: Tally | None) -> Tally:
    """Tally for the next stage; with a single source it continues the last stage."""
    if last is None or scene.x.size > 1 or tells_sources(scene.case):
        tally = start(scene, scene.case.case["threads"])
        if last is not None:
            tally.wall, tally.cpu = last.wall, last.cpu
        return tally
    check_overflow(scene, scene.survey())
    last.go_on(scene)
    return last


def next_stage(verdicts: list[Verdict], n: int, cap: int) -> int:
    """Boulders from each source in the stage after `n`; `n` itself if no further stage is
    needed."""
    needs = [verdict.need for verdict in verdicts if not verdict.met and not np.isinf(verdict.need)]
    if not needs:
        return n
    need = max(MAX_GROWTH * n if np.isnan(needed) else needed for needed in needs)
    target = MARGIN * need if need <= NEAR * n else max(NEAR * n, SHORT * need)
    return min(cap, math.ceil(np.clip(target, MIN_GROWTH * n, MAX_GROWTH * n)))


def verdicts_of(result: Held) -> list[Verdict]:
    """Verdicts on the rules of a `run_until` result; empty for other results."""
    if "until" not in result.attrs:
        return []
    return evaluate(read_rules(result.attrs["until"], line_names(result)), result)


def evaluate(rules: list[Rule], result: Held) -> list[Verdict]:
    """Verdict on each rule for a result."""
    samples = LineSamples(result)
    return [_verdict(rule, samples) for rule in rules]


def _verdict(rule: Rule, line_samples: LineSamples) -> Verdict:
    """Verdict on a rule; the width gives the number of required boulders. For sampled sources, the
    contribution of differences between sources does not decrease with more boulders."""
    n = line_samples.boulders / max(line_samples.sources, 1)
    sample = line_samples.sample(rule.line, rule.quantity)
    row = numbers(sample, rule.quantity)
    width = half_width(row, rule.statistic)
    crossed = np.inf if rule.statistic == "fraction" else row["n"]
    if width <= rule.limit and crossed >= CROSSED:
        return Verdict(rule, True, width, n)
    if not row["n"] or not np.isfinite(width):
        few = line_samples.sampled and 1 < line_samples.sources < MIN_FOR_MEAN <= row["n"]
        return Verdict(rule, False, width, np.inf if few else np.nan)
    limit = rule.limit
    if line_samples.sampled and line_samples.sources > 1:
        sample = line_samples.given().sample(rule.line, rule.quantity)
        row = numbers(sample, rule.quantity)
        within = half_width(row, rule.statistic)
        limit = math.sqrt(max(0.0, limit**2 - max(0.0, width**2 - within**2)))
    error = _expected_width(sample, row, rule.statistic)
    if limit > 0:
        need = max(n, boulders_needed(n, error, limit, crossed))
        return Verdict(rule, False, width, need)
    return Verdict(rule, False, width, np.inf if error < USELESS * rule.limit else np.nan)


def _expected_width(sample: Sample, row: Mapping[str, float], statistic: str) -> float:
    """Expected relative half-width of an interval. For quantiles, the random part of the width is
    excluded; including it would make runs a third too long."""
    level, width = LEVELS.get(statistic), half_width(row, statistic)
    if level is None or not 0 < width < np.inf:
        return width
    value = row[statistic]
    low, high = sample.fitted_between(level, sample.effective_below(value))
    return (high - low) / 2 / abs(value)


def read_rules(text: str, lines: list[str]) -> list[Rule]:
    """Rules from a text such as 'speed.mean@EL1<2%, fraction@EL1<3%'; `lines` are the line names.

    Quantities and statistics are as in `rockfall.line_statistics`, except the maximum.
    """
    parts = re.split(r",(?=\s*[\w.]+\s*@)", text)  # line names may contain commas
    return [_rule(part.strip(), lines) for part in parts]


def _rule(text: str, lines: list[str]) -> Rule:
    prefix = f"until '{text}'"
    match = re.fullmatch(r"([\w.]+)\s*@\s*(.+?)\s*<\s*([^<]*?)\s*%", text)
    if not match:
        raise RockfallError(f"{prefix}: must be {FORM}, or several separated by commas")
    what, line, percent = match.groups()
    quantity, _, statistic = what.partition(".")
    if what in ("fraction", "share"):  # share is the old name
        quantity, statistic = QUANTITIES[0], "fraction"  # the fraction is the same for any quantity
    elif quantity not in QUANTITIES:
        names = ", ".join(QUANTITIES)
        raise RockfallError(
            f"{prefix}: unknown quantity '{quantity}': must be one of {names}, or fraction "
            "without a statistic"
        )
    elif statistic not in STATISTICS:
        names = ", ".join(STATISTICS)
        raise RockfallError(
            f"{prefix}: statistic '{statistic}' has no interval: must be one of {names}"
        )
    if line not in lines:
        names = ", ".join(lines) or "none"
        raise RockfallError(f"{prefix}: unknown line '{line}' (lines: {names})")
    if not re.fullmatch(r"\d+\.?\d*|\.\d+", percent) or not 0 < float(percent) < 100:
        raise RockfallError(f"{prefix}: {percent} %: must be a number above 0 and below 100")
    return Rule(text, lines.index(line), quantity, statistic, float(percent) / 100)
