# SPDX-License-Identifier: BSD-3-Clause
"""Make the inputs of case.nml from the published data of the Mel de la Niva. Tested only with a
stand-in: the contents of the real files are inferred from other programs.

    python make_case.py [--data FOLDER] [--cell 2] [-o FOLDER]

Downloads three archives of 85 MB (pip install 'rockfall[field,vector]'), or takes them from FOLDER
or from the folder in the environment variable ROCKFALL_FIELD_DATA. It expects these files:

    3d_trajectories_epsg21781_lv03.zip   traj_bl1.las, traj_bl2.las: points of two trajectories
    gis_shapes_epsg21781_lv03.zip        deposited_bl.shp: points of deposited blocks, with the
                                         attributes `year` and `size`, a text '[a; b; c]' in metres
    sfm_rasters_epsg21781_lv03.zip       dsm_lv1903_50cm.tif: elevations of the surface

and reports missing files. Writes dem.tif, with cells of the given size (means of smaller cells),
over the extent of the trajectories and blocks of 2015 plus 200 m; releases.csv, the highest point
of each trajectory, with the volume of the block nearest to its lowest point; observed.csv, the
blocks of 2015, as if each came from the trajectory whose lowest point is the nearest.
"""

import argparse
import csv
import sys
import tempfile
import zipfile
from math import pi
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from rockfall.errors import RockfallError, need
from rockfall.io.atomic import atomic_write
from rockfall.io.rasters.geotiff import write_geotiff
from rockfall.io.rasters.grid import Grid

HERE = Path(__file__).resolve().parent
sys.path.append(str(HERE.parents[1]))

from benchmarks.field_data import fetch  # noqa: E402

ARCHIVE = "mel_de_la_niva_2015"
TRAJECTORIES, SHAPES, RASTERS = (
    f"{name}_epsg21781_lv03.zip" for name in ("3d_trajectories", "gis_shapes", "sfm_rasters")
)
RUNS = "traj_bl1.las", "traj_bl2.las"
BLOCKS, SURFACE = "deposited_bl.shp", "dsm_lv1903_50cm.tif"
YEAR = 2015
EPSG = 21781
MARGIN = 200.0  # margin around the known points [m]
ELLIPSOID = pi / 6  # volume of a block over the product of its three sizes: assumed
RELEASE = "name", "x", "y", "volume"
OBSERVED = "x", "y", "start_x", "start_y"


def member(archive: Path, name: str) -> str:
    """Path of a file in an archive, in any folder."""
    try:
        with zipfile.ZipFile(archive) as opened:
            found = [one for one in opened.namelist() if PurePosixPath(one).name == name]
    except (OSError, zipfile.BadZipFile) as error:
        raise RockfallError(f"{archive}: cannot be read as a ZIP archive: {error}") from None
    if len(found) != 1:
        raise RockfallError(f"{archive}: expected one {name} in it, found {len(found)}")
    return found[0]


def read_trajectory(archive: Path, name: str) -> np.ndarray:
    """Points of a trajectory, (n, 3) [m]."""
    import laspy

    place = member(archive, name)
    with zipfile.ZipFile(archive) as opened, opened.open(place) as file:
        try:
            points = laspy.read(file).xyz
        except (laspy.errors.LaspyException, ValueError) as error:
            raise RockfallError(f"{archive}: {name}: cannot be read as LAS: {error}") from None
    if len(points) < 2:
        raise RockfallError(f"{archive}: {name}: has {len(points)} points, at least 2 are needed")
    return np.asarray(points)


def read_blocks(archive: Path) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 2) [m] and volumes (n,) [m3] of the blocks deposited in 2015."""
    import pyogrio

    place = member(archive, BLOCKS)
    with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(archive) as opened:
        opened.extractall(folder)
        about, _, shapes, fields = pyogrio.raw.read(Path(folder) / place)
    columns = dict(zip(map(str, about["fields"]), fields, strict=True))
    for needed in "year", "size":
        if needed not in columns:
            known = ", ".join(columns)
            raise RockfallError(f"{archive}: {BLOCKS}: no attribute {needed}; has: {known}")
    from shapely import from_wkb, get_coordinates

    mine = columns["year"].astype(float) == YEAR
    if not mine.any():
        raise RockfallError(f"{archive}: {BLOCKS}: no block of {YEAR}")
    volumes = [volume_of(text, archive) for text in columns["size"][mine]]
    return get_coordinates(from_wkb(shapes[mine])), np.array(volumes)


def volume_of(text: str, archive: Path) -> float:
    """Volume of a block from its sizes, a text '[a; b; c]' [m]; a single size means a sphere."""
    try:
        sizes = [float(one) for one in str(text).strip("[] ").split(";")]
    except ValueError:
        sizes = []
    if len(sizes) not in (1, 3) or min(sizes) <= 0:
        raise RockfallError(f"{archive}: {BLOCKS}: size = {text}: expected '[a; b; c]' [m]")
    return float(ELLIPSOID * np.prod(sizes if len(sizes) == 3 else 3 * sizes))


def surface(archive: Path, known: np.ndarray, cell: float) -> tuple[np.ndarray, Grid]:
    """Elevations around known points, as means in cells of a given size [m]."""
    import rasterio
    from rasterio.crs import CRS
    from rasterio.enums import Resampling
    from rasterio.windows import from_bounds

    place = member(archive, SURFACE)
    low, high = known.min(axis=0) - MARGIN, known.max(axis=0) + MARGIN
    with rasterio.open(f"/vsizip/{archive.resolve()}/{place}") as raster:
        box = raster.bounds
        west, south = max(low[0], box.left), max(low[1], box.bottom)
        east, north = min(high[0], box.right), min(high[1], box.top)
        nx, ny = int((east - west) / cell), int((north - south) / cell)
        if min(nx, ny) < 2:
            raise RockfallError(f"{archive}: {SURFACE}: lies apart from trajectories and blocks")
        window = from_bounds(west, north - ny * cell, west + nx * cell, north, raster.transform)
        z = raster.read(
            1, window=window, out_shape=(ny, nx), masked=True, resampling=Resampling.average
        )
    grid = Grid(west, north, cell, nx, ny, CRS.from_epsg(EPSG))
    return z.astype("f4").filled(np.nan), grid


def write(path: Path, columns: tuple[str, ...], rows: list[list[Any]]) -> None:
    """Write a table as CSV."""
    with atomic_write(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)


def make(data: Path | None, cell: float, folder: Path) -> None:
    """Write the inputs of the case into a folder."""
    need("trajectories of the Mel de la Niva need", "field", "laspy")
    need("blocks of the Mel de la Niva need", "vector", "pyogrio", "shapely")
    files = fetch(ARCHIVE, data)
    runs = [read_trajectory(files[TRAJECTORIES], name) for name in RUNS]
    tops = np.array([run[run[:, 2].argmax(), :2] for run in runs])
    ends = np.array([run[run[:, 2].argmin(), :2] for run in runs])
    places, volumes = read_blocks(files[SHAPES])
    apart = np.hypot(*(places[:, None] - ends).transpose(2, 0, 1))  # distances (block, trajectory)
    known = np.concatenate([places, *(run[:, :2] for run in runs)])
    z, grid = surface(files[RASTERS], known, cell)
    folder.mkdir(parents=True, exist_ok=True)
    write_geotiff(folder / "dem.tif", z, grid)
    nearest = apart.argmin(axis=0)
    releases = [
        [Path(name).stem, *top.tolist(), f"{volumes[k]:.6g}"]
        for name, top, k in zip(RUNS, tops, nearest, strict=True)
    ]
    write(folder / "releases.csv", RELEASE, releases)
    observed = [
        [*place.tolist(), *tops[k].tolist()]
        for place, k in zip(places, apart.argmin(axis=1), strict=True)
    ]
    write(folder / "observed.csv", OBSERVED, observed)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, help="folder that holds the three archives")
    parser.add_argument("--cell", type=float, default=2.0, help="size of cells [m], at least 0.5")
    parser.add_argument("-o", metavar="FOLDER", type=Path, dest="folder", default=HERE)
    given = parser.parse_args()
    if not 0.5 <= given.cell <= 50:
        parser.error(f"--cell {given.cell:g}: must be 0.5 to 50 [m]")
    try:
        make(given.data, given.cell, given.folder)
    except RockfallError as error:
        print(f"make_case.py: {error}", file=sys.stderr)
        return error.code
    return 0


if __name__ == "__main__":
    sys.exit(main())
