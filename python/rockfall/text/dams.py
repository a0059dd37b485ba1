# SPDX-License-Identifier: BSD-3-Clause
"""Dams in one line each: shape as rasterised, and as requested."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from rockfall.terrain.dams import DamShape


def dam_lines(dams: Iterable[DamShape]) -> Iterator[tuple[str, str]]:
    """Name and line of each dam."""
    for number, dam in enumerate(dams, start=1):
        height, width, slope = dam.requested
        yield (
            f"dam {number}",
            f"on the raster {dam.length:.0f} m long, {dam.height:.1f} m high "
            f"({dam.height_min:.1f} m at its lowest), face {dam.slope:.0f} degrees and "
            f"{dam.face_cells:.1f} cells wide, crest {dam.crest_width:.1f} m wide at "
            f"{dam.crest_min:,.1f} to {dam.crest_max:,.1f} m; requested {height:g} m, {slope:g} "
            f"degrees, crest {width:g} m",
        )
