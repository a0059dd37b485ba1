# SPDX-License-Identifier: BSD-3-Clause
"""Statistics at the lines of a result, as messages for the page."""

import math
from collections.abc import Collection
from typing import Any

import numpy as np
import xarray as xr

from rockfall.analysis.line_statistics import numbers, withheld
from rockfall.analysis.lines.samples import LineSamples
from rockfall.analysis.precision.samples import Sample, Values
from rockfall.quantities import QUANTITIES
from rockfall.result.contents import Contents
from rockfall.result.crossings import line_names
from rockfall.result.variables import ENDS

SHOWN = ("speed", "energy_total", "passing_height")  # quantities shown at lines
NUMBERS = ("mean", "q50", "q95")
BINS = 20


class LineTable:
    """Lines of a result. Their statistics are computed on first use, because for thousands of
    lines they would take longer than the run."""

    def __init__(self, result: xr.Dataset) -> None:
        self._result = _without_maps(result)
        self._samples = LineSamples(self._result)
        self.names = line_names(self._result)
        self._indices = {name: k for k, name in enumerate(self.names)}
        self.missing = dict.fromkeys(self.names)  # lines without statistics yet, in order

    def entries(self, chosen: Collection[str]) -> list[dict[str, Any]]:
        """Name and kind of each line; the chosen lines also have statistics."""
        return [self._entry(name) if name in chosen else self._head(name) for name in self.names]

    def further(self, chosen: Collection[str]) -> list[dict[str, Any]]:
        """Entries of chosen lines whose statistics have not been sent."""
        return [self._entry(name) for name in chosen if name in self.missing]

    def _head(self, name: str) -> dict[str, Any]:
        height = self._result["barrier_height"].values if "barrier_height" in self._result else None
        barrier = height is not None and np.isfinite(height[self._indices[name]])
        return {"name": name, "kind": "barrier" if barrier else "line"}

    def _entry(self, name: str) -> dict[str, Any]:
        """Statistics of a line in display units; null where they are withheld."""
        self.missing.pop(name, None)
        line = self._indices[name]
        samples = {quantity: self._samples.sample(line, quantity) for quantity in SHOWN}
        rows = {quantity: numbers(sample, quantity) for quantity, sample in samples.items()}
        first = rows[SHOWN[0]]
        quantities = {
            quantity: _numbers(quantity, row, samples[quantity]) for quantity, row in rows.items()
        }
        return self._head(name) | {
            "n": int(first["n"]),
            "fraction": [_known(first, f"fraction{end}") for end in ENDS],
            "quantities": quantities,
        }


def _without_maps(result: xr.Dataset) -> Contents:
    """Result without maps, which slow lookups for thousands of lines."""
    held = {
        str(name): (variable.dims, variable.values, variable.attrs)
        for name, variable in result.variables.items() if "x" not in variable.dims
    }  # fmt: skip
    return Contents(held, result.attrs, map(str, result.coords))


def _known(row: dict[str, float], name: str, factor: float = 1.0) -> float | None:
    """Number of a row times `factor`; None for NaN, which would make JSON encoding much slower."""
    value = factor * float(row.get(name, math.nan))
    return value if math.isfinite(value) else None


def _numbers(name: str, row: dict[str, float], sample: Sample) -> dict[str, Any]:
    """Numbers of a quantity at a line, and its histogram."""
    quantity, without = QUANTITIES[name], withheld(row)
    factor = quantity.factor
    counts, low, high = _histogram(sample)
    return {
        "label": quantity.label, "unit": quantity.unit, "factor": factor,
        "decimals": quantity.decimals, "max": _known(row, "max", factor),
        **{
            number: [None if number in without else _known(row, f"{number}{end}", factor)
                     for end in ENDS]
            for number in NUMBERS
        },
        "counts": counts, "range": [factor * low, factor * high],
    }  # fmt: skip


def _histogram(sample: Sample) -> tuple[list[int], float, float]:
    """Counts in equal bins, and the ends of their range: 0 (or a negative minimum) and the maximum.
    No counts if the sample has no values in memory."""
    if not isinstance(sample, Values) or not sample.n:
        return [], 0.0, 1.0
    values = sample.values
    low, high = min(0.0, float(values.min())), float(values.max())
    high = high if high > low else low + 1.0
    return np.histogram(values, BINS, (low, high))[0].tolist(), low, high
