# SPDX-License-Identifier: BSD-3-Clause
"""Text output of the risk of objects: tables, sums, and every assumption that entered."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.analysis.objects.risk import CLASS_ENDS
from rockfall.files.risk_files import class_words, has_risk, risk_columns, total_table
from rockfall.language import Number, Text, say, word
from rockfall.quantities import count, number, within
from rockfall.text.table import table

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

MAX_OBJECTS = 20  # listed individually


def risk_lines(hazard: xr.Dataset) -> Iterator[str]:
    """Risk of the objects and of all together, and the assumptions; nothing without any."""
    if not has_risk(hazard):
        return
    yield table(risk_rows(hazard))
    yield f"  {class_legend()}"
    if (more := hazard.sizes["object"] - MAX_OBJECTS) > 0:
        yield f"  and {count(more, 'more object')}, in objects.csv"
    yield from (f"  assumption: {text}" for text in assumptions(hazard))


def assumptions(hazard: xr.Dataset) -> list[str]:
    """Assumptions of the risk, a line each; none if the objects do not say what is exposed."""
    return str(hazard.attrs["risk_assumptions"]).splitlines() if has_risk(hazard) else []


def risk_rows(hazard: xr.Dataset) -> Iterator[list[str]]:
    """Objects, those of the highest individual risk first, then of the highest damage; and sums."""
    rows = _rows(hazard)
    keys = [-np.nan_to_num(rows[name].to_numpy()) for name in ("damage", "individual_risk")]
    layer = ["layer"] * has_layers(hazard)
    head = (say(f"hazard.{name}") for name in ("damage", "individual", "class", "collective"))
    yield [f"  {say('hazard.risk_within')}", *map(word, layer), *head]
    for _, row in rows.iloc[np.lexsort(keys)][:MAX_OBJECTS].iterrows():
        damage, individual, collective = (
            _within(row, name, digits)
            for name, digits in (
                ("damage", plain), ("individual_risk", small), ("collective_risk", small),
            )
        )  # fmt: skip
        first = [f"  {row['object']}", *(row[name] for name in layer)]
        yield [*first, damage, individual, class_number(row), collective]
    sums = {row["quantity"]: row for row in total_table(hazard).to_dict("records")}
    values = {
        f"{name}{end}": row[key]
        for name, row in sums.items()
        for end, key in (("", "value"), ("_low", "low"), ("_high", "high"))
    }
    damage, deaths = _within(values, "damage", plain), _within(values, "collective_risk", small)
    yield [f"  {say('hazard.all_objects')}", *[""] * len(layer), damage, "", "", deaths]


def class_number(row: Mapping[str, Any]) -> Number | Text:
    """Number of a class of individual risk, and those at the ends of its interval if they differ:
    names of the classes are ranges themselves."""
    names = class_words().tolist()
    value, low, high = (
        Number(f"{names.index(row[f'risk_class{end}'])}") for end in ("", "_lower", "_upper")
    )
    return value if low == high else within(value, low, high)


def class_legend() -> Text:
    """Meaning of the numbers of the classes."""
    low, middle, high = (Number(f"{end:.0e}".replace("e-0", "e-")) for end in CLASS_ENDS)
    return say("hazard.risk_classes", low=low, middle=middle, high=high)


def _rows(hazard: xr.Dataset) -> pd.DataFrame:
    import pandas as pd

    columns = {"object": hazard["object"].values, **dict(risk_columns(hazard))}
    if has_layers(hazard):
        columns["layer"] = hazard["object_layer"].values
    return pd.DataFrame(columns)


def has_layers(hazard: xr.Dataset) -> bool:
    """Return True if the objects of a hazard are of several layers."""
    return "object_layer" in hazard and len({*hazard["object_layer"].values.tolist()}) > 1


def plain(value: float) -> str:
    """A sum of money."""
    return number(value, 3)


def small(value: float) -> str:
    """A risk, by a power of ten: 2.3e-7."""
    if not math.isfinite(value):
        return "-"
    return f"{value:.1e}".replace("e-0", "e-").replace("e+00", "") if value else "0"


def _within(row: Mapping[str, Any], name: str, shown: Callable[[float], str]) -> str:
    """Number and its interval; "-" where there is none."""
    value, low, high = (row[f"{name}{end}"] for end in ("", "_low", "_high"))
    return within(shown(value), shown(low), shown(high)) if math.isfinite(value) else "-"
