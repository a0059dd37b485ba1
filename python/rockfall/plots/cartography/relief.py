# SPDX-License-Identifier: BSD-3-Clause
"""Map background: shaded relief or the user's image, and contours."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rockfall.plots.cartography.rasters import cropped, draw_image
from rockfall.plots.extent import Extent
from rockfall.result.trajectories import Terrain

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BROWN = "#5f4426"
DARKEST = 0.35
#: Azimuth [degree] and weight of each light.
LIGHTS = ((315.0, 0.5), (0.0, 0.2), (270.0, 0.2), (45.0, 0.1))
INTERVALS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)  # standard map intervals [m]
INDEX = 5  # every fifth contour is bold and labelled
LINES = 60  # contours on a map, at most about
CONTOUR_DOTS = 400  # terrain resolution for contours; finer contours are ragged
SHORTEST = 12  # minimum vertices of a contour


class Contours(NamedTuple):
    """Contour interval [m], and curves (n, 2) [m] for each level."""

    interval: float
    curves: dict[float, list[np.ndarray]]

    def is_index(self, level: float) -> bool:
        return round(level / self.interval) % INDEX == 0


def shade(z: np.ndarray, cell: float) -> np.ndarray:
    """Brightness (0 to 1) of a terrain that is lit mainly from the north-west, darker on steep
    ground; nodata is white. Shared by the maps on a page."""
    return _shade(z.tobytes(), z.dtype.str, z.shape, cell)


@lru_cache(maxsize=2)
def _shade(content: bytes, dtype: str, shape: tuple[int, int], cell: float) -> np.ndarray:
    z = np.frombuffer(content, dtype).reshape(shape)
    down, right = np.gradient(z, cell)
    length = np.sqrt(1 + right**2 + down**2)
    light = np.zeros_like(length)
    for azimuth, part in LIGHTS:
        angle = np.radians(azimuth)
        light += part * np.clip((1 - right * np.sin(angle) + down * np.cos(angle)) / length, 0, 9)
    light += 0.5 / length
    dark, bright = np.nanpercentile(light, [1, 99]) if np.isfinite(light).any() else (0, 1)
    shade = DARKEST + (1 - DARKEST) * np.clip((light - dark) / max(bright - dark, 1e-9), 0, 1)
    shade = np.where(np.isnan(shade), 1, shade)
    shade.flags.writeable = False
    return shade


def contours_of(terrain: Terrain, extent: Extent) -> Contours:
    """Contours within an extent, at an interval that keeps them legible."""
    from contourpy import contour_generator

    z, grid = cropped(*terrain, extent, np.add, CONTOUR_DOTS)
    low, high = (np.nanmin(z), np.nanmax(z)) if np.isfinite(z).any() else (0.0, 0.0)
    interval = next((step for step in INTERVALS if (high - low) / step <= LINES), INTERVALS[-1])
    levels = np.arange(low // interval + 1, high // interval + 1) * interval
    made = contour_generator(grid.x, grid.y, np.ma.masked_invalid(z))
    curves: dict[float, Any] = {
        float(level): [line for line in made.lines(level) if len(line) >= SHORTEST]
        for level in (levels if high - low > 1e-3 else ())
    }
    return Contours(interval, {level: pieces for level, pieces in curves.items() if pieces})


def draw_relief(axes: Axes, terrain: Terrain, extent: Extent) -> None:
    """Draw the shaded terrain within an extent, in colours: Matplotlib draws numbers half as
    fast."""
    from matplotlib import colormaps

    z, grid = cropped(*terrain, extent, np.add)
    draw_image(axes, colormaps["gray"](shade(z, grid.cell), bytes=True), grid)


def draw_contours(axes: Axes, contours: Contours) -> None:
    """Draw contours; labelled contours are thicker. All contours of a kind form a single curve
    with gaps, which Matplotlib simplifies and PDF readers draw in one step."""
    from matplotlib.lines import Line2D

    gap = np.full((1, 2), np.nan)
    for bold, wide in ((True, 0.5), (False, 0.2)):
        curves = [
            part
            for level, curves in contours.curves.items()
            if contours.is_index(level) == bold
            for curve in curves
            for part in (curve, gap)
        ]
        if curves:
            style: dict[str, Any] = {"color": BROWN, "linewidth": wide, "alpha": 0.7, "zorder": 1}
            axes.add_artist(Line2D(*np.concatenate(curves).T, **style))
