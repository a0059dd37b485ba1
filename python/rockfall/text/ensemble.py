# SPDX-License-Identifier: BSD-3-Clause
"""An ensemble in words and tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from rockfall.limits import Z
from rockfall.quantities import SHOWN, number
from rockfall.text.table import table

if TYPE_CHECKING:
    import xarray as xr

NUMBERS = {  # as printed
    "the case as it is": "case_value",
    "mean of the draws": "mean",
    "5 % of them below": "q05",
    "5 % of them above": "q95",
    "Monte Carlo error, std": "monte_carlo_std",
    "epistemic, std": "epistemic_std",
    "too few pass, in runs": "too_few",
}
KINDS = {"total": "with all that an input does", "first_order": "of an input alone"}


def ensemble_summary(found: xr.Dataset) -> str:
    """The table for a reader: for each line its results side by side, inputs sorted by fraction."""
    blocks, variants = found.sizes["run"], found.sizes["variant"]
    text = [
        f"{found.attrs['title'] or 'rockfall'}: {blocks} draws of {variants} runs, "
        f"{found.attrs['boulders']:,} boulders each"
    ]
    for line in found["line"].values:
        text.append(table(_line_block(found.sel(line=line), str(line))))
    if "drawn_source_redrawn" in found and found["drawn_source_redrawn"].any():
        redrawn = int(found["drawn_source_redrawn"].sum())
        text.append(f"  shifts drawn again, as a source left the terrain: {redrawn:,}")
    return "\n".join(text)


def _line_block(at: xr.Dataset, line: str) -> Iterator[Iterable[str]]:
    names = [str(name).partition(".") for name in at["result"].values]
    shown = [SHOWN.get(units, (units, 1.0)) for units in at["result_units"].values]
    yield f"  {line}", *(quantity.replace("_", " ") for quantity, *_ in names)
    yield "", *(f"{n[2]} [{p[0]}]".strip() for n, p in zip(names, shown, strict=True))
    factors = np.array([factor for _, factor in shown])
    for label, name in NUMBERS.items():
        values = at[name].values
        if name != "too_few":
            yield f"  {label}", *map(number, values * factors)
        elif values.any():
            yield f"  {label}", *(f"{n:,}" for n in values)
    for kind, label in KINDS.items():
        yield (f"  fraction of the epistemic variance {label} [%], +- 95 %",)
        for name in _sorted_inputs(at):
            one = at.sel(input=name)
            pairs = zip(one[kind].values, one[f"{kind}_error"].values, strict=True)
            yield f"    {name}", *(_fraction(*pair) for pair in pairs)


def _sorted_inputs(at: xr.Dataset) -> list[str]:
    """Names of the inputs, the one with the largest fraction over all results first."""
    order = np.argsort(-np.nansum(at["total"].values, axis=1), kind="stable")
    return [str(name) for name in at["input"].values[order]]


def _fraction(value: float, error: float) -> str:
    return "-" if np.isnan(value) else f"{100 * value:.0f} +- {100 * Z * error:.0f}"
