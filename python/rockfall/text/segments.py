# SPDX-License-Identifier: BSD-3-Clause
"""Text output of the hazard of segments of roads."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.hazard.segment_files import has_segments, segment_table
from rockfall.quantities import QUANTITIES, count, number
from rockfall.result.flat_maps import shown
from rockfall.text.table import table

if TYPE_CHECKING:
    import xarray as xr

MAX_SEGMENTS = 20  # listed individually
NUMBERS = {"energy_total": "energy_q95_kJ", "upper_edge": "upper_edge_q95"}


def segment_lines(found: xr.Dataset) -> Iterator[str]:
    """Table of the segments that are hit most often; nothing without any."""
    if not has_segments(found):
        return
    yield table(segment_rows(found))
    if (more := found.sizes["segment"] - MAX_SEGMENTS) > 0:
        yield f"  and {count(more, 'more segment')}, in segments.csv"
    limits = [found[f"segment_{name}_q95_high"].values for name in ("energy", "upper_edge")]
    if np.isnan(limits).any():
        yield "  -: too few boulders touch the segment to know this limit"


def segment_rows(found: xr.Dataset) -> Iterator[list[str]]:
    """Segments that are hit most often, with their frequencies, class, energies and heights."""
    rows = segment_table(found).assign(segment=found["segment"].values)
    order = np.argsort(-rows["frequency"].to_numpy(), kind="stable")
    above = [shown("threshold", one) for one in found["threshold"].values.tolist()]
    names = ["frequency", *(f"frequency_above_{one}" for one in above)]
    heads = [f"{QUANTITIES[name].short}, q95" for name in NUMBERS]
    titles = ["boulders a year", *(f"above {one}" for one in above)]
    yield ["  segment (95 %)", *titles, "hazard", *heads]
    for _, row in rows.iloc[order][:MAX_SEGMENTS].iterrows():
        hazard = row["hazard"]
        if row["hazard_lower"] != row["hazard_upper"]:
            hazard += f" ({row['hazard_lower']} to {row['hazard_upper']})"
        texts = [within(row, name) for name in names]
        yield [f"  {row['segment']}", *texts, hazard, *(within(row, NUMBERS[q]) for q in NUMBERS)]


def within(row: object, name: str) -> str:
    """Number and its interval; "-" for a limit that too few boulders give."""
    low, high = (number(row[f"{name}{end}"], 2) for end in ("_low", "_high"))  # type: ignore[index]
    return f"{number(row[name], 2)} ({low} to {high})"  # type: ignore[index]
