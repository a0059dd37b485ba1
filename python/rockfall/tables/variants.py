# SPDX-License-Identifier: BSD-3-Clause
"""Comparison of variants as tables and text."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.population import population_notes
from rockfall.case import FROM_ARRAY, Case, case_of
from rockfall.language import Number, Text, localised, say
from rockfall.quantities import QUANTITIES, number
from rockfall.result.crossings import line_names
from rockfall.result.samples import kept_note
from rockfall.result.variables import ENDS
from rockfall.studies.variants import UNDECIDED
from rockfall.table import Table, as_text, stacked
from rockfall.tables.hazard import level_cell

#: Message id of each quantity.
NAMES = {
    "speed": "variants.speed",
    "upper_edge": "variants.upper_edge",
    "energy_total": "variants.energy_total",
}
#: Message ids of annual frequencies, of all boulders and above an energy.
YEARLY = {
    "frequency": ("variants.yearly", "variants.yearly_above"),
    "frequency_behind": ("variants.yearly_behind", "variants.yearly_above_behind"),
}
MEAN, Q95 = "variants.mean", "variants.q95"


def variants_text(
    frame: pd.DataFrame, note: str = "", frequencies: pd.DataFrame | None = None
) -> str:
    """Text with a table for each line and a column for each variant, followed by `note`."""
    parts = []
    for _, of_line in frame.groupby("line", sort=False):
        table = variant_table(of_line, frequencies)
        parts.append(f"{table.caption}\n{as_text(table)}")
    return "\n\n".join([*parts, say("variants.note"), *([note] if note else [])])


def comparison_notes(results: Mapping[str, xr.Dataset], yearly: bool = False) -> Iterator[str]:
    """Notes on the variants' boulders (`population_notes`), on the boulders that have rows, and on
    lines whose position differs between variants."""
    first = next(iter(results.values()))
    yield from population_notes(case_of(first), yearly)
    if note := kept_note(first):
        yield note
    places: dict[str, tuple[str, np.ndarray]] = {}
    for name, result in results.items():
        for k, line in enumerate(line_names(result)):
            here = np.array([result[f"line_vertex_{axis}"].values for axis in "xy"])
            here = here[:, result["line_vertex_line"].values == k]
            before, place = places.setdefault(line, (name, here))
            if not np.array_equal(here, place):
                yield say("variants.moved_line", line=line, name=name, before=before)


def variant_table(of_line: pd.DataFrame, frequencies: pd.DataFrame | None = None) -> Table:
    """Table of the numbers at a line, each with its difference from the first variant: annual
    values from `frequencies` (of `rockfall.yearly_variants`), then those of the simulated
    boulders."""
    rows: list[tuple[object, ...]] = []
    if frequencies is not None:
        rows += _yearly_rows(of_line, frequencies)
    for (quantity, statistic), group in of_line.groupby(["quantity", "statistic"], sort=False):
        display = QUANTITIES["fraction" if quantity == "passing" else quantity]
        records = group.to_dict("records")
        label = _label(str(quantity), str(statistic), display.unit)
        rows.append((label, *(_cell(row, display.factor) for row in records)))
    heads = ["", *of_line["variant"].unique()]
    return Table.of(say("variants.line_caption", line=of_line["line"].iloc[0]), heads, rows)


def _yearly_rows(of_line: pd.DataFrame, frequencies: pd.DataFrame) -> Iterator[tuple[object, ...]]:
    """Rows of frequencies, and energies by return period, at a line for the variants of a table."""
    here = frequencies[
        (frequencies["line"] == of_line["line"].iloc[0])
        & frequencies["variant"].isin(of_line["variant"].unique())
    ]
    for (quantity, statistic), group in here.groupby(["quantity", "statistic"], sort=False):
        records = group.to_dict("records")
        if quantity != "energy_by_period":
            yield (
                _yearly_label(str(quantity), str(statistic)),
                *(_cell(row, 1.0) for row in records),
            )
        else:
            label = say("variants.energy_by_period", years=Number(str(statistic)))
            yield (
                label,
                *(level_cell(*(1e-3 * row[f"value{end}"] for end in ENDS)) for row in records),
            )


def difference_table(frequencies: pd.DataFrame) -> Table:
    """Table of boulders per year at each place and variant, with the differences from the first
    variant; `frequencies` as from `rockfall.yearly_variants`."""
    chosen = (frequencies["quantity"] == "frequency") & (frequencies["statistic"] == "all")
    names = list(frequencies["variant"].unique())
    rows = []
    for line, here in frequencies[chosen].groupby("line", sort=False):
        own = {row["variant"]: row for row in here.to_dict("records")}
        rows.append((line, *(_cell(own[name], 1.0) if name in own else "-" for name in names)))
    return Table.of(say("variants.differences"), [say("hazard.place"), *names], rows)


def _label(quantity: str, statistic: str, unit: str) -> Text:
    threshold = statistic.removeprefix("above_")
    if threshold != statistic:
        return say("variants.above", energy=Number(threshold))
    if quantity == "passing":
        return say("variants.passing")
    return say(MEAN if statistic == "mean" else Q95, quantity=say(NAMES[quantity]), unit=unit)


def _yearly_label(quantity: str, statistic: str) -> Text:
    threshold, (every, above) = statistic.removeprefix("above_"), YEARLY[quantity]
    return say(every) if threshold == statistic else say(above, energy=Number(threshold))


def _cell(row: Mapping[Any, Any], factor: float) -> str:
    """Cell with a number and, on the lines below, its difference and the interval."""
    value = value_text(row, factor)
    if not isinstance(row["verdict"], str):
        return stacked(value)
    apart, low, high = (_signed(factor * row[f"difference{end}"]) for end in ENDS)
    doubt = " ?" if row["verdict"] == UNDECIDED else ""
    ends = say("interval.range", low=low, high=high)
    limits = [f"({ends})"] if np.isfinite(row["difference_low"]) else []
    return stacked(value, Number(apart + doubt), *limits)


def value_text(row: Mapping[Any, Any], factor: float) -> str:
    """Text of a number. If no boulder passes, the upper limit of the fraction is added, because a
    few hundred boulders cannot exclude that some reach a road."""
    value = number(factor * row["value"])
    is_none = row["value"] == 0 and row["value_high"] > 0
    high = number(factor * row["value_high"], up=True)
    return say("interval.range", low=value, high=high) if is_none else value


def _signed(value: float) -> Number:
    return Number(("+" if value > 0 else "") + number(value))


def measures_table(cases: Mapping[str, Case], costs: Mapping[str, float]) -> Table:
    """Table of measures by variant, from each case, with costs."""
    rows = [[say("variants.terrain"), *(_dem(case) for case in cases.values())]]
    rows.append([say("variants.barriers"), *(_barriers(case) for case in cases.values())])
    rows.append([say("variants.dams"), *(_dams(case) for case in cases.values())])
    rows.append([say("variants.forest"), *(_forest(case) for case in cases.values())])
    if costs:
        each = (costs.get(name) for name in cases)
        shown = ("-" if cost is None else localised(f"{cost:,.10g}") for cost in each)
        rows.append([say("variants.cost"), *shown])
    return Table.of(say("variants.measures"), ["", *cases], rows, "facts")


def _dem(case: Case) -> str:
    name = case.terrain["dem"]
    return say("variants.array") if name == FROM_ARRAY else Path(name).name


def _barriers(case: Case) -> str:
    return "\n".join(map(_barrier, case.barrier)) or "-"


def _barrier(given: Mapping[str, object]) -> str:
    if "diameter" in given:
        return f"{given.get('name') or given.get('file')}: ⌀ {_digits(given['diameter'])} cm"
    strength = (
        f"EAD {given['class']}" if "class" in given else f"{_digits(given.get('capacity', 0.0))} kJ"
    )
    height = _digits(given.get("height", 0.0))
    return f"{given.get('name') or given.get('file')}: {height} m, {strength}"


def _dams(case: Case) -> str:
    heights = (_digits(dam.get("height", 0.0)) for dam in case.dam)
    return "\n".join(f"{height} m" for height in heights) or "-"


def _digits(value: object) -> str:
    return localised(f"{value:,.10g}")


def _forest(case: Case) -> str:
    """Text with the origin of the trees, the remaining fraction, and the layer of clearings; "-"
    without trees."""
    if not case.has_forest:
        return "-"
    forest = case.forest
    sources = (forest[key] for key in ("trees", "polygons", "stems") if key in forest)
    parts = [say("variants.yes") if name == FROM_ARRAY else Path(name).name for name in sources]
    if "uniform_stems" in forest:
        parts.append(f"{_digits(forest['uniform_stems'])}/ha")
    if forest["density_factor"] < 1:
        parts.append(f"× {_digits(forest['density_factor'])}")
    parts += [f"- {Path(forest['clearings']).name}"] if "clearings" in forest else []
    return "\n".join(map(str, parts))
