# SPDX-License-Identifier: BSD-3-Clause
"""Text output of a back-analysis, with tables."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from rockfall.quantities import count, number
from rockfall.studies.back.posterior import alone_table, posterior_table, warnings
from rockfall.studies.back.study import Back
from rockfall.text.table import table

if TYPE_CHECKING:
    import pandas as pd


def back_text(analysis: Back) -> str:
    """Parameters and their posterior, the contribution of each set of data, and reasons for
    caution."""
    members = count(len(analysis.members), "member")
    text = [
        f"{analysis.case.case['title'] or 'rockfall'}: {members} of "
        f"{analysis.boulders:,} boulders, worth {analysis.effective:.0f} of the posterior",
        table(_parameters(analysis)),
        table(_data(analysis)),
        *([table(_alone(analysis))] if len(analysis.data) > 1 else []),
    ]
    return "\n".join([*text, *(f"  {line}" for line in (*warnings(analysis), *analysis.notes))])


def _parameters(analysis: Back) -> Iterator[list[str]]:
    yield ["  sought", "the case", "prior: median", "5 to 95 %", "posterior: median", "5 to 95 %",
           "of the prior's range", "verdict"]  # fmt: skip
    for row in posterior_table(analysis).to_dict("records"):
        unit = f" [{row['units']}]" if row["units"] != "1" else ""
        name, width = f"  {row['parameter']}{unit}", f"{100 * row['ratio']:.0f} %"
        verdict = row["verdict"]
        if np.isfinite(row["set_best"]):
            verdict += f"; the likeliest: {row['set_best']:.0f}, from 0"
            yield [name, "", "", "", "", "", width, verdict]
            continue
        ranges = []
        for prefix in ("prior_", ""):
            low, middle, high = (
                number(row[f"{prefix}{name}"]) for name in ("q05", "median", "q95")
            )
            ranges += [middle, f"{low} to {high}"]
        yield [name, number(row["case"]), *ranges, width, verdict]


def _data(analysis: Back) -> Iterator[list[str]]:
    yield ["  observed", "n", "counts", "as far off or farther, of samples", "lost to the others",
           ""]  # fmt: skip
    for row in analysis.data.to_dict("records"):
        p, loss = row["predictive_p"], f"{row['loss']:.1f} +- {row['loss_error']:.1f}"
        off = "-" if np.isnan(p) else f"{100 * p:.1f} %"
        lost = [loss, row["agreement"]] if row["agreement"] else ["-", ""]
        yield [f"  {row['data']}", f"{row['n']:,}", f"{row['counts']:.2f}", off, *lost]


def _alone(analysis: Back) -> Iterator[list[str]]:
    """Median and range of each parameter by each set of data alone."""
    rows = alone_table(analysis)
    rows = rows[np.isfinite(rows["median"])]
    names = [*dict.fromkeys(rows["parameter"])]
    yield ["  alone: median (5 to 95 %)", *names]
    for data, members in rows.groupby("data", sort=False):
        by_name = members.set_index("parameter")
        yield [f"  {data}", *(_range(by_name.loc[name]) for name in names)]


def _range(row: pd.Series) -> str:
    return f"{number(row['median'])} ({number(row['q05'])} to {number(row['q95'])})"
