# SPDX-License-Identifier: BSD-3-Clause
"""Text output of a design block."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from rockfall.analysis.design_block import REJECTED, DesignBlock
from rockfall.case.text import Entry, Group, case_text
from rockfall.quantities import count, number
from rockfall.text.table import table

COMMENTS = {
    "activity": "blocks larger than 1 m3 a year",
    "volume_min": "m3, the threshold of the survey",
    "volume_exponent": "of the number of larger blocks",
}
ABOUT = """\
Of blocks that come to the place of the survey, in brackets 95 % confidence intervals. The block of
a return period is the one that larger ones exceed once in that time: see docs/design_block.md."""
PLACE = """\
It takes the blocks of the survey for those that come loose. Where some stop above the place of the
survey, or are gone from it, more come loose: raise the activity."""


def design_block_text(block: DesignBlock) -> str:
    """Survey, distribution, table of return periods, warnings and scenario."""
    parts = [ABOUT, "", table(_survey_rows(block)), "", table(_level_rows(block))]
    parts += [f"Warning: {text}" for text in block.warnings]
    volume = number(block.volume, up=True).replace(",", "")
    parts += ["", f"Design sheet of a result: rockfall design OUT.nc --volume {volume}"]
    if block.scenario:
        parts += ["", "Scenario for `rockfall hazard`:", PLACE, "", scenario_text(block).rstrip()]
    return "\n".join(parts)


def _survey_rows(block: DesignBlock) -> Iterator[list[str]]:
    survey, rate, fit, law = block.survey, block.rate, block.fit, block.power_law
    yield [f"{survey.name}: {count(survey.volumes.size, 'block')}"]
    yield ["  threshold [m3]", number(fit.threshold)]
    yield ["  larger blocks", f"{fit.exceedances:,}"]
    yield [f"  of the dated ones, in {survey.years:g} years", f"{rate.dated:,}"]
    yield ["  larger blocks a year", _interval(rate.value, rate.low, rate.high)]
    shape = _interval(fit.shape, *block.shape_limits)
    yield ["  generalised Pareto, shape", f"{shape}, {_fits(fit.p_value)}"]
    yield ["  generalised Pareto, scale [m3]", number(fit.scale)]
    exponent = _interval(law.exponent, law.low, law.high)
    yield ["  power law, exponent", f"{exponent}, {_fits(law.p_value)}"]


def _fits(p_value: float) -> str:
    return f"p = {p_value:.2g}" + (": does not fit" if p_value < REJECTED else "")


def _interval(value: float, low: float, high: float, *, up: bool = False) -> str:
    return f"{number(value, up=up)} ({number(low)} to {number(high, up=up)})"


def _level_rows(block: DesignBlock) -> Iterator[list[str]]:
    yield ["return period [year]", "block [m3]", "by the power law [m3]", ""]
    for row in block.levels.to_dict("records"):
        yield [f"  {row['return_period']:g}", *_level_cells(row, block.fit.threshold)]


def _level_cells(row: Mapping[str, Any], threshold: float) -> list[str]:
    if row["refused"]:
        return ["-", "-", row["refused"]]
    block = _interval(row["volume"], row["volume_low"], row["volume_high"], up=True)
    remark = "extrapolated" if row["extrapolated"] else ""
    return [block, number(row["power_law"]), remark]


def scenario_text(block: DesignBlock) -> str:
    """Scenario of a case by the power law; empty if there is none."""
    if not block.scenario:
        return ""
    beyond = number(block.power_law.period(block.scenario["volume_max"]))
    comments = {"volume_max": f"m3, a decision: none larger (once in {beyond} years)"}
    entries = [
        Entry(key, value, (COMMENTS | comments).get(key, ""))
        for key, value in block.scenario.items()
    ]
    return case_text([], [Group("scenario", entries)], []).lstrip("\n")
