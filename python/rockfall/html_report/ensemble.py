# SPDX-License-Identifier: BSD-3-Clause
"""What is uncertain in the inputs, beside the Monte Carlo error: tables and a sentence."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rockfall.analysis.ensemble.study import RESULTS, is_ensemble
from rockfall.html_report.intervals import STATISTICS, in_unit, interval
from rockfall.html_report.tables import Table
from rockfall.quantities import QUANTITIES, with_unit
from rockfall.text.ensemble import INDICES, UNDECIDED, indices_of, more_needed, sorted_inputs

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.html_report.intervals import Rows

PER_LINE = 1 + len(INDICES)  # tables


def range_tables(result: xr.Dataset, rows: Rows) -> list[Table]:
    """Of an ensemble, for each line: both uncertainties of its numbers side by side, then the
    inputs that the epistemic one comes from. Nothing of any other result."""
    if not is_ensemble(result):
        return []
    found = []
    for line, numbers in rows.items():
        at = result.sel(line=line)
        head = ("", "the case as it is", "Monte Carlo, 95 % interval",
                "uncertain inputs, 90 % of the draws", "standard deviations: Monte Carlo",
                "epistemic")  # fmt: skip
        shown = []
        for name, (quantity, number) in RESULTS.items():
            about = "fraction" if number == "fraction" else quantity
            one = at.sel(result=name)
            value, low, high, chance, epistemic = (
                in_unit(one[key].item(), about)
                for key in ("case_value", "q05", "q95", "monte_carlo_std", "epistemic_std")
            )
            limits = interval(numbers[quantity], number, about)
            shown.append((_label(name), value, limits, f"({low} to {high})", chance, epistemic))
        caption = f"{line}: what more boulders would make certain, and what they would not"
        found += [Table(caption, head, shown), *_indices(at, line)]
    return found


def _indices(at: xr.Dataset, line: str) -> Iterator[Table]:
    for kind, label in INDICES.items():
        rows = [(name, *indices_of(at.sel(input=name), kind)) for name in sorted_inputs(at)]
        caption = f"{line}: fraction of the epistemic variance {label} [%], with 95 % intervals"
        yield Table(caption, ("", *map(_label, RESULTS)), rows)


def _label(name: str) -> str:
    """A result in words."""
    quantity, number = RESULTS[name]
    if number == "fraction":
        return QUANTITIES["fraction"].title
    about = QUANTITIES[quantity]
    return with_unit(f"{about.label}, {STATISTICS[number]}", about.unit)


def range_words(result: xr.Dataset, tables: list[Table]) -> list[str]:
    """What the tables hold."""
    if not tables:
        return []
    runs = 2 * result.sizes["run"]
    words = [
        f"The inputs that the case calls uncertain were drawn {runs:,} times: "
        f"{'; '.join(result['input'].values)}. The range of these draws is the epistemic "
        "uncertainty: more boulders do not make it smaller, better knowledge of the slope does."
    ]
    undecided = any(UNDECIDED in str(cell) for one in tables for row in one.rows for cell in row)
    return [*words, f"{more_needed(result).capitalize()}."] if undecided else words
