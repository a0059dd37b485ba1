# SPDX-License-Identifier: BSD-3-Clause
"""Map labels that do not overlap each other or the frame."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.plots.style import INK, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Annotation

#: Position x, y [m], angle of the text [degree], and offset from the position [points].
Place = tuple[float, float, float, tuple[float, float]]

FREE = 2.0  # minimum gap between texts [dots]
TRIED = 24  # places tried along a curve
BESIDE = ((0.0, 4.0), (0.0, -4.0), (4.0, 0.0), (-4.0, 0.0))  # offsets tried for a name [points]


class Labels:
    """Labels of a map whose scale is fixed."""

    def __init__(self, axes: Axes) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        self.axes = axes
        self.boxes: list[Any] = []
        self.renderer = FigureCanvasAgg(axes.figure).get_renderer()  # type: ignore[arg-type]

    def put(self, text: str, places: Iterable[Place], **style: Any) -> bool:
        """Write a text at the first free place; return False if there is none."""
        from matplotlib.patheffects import withStroke

        halo = [withStroke(linewidth=2, foreground="white")]
        style = {"color": INK, "path_effects": halo, "rotation_mode": "anchor"} | style
        frame = self.axes.get_window_extent(self.renderer)
        rooms: dict[Any, Any] = {}  # cached text boxes, because measuring is slow
        for x, y, angle, offset in places:
            at = self.axes.transData.transform((x, y))
            if not frame.contains(*at):
                continue
            if (angle, offset) not in rooms:
                note = self._written(text, (x, y), angle, offset, style)
                box = note.get_window_extent(self.renderer).padded(FREE)
                rooms[angle, offset] = box.translated(*-at)
                note.remove()
            box = rooms[angle, offset].translated(*at)
            is_inside = frame.contains(box.x0, box.y0) and frame.contains(box.x1, box.y1)
            if is_inside and not box.count_overlaps(self.boxes):
                self._written(text, (x, y), angle, offset, style)
                self.boxes.append(box)
                return True
        return False

    def _written(
        self, text: str, place: tuple[float, float], angle: float, offset: tuple[float, float],
        style: dict[str, Any],
    ) -> Annotation:  # fmt: skip
        right, up = offset
        ha = "center" if not right else "left" if right > 0 else "right"
        va = "center" if not up else "bottom" if up > 0 else "top"
        return self.axes.annotate(
            plain(text), place, offset, textcoords="offset points",
            rotation=angle, ha=ha, va=va, **style,
        )  # fmt: skip


def beside(x: np.ndarray, y: np.ndarray) -> Iterator[Place]:
    """Candidate places for the name of a polyline, starting at its first vertex."""
    for at in np.linspace(0, x.size - 1, TRIED) if x.size else ():
        for offset in BESIDE:
            place = (float(np.interp(at, np.arange(x.size), c)) for c in (x, y))
            yield (*place, 0.0, offset)  # type: ignore[misc]


def along(curve: np.ndarray) -> Iterator[Place]:
    """Candidate places for a number on a contour, from the middle outwards."""
    inner = np.linspace(0.08, 0.92, TRIED)
    for part in sorted(inner, key=lambda place: abs(place - 0.5)):
        k = int(part * (len(curve) - 1))
        before, after = curve[max(k - 2, 0)], curve[min(k + 2, len(curve) - 1)]
        angle = np.degrees(np.arctan2(*(after - before)[::-1]))
        yield float(curve[k, 0]), float(curve[k, 1]), (angle + 90) % 180 - 90, (0.0, 0.0)
