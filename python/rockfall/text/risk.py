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


def risk_lines(found: xr.Dataset) -> Iterator[str]:
    """Risk of the objects and of all together, and the assumptions; nothing without any."""
    if not has_risk(found):
        return
    yield table(risk_rows(found))
    if (more := found.sizes["object"] - MAX_OBJECTS) > 0:
        yield f"  and {count(more, 'more object')}, in objects.csv"
    yield from (f"  assumption: {text}" for text in assumptions(found))


def assumptions(found: xr.Dataset) -> list[str]:
    """Assumptions of the risk, a line each; none if the objects do not say what is exposed."""
    return str(found.attrs["risk_assumptions"]).splitlines() if has_risk(found) else []


def risk_rows(found: xr.Dataset) -> Iterator[list[str]]:
    """Objects, those of the highest individual risk first, then of the highest damage; and sums."""
    rows = _rows(found)
    keys = [-np.nan_to_num(rows[name].to_numpy()) for name in ("damage", "individual_risk")]
    layer = ["layer"] * has_layers(found)
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
    sums = {row["quantity"]: row for row in total_table(found).to_dict("records")}
    about = {
        f"{name}{end}": row[key]
        for name, row in sums.items()
        for end, key in (("", "value"), ("_low", "low"), ("_high", "high"))
    }
    damage, deaths = within(about, "damage", plain), within(about, "collective_risk", small)
    yield ["  all objects", *[""] * len(layer), damage, "", "", deaths]


def _rows(found: xr.Dataset) -> pd.DataFrame:
    import pandas as pd

    columns = {"object": found["object"].values, **dict(risk_columns(found))}
    if has_layers(found):
        columns["layer"] = found["object_layer"].values
    return pd.DataFrame(columns)


def has_layers(found: xr.Dataset) -> bool:
    """Return True if the objects of a hazard are of several layers."""
    return "object_layer" in found and len({*found["object_layer"].values.tolist()}) > 1


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
