# SPDX-License-Identifier: BSD-3-Clause
"""Hazard as text, with tables."""

from collections.abc import Collection, Iterator
from typing import NamedTuple

import pandas as pd
import xarray as xr

from rockfall.analysis.hazard.classes import CLASSES, RESIDUAL, boulders_needed, unseen
from rockfall.analysis.hazard.model_warnings import stored_warnings
from rockfall.analysis.hazard.zones import lowered_area, zones_of
from rockfall.case import case_in
from rockfall.files.risk_files import has_risk
from rockfall.files.segment_files import has_segments
from rockfall.language import Text, say, word
from rockfall.quantities import count, number
from rockfall.table import Column, Estimate, Table, as_text
from rockfall.tables.hazard import (
    MOST,
    assumptions,
    class_table,
    object_table,
    period_tables,
    risk_table,
    scenario_table,
    segment_table,
)

AREAS = 10  # maximum source areas printed


def hazard_summary(hazard: xr.Dataset) -> str:
    """Summary of a hazard: scenarios, area of each class with its certain fraction, objects, road
    segments, object risk and its assumptions."""
    scenarios = count(hazard.sizes["scenario"], "scenario")
    lines = [f"{hazard.attrs['title'] or 'rockfall'}: {scenarios}"]
    lines += [
        as_text(scenario_table(hazard)),
        f"  {say('hazard.population')}",
        as_text(class_table(hazard)),
    ]
    for table in period_tables(hazard):
        lines += [f"  {table.caption}", as_text(table)]
    if "object" in hazard.dims:
        lines += [as_text(object_table(hazard)), *_more(hazard, "object")]
    if has_segments(hazard):
        lines += [as_text(segment_table(hazard)), *_more(hazard, "segment")]
    if has_risk(hazard):
        table = risk_table(hazard)
        lines += [as_text(table), f"  {table.caption}", *_more(hazard, "object")]
        lines += [f"  assumption: {sentence}" for sentence in assumptions(hazard)]
    lines += [f"  warning: {sentence}" for sentence in hazard_warnings(hazard)]
    wall, cpu = (hazard.attrs[f"{clock}_seconds"] for clock in ("wall", "cpu"))
    lines.append(f"  {wall:.1f} s, {cpu:.1f} s of CPU")
    return "\n".join(lines)


def _more(hazard: xr.Dataset, name: str) -> list[str]:
    more = hazard.sizes[name] - MOST
    return [f"  and {count(more, f'more {name}')}, in {name}s.csv"] * (more > 0)


def hazard_warnings(hazard: xr.Dataset, shown: Collection[str] = ()) -> Iterator[str]:
    """Warnings of a hazard, except those with ids in `shown`: model remarks of each scenario,
    merged if equal; too few boulders to identify safe cells, and zones that show a lower class than
    the map."""
    for group in warning_groups(hazard):
        for sentence in group.texts:
            if isinstance(sentence, Text) and sentence.key in shown:
                continue
            yield f"{group.scenarios}: {sentence}" if group.scenarios else sentence


class WarningGroup(NamedTuple):
    """Warnings about the same scenarios."""

    scenarios: str  # scenario names; "" for all scenarios or the whole hazard
    texts: list[str]


def warning_groups(hazard: xr.Dataset) -> list[WarningGroup]:
    """Groups of `hazard_warnings`: first those on all scenarios, then by scenario."""
    groups: dict[str, list[str]] = {"": []}
    for names, text in _of_model(hazard):
        groups.setdefault(names, []).append(text)
    groups[""] += limits_of_hazard(hazard)
    return [WarningGroup(names, texts) for names, texts in groups.items() if texts]


def limits_of_hazard(hazard: xr.Dataset) -> Iterator[Text]:
    """Warnings on the whole hazard: too few boulders for safe cells, and zones shown lower."""
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
    """Model remarks with the names of their scenarios; "" for remarks on all scenarios."""
    texts = stored_warnings(hazard)
    details = {
        text: [name for name, own in texts.items() if text in own]
        for own in texts.values()
        for text in own
    }
    for text, holders in details.items():
        yield "" if len(holders) == len(texts) else "; ".join(holders), text


def origins_text(areas: pd.DataFrame, place: str, side: float) -> str:
    """Boulders per year that reach a place, and the source areas from which most of them come, with
    95 % intervals; `side` is the side of the areas [m]."""
    *names, quantile, high = map(str, areas.drop(columns=["frequency_low", "frequency_high"]))
    columns = [*(Column(axis, "m", 0) for axis in "xy"), *map(Column, [*names[2:], quantile])]
    rows = [
        (
            *(
                Estimate.of(row, name, digits=2) if name == "frequency" else row[name]
                for name in names
            ),
            Estimate(row[quantile], high=row[high]),
        )
        for row in areas[:AREAS].to_dict("records")
    ]
    arrive, sources = number(areas["frequency"].sum()), count(areas["cells"].sum(), "source cell")
    text = f"{place}: {arrive} boulders per year, from squares of {side:g} m with {sources}"
    more = len(areas) - AREAS
    rest = f"\n  and {count(more, 'more square')}, in areas.csv" if more > 0 else ""
    return f"{text}\n{as_text(Table('', columns, rows))}{rest}"
