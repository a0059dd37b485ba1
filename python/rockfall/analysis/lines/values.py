# SPDX-License-Identifier: BSD-3-Clause
"""Quantities of each boulder at a line, by the kernel's own rules."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rockfall.limits import line_quantities, places_along
from rockfall.result.samples import check_rows
from rockfall.result.variables import fields

if TYPE_CHECKING:
    from rockfall.result.contents import Held

HEIGHTS = ("upper_edge", "normal_height", "normal_upper_edge")
HEIGHT_NEEDS = ("jump_height", "passing_height")  # in addition to the volume
ENERGY_NEEDS = ("energy_translational", "energy_rotational")
QUANTITIES = fields("line_quantity")  # in the kernel's numbering


def line_names(result: Held) -> list[str]:
    """Names of the evaluation lines of a result, which may have none."""
    return [str(name) for name in result["line"].values] if "line" in result else []


def line_values(result: Held, quantity: str, line: int) -> np.ndarray:
    """Values of a quantity of each boulder at a line; NaN where it did not cross."""
    check_rows(result, "a quantity of each boulder at a line")
    if quantity == "position":
        return _along(result, line)
    if quantity == "fragments":
        counts = result["line_fragments"].values[line]
        return np.where(counts > 0, counts, np.nan)
    if not is_derived(result, quantity):
        return result[f"line_{quantity}"].values[line]
    return derived_values(result, line)[QUANTITIES.index(quantity)]


def is_derived(result: Held, quantity: str) -> bool:
    """Return True for a quantity that follows from others in a result."""
    return quantity != "position" and f"line_{quantity}" not in result


def derived_values(result: Held, line: int) -> np.ndarray:
    """Values (quantities, boulder) at a line of the quantities that follow from others; NaN where a
    boulder did not cross."""
    columns = {
        fields("line").index(name): result[f"line_{name}"].values[line]
        for name in HEIGHT_NEEDS + ENERGY_NEEDS
        if f"line_{name}" in result
    }
    crossed = np.zeros(result.sizes["boulder"], bool)
    for column in columns.values():
        crossed |= ~np.isnan(column)
    values = np.full((len(QUANTITIES), crossed.size), np.nan)
    if crossed.any():
        rows = np.full((len(fields("line")), np.count_nonzero(crossed)), np.nan, order="F")
        for row, column in columns.items():
            rows[row] = column[crossed]
        has_volume = "volume" in result or "line_volume" in result
        volumes = volumes_at_line(result, line)[crossed] if has_volume else rows[0]
        derived = line_quantities(rows, volumes)
        values[: len(derived), crossed] = derived
    return values


def volumes_at_line(result: Held, line: int) -> np.ndarray:
    """Volume [m3] of each boulder at a line; where boulders may break, of the fragment whose
    crossing is given (NaN where none crossed)."""
    if "line_volume" in result:
        return result["line_volume"].values[line]
    return result["volume"].values


def _along(result: Held, line: int) -> np.ndarray:
    """Distance along a line, from its first vertex, at which each boulder crossed."""
    on_line = result["line_vertex_line"].values == line
    vertices = (result[f"line_vertex_{axis}"].values[on_line] for axis in "xy")
    return places_along(*vertices, *(result[f"line_{axis}"].values[line] for axis in "xy"))
