# SPDX-License-Identifier: BSD-3-Clause
"""Text output of the risk of objects: tables, sums, and every assumption that entered."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.hazard.risk_files import has_risk, risk_columns, total_table
from rockfall.quantities import count, number
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
    head = ["damage", "individual", "class", "collective (deaths)"]
    yield ["  risk a year (95 %)", *layer, *head]
    for _, row in rows.iloc[np.lexsort(keys)][:MAX_OBJECTS].iterrows():
        of_class = row["risk_class"]
        if row["risk_class_lower"] != row["risk_class_upper"]:
            of_class += f" ({row['risk_class_lower']} to {row['risk_class_upper']})"
        damage, individual, collective = (
            within(row, name, digits)
            for name, digits in (
                ("damage", plain), ("individual_risk", small), ("collective_risk", small),
            )
        )  # fmt: skip
        first = [f"  {row['object']}", *(row[name] for name in layer)]
        yield [*first, damage, individual, of_class, collective]
    sums = {row["quantity"]: row for row in total_table(hazard).to_dict("records")}
    values = {
        f"{name}{end}": row[key]
        for name, row in sums.items()
        for end, key in (("", "value"), ("_low", "low"), ("_high", "high"))
    }
    damage, deaths = within(values, "damage", plain), within(values, "collective_risk", small)
    yield ["  all objects", *[""] * len(layer), damage, "", "", deaths]


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


def within(row: object, name: str, shown: object) -> str:
    """Number and its interval; "-" where there is none."""
    value, low, high = (row[f"{name}{end}"] for end in ("", "_low", "_high"))  # type: ignore[index]
    if not math.isfinite(value):
        return "-"
    return f"{shown(value)} ({shown(low)} to {shown(high)})"  # type: ignore[operator]
