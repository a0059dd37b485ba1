# SPDX-License-Identifier: BSD-3-Clause
"""Three-dimensional view of the terrain with trajectories, drawn by plotly.js in the page.

Library and data are packed in the page and unpacked on request: no network is needed, and other
readers do not wait.
"""

from __future__ import annotations

import base64
import hashlib
import json
import zlib
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rockfall.errors import need
from rockfall.language import say
from rockfall.plots.cartography.marks import inside
from rockfall.plots.cartography.rasters import cropped
from rockfall.plots.cartography.relief import shade
from rockfall.plots.extent import reached
from rockfall.plots.style import BLUE, INK, VERMILION
from rockfall.protection.barriers import barriers_of
from rockfall.result.motion import motion_of, sampled
from rockfall.result.trajectories import lines
from rockfall.terrain.height import height

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.result.trajectories import Terrain

    Trace = dict[str, Any]

VERTICES = 160  # of the terrain along its longer side
SHOWN = 100  # trajectories
COARSE = 0.5  # tolerance of drawn parabolas [m]
AWAY = 1.2  # distance of the eye from the centre, in sides of the scene
ABOVE = 2.0  # height of lines above the ground, so that they remain visible [m]
CLEAR = 0.5  # least height of trajectories above the drawn surface, for the same reason [m]


class View(NamedTuple):
    """Packed library and data, and the hash that permits the library in the page."""

    library: str
    data: str
    library_hash: str


def check_view() -> None:
    """Refuse a view if the package that draws it is missing."""
    need("a view in three dimensions needs", "view", "plotly")


def terrain_view(result: xr.Dataset, terrain: Terrain) -> View:
    """The view of a result over its terrain; the same result gives the same view."""
    from plotly.offline import get_plotlyjs

    library = get_plotlyjs().encode()
    scene_json = json.dumps({"traces": traces(result, terrain), "layout": _layout(result)})
    checksum = base64.b64encode(hashlib.sha256(library).digest()).decode()
    return View(_packed(library), _packed(scene_json.encode()), checksum)


def _packed(content: bytes) -> str:
    return base64.b64encode(zlib.compress(content, 9)).decode()


def traces(result: xr.Dataset, terrain: Terrain) -> list[Trace]:
    """Surface, lines and trajectories in metres from the south-western corner of the view."""
    extent = reached(result, terrain)
    corner = np.array([extent[0], extent[2]])
    z, grid = cropped(*terrain, False, extent, np.add, VERTICES)
    surface: Trace = {
        "type": "surface", "x": _numbers(grid.x - corner[0]), "y": _numbers(grid.y - corner[1]),
        "z": [_numbers(row) for row in z],
        "surfacecolor": [_numbers(row, 2) for row in shade(z, grid.cell)],
        "colorscale": [[0, "#4a4a42"], [1, "#f4f1e6"]], "cmin": 0, "cmax": 1, "showscale": False,
        "lighting": {"ambient": 1, "diffuse": 0, "specular": 0}, "hoverinfo": "z",
        "contours": {axis: {"highlight": False} for axis in "xyz"},
    }  # fmt: skip
    traced, nets = [surface], barriers_of(result)
    for k, (name, x, y) in enumerate(lines(result)):
        x, y = inside(x, y, extent)
        look = {"color": BLUE if k in nets else INK, "width": 6}
        traced.append(_curve(name, [(x, y, height(*terrain, x, y) + ABOVE)], corner, look))
    motion = motion_of(result, SHOWN)
    if paths := sampled(motion, COARSE).strings(motion.boulder):
        curves = [
            (x, y, np.fmax(up, height(z, grid, x, y) + CLEAR))
            for x, y, up, _ in (p.T for p in paths)
        ]
        traced.append(
            _curve(say("page.trajectories"), curves, corner, {"color": VERMILION, "width": 2})
        )
    return traced


def _curve(name: str, curves: list[Any], corner: np.ndarray, look: dict[str, Any]) -> Trace:
    """Curves (x, y, z) [m] as one trace, with gaps between them."""
    gaps = [np.column_stack([*curve]) for curve in curves]
    parts = [part for gap in gaps for part in (gap, np.full((1, 3), np.nan))]
    x, y, z = (np.concatenate(parts) - [*corner, 0.0]).T
    attrs = {"type": "scatter3d", "mode": "lines", "name": name, "hoverinfo": "name", "line": look}
    return attrs | {axis: _numbers(c) for axis, c in zip("xyz", (x, y, z), strict=True)}


def _numbers(values: np.ndarray, decimals: int = 1) -> list[float | None]:
    """Numbers for JSON, which has no NaN."""
    rounded = np.round(np.asarray(values, float), decimals).tolist()
    return [value if value == value else None for value in rounded]


def _layout(result: xr.Dataset) -> dict[str, Any]:
    """Layout with the camera looking uphill from the side to which boulders went."""
    went = [np.nanmean(result[f"stop_{c}"].values - result[f"start_{c}"].values) for c in "xy"]
    east, north = AWAY * np.array(went) / max(np.hypot(*went), 1e-9)
    axis = {"visible": False, "showspikes": False}
    scene = {f"{name}axis": axis for name in "xyz"}
    camera = {"eye": {"x": east, "y": north, "z": AWAY / 2}}
    return {
        "scene": scene | {"aspectmode": "data", "camera": camera, "dragmode": "turntable"},
        "margin": dict.fromkeys("lrtb", 0), "showlegend": True,
        "legend": {"x": 0, "y": 1, "bgcolor": "rgba(255,255,255,0.7)"},
    }  # fmt: skip
