# SPDX-License-Identifier: BSD-3-Clause
"""Dams in one line each: shape as rasterised, and as requested."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from rockfall.terrain.dams import DamShape


def dam_lines(dams: Iterable[DamShape]) -> Iterator[tuple[str, str]]:
    """Name and line of each dam."""
    for number, one in enumerate(dams, start=1):
        height, width, slope = one.requested
        yield (
            f"dam {number}",
            f"on the raster {one.length:.0f} m long, {one.height:.1f} m high "
            f"({one.height_min:.1f} m at its lowest), face {one.slope:.0f} degrees and "
            f"{one.face_cells:.1f} cells wide, crest {one.crest_width:.1f} m wide at "
            f"{one.crest_min:,.1f} to {one.crest_max:,.1f} m; requested {height:g} m, {slope:g} "
            f"degrees, crest {width:g} m",
        )
