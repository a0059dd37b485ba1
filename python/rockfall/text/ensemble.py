# SPDX-License-Identifier: BSD-3-Clause
"""Text output of an ensemble, with tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from rockfall.kernel_rules import Z
from rockfall.language import say
from rockfall.quantities import SHOWN, number
from rockfall.result.crossings import line_names
from rockfall.studies.ensemble.sobol_indices import limits, runs_needed
from rockfall.text.summary import remark_lines
from rockfall.text.table import table

if TYPE_CHECKING:
    import xarray as xr

NUMBERS = {  # printed names
    "the case as it is": "case_value",
    "mean of the draws": "mean",
    "5 % of them below": "q05",
    "5 % of them above": "q95",
    "Monte Carlo error, std": "monte_carlo_std",
    "epistemic, std": "epistemic_std",
    "too few pass, in runs": "too_few",
}
INDICES = {
    "first_order": "of an input alone (first-order Sobol' index)",
    "total": "with all that an input does (total Sobol' index)",
}
UNDECIDED = "word.undecided"
LEAST_EXCESS = 0.005  # minimum visible difference of two indices, in whole per cent


def ensemble_summary(data: xr.Dataset) -> str:
    """Table for reading: for each line its results side by side, inputs sorted by fraction; and
    the remarks on the model in the run of the unchanged case, which the data hold."""
    blocks, variants = data.sizes["run"], data.sizes["variant"]
    text = [
        f"{data.attrs['title'] or 'rockfall'}: {blocks} draws of {variants} runs, "
        f"{data.sizes['boulder']:,} boulders each"
    ]
    for k, line in enumerate(line_names(data)):
        text.append(table(_line_block(data.isel(line=k), line)))
    if "drawn_source_redrawn" in data and data["drawn_source_redrawn"].any():
        redrawn = int(data["drawn_source_redrawn"].sum())
        text.append(f"  shifts drawn again, as a source left the terrain: {redrawn:,}")
    text += [f"  {line}" for line in orders_reversed(data)]
    if any(say(UNDECIDED) in line for line in text):
        text.append(f"  {more_needed(data)}")
    if remarks := [*remark_lines(data)]:
        text += ["  remarks on the model, of the unchanged case:", *remarks]
    return "\n".join(text)


def more_needed(data: xr.Dataset) -> str:
    """Runs needed to resolve the undecided indices."""
    errors = np.stack([data[f"{kind}_error"].values for kind in INDICES])
    runs = runs_needed(errors, data.sizes["run"])
    return say("ensemble.more_draws", runs=number(runs, 1))


def orders_reversed(data: xr.Dataset) -> Iterator[str]:
    """Warnings of a first-order index above the total, which is impossible in theory, with the
    significance of the difference, for the result with the largest one."""
    for index, line in enumerate(line_names(data)):
        within: list[str] = []
        beyond: list[str] = []
        for name in map(str, data["input"].values):
            at = data.isel(line=index).sel(input=name)
            errors = [at[f"{kind}_error"].values for kind in INDICES]
            first, total = (
                np.array([limits(*pair)[0] for pair in zip(at[kind].values, error, strict=True)])
                for kind, error in zip(INDICES, errors, strict=True)
            )
            k = int(np.argmax(excess := np.nan_to_num(first - total)))
            if excess[k] >= LEAST_EXCESS:
                kept = within if excess[k] <= Z * np.hypot(*errors)[k] else beyond
                both = {"first": 100 * first[k], "total": 100 * total[k]}
                display = say(f"uncertain.{name}")
                kept.append(say("ensemble.two_indices", name=display, **both))
        if within:
            yield say("ensemble.reversed_within", line=line, inputs=within)
        if beyond:
            yield say("ensemble.reversed_beyond", line=line, inputs=beyond)


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
    for kind, label in INDICES.items():
        yield (f"  fraction of the epistemic variance {label} [%], 95 % interval",)
        for name in sorted_inputs(at):
            yield f"    {name}", *indices_of(at.sel(input=name), kind)


def sorted_inputs(at: xr.Dataset) -> list[str]:
    """Names of the inputs, the one with the largest fraction over all results first."""
    total = np.nan_to_num(at["total"].values).clip(0, 1)
    order = np.argsort(-total.sum(axis=1), kind="stable")
    return [str(name) for name in at["input"].values[order]]


def indices_of(data: xr.Dataset, kind: str) -> Iterator[str]:
    """Indices of an input, for each result, with their intervals [%]; "-" if there is no epistemic
    variance to explain."""
    for value, error in zip(data[kind].values, data[f"{kind}_error"].values, strict=True):
        index, low, high = (100 * limit for limit in limits(value, error))
        if np.isnan(value):
            yield "-"
        else:
            yield (
                say(UNDECIDED)
                if np.isnan(index)
                else say("ensemble.index", index=index, low=low, high=high)
            )
