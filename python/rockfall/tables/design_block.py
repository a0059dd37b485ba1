# SPDX-License-Identifier: BSD-3-Clause
"""Design block as tables and text."""

from rockfall.analysis.design_block import REJECTED, DesignBlock
from rockfall.case.text import Entry, Group, case_text
from rockfall.quantities import count, number
from rockfall.table import Column, Estimate, Table, as_text

COMMENTS = {
    "activity": "blocks larger than 1 m3 per year",
    "volume_min": "m3, the threshold of the survey",
    "volume_exponent": "of the number of larger blocks",
}
ABOUT = """\
Blocks that reach the survey site; brackets: 95 % confidence intervals. The block of a return period
is exceeded once in this period: see docs/design_block.md."""
PLACE = """\
It assumes that all released blocks were surveyed. If some stopped above the survey site or were
removed from it, more are released: raise the activity."""


def design_block_text(block: DesignBlock) -> str:
    """Text with survey, distribution, table of return periods, warnings and scenario."""
    parts = [ABOUT, "", as_text(survey_table(block)), "", as_text(block_table(block))]
    parts += [f"Warning: {note}" for note in block.warnings]
    volume = number(block.volume, up=True).replace(",", "")
    parts += ["", f"Design sheet of a result: rockfall design OUT.nc --volume {volume}"]
    if block.scenario:
        parts += ["", "Scenario for `rockfall hazard`:", PLACE, "", scenario_text(block).rstrip()]
    return "\n".join(parts)


def survey_table(block: DesignBlock) -> Table:
    """Table of the survey and the fitted distributions."""
    survey, rate, fit, law = block.survey, block.rate, block.fit, block.power_law
    shape = Estimate(fit.shape, *block.shape_limits, digits=3)
    exponent = Estimate(law.exponent, law.low, law.high, digits=3)
    rows: list[list[object]] = [
        [f"{survey.name}: {count(survey.volumes.size, 'block')}"],
        ["threshold [m3]", fit.threshold],
        ["larger blocks", int(fit.exceedances)],
        [f"dated larger blocks, in {survey.years:g} years", int(rate.dated)],
        ["larger blocks per year", Estimate(rate.value, rate.low, rate.high, digits=3)],
        ["generalised Pareto, shape", f"{shape}\n{_fits(fit.p_value)}"],
        ["generalised Pareto, scale [m3]", fit.scale],
        ["power law, exponent", f"{exponent}\n{_fits(law.p_value)}"],
    ]
    return Table.of("", ("", ""), rows)


def _fits(p_value: float) -> str:
    return f"p = {p_value:.2g}" + (": does not fit" if p_value < REJECTED else "")


def block_table(block: DesignBlock) -> Table:
    """Table of the design block for each return period."""
    rows: list[list[object]] = []
    for row in block.levels.to_dict("records"):
        period = f"{row['return_period']:g}"
        if row["refused"]:
            rows.append([period, "-", "-", row["refused"]])
        else:
            remark = "extrapolated" if row["extrapolated"] else ""
            volume = Estimate.of(row, "volume", digits=3, up=True)
            rows.append([period, volume, row["power_law"], remark])
    heads = (Column("return period", "year"), Column("block", "m3"),
             Column("by the power law", "m3"), "")  # fmt: skip
    return Table.of("", heads, rows)


def scenario_text(block: DesignBlock) -> str:
    """Scenario of a case from the fitted power law; "" if there is none."""
    if not block.scenario:
        return ""
    beyond = number(block.power_law.period(block.scenario["volume_max"]))
    comments = {"volume_max": f"m3, chosen as the largest block (exceeded once in {beyond} years)"}
    entries = [
        Entry(key, value, (COMMENTS | comments).get(key, ""))
        for key, value in block.scenario.items()
    ]
    return case_text([], [Group("scenario", entries)], []).lstrip("\n")
