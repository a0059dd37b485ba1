# SPDX-License-Identifier: BSD-3-Clause
"""Text output of the hazard of segments of roads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.files.segment_files import has_segments, segment_table
from rockfall.language import Number, Text, say, word
from rockfall.quantities import QUANTITIES, count, number, within
from rockfall.result.maps.flat_maps import shown
from rockfall.text.table import table

if TYPE_CHECKING:
    import xarray as xr

MAX_SEGMENTS = 20  # listed individually
NUMBERS = {"energy_total": "energy_q95_kJ", "upper_edge": "upper_edge_q95"}


def segment_lines(hazard: xr.Dataset) -> Iterator[str]:
    """Table of the segments that are hit most often; nothing without any."""
    if not has_segments(hazard):
        return
    yield table(segment_rows(hazard))
    if (more := hazard.sizes["segment"] - MAX_SEGMENTS) > 0:
        yield f"  and {count(more, 'more segment')}, in segments.csv"
    limits = [hazard[f"segment_{name}_q95_high"].values for name in ("energy", "upper_edge")]
    if np.isnan(limits).any():
        yield "  -: too few boulders touch the segment to know this limit"


def segment_rows(hazard: xr.Dataset) -> Iterator[list[str]]:
    """Segments that are hit most often, with their frequencies, class, energies and heights."""
    rows = segment_table(hazard).assign(segment=hazard["segment"].values)
    order = np.argsort(-rows["frequency"].to_numpy(), kind="stable")
    names, titles = frequency_columns(hazard)
    heads = [f"{QUANTITIES[name].short}, q95" for name in NUMBERS]
    yield [f"  {say('hazard.segment')}", *titles, say("hazard.hazard"), *heads]
    for _, row in rows.iloc[order][:MAX_SEGMENTS].iterrows():
        texts = [with_interval(row, name) for name in names]
        values = (with_interval(row, NUMBERS[q]) for q in NUMBERS)
        yield [f"  {row['segment']}", *texts, class_within(row), *values]


def frequency_columns(hazard: xr.Dataset) -> tuple[list[str], list[str]]:
    """Columns of the annual frequencies, of all boulders and above each threshold; their heads."""
    thresholds = hazard["threshold"].values.tolist()
    names = [f"frequency_above_{shown('threshold', threshold)}" for threshold in thresholds]
    titles = [
        say("hazard.above", energy=Number(shown("threshold", threshold)))
        for threshold in thresholds
    ]
    return ["frequency", *names], [say("hazard.boulders_a_year"), *titles]


def class_within(row: Mapping[str, Any]) -> str:
    """Class of hazard, and those at the ends of its interval if they differ."""
    name, low, high = (word(row[f"hazard{end}"]) for end in ("", "_lower", "_upper"))
    return name if low == high else within(name, low, high)


def with_interval(row: Mapping[str, Any], name: str) -> Text:
    """Number and its interval; "-" for a limit that too few boulders give."""
    value, low, high = (number(row[f"{name}{end}"], 2) for end in ("", "_low", "_high"))
    return within(value, low, high)
