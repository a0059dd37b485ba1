# SPDX-License-Identifier: BSD-3-Clause
"""Stands of trees in one line each: stems over the area of their polygons."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rockfall.scene.forest.trees import Stand

SHOWN = 12  # stands that are listed


def stand_lines(stands: Sequence[Stand]) -> Iterator[str]:
    """A line for each of the first stands, and one for the others."""
    for stand in stands[:SHOWN]:
        yield (
            f"stand {stand.name}: {stand.stems:,} stems on {stand.area:.3g} ha, "
            f"{stand.density:,.0f} a hectare; its layer says {stand.stated:,.0f}"
        )
    if rest := stands[SHOWN:]:
        yield f"{len(rest):,} more stands: {sum(stand.stems for stand in rest):,} stems"
