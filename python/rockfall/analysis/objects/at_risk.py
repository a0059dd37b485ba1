# SPDX-License-Identifier: BSD-3-Clause
"""Layers of objects at risk, as given for a hazard or dossier."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rockfall.scene.frames import is_frame


class AtRisk(NamedTuple):
    """Arguments of `rockfall.hazard` and `rockfall.dossier` that describe objects at risk."""

    objects: Any = None  # path or GeoDataFrame, or a list of these
    #: Layer name in a file with several layers, or a name for each file.
    objects_layer: str | Sequence[str] | None = None
    vulnerability: str | Path | None = None  # table of vulnerability curves
    segments: Any = None  # roads: a path or a GeoDataFrame
    segments_layer: str | None = None
    segment_length: float | None = None  # [m]; None: each line is a segment

    @property
    def files(self) -> list[Path]:
        """Paths of the layers that are files."""
        several = isinstance(self.objects, list | tuple)
        given = [*(self.objects if several else [self.objects]), self.vulnerability, self.segments]
        return [Path(item) for item in given if item is not None and not is_frame(item)]


NOTHING = AtRisk()
