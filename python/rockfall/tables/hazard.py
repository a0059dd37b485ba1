# SPDX-License-Identifier: BSD-3-Clause
"""Hazard as tables: scenarios, classes, objects, road segments, and risk to objects."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.hazard.classes import CLASSES
from rockfall.analysis.hazard.combined import RISK_TEXTS
from rockfall.analysis.hazard.levels import PLACES, find_place
from rockfall.analysis.hazard.released import EXTENT
from rockfall.analysis.objects.risk import CLASS_ENDS
from rockfall.analysis.objects.segments import segment_names
from rockfall.files.hazard_files import object_table as objects_of
from rockfall.files.risk_files import class_words, has_risk, risk_columns
from rockfall.files.segment_files import SHOWN_COLUMNS, has_segments
from rockfall.files.segment_files import segment_table as segments_of
from rockfall.io.rasters.arrays import grid_of
from rockfall.language import Number, Text, say, unpacked_texts, word
from rockfall.quantities import QUANTITIES, number, percent, small, worst_first
from rockfall.result.maps.flat_maps import shown
from rockfall.result.variables import ENDS
from rockfall.table import Column, Estimate, Table, between, stacked

RELEASED_HEADS = {  # message ids
    "volume": "inputs.volume_m",
    "density": "inputs.density_kg_m",
    "drop_height": "hazard.drop_height",
    "release_speed": "hazard.release_speed",
}
MOST = 20  # maximum places in a table
FACTORS = {"energy": 1e-3, "height": 1.0}  # from levels by return period to the unit shown


def hazard_tables(hazard: xr.Dataset) -> Iterator[Table]:
    """Tables of class areas, energies and heights by return period, objects, road segments and
    scenarios; `risk_table` gives the risk."""
    yield class_table(hazard)
    yield from period_tables(hazard)
    if "object" in hazard.dims:
        yield object_table(hazard)
    if has_segments(hazard):
        yield segment_table(hazard)
    yield scenario_table(hazard)


def scenario_table(hazard: xr.Dataset) -> Table:
    """Table of scenarios: annual frequency, return period, number of simulated boulders, and range
    of the quantities of the released boulders."""
    columns = (hazard[name].values.tolist() for name in ("scenario", "frequency", "boulders"))
    heads = [f"hazard.{name}" for name in ("scenario", "a_year", "years", "simulated")]
    shown = dict(RELEASED_HEADS)
    if not hazard["released_release_speed_max"].values.any():
        del shown["release_speed"]
    rows = [
        (name, yearly, 1 / yearly, boulders, *(_released(hazard, k, what) for what in shown))
        for k, (name, yearly, boulders) in enumerate(zip(*columns, strict=True))
    ]
    return Table.of(say("sheet.scenarios"), map(say, [*heads, *shown.values()]), rows)


def _released(hazard: xr.Dataset, k: int, what: str) -> str:
    """Range and mean of a quantity of the boulders that scenario k releases."""
    values = (hazard[f"released_{what}_{end}"].values[k] for end in EXTENT)
    low, mean, high = (number(value, 4 if what == "density" else 3) for value in values)
    if low == "-":
        return say("inputs.not_kept")
    return low if low == high else say("inputs.range", low=low, high=high, mean=mean)


def class_table(hazard: xr.Dataset) -> Table:
    """Table of cells, area and certain fraction for each class present, highest class first."""
    classes, cell = hazard["hazard_class"].values, grid_of(hazard["hazard_class"])[0].cell
    certain = hazard["hazard_class_certain"].values > 0
    rows = [
        (word(CLASSES[k]), int(n := here.sum()), float(n * cell**2), percent(certain[here].mean()))
        for k in range(len(CLASSES) - 1, 0, -1)
        if (here := classes == k).any()
    ]  # fmt: skip
    heads = "hazard.hazard", "hazard.cells", "hazard.area", "hazard.certain"
    return Table.of(say("tables.classes_of_hazard"), map(say, heads), rows)


def period_tables(hazard: xr.Dataset, *names: str) -> Iterator[Table]:
    """Tables of energies and heights by return period at the named places (default: the worst
    lines, objects and segments). No table if all levels are unknown."""
    with_levels = [
        (place.kind, place.k)
        for place in places_of(hazard, barriers=True)
        if f"{place.kind}_energy_by_period" in hazard
        and not np.isnan(hazard[f"{place.kind}_energy_by_period"].values[place.k]).any()
    ]
    named = [place for name in names if (place := find_place(hazard, name)) in with_levels]
    places = named if names else with_levels[:MOST]
    if not places:
        return
    names_of = {kind: place_names(hazard, kind) for kind in dict(places)}
    left = 0 if names else len(with_levels)
    years = [say("hazard.in_years", years=T) for T in hazard["event_period"].values.tolist()]
    for quantity, factor in FACTORS.items():
        names = [f"{quantity}_by_period{end}" for end in ENDS]
        rows = []
        for kind, k in places:
            levels = np.array([hazard[f"{kind}_{name}"].values[k] for name in names]) * factor
            rows.append((names_of[kind][k], *map(level_cell, *levels.tolist())))
        caption = worst_caption(say(f"tables.{quantity}_by_period"), left)
        yield Table.of(caption, [say("hazard.place"), *years], rows)


def worst_caption(caption: Text, places: int, most: int = MOST) -> Text:
    """Caption of a table that shows at most `most` of `places` places, the worst first."""
    if places <= most:
        return caption
    return say("tables.worst", caption=caption, part=most, n=places)


class Place(NamedTuple):
    """A line, object or segment of a hazard: kind, index within this kind, and name."""

    kind: str
    k: int
    name: str


def places_of(hazard: xr.Dataset, *, barriers: bool = False) -> list[Place]:
    """Lines (without the case's barriers, unless `barriers`), objects and segments, the worst
    first: by frequency, and by energy and height in the longest return period."""
    places, loads = [], []
    for kind in PLACES:
        if kind in hazard.dims:
            names = place_names(hazard, kind)
            is_shown = np.full(len(names), True)
            if kind == "line" and not barriers:
                is_shown = np.isnan(hazard["line_barrier_height"].values)
            places += [Place(kind, int(k), names[k]) for k in np.flatnonzero(is_shown)]
            loads.append(_loads(hazard, kind)[:, is_shown])
    return [places[k] for k in worst_first(*np.hstack(loads))] if places else []


def _loads(hazard: xr.Dataset, kind: str) -> np.ndarray:
    """Frequency, and energy and height in the longest return period, of all places of a kind;
    NaN if unknown."""
    frequency = hazard[f"{kind}_frequency"].values
    names = f"{kind}_energy_by_period", f"{kind}_height_by_period"
    unknown = np.full(frequency.shape, np.nan)
    levels = (hazard[name].values[:, -1] if name in hazard else unknown for name in names)
    return np.array([frequency, *levels])


def place_names(hazard: xr.Dataset, kind: str) -> list[str]:
    """Names of lines, objects or segments (`kind`); those of segments in the current language."""
    if kind != "segment":
        return [str(name) for name in hazard[kind].values]
    roads, starts, ends = (hazard[f"segment_{name}"].values for name in ("road", "start", "end"))
    return segment_names(roads.tolist(), starts, ends)


def level_cell(value: float, low: float, high: float) -> Estimate | float:
    """Cell with the level of a return period and its interval; 0 if its upper limit is 0, because
    boulders are less frequent."""
    if high == 0:
        return 0.0
    is_open = np.isinf(high) and not low
    return Estimate(value, np.nan if is_open else low, high, digits=2)


def object_table(hazard: xr.Dataset) -> Table:
    """Table of objects, the worst first: by risk if known, frequency, energy and height."""
    frame = objects_of(hazard)
    key = "risk" if "risk" in frame else "frequency"
    first = [frame["risk"]] if "risk" in frame else []
    frame = frame.iloc[worst_first(*first, *_loads(hazard, "object"))[:MOST]]
    names, titles = _frequencies(hazard)
    risk, layer = ["risk"] * (key == "risk"), ["layer"] * has_layers(hazard)
    rows = [
        (row["object"], *(row[name] for name in layer), *(_estimate(row, name) for name in names),
         class_within(row), *(_estimate(row, name) for name in risk))
        for row in frame.to_dict("records")
    ]  # fmt: skip
    heads = [say("hazard.object"), *map(word, layer), *titles, say("hazard.hazard")]
    caption = worst_caption(say("tables.objects"), hazard.sizes["object"])
    return Table.of(caption, [*heads, *(say("hazard.risk_a_year") for _ in risk)], rows)


def stretch_tables(hazard: xr.Dataset, line: str) -> Iterator[Table]:
    """Tables of the segments of a line, in its direction: their frequencies, class, energies and
    heights, and their energies by return period. No table without segments."""
    if has_segments(hazard):
        order = np.flatnonzero(hazard["segment_name"].values == line)
        if order.size:
            caption = say("tables.segments_of_line", line=line)
            yield segment_table(hazard, order)._replace(caption=caption)
            yield from [*period_tables(hazard, *hazard["segment"].values[order])][:1]


def segment_table(hazard: xr.Dataset, order: np.ndarray | None = None) -> Table:
    """Table of segments in `order` (default: the worst first): frequencies, class, energies and
    heights."""
    frame = segments_of(hazard).assign(segment=place_names(hazard, "segment"))
    places = len(frame) if order is None else 0
    if order is None:
        order = np.array(worst_first(*_loads(hazard, "segment"))[:MOST])
    names, titles = _frequencies(hazard)
    rows = [
        (row["segment"], *(_estimate(row, name) for name in names), class_within(row),
         *(_estimate(row, name) for name in SHOWN_COLUMNS.values()))
        for row in frame.iloc[order].to_dict("records")
    ]  # fmt: skip
    columns = (Column.of(QUANTITIES[name], "q95", short=True) for name in SHOWN_COLUMNS)
    heads = say("hazard.segment"), *titles, say("hazard.hazard")
    caption = worst_caption(say("tables.segments"), places)
    return Table.of(caption, [*heads, *columns], rows)


def risk_table(hazard: xr.Dataset) -> Table:
    """Table of object risks, by decreasing individual risk, then damage; with sums."""
    layer = ["layer"] * has_layers(hazard)
    frame = pd.DataFrame({"object": hazard["object"].values, **dict(risk_columns(hazard))})
    keys = [-np.nan_to_num(frame[name].to_numpy()) for name in ("damage", "individual_risk")]
    order = np.lexsort(keys)[:MOST]
    layers = hazard["object_layer"].values[order] if layer else order
    rows = [
        (row["object"], *([of_layer] if layer else []), _estimate(row, "damage", 3),
         Risk.of(row, "individual_risk"), class_number(row), Risk.of(row, "collective_risk"))
        for of_layer, row in zip(layers, frame.iloc[order].to_dict("records"), strict=True)
    ]  # fmt: skip
    damage = Estimate(*total(hazard, "damage"), digits=3)
    deaths = Risk(*total(hazard, "collective_risk"))
    rows.append((say("hazard.all_objects"), *[""] * len(layer), damage, "", "", deaths))
    heads = (say(f"hazard.{name}") for name in ("damage", "individual", "class", "collective"))
    return Table.of(class_legend(), [say("hazard.risk_within"), *map(word, layer), *heads], rows)


def total(hazard: xr.Dataset, what: str) -> tuple[float, float, float]:
    """Sum of `damage` or `collective_risk` over all objects, with limits; NaN if unknown."""
    is_known = np.isfinite(hazard[f"object_{what}"].values).any()
    value, low, high = (float(hazard[f"total_{what}{end}"]) if is_known else np.nan for end in ENDS)
    return value, low, high


def assumptions(hazard: xr.Dataset) -> list[str]:
    """Assumptions of the risk in the current language; empty without risk."""
    if not has_risk(hazard):
        return []
    return unpacked_texts(*(hazard.attrs[name] for name in RISK_TEXTS))


def class_number(row: Mapping[str, Any]) -> str:
    """Number of an individual-risk class, and the numbers at the interval limits if they differ;
    class names are ranges already."""
    names = class_words().tolist()
    value, low, high = (
        Number(f"{names.index(row[f'risk_class{end}'])}") for end in ("", "_lower", "_upper")
    )
    return value if low == high else stacked(value, between(low, high))


def class_legend() -> Text:
    """Explanation of the numbers of the individual-risk classes."""
    low, middle, high = (Number(f"{end:.0e}".replace("e-0", "e-")) for end in CLASS_ENDS)
    return say("hazard.risk_classes", low=low, middle=middle, high=high)


def has_layers(hazard: xr.Dataset) -> bool:
    """Return True if the objects of a hazard come from several layers."""
    return len({*hazard["object_layer"].values.tolist()}) > 1


def class_within(row: Mapping[str, Any]) -> str:
    """Hazard class, and the classes at the interval limits if they differ."""
    name, low, high = (word(row[f"hazard{end}"]) for end in ("", "_lower", "_upper"))
    return name if low == high else stacked(name, between(low, high))


def _frequencies(hazard: xr.Dataset) -> tuple[list[str], list[str]]:
    """Columns and heads for the frequency of all boulders, and above each threshold."""
    thresholds = hazard["threshold"].values.tolist()
    energies = [Number(shown("threshold", value, " ")) for value in thresholds]
    titles = [say("hazard.above", energy=energy) for energy in energies]
    names = [f"frequency_above_{shown('threshold', value)}" for value in thresholds]
    return ["frequency", *names], [say("hazard.boulders_a_year"), *titles]


def _estimate(row: Mapping[Any, Any], name: str, digits: int = 2) -> Estimate:
    return Estimate.of(row, name, digits=digits)


class Risk(Estimate):
    """A risk and its limits, displayed as powers of ten."""

    __slots__ = ()

    def shown(self, value: float, *, up: bool = False) -> Number:
        return small(value)
