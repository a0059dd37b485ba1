# SPDX-License-Identifier: BSD-3-Clause
"""Results of a case by each rebound model, compared with observations, as tables and text."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.case import case_in
from rockfall.errors import RockfallError
from rockfall.language import Text, say, word
from rockfall.quantities import AT_LINES, QUANTITIES, Quantity, number, percent
from rockfall.result.grounds import classical_grounds
from rockfall.result.same_case import check_same_case
from rockfall.studies.models import RUN_OUT, Models
from rockfall.studies.validation import AT_REST, BOUNDS, Validation
from rockfall.table import Column, Estimate, Table, as_text, stacked
from rockfall.tables.lines import HEADLINE, estimate, in_unit

TITLES = {
    "mean": "mean", "std": "std", "q05": "5 %", "q50": "50 %", "q95": "95 %",
    "lateral_std": "lateral std", "ks": "KS", "p": "p", "wasserstein": "Wasserstein",
    "log_density": "mean logarithm",
}  # fmt: skip
BARE = ("ks", "p", "log_density")  # statistics without a unit
APART = 3.0  # page 1 begins with a warning if models differ in frequency by more than this factor
ABOUT = QUANTITIES | {AT_REST: Quantity("density at blocks at rest", "m-2", 1)}
PLACES = {"stopping_distance": "run-out in plan", AT_REST: "density at blocks at rest"}


def models_text(models: Models) -> str:
    """Text with a table for each line and for the run-out: a row for each model, intervals in
    brackets. Paired differences from the first model follow."""
    parts = [f"{models.title}: {models.boulders:,} boulders per model, 95 % intervals"]
    for table in (*model_tables(models, detailed=True), run_out_table(models)):
        parts += [f"  {table.caption}", as_text(table, "    ")]
    return "\n".join([*parts, *(f"  {note}" for note in models.notes)])


def check_models(result: xr.Dataset, models: Models, what: str) -> None:
    """Raise a RockfallError if `models` belong to another case or have other lines."""
    check_same_case(result, models.case, what)
    ours, theirs = (
        {line["name"]: (line["x"], line["y"]) for line in case_in(values.attrs).lines}
        for values in (result, models.case)
    )
    if other := [name for name, place in ours.items() if theirs.get(name) != place]:
        raise RockfallError(
            f"{what}: line '{other[0]}' is missing or elsewhere: run `rockfall models` again"
        )


def missing_spread(result: xr.Dataset, models: Models | None) -> list[str]:
    """Note that the page lacks the spread over models; none if it is shown or does not apply."""
    if models is not None or not classical_grounds(result):
        return []
    return [say("spread.missing", case_file=result.attrs["case_file"])]


def spread_table(models: Models | None) -> list[Table]:
    """Table of the minimum and maximum over all models at each line, with the headline columns."""
    if models is None or not (lines := _lines(models)):
        return []
    rows = [
        (line, *(_ends(_at(models, line, number), number[0]) for number in HEADLINE.values()))
        for line in lines
    ]
    caption = say("spread.caption", number=len(models.names), boulders=models.boulders)
    return [Table.of(caption, (say("label.line_or_barrier"), *map(say, HEADLINE)), rows)]


def apart(places: Iterable[tuple[str, Sequence[Estimate]]]) -> Iterator[Text]:
    """Sentence on the place whose frequencies by several models differ most, if by more than
    `APART` and beyond their intervals. The upper limit replaces a frequency of zero."""
    worst = APART, "", False
    for name, rates in places:
        least, most = (choose(rates, key=lambda rate: rate.value) for choose in (min, max))
        if most.low > least.high > 0:
            worst = max(worst, (most.value / (least.value or least.high), name, not least.value))
    ratio, name, is_over = worst
    if name:
        factor = number(ratio, 2)
        yield say(
            "spread.apart", name=name, factor=say("spread.over", n=factor) if is_over else factor
        )


def spread_answer(models: Models | None) -> Iterator[Text]:
    """Sentence on the line where the models differ widely; none if they agree."""
    if models is not None:
        yield from apart(
            (line, [Estimate(row["value"], row["low"], row["high"]) for _, row in rows.iterrows()])
            for line in _lines(models)
            for rows in [_at(models, line, ("fraction", "fraction"))]
        )


def spread_words(models: Models | None) -> Iterator[str]:
    """Sentences on the range of the run-out over all models, and the notes of `models`."""
    if models is None:
        return
    far = _at(models, "", (RUN_OUT, "q95"))["value"].to_numpy(float)
    low, high = (in_unit(end, RUN_OUT) for end in (far.min(), far.max()))
    yield say("spread.run_out", low=low, high=high)
    yield from (f"{note}." for note in models.notes)


def model_tables(models: Models | None, *, detailed: bool = False) -> Iterator[Table]:
    """Tables for each line with a row for each model; if `detailed`, with means and differences."""
    for line in [] if models is None else _lines(models):
        assert models is not None
        columns = {Column(say(key)): number for key, number in HEADLINE.items()}
        columns |= _columns((name, "mean") for name in AT_LINES if detailed)
        caption = say("spread.by_each_rebound_model", line=line)
        yield _by_model(models, line, caption, columns, detailed)


def run_out_table(models: Models) -> Table:
    """Table of the run-out by each model."""
    columns = _columns((RUN_OUT, number) for number in ("mean", "q95"))
    return _by_model(models, "", PLACES[RUN_OUT], columns, True)


def _columns(numbers: Iterable[tuple[str, str]]) -> dict[Column, tuple[str, str]]:
    return {Column.of(QUANTITIES[number[0]], number[1]): number for number in numbers}


def _by_model(
    models: Models, line: str, caption: str, columns: dict[Column, tuple[str, str]], detailed: bool
) -> Table:
    rows = []
    for name in models.names:
        apart = detailed and name != models.names[0]
        cells = (
            _cell(_at(models, line, number).set_index("model").loc[name], number[0], apart)
            for number in columns.values()
        )
        rows.append((word(name), *cells))
    return Table.of(caption, ("", *columns), rows)


def _lines(models: Models) -> list[str]:
    return [line for line in dict.fromkeys(models.table["line"]) if line]


def _at(models: Models, line: str, number: tuple[str, str]) -> pd.DataFrame:
    """Rows for a quantity and statistic at a line, or for the run-out."""
    quantity, statistic = number
    named = "boulders" if quantity == "fraction" else quantity
    table = models.table
    here = (table["line"] == line) & (table["quantity"] == named)
    return table[here & (table["statistic"] == statistic)]


def _cell(row: pd.Series[Any], quantity: str, has_difference: bool) -> object:
    factor = QUANTITIES[quantity].factor
    value = Estimate(*(factor * row[end] for end in ("value", "low", "high")))
    if not has_difference or np.isnan(row["difference"]):
        return value
    apart = estimate(row, "difference", quantity)
    sign = "+" if row["difference"] > 0 else ""
    return stacked(value, f"{sign}{apart}".replace("\n", " "))


def _ends(rows: pd.DataFrame, quantity: str) -> str:
    values = rows["value"].to_numpy(float)
    if np.isnan(values).all():
        return "-"
    low, high = (in_unit(end(values), quantity) for end in (np.nanmin, np.nanmax))
    return low if low == high else say("interval.range", low=low, high=high)


def validation_text(validation: Validation) -> str:
    """Text with the observed numbers for each place and quantity, and a row for each rebound
    model: means over seeds and their standard errors."""
    mean, std = (percent(BOUNDS[name]) for name in ("mean", "std"))
    seeds = f"seeds {validation.seeds[0]} to {validation.seeds[-1]}"
    parts = [
        f"{validation.title}: {validation.boulders:,} boulders per model, {seeds}; bounds: mean "
        f"within {mean}, std within {std}"
    ]
    for _, rows in validation.table.groupby(["line", "quantity"], sort=False):
        parts.append(as_text(validation_table(rows)))
    return "\n".join([*parts, *(f"  {note}" for note in validation.notes)])


def validation_table(rows: pd.DataFrame) -> Table:
    """Table of a quantity at a place: observed value, and value by each rebound model."""
    line, display = rows["line"].iloc[0], ABOUT[rows["quantity"].iloc[0]]
    names = [name for name in TITLES if name in set(rows["statistic"])]
    n = f"{rows['n_observed'].iloc[0]:,.0f} observed" if rows["n_observed"].notna().any() else ""
    place = f"{line}, {display.label}" if line else PLACES[rows["quantity"].iloc[0]]
    observed = rows.drop_duplicates("statistic").set_index("statistic")
    shown = [(n or "observed", *(
        "" if np.isnan(observed.loc[name, "observed"])
        else _with_error(observed.loc[name], "observed", display.factor) for name in names
    ))]  # fmt: skip
    for law, of_law in rows.groupby("law", sort=False):
        each = of_law.set_index("statistic")
        cells = []
        for name in names:
            factor = 1.0 if name in BARE else display.factor
            cell = _with_error(each.loc[name], "simulated", factor)
            cells.append(f"{cell} {each.loc[name, 'verdict']}".rstrip())
        shown.append((str(law), *cells))
    return Table.of("", (f"{place} [{display.unit}]", *(TITLES[name] for name in names)), shown)


def _with_error(row: pd.Series, whose: str, factor: float) -> str:
    """Cell with a number (three digits) and its standard error (one digit)."""
    value, error = factor * row[whose], factor * row[f"{whose}_error"]
    if value != value:
        return "-"
    return f"{value:.3g}" + (f" +- {error:.1g}" if error == error else "")
