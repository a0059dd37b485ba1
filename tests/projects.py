# SPDX-License-Identifier: BSD-3-Clause
"""Folders of projects of other programs, as these write them: a slope of 39 degrees above a
flat."""

import json
from pathlib import Path

import numpy as np

from made import make_layer, write_ascii
from rockfall.io.rasters.grid import Grid

GRID = Grid(1000.0, 2300.0, 5.0, 50, 60)  # x from 1000 to 1250, y from 2000 to 2300
BOX = {"west": (1050, 2250, 1100, 2280), "east": (1150, 2250, 1200, 2280)}  # release areas


def elevations():
    """Elevations of a flat at 100 m, and of a slope of 0.8 north of y = 2100."""
    y = GRID.north - (np.arange(GRID.ny) + 0.5) * GRID.cell
    return np.repeat(np.interp(y, [2000, 2100, 2300], [100, 100, 260])[:, None], GRID.nx, 1)


def box(west, south, east, north):
    corners = [[west, south], [east, south], [east, north], [west, north], [west, south]]
    return {"type": "Polygon", "coordinates": [corners]}


def collection(*features):
    """GeoJSON text from (properties, geometry)."""
    return json.dumps({
        "type": "FeatureCollection",
        "features": [
            {"type": "Feature", "properties": properties, "geometry": shape}
            for properties, shape in features
        ],
    })  # fmt: skip


ROCKS = (
    {"number": 300, "rocks_min_vol": 0.5, "rocks_max_vol": 2.0, "density": 2700, "z": 3},
    {"number": 100, "rocks_min_vol": 1.0, "rocks_max_vol": 1.0},
)
SOILS = (
    {"R_n": 0.4, "R_t": 0.8, "roughness": 0.3, "bounce_mod": 0, "mu_r": 0.2},
    {"R_t": 0.7, "v_half": 5, "phi": 30, "bounce_mod": 2},
)


def platrock(folder, **files):
    """Write a PlatRock simulation: two release polygons, two soils that overlap from y = 2100 to
    2150, a checkpoint, trees. `files` has other texts by file name, or None to leave a file out."""
    texts = {
        "rocks.geojson": collection(*zip(ROCKS, (box(*BOX[name]) for name in BOX), strict=True)),
        "soil.geojson": collection(
            (SOILS[0], box(1000, 2000, 1250, 2150)), (SOILS[1], box(1000, 2100, 1250, 2290))
        ),
        "checkpoints.geojson": collection(
            ({}, {"type": "LineString", "coordinates": [[1000, 2080], [1250, 2080]]})
        ),
        "trees.xyd": "".join(f"{1010 + 10 * k},{2120 + k},{20 + k}\n" for k in range(20)),
        "setup.json": "{}",
    }  # fmt: skip
    folder = Path(folder)
    folder.mkdir()
    write_ascii(folder / "dem.asc", elevations(), GRID)
    for name, text in (texts | files).items():
        if text is not None:
            (folder / name).write_text(text)
    return folder


def avaframe(folder, release="raster"):
    """Write an AvaFrame folder: release areas (one raster, or two shapefiles), infrastructure of
    two areas, a forest structure index, and empty folders."""
    import shapely

    inputs = Path(folder) / "Inputs"
    for name in ("REL", "RES", "INFRA", "ENT", "LINES", "CFGs"):
        (inputs / name).mkdir(parents=True)
    write_ascii(inputs / "hill.asc", elevations(), GRID)
    if release == "raster":
        thickness = np.zeros(GRID.shape)
        thickness[5:9, 10:20] = 1.5
        write_ascii(inputs / "REL/area.asc", thickness, GRID)
    else:
        for name, corners in BOX.items():
            shapes = [shapely.box(*corners)]
            make_layer(
                inputs / f"REL/{name}.shp", shapes, "EPSG:31287", name=["a"], thickness=[1.0]
            )
    infra = np.zeros(GRID.shape)
    infra[50, 10:14], infra[52:54, 30] = 3, 1
    write_ascii(inputs / "INFRA/infra.asc", infra, GRID)
    write_ascii(inputs / "RES/fsi.asc", infra / 3, GRID)
    (inputs / "CFGs/local_com4FlowPyCfg.ini").write_text("[GENERAL]\nalpha = 32\n")
    return Path(folder)
