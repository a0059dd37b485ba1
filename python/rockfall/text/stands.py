# SPDX-License-Identifier: BSD-3-Clause
"""Stands of trees in one line each: stems over the area of their polygons."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rockfall.scene.forest.trees import Stand

SHOWN = 12  # stands that are listed


def stand_lines(stands: Sequence[Stand]) -> Iterator[str]:
    """A line for each of the first stands, and one for the others."""
    for one in stands[:SHOWN]:
        yield (
            f"stand {one.name}: {one.stems:,} stems on {one.area:.3g} ha, {one.density:,.0f} a "
            f"hectare; its layer says {one.stated:,.0f}"
        )
    if rest := stands[SHOWN:]:
        yield f"{len(rest):,} more stands: {sum(one.stems for one in rest):,} stems"
