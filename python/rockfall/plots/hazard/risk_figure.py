# SPDX-License-Identifier: BSD-3-Clause
"""Objects by individual risk class, over the terrain relief."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from rockfall.files.risk_files import COLOURS, class_words
from rockfall.language import say
from rockfall.plots.cartography.labels import beside
from rockfall.plots.cartography.marks import OBJECT, draw_line
from rockfall.plots.cartography.sheet import Sheet
from rockfall.plots.style import INK
from rockfall.quantities import small

BROAD: dict[str, Any] = OBJECT | {"linewidth": 3.0}


def risk_key(hazard: xr.Dataset) -> list[Any]:
    """Legend handles for the classes that occur, highest class first."""
    from matplotlib.patches import Patch

    numbers = {*hazard["object_risk_class"].values.tolist()}
    words = [say("hazard.risk_class", name=name) for name in class_words().tolist()]
    words[0] = say("hazard.no_risk")
    return [
        Patch(facecolor=COLOURS[k], edgecolor=INK, label=words[k])
        for k in sorted(numbers, reverse=True)
    ]


def draw_risk(sheet: Sheet, hazard: xr.Dataset) -> None:
    """Draw objects in class colours, with names and individual risks."""
    import shapely

    shapes = shapely.from_wkt(hazard["object_geometry"].values.astype(str))
    numbers, risks = (hazard[f"object_{name}"].values for name in ("risk_class", "individual_risk"))
    for name, shape, number, risk in zip(
        hazard["object"].values, shapes, numbers, risks, strict=True
    ):
        colour = COLOURS[number]
        for part in getattr(shape, "geoms", [shape]):
            _draw_part(sheet, part, colour)
        text = str(name) if np.isnan(risk) else f"{name}\n{small(float(risk))}"
        sheet.labels.put(text, beside(*shapely.get_coordinates(shape).T))


def _draw_part(sheet: Sheet, part: Any, colour: str) -> None:
    if part.geom_type == "Polygon":
        x, y = np.array(part.exterior.coords).T[:2]
        sheet.axes.fill(x, y, color=colour)
        draw_line(sheet, x, y, OBJECT)
        return
    x, y = np.array(part.coords).T[:2]
    if x.size == 1:
        sheet.axes.plot(x, y, "o", ms=6, mfc=colour, mec=INK, mew=0.8)
    else:
        draw_line(sheet, x, y, BROAD | {"color": colour})
