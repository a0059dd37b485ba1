# SPDX-License-Identifier: BSD-3-Clause
"""One case by every rebound model, as tables for a terminal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from rockfall.analysis.models import QUANTITIES as AT_LINES
from rockfall.analysis.models import RUN_OUT, Models
from rockfall.quantities import QUANTITIES, TOO_FEW
from rockfall.text.table import table

if TYPE_CHECKING:
    import pandas as pd


def models_text(found: Models) -> str:
    """For each line, and for the run-out, a row for each model; in brackets the difference from the
    first, boulder by boulder."""
    text = [f"{found.title}: {found.boulders:,} boulders by each model, 95 % intervals"]
    lines = [line for line in dict.fromkeys(found.table["line"]) if line]
    text += [table(_at_line(found, line)) for line in lines]
    text.append(table(_run_out(found)))
    return "\n".join([*text, *(f"  {note}" for note in found.notes)])


def _at_line(found: Models, line: str) -> Iterator[list[str]]:
    titles = [f"mean {QUANTITIES[name].label} [{QUANTITIES[name].unit}]" for name in AT_LINES]
    yield [f"  {line}", "fraction passing [%]", *titles]
    numbers = found.table[found.table["line"] == line].set_index(["model", "quantity", "statistic"])
    for model in found.names:
        cells = [_cell(numbers.loc[model, "boulders", "fraction"], "fraction")]
        cells += [_cell(numbers.loc[model, name, "mean"], name) for name in AT_LINES]
        yield [f"  {model}", *cells]


def _run_out(found: Models) -> Iterator[list[str]]:
    about = QUANTITIES[RUN_OUT]
    yield ["  run-out in plan", f"mean [{about.unit}]", f"95 % quantile [{about.unit}]"]
    numbers = found.table[found.table["line"] == ""].set_index(["model", "statistic"])
    for model in found.names:
        yield [
            f"  {model}",
            *(_cell(numbers.loc[model, name], RUN_OUT) for name in ("mean", "q95")),
        ]


def _cell(row: pd.Series[Any], quantity: str) -> str:
    """A number +- the longer side of its interval, and the same of its difference."""
    about = QUANTITIES[quantity]

    def within(name: str, sign: str = "") -> str:
        low, high = ("low", "high") if name == "value" else (f"{name}_low", f"{name}_high")
        value = about.factor * row[name]
        half = about.factor * max(row[high] - row[name], row[name] - row[low])
        shown = f"{value:{sign}.{about.decimals}f}"
        return f"{shown} +- {half:.{about.decimals}f}" if half == half else f"{shown} ({TOO_FEW})"

    if row["value"] != row["value"]:
        return "-"
    apart = row["difference"]
    return within("value") + (f" ({within('difference', '+')})" if apart == apart else "")
