# SPDX-License-Identifier: BSD-3-Clause
"""Back-analysis as tables and text."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from rockfall.quantities import count, with_unit
from rockfall.studies.back.posterior import alone_table, posterior_table, warnings
from rockfall.studies.back.study import Back
from rockfall.table import Column, Estimate, Table, as_text


def back_text(analysis: Back) -> str:
    """Posterior of the parameters, contributions of the data sets, and warnings, as text."""
    members = count(len(analysis.members), "member")
    parts = [
        f"{analysis.case.case['title'] or 'rockfall'}: {members} of {analysis.boulders:,} "
        f"boulders, effective sample size {analysis.effective:.0f}",
        as_text(parameter_table(analysis)),
        as_text(evidence_table(analysis)),
        *([as_text(alone(analysis))] if len(analysis.data) > 1 else []),
    ]
    return "\n".join([*parts, *(f"  {line}" for line in (*warnings(analysis), *analysis.notes))])


def parameter_table(analysis: Back) -> Table:
    """Table of estimated parameters before and after the analysis: medians and 5 to 95 % ranges."""
    rows: list[list[object]] = []
    for row in posterior_table(analysis).to_dict("records"):
        name = with_unit(row["parameter"], row["units"] if row["units"] != "1" else "")
        width, verdict = f"{100 * row['ratio']:.0f} %", row["verdict"]
        if np.isfinite(row["set_best"]):
            verdict += f"; the likeliest: {row['set_best']:.0f}, from 0"
            rows.append([name, "", "", "", width, verdict])
        else:
            rows.append([name, row["case"], _range(row, "prior_"), _range(row), width, verdict])
    heads = ("sought", "the case", "prior: median (5 to 95 %)", "posterior: median (5 to 95 %)",
             "of the prior's range", "verdict")  # fmt: skip
    return Table.of("", heads, rows)


def evidence_table(analysis: Back) -> Table:
    """Table of data sets: the contribution of each, and whether it agrees with the others."""
    rows = []
    for row in analysis.data.to_dict("records"):
        p, agreement = row["predictive_p"], row["agreement"]
        lost = f"{row['loss']:.1f} +- {row['loss_error']:.1f}" if agreement else "-"
        off = "-" if np.isnan(p) else f"{100 * p:.1f} %"
        rows.append((row["data"], int(row["n"]), row["counts"], off, lost, agreement or ""))
    heads = ("observed", "n", Column("counts", decimals=2),
             "samples that deviate as much", "lost with the others", "")  # fmt: skip
    return Table.of("", heads, rows)


def alone(analysis: Back) -> Table:
    """Median and range of each parameter, estimated from each data set alone."""
    frame = alone_table(analysis)
    frame = frame[np.isfinite(frame["median"])]
    names = [*dict.fromkeys(frame["parameter"])]
    rows = []
    for data, members in frame.groupby("data", sort=False):
        by_name = members.set_index("parameter")
        rows.append((str(data), *(_range(by_name.loc[name]) for name in names)))
    return Table.of("", ("alone: median (5 to 95 %)", *names), rows)


def _range(row: Mapping[Any, Any], prefix: str = "") -> Estimate:
    median, low, high = (row[f"{prefix}{name}"] for name in ("median", "q05", "q95"))
    return Estimate(median, low, high, digits=3)
