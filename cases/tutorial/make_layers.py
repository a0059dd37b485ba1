# SPDX-License-Identifier: BSD-3-Clause
"""Make the layers of the tutorial: a valley with a cliff, scree, pasture, a forest and a road.

`python make_layers.py [FOLDER]` writes them to the current folder, or to FOLDER:

    dem.tif      elevations, cells of 2 m
    site.gpkg    cliff and ground (polygons), road (line), houses (polygons)
    net.gpkg     a planned net (line)
    forest.gpkg  trees (points)
    houses.gpkg  houses (polygons) with their values and residents
    traffic.gpkg the road (line): vehicles per day

It needs the packages required by rockfall, but not rockfall itself. The valley is invented; it has
coordinates in EPSG:25832 so that a GIS can show it, but it is not a real place.
"""

import sys
from pathlib import Path

import numpy as np
import pyogrio
import rasterio
import shapely
from rasterio.transform import from_origin

CRS = "EPSG:25832"
WEST, NORTH, CELL, NX, NY = 640_000.0, 5_230_000.0, 2.0, 180, 240  # 360 m by 480 m
TOP = 1100.0  # elevation of the northern edge [m]
BENDS = 0, 40, 44, 60, 64, 110, 200, 240, 300, 340, 480  # plan distances from the northern edge [m]
ANGLES = 28, 32, 62, 62, 40, 37, 34, 29, 23, 12, 5  # slopes at the bends [degree]
GULLY = 210.0, 3.5, 14.0  # axis from the west, depth, half width [m]
ROAD = 346.0  # plan distance from the north [m]
RELIEF = 0.15  # standard deviation of the relief [m]


def relief(random: np.random.RandomState, s: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Sum of waves of 8 to 60 m, with higher amplitudes for longer waves."""
    total = 0.0
    for length in np.geomspace(8, 60, 40):
        angle, phase = random.uniform(0, 2 * np.pi, 2)
        along = x * np.cos(angle) + s * np.sin(angle)
        total = total + length**0.5 * np.cos(2 * np.pi * along / length + phase)
    return RELIEF * total / total.std()


def elevation(random: np.random.RandomState) -> np.ndarray:
    """Elevation of the cells, northern row first [m], to a centimetre, as in surveys."""
    s = CELL * (np.arange(NY) + 0.5)[:, None]
    x = CELL * (np.arange(NX) + 0.5)[None, :]
    fine = np.arange(0, CELL * NY, 0.01) + 0.005
    fall = np.cumsum(0.01 * np.tan(np.radians(np.interp(fine, BENDS, ANGLES))))
    z = TOP - np.interp(s, fine, fall) + relief(random, s, x)
    axis, depth, half = GULLY
    z -= np.interp(s, [0, 60, 240, 320], [0, depth, depth, 0]) * np.exp(-(((x - axis) / half) ** 2))
    bench = np.clip(1 - (np.abs(s - ROAD) - 3) / 4, 0, 1)  # the road is 6 m wide
    level = TOP - np.interp(ROAD, fine, fall) - 0.03 * (s - ROAD)  # it falls outwards by 3 %
    return np.round(z + bench * (level - z), 2).astype("f4")


def box(west: float, top: float, east: float, bottom: float) -> shapely.Polygon:
    """Rectangle, given by plan distances from the western and northern edge [m]."""
    return shapely.box(WEST + west, NORTH - bottom, WEST + east, NORTH - top)


def line(*places: tuple[float, float]) -> shapely.LineString:
    """Line, given by distances from the western and northern edge [m]."""
    return shapely.LineString([(WEST + x, NORTH - s) for x, s in places])


def write_layer(path: Path, layer: str, shapes: list, **columns: list) -> None:
    fields = [
        np.array(one, object if isinstance(one[0], str) else None) for one in columns.values()
    ]
    pyogrio.raw.write(
        path,
        shapely.to_wkb(np.array(shapes, object)),
        fields,
        list(columns),
        geometry_type=shapes[0].geom_type,
        crs=CRS,
        layer=layer,
        append=path.exists(),
    )


def make(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("site.gpkg", "net.gpkg", "forest.gpkg", "houses.gpkg", "traffic.gpkg"):
        (folder / name).unlink(missing_ok=True)
    random = np.random.RandomState(20260301)  # gives the same numbers in every version of NumPy
    profile = {"driver": "GTiff", "width": NX, "height": NY, "count": 1, "dtype": "float32"}
    place = from_origin(WEST, NORTH, CELL, CELL)
    with rasterio.open(folder / "dem.tif", "w", crs=CRS, transform=place, **profile) as file:
        file.write(elevation(random), 1)

    site = folder / "site.gpkg"
    faces = [box(60, 44, 140, 60), box(180, 44, 270, 60)]
    write_layer(site, "cliff", faces, name=["west face", "east face"])
    ground = {
        "rock": (box(0, 0, 360, 64), 0.10, "rock"),
        "coarse scree": (box(0, 64, 360, 130), 0.35, "talus"),
        "fine scree": (box(0, 130, 360, 220), 0.20, "talus"),
        "pasture": (box(0, 220, 360, 480), 0.12, "vegetated-soil"),
    }
    shapes, radii, grounds = map(list, zip(*ground.values(), strict=True))
    write_layer(site, "ground", shapes, name=list(ground), mean_radius=radii, ground=grounds)
    write_layer(site, "road", [line((0, ROAD), (360, ROAD))], name=["road"])
    houses = [box(95, 370, 109, 382), box(228, 362, 242, 376), box(262, 388, 276, 400)]
    write_layer(
        site, "houses", houses, name=["house 1", "house 2", "house 3"],
        vulnerability_1=[0.05] * 3, vulnerability_2=[0.3] * 3, vulnerability_3=[0.8] * 3,
        value=[600_000.0] * 3,
    )  # fmt: skip

    write_layer(
        folder / "houses.gpkg", "houses", houses, name=["house 1", "house 2", "house 3"],
        kind=["building"] * 3, value=[600_000.0] * 3, persons=[4.0, 4.0, 2.0], presence=[0.6] * 3,
        lethality_1=[0.01] * 3, lethality_2=[0.1] * 3, lethality_3=[0.3] * 3,
    )  # fmt: skip
    write_layer(
        folder / "traffic.gpkg", "traffic", [line((0, ROAD), (360, ROAD))], name=["valley road"],
        width=[6.0], aadt=[1200.0], speed=[60.0], persons_per_vehicle=[1.5],
    )  # fmt: skip

    net = line((20, 310), (330, 310))
    write_layer(folder / "net.gpkg", "net", [net], name=["net"], height=[4.0], capacity=[500.0])

    stand = 0, 235, 360, 300  # extent of the forest [m]
    count = round(400 * (stand[2] - stand[0]) * (stand[3] - stand[1]) / 1e4)  # 400 per hectare
    x = random.uniform(stand[0], stand[2], count)
    s = random.uniform(stand[1], stand[3], count)
    dbh = random.gamma(9, 28 / 9, count).round(1)  # 28 cm, std a third of it
    species = np.where(random.uniform(size=count) < 0.7, "spruce", "beech").tolist()
    points = [shapely.Point(WEST + one, NORTH - other) for one, other in zip(x, s, strict=True)]
    write_layer(folder / "forest.gpkg", "trees", points, dbh=list(dbh), species=species)


if __name__ == "__main__":
    make(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
