# SPDX-License-Identifier: BSD-3-Clause
"""Text output of a hazard, with tables."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.hazard.classes import CLASSES, RESIDUAL, boulders_needed, unseen
from rockfall.analysis.hazard.files import object_table
from rockfall.analysis.hazard.zones import lowered_area, zones_of
from rockfall.case import case_in
from rockfall.io.arrays import grid_of
from rockfall.quantities import count, number, percent
from rockfall.result.flat_maps import shown
from rockfall.text.risk import has_layers, risk_lines
from rockfall.text.segments import segment_lines, within
from rockfall.text.table import table

if TYPE_CHECKING:
    import xarray as xr

MAX_OBJECTS = 20  # listed individually


def hazard_summary(found: xr.Dataset) -> str:
    """The scenarios, the area of each class and its certain fraction, the objects, the segments of
    roads, the risk of the objects."""
    scenarios = count(found.sizes["scenario"], "scenario")
    lines = [f"{found.attrs['title'] or 'rockfall'}: {scenarios}"]
    lines.append(table(scenario_rows(found)))
    lines.append(table(class_rows(found)))
    if "object" in found.dims:
        lines.append(table(object_rows(found)))
        if (more := found.sizes["object"] - MAX_OBJECTS) > 0:
            lines.append(f"  and {count(more, 'more object')}, in objects.csv")
    lines += segment_lines(found)
    lines += risk_lines(found)
    lines += [f"  warning: {text}" for text in hazard_warnings(found)]
    wall, cpu = (found.attrs[f"{clock}_seconds"] for clock in ("wall", "cpu"))
    lines.append(f"  {wall:.1f} s, {cpu:.1f} s of CPU")
    return "\n".join(lines)


def hazard_warnings(found: xr.Dataset) -> Iterator[str]:
    """Model remarks of `run` for each scenario, merged if all are equal; warnings of too few
    boulders to identify safe cells, and of zones that show less than the map."""
    yield from _of_model(found)
    yearly, longest = float(found["frequency"].sum()), float(found["return_period"].max())
    clusters = (found["boulders"] / found["boulders_per_cluster"]).values.tolist()
    parts = zip(clusters, found["frequency"].values, strict=True)
    factor = case_in(found.attrs).hazard["frequency_factor"]
    if (limit := unseen(parts, factor)) >= 1 / longest:
        needed = boulders_needed(factor[1] * yearly, longest)
        yield (
            f"where none of the boulders passed one may still come every {number(1 / limit, 2)} "
            f"years: to tell {longest:g} years take {needed:,} boulders or more in each scenario"
        )
    minimum_area = case_in(found.attrs).hazard["minimum_area"]
    lowered = lowered_area(zones_of(found), found)
    parts = [f"{number(lowered[k])} m2 {CLASSES[k]}" for k in range(len(CLASSES)) if lowered[k]]
    if lowered[RESIDUAL + 1 :].any():
        yield (
            f"in zones, minimum_area = {minimum_area:g} m2 gives a lower class to: "
            f"{'; '.join(reversed(parts))}; their attribute `highest`, and the map, keep it"
        )


def _of_model(found: xr.Dataset) -> Iterator[str]:
    """Remarks common to all scenarios, then those of single ones."""
    if "scenario_warnings" not in found:
        yield (
            "the file is of an older version, without what must be said of the model: run the "
            "hazard again"
        )
        return
    texts = {
        str(name): str(text).splitlines()
        for name, text in zip(
            found["scenario"].values, found["scenario_warnings"].values, strict=True
        )
    }
    said = {
        text: [name for name, own in texts.items() if text in own]
        for own in texts.values()
        for text in own
    }
    for text, names in said.items():
        yield text if len(names) == len(texts) else f"{'; '.join(names)}: {text}"


def scenario_rows(found: xr.Dataset) -> Iterator[list[str]]:
    """Table of the scenarios: annual frequency and number of boulders."""
    yield ["  scenario", "a year", "years from one to the next", "simulated"]
    columns = (found[name].values for name in ("scenario", "frequency", "boulders"))
    for name, yearly, boulders in zip(*columns, strict=True):
        yield [f"  {name}", number(yearly), number(1 / yearly), f"{boulders:,}"]


def class_rows(found: xr.Dataset) -> Iterator[list[str]]:
    """Cells and area of each class present, the highest first."""
    classes, cell = found["hazard_class"].values, grid_of(found["hazard_class"])[0].cell
    certain = found["hazard_class_certain"].values > 0
    yield ["  hazard", "cells", "area [m2]", "certain"]
    for k in range(len(CLASSES) - 1, 0, -1):
        if (here := classes == k).any():
            area = number(here.sum() * cell**2)
            yield [f"  {CLASSES[k]}", f"{here.sum():,}", area, percent(certain[here].mean())]


def object_rows(found: xr.Dataset) -> Iterator[list[str]]:
    """Objects, those hit most often first; or those of the highest risk, if available."""
    rows = object_table(found)
    key = "risk" if "risk" in rows else "frequency"
    rows = rows.iloc[np.argsort(-rows[key].to_numpy(), kind="stable")][:MAX_OBJECTS]
    above = [shown("threshold", one) for one in found["threshold"].values.tolist()]
    names = ["frequency", *(f"frequency_above_{one}" for one in above)]
    titles = ["boulders a year", *(f"above {one}" for one in above)]
    risk = ["risk"] if key == "risk" else []
    layer = has_layers(found)
    head = ["  object (95 %)", *["layer"] * layer, *titles, "hazard"]
    yield [*head, *(f"{one} a year" for one in risk)]
    for _, row in rows.iterrows():
        texts = [within(row, name) for name in names + risk]
        hazard = row["hazard"]
        if row["hazard_lower"] != row["hazard_upper"]:
            hazard += f" ({row['hazard_lower']} to {row['hazard_upper']})"
        first = [f"  {row['object']}", *[row["layer"] for _ in range(layer)]]
        yield [*first, *texts[: len(names)], hazard, *texts[len(names) :]]
