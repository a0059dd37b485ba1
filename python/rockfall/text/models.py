# SPDX-License-Identifier: BSD-3-Clause
"""Tables for a terminal: a case by every rebound model, and compared with observations."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from rockfall.quantities import QUANTITIES, TOO_FEW, Quantity, percent
from rockfall.studies.models import QUANTITIES as AT_LINES
from rockfall.studies.models import RUN_OUT, Models
from rockfall.studies.validation import AT_REST, BOUNDS, Validation
from rockfall.text.table import table

if TYPE_CHECKING:
    import pandas as pd

TITLES = {
    "mean": "mean", "std": "std", "q05": "5 %", "q50": "50 %", "q95": "95 %",
    "lateral_std": "lateral std", "ks": "KS", "p": "p", "wasserstein": "Wasserstein",
    "log_density": "mean logarithm",
}  # fmt: skip
BARE = ("ks", "p", "log_density")  # without a unit
ABOUT = QUANTITIES | {AT_REST: Quantity("density at blocks at rest", "m-2", 1)}
PLACES = {"stopping_distance": "run-out in plan", AT_REST: "density at blocks at rest"}


def models_text(models: Models) -> str:
    """A row per model for each line, and for the run-out; in brackets the difference from the
    first, boulder by boulder."""
    text = [f"{models.title}: {models.boulders:,} boulders by each model, 95 % intervals"]
    lines = [line for line in dict.fromkeys(models.table["line"]) if line]
    text += [table(_at_line(models, line)) for line in lines]
    text.append(table(_run_out(models)))
    return "\n".join([*text, *(f"  {note}" for note in models.notes)])


def _at_line(models: Models, line: str) -> Iterator[list[str]]:
    titles = [f"mean {QUANTITIES[name].label} [{QUANTITIES[name].unit}]" for name in AT_LINES]
    yield [f"  {line}", "fraction passing [%]", *titles]
    numbers = models.table[models.table["line"] == line].set_index(
        ["model", "quantity", "statistic"]
    )
    for model in models.names:
        cells = [_cell(numbers.loc[model, "boulders", "fraction"], "fraction")]
        cells += [_cell(numbers.loc[model, name, "mean"], name) for name in AT_LINES]
        yield [f"  {model}", *cells]


def _run_out(models: Models) -> Iterator[list[str]]:
    display = QUANTITIES[RUN_OUT]
    yield ["  run-out in plan", f"mean [{display.unit}]", f"95 % quantile [{display.unit}]"]
    numbers = models.table[models.table["line"] == ""].set_index(["model", "statistic"])
    for model in models.names:
        yield [
            f"  {model}",
            *(_cell(numbers.loc[model, name], RUN_OUT) for name in ("mean", "q95")),
        ]


def _cell(row: pd.Series[Any], quantity: str) -> str:
    """Number +- the longer side of its interval, with the same for its difference."""
    display = QUANTITIES[quantity]

    def within(name: str, sign: str = "") -> str:
        low, high = ("low", "high") if name == "value" else (f"{name}_low", f"{name}_high")
        value = display.factor * row[name]
        half = display.factor * max(row[high] - row[name], row[name] - row[low])
        shown = f"{value:{sign}.{display.decimals}f}"
        return f"{shown} +- {half:.{display.decimals}f}" if half == half else f"{shown} ({TOO_FEW})"

    if row["value"] != row["value"]:
        return "-"
    apart = row["difference"]
    return within("value") + (f" ({within('difference', '+')})" if apart == apart else "")


def validation_text(validation: Validation) -> str:
    """Observed numbers for each place and quantity, and a row for each rebound model: means over
    seeds and their standard errors."""
    mean, std = (percent(BOUNDS[name]) for name in ("mean", "std"))
    seeds = f"seeds {validation.seeds[0]} to {validation.seeds[-1]}"
    text = [
        f"{validation.title}: {validation.boulders:,} boulders by each law, {seeds}; bounds: mean "
        f"within {mean}, std within {std}"
    ]
    for _, rows in validation.table.groupby(["line", "quantity"], sort=False):
        text.append(table(_at_place(rows)))
    return "\n".join([*text, *(f"  {note}" for note in validation.notes)])


def _at_place(rows: pd.DataFrame) -> Iterator[list[str]]:
    line, display = rows["line"].iloc[0], ABOUT[rows["quantity"].iloc[0]]
    names = [name for name in TITLES if name in set(rows["statistic"])]
    n = f"{rows['n_observed'].iloc[0]:,.0f} observed" if rows["n_observed"].notna().any() else ""
    place = f"{line}, {display.label}" if line else PLACES[rows["quantity"].iloc[0]]
    yield [f"  {place} [{display.unit}]", *(TITLES[name] for name in names)]
    observed = rows.drop_duplicates("statistic").set_index("statistic")
    yield [f"  {n or 'observed'}", *(
        "" if observed.loc[name, "observed"] != observed.loc[name, "observed"]
        else _with_error(observed.loc[name], "observed", display.factor) for name in names
    )]  # fmt: skip
    for law, of_law in rows.groupby("law", sort=False):
        each = of_law.set_index("statistic")
        cells = []
        for name in names:
            factor = 1.0 if name in BARE else display.factor
            cell = _with_error(each.loc[name], "simulated", factor)
            cells.append(f"{cell} {each.loc[name, 'verdict']}".rstrip())
        yield [f"  {law}", *cells]


def _with_error(row: pd.Series, whose: str, factor: float) -> str:
    """Number and its standard error, to two digits of the latter."""
    value, error = factor * row[whose], factor * row[f"{whose}_error"]
    if value != value:
        return "-"
    return f"{value:.3g}" + (f" +- {error:.1g}" if error == error else "")
