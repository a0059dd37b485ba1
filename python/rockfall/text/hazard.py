# SPDX-License-Identifier: BSD-3-Clause
"""Text output of a hazard, with tables."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.analysis.hazard.classes import CLASSES, RESIDUAL, boulders_needed, unseen
from rockfall.analysis.hazard.zones import lowered_area, zones_of
from rockfall.case import case_in
from rockfall.files.hazard_files import object_table
from rockfall.io.rasters.arrays import grid_of
from rockfall.language import Number, say, unpacked, word
from rockfall.quantities import count, number, percent
from rockfall.text.risk import has_layers, risk_lines
from rockfall.text.segments import class_within, frequency_columns, segment_lines, with_interval
from rockfall.text.table import table

if TYPE_CHECKING:
    import xarray as xr

MAX_OBJECTS = 20  # listed individually


def hazard_summary(hazard: xr.Dataset) -> str:
    """The scenarios, the area of each class and its certain fraction, the objects, the segments of
    roads, the risk of the objects."""
    scenarios = count(hazard.sizes["scenario"], "scenario")
    lines = [f"{hazard.attrs['title'] or 'rockfall'}: {scenarios}"]
    lines.append(table(scenario_rows(hazard)))
    lines.append(f"  {say('hazard.population')}")
    lines.append(table(class_rows(hazard)))
    if "object" in hazard.dims:
        lines.append(table(object_rows(hazard)))
        if (more := hazard.sizes["object"] - MAX_OBJECTS) > 0:
            lines.append(f"  and {count(more, 'more object')}, in objects.csv")
    lines += segment_lines(hazard)
    lines += risk_lines(hazard)
    lines += [f"  warning: {text}" for text in hazard_warnings(hazard)]
    wall, cpu = (hazard.attrs[f"{clock}_seconds"] for clock in ("wall", "cpu"))
    lines.append(f"  {wall:.1f} s, {cpu:.1f} s of CPU")
    return "\n".join(lines)


def hazard_warnings(hazard: xr.Dataset) -> Iterator[str]:
    """Model remarks of `run` for each scenario, merged if all are equal; warnings of too few
    boulders to identify safe cells, and of zones that show less than the map."""
    for group in warning_groups(hazard):
        for text in group.texts:
            yield f"{group.scenarios}: {text}" if group.scenarios else text


class WarningGroup(NamedTuple):
    """Warnings about the same scenarios."""

    scenarios: str  # names; "": all of them, or the hazard itself
    texts: list[str]


def warning_groups(hazard: xr.Dataset) -> list[WarningGroup]:
    """Warnings of `hazard_warnings` by the scenarios that they are about: those of all first, then
    in the order of the scenarios."""
    groups: dict[str, list[str]] = {"": []}
    for names, text in _of_model(hazard):
        groups.setdefault(names, []).append(text)
    groups[""] += _of_hazard(hazard)
    return [WarningGroup(names, texts) for names, texts in groups.items() if texts]


def _of_hazard(hazard: xr.Dataset) -> Iterator[str]:
    """Warnings of all scenarios together."""
    yearly, longest = float(hazard["frequency"].sum()), float(hazard["return_period"].max())
    clusters = (hazard["boulders"] / hazard["boulders_per_cluster"]).values.tolist()
    parts = zip(clusters, hazard["frequency"].values, strict=True)
    factor = case_in(hazard.attrs).hazard["frequency_factor"]
    if (limit := unseen(parts, factor)) >= 1 / longest:
        needed = boulders_needed(factor[1] * yearly, longest)
        yield say("hazard.unseen", years=number(1 / limit, 2), longest=longest, needed=needed)
    minimum_area = case_in(hazard.attrs).hazard["minimum_area"]
    lowered = lowered_area(zones_of(hazard), hazard)
    parts = [
        say("hazard.area_of_class", area=number(lowered[k]), name=word(CLASSES[k]))
        for k in reversed(range(len(CLASSES)))
        if lowered[k]
    ]
    if lowered[RESIDUAL + 1 :].any():
        yield say("hazard.lowered", minimum_area=minimum_area, parts=parts)


def _of_model(hazard: xr.Dataset) -> Iterator[tuple[str, str]]:
    """Remarks on the model with the names of their scenarios; "" for those of all."""
    if "scenario_warnings" not in hazard:
        yield "", say("hazard.no_remarks")
        return
    names = map(str, hazard["scenario"].values)
    texts = {name: _remarks_of(hazard, k) for k, name in enumerate(names)}
    details = {
        text: [name for name, own in texts.items() if text in own]
        for own in texts.values()
        for text in own
    }
    for text, holders in details.items():
        yield "" if len(holders) == len(texts) else "; ".join(holders), text


def _remarks_of(hazard: xr.Dataset, k: int) -> list[str]:
    """Remarks on the model in a scenario; those of older files are in English only."""
    texts = str(hazard["scenario_warnings"].values[k]).splitlines()
    if "scenario_messages" not in hazard:
        return texts
    data = json.loads(str(hazard["scenario_messages"].values[k]))
    return [unpacked(remark, text) for remark, text in zip(data, texts, strict=True)]


def scenario_rows(hazard: xr.Dataset) -> Iterator[list[str]]:
    """Table of the scenarios: annual frequency and number of boulders."""
    heads = "hazard.a_year", "hazard.years", "hazard.simulated"
    yield [f"  {say('hazard.scenario')}", *map(say, heads)]
    columns = (hazard[name].values for name in ("scenario", "frequency", "boulders"))
    for name, yearly, boulders in zip(*columns, strict=True):
        yield [f"  {name}", number(yearly), number(1 / yearly), Number(f"{boulders:,}")]


def class_rows(hazard: xr.Dataset) -> Iterator[list[str]]:
    """Cells and area of each class present, the highest first."""
    classes, cell = hazard["hazard_class"].values, grid_of(hazard["hazard_class"])[0].cell
    certain = hazard["hazard_class_certain"].values > 0
    heads = "hazard.cells", "hazard.area", "hazard.certain"
    yield [f"  {say('hazard.hazard')}", *map(say, heads)]
    for k in range(len(CLASSES) - 1, 0, -1):
        if (here := classes == k).any():
            area = number(here.sum() * cell**2)
            certainly = percent(certain[here].mean())
            yield [f"  {word(CLASSES[k])}", Number(f"{here.sum():,}"), area, certainly]


def object_rows(hazard: xr.Dataset) -> Iterator[list[str]]:
    """Objects, those hit most often first; or those of the highest risk, if available."""
    rows = object_table(hazard)
    key = "risk" if "risk" in rows else "frequency"
    rows = rows.iloc[np.argsort(-rows[key].to_numpy(), kind="stable")][:MAX_OBJECTS]
    names, titles = frequency_columns(hazard)
    risk = ["risk"] if key == "risk" else []
    layer = has_layers(hazard)
    head = [f"  {say('hazard.object')}", *[word("layer")] * layer, *titles, say("hazard.hazard")]
    yield [*head, *(say("hazard.risk_a_year") for _ in risk)]
    for _, row in rows.iterrows():
        texts = [with_interval(row, name) for name in names + risk]
        first = [f"  {row['object']}", *[row["layer"] for _ in range(layer)]]
        yield [*first, *texts[: len(names)], class_within(row), *texts[len(names) :]]
