# SPDX-License-Identifier: BSD-3-Clause
"""Views of boulders that slide and wait: on the ground, or no higher than the boulders jumped."""

import json
import sqlite3
from contextlib import closing
from xml.etree import ElementTree

import numpy as np
import pyproj
import pytest

import rockfall
from made import make_raster
from rockfall.app.pictures import trajectory_message
from rockfall.case import case_of
from rockfall.io.rasters.grid import Grid
from rockfall.result.motion import motion_of
from rockfall.terrain.height import height
from scenes import make_case, rough, sets

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
pytest.importorskip("pyogrio", reason="the vector extra is not installed")
ezdxf = pytest.importorskip("ezdxf", reason="the cad extra is not installed")

KML = "{http://www.opengis.net/kml/2.2}"
W, N, DROP, G = 600000.0, 5000000.0, 2.0, 9.81
Z = rough(gradient=0.3, relief=1.5)  # gentle, so that boulders slide and wait
TERRAIN = Z, Grid(W, N, 5.0, 60, 80)
NET = {"name": "net", "x": [W, W + 300], "y": [N - 60.0] * 2, "height": 4.0, "capacity": 50.0}
#: Table or rest angle, volume [m3], gravity [m/s2], barriers, and boulders.
RUNS = {
    "talus": ("talus", 2.0, G, [], 20),
    "meadow": ("meadow", 2.0, G, [], 20),
    "compact": ("compact", 0.2, G, [], 20),
    "rolls": (5.0, 2.0, G, [], 8),
    "moon": ("meadow", 2.0, 1.62, [], 8),
    "net": ("meadow", 2.0, G, [NET], 8),
}


@pytest.fixture(
    scope="module",
    params=[pytest.param(one, marks=pytest.mark.all) if one in ("meadow", "compact") else one
            for one in RUNS],
)  # fmt: skip
def drawn(request, tmp_path_factory):
    """Result, and the folder of its exports."""
    by, volume, gravity, nets, number = RUNS[request.param]
    place = tmp_path_factory.mktemp("drawn")
    make_raster(place / "dem.tif", Z, crs="EPSG:32632")
    case = make_case(
        place, *sets(), terrain={"dem": "dem.tif"}, flight={"gravity": gravity},
        impact={"rest_angle": by} if by == 5.0 else {"form": "table", "table": by},
        case={"boulders": number}, output={"trajectories": number}, boulder={"volume_mean": volume},
        release={"x": [W + 150.0], "y": [N - 20.0], "drop_height": DROP},
    ).replace(barrier=nets)  # fmt: skip
    result = rockfall.run(case)
    rockfall.export(result, place / "gis", formats=["gpkg", "kml", "dxf"])
    return result, place / "gis"


def of_curves(result, _):
    curves = rockfall.trajectories(result)
    return np.column_stack([np.concatenate([one[axis] for one in curves]) for axis in range(3)])


class Shown:
    """Ground of a window whose origin is (W, N)."""

    def relative(self, x, y):
        return np.column_stack([x, y]) - (W, N)


def of_window(result, _):
    """Points in the message to the page: ends of legs, and middles raised by the gravity of each
    leg."""
    paths = rockfall.trajectories(result)
    message = trajectory_message(paths, np.ones(len(paths)), Shown(), revision=0, append=False)
    size = int.from_bytes(message[:4], "little")
    (about, *_) = json.loads(message[4 : 4 + size])["arrays"]
    assert (about["name"], about["offset"]) == ("points", 0)
    count = int(np.prod(about["shape"]))
    points = np.frombuffer(message, "<f4", count, 4 + size).reshape(-1, 6).astype(float)
    assert {*points[:, 5].tolist()} <= {0.0, float(np.float32(gravity_of(result)))}
    start, end = points[:-1], points[1:]
    same = end[:, 3] >= start[:, 3]  # legs of the same boulder
    middle = (start + end)[same, :3] / 2
    middle[:, 2] += (start[:, 5] * (end - start)[:, 3] ** 2)[same] / 8
    return np.concatenate([points[:, :3], middle]) + (W, N, 0.0)


def gravity_of(result):
    return case_of(result).flight["gravity"]


def of_geopackage(layer):
    def points(_, folder):
        with closing(sqlite3.connect(folder / "rockfall.gpkg")) as database:
            blobs = database.execute(f"SELECT geom FROM {layer}").fetchall()
        return np.concatenate([strings(blob) for (blob,) in blobs])[:, :3]

    def strings(blob):
        start = 8 + (0, 32, 48, 48, 64)[(blob[3] >> 1) & 7]
        return np.frombuffer(blob, "<f8", offset=start + 9).reshape(-1, 4)

    return points


def in_metres(degrees):
    back = pyproj.Transformer.from_crs(4326, 32632, always_xy=True)
    return np.column_stack([*back.transform(*degrees.T[:2]), degrees[:, 2]])


def of_kml(name):
    def points(_, folder):
        root = ElementTree.parse(folder / "rockfall.kml").getroot()
        (layer,) = [one for one in root.iter(f"{KML}Folder") if one.find(f"{KML}name").text == name]
        texts = [one.text for one in layer.iter(f"{KML}coordinates")]
        return in_metres(np.array([p.split(",") for t in texts for p in t.split()], float))

    return points


def of_drawing(_, folder):
    space = ezdxf.readfile(folder / "rockfall.dxf").modelspace()
    paths = space.query('POLYLINE[layer=="trajectories"]')
    return np.array([vertex.xyz for path in paths for vertex in path.points()])


#: Views, with the maximum distance between points and motion [m], due to chords and rounding.
VIEWS = {
    "rockfall.trajectories": (of_curves, 0.01),
    "window": (of_window, 0.01),
    "GeoPackage trajectories": (of_geopackage("trajectories"), 0.06),
    "GeoPackage flights": (of_geopackage("flights"), 0.06),
    "KML trajectories": (of_kml("trajectories"), 0.06),
    "KML flights": (of_kml("flights"), 0.06),
    "DXF": (of_drawing, 0.06),
}


@pytest.mark.family(2)
@pytest.mark.parametrize("view", VIEWS)
def test_no_view_draws_a_boulder_higher_than_it_jumped(view, drawn):
    """Drawn heights are at most the kernel's maximum, and never below the ground."""
    result, folder = drawn
    draw, near = VIEWS[view]
    x, y, z = draw(result, folder).T
    assert x.size > 200
    above = z - height(*TERRAIN, x, y)
    above = above[np.isfinite(above)]  # except where boulders leave the terrain
    jumped = max(result["jump_height_max"].values.max(), DROP)
    assert above.min() >= -near and above.max() <= jumped + near


def test_arcs_over_slides_and_waits_would_be_needles(drawn):
    """Free fall between all vertices would raise the middle of some legs by more than 0.1 m."""
    result, _ = drawn
    motion = motion_of(result).straightened()
    lasts = (motion.end - motion.start)[3, motion.gravity == 0].max()
    assert G * lasts**2 / 8 > 0.1
