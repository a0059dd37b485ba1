# SPDX-License-Identifier: BSD-3-Clause
"""Rockyfor3D nets, given as rasters of net numbers, converted to lines."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from rockfall.errors import RockfallError, need
from rockfall.io.rasters.grid import Grid
from rockfall.rockyfor3d.folder import Folder

NETS = ("net_number", "net_energy", "net_height")
AROUND = np.ones((3, 3), int)  # adjacent cells, including diagonal ones
TOLERANCE = 1.0  # maximum distance of a line from cell centres [cells]
TOUCH = 1.5  # exceeds the distance of adjacent centres, including diagonal ones [cells]
DECIMALS = 3  # decimals of coordinates [m]


class Net(NamedTuple):
    """A barrier, and the number of its cells that are off the line, on branches or loops."""

    keys: dict[str, Any]
    off: int


def barriers(folder: Folder) -> Iterator[Net]:
    """Barriers for all nets; a net in several parts gives a barrier for each part."""
    from scipy.ndimage import label
    from scipy.spatial import cKDTree

    number, energy, height = (folder.read(name) for name in NETS)
    dem = folder.read("dem")
    for net in np.unique(number[number > 0]):
        parts, n = label(number == net, AROUND)
        for part in range(1, n + 1):
            here = parts == part
            cells = np.argwhere(here)
            way = longest_way(cells)
            name = f"net {net:g}" + (f" part {part}" if n > 1 else "")
            x, y = centre_line(way, folder.grid, dem)
            keys = {
                "name": name, "x": x, "y": y,
                "height": _of_net(folder, "net_height", height[here], name),
                "capacity": _of_net(folder, "net_energy", energy[here], name),
            }  # fmt: skip
            yield Net(keys, int((cKDTree(way).query(cells)[0] > TOUCH).sum()))


def _of_net(folder: Folder, raster: str, values: np.ndarray, name: str) -> float:
    """Minimum value over the cells of a net; refuses cells that are not > 0."""
    if not (values > 0).all():  # true for nodata, too
        raise RockfallError(
            f"{folder.rasters[raster]}: {name} has cells that are not > 0: give every cell of "
            "net_number an energy [kJ] and a height [m]"
        )
    return float(values.min())


def centre_line(path: np.ndarray, grid: Grid, dem: np.ndarray) -> tuple[list[float], list[float]]:
    """Coordinates x and y [m] of a line along cells (n, 2), extended by half a cell at both ends
    and without raster steps. A single cell gives a line along the contour."""
    if len(path) == 1:
        along = _contour(dem, *path[0])
        path = path + 0.5 * np.array([-along, along])
    else:
        path = _simplified(_lengthened(path.astype(float)))
    row, column = path.T
    x, y = grid.west + (column + 0.5) * grid.cell, grid.north - (row + 0.5) * grid.cell
    return np.round(x, DECIMALS).tolist(), np.round(y, DECIMALS).tolist()


def longest_way(cells: np.ndarray) -> np.ndarray:
    """Shortest path (n, 2: row, column) over adjacent cells between the two most distant cells."""
    from scipy.sparse.csgraph import dijkstra
    from scipy.spatial import cKDTree

    near = cKDTree(cells).sparse_distance_matrix(cKDTree(cells), TOUCH).tocsr()
    start = int(np.argmax(dijkstra(near, indices=0)))
    far, before = dijkstra(near, indices=start, return_predecessors=True)
    way = [int(np.argmax(far))]
    while way[-1] != start:
        way.append(int(before[way[-1]]))
    return cells[way]


def _lengthened(path: np.ndarray) -> np.ndarray:
    """Path (n, 2) extended by half a step at both ends."""
    first, last = path[0] + 0.5 * (path[0] - path[1]), path[-1] + 0.5 * (path[-1] - path[-2])
    return np.concatenate(([first], path[1:-1], [last]))


def _simplified(path: np.ndarray) -> np.ndarray:
    """Simplified path that deviates by at most the tolerance (Douglas and Peucker 1973)."""
    need("nets need", "vector")
    import shapely

    return shapely.get_coordinates(shapely.LineString(path).simplify(TOLERANCE))


def _contour(dem: np.ndarray, row: int, column: int) -> np.ndarray:
    """Contour direction (rows, columns); east if the terrain is flat or unknown."""
    block = dem[max(0, row - 1) : row + 2, max(0, column - 1) : column + 2]
    if min(block.shape) < 2 or np.isnan(block).any():
        return np.array([0.0, 1.0])
    down, right = (float(gradient.mean()) for gradient in np.gradient(block))
    steep = np.hypot(down, right)
    return np.array([-right, down]) / steep if steep > 0 else np.array([0.0, 1.0])
