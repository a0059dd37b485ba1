# SPDX-License-Identifier: BSD-3-Clause
"""Block shapes: random convex polyhedra of a class or with given axes, or convex hulls."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rockfall.errors import RockfallError
from rockfall.grounds import block_axes
from rockfall.grounds.random_numbers import Uniform

#: Lengths of the axes of each shape class, relative to the longest axis.
SHAPES = block_axes()
JITTER = 0.12  # scatter of the tilt and relative distance of the box faces
FACETS = 14  # number of random facets that cut off corners and edges
CUT = 0.72, 1.0  # range of the relative distance of these facets
QUANTUM = 2.0**-20  # rounding of vertices: the last bits of a hull may differ between libraries


@dataclass(frozen=True)
class Surface:
    """Closed convex surface: vertices (n, 3) in any unit of length, and triangles (m, 3) of vertex
    indices, counterclockwise as seen from outside."""

    vertices: np.ndarray
    triangles: np.ndarray


def random_block(axes: Sequence[float], seed: int, number: int) -> Surface:
    """Block `number` with axes (3,): a perturbed box whose edges and corners are cut off by random
    facets."""
    from scipy.spatial import HalfspaceIntersection

    draw = Uniform(seed, number)
    half = np.array(axes) / max(axes)
    box = np.vstack([np.eye(3), -np.eye(3)])
    normals = np.vstack([box + JITTER * draw.between(-1, 1, (6, 3)), draw.directions(FACETS)])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    distance = np.empty(6 + FACETS)
    distance[:6] = np.tile(half, 2) * (1 + JITTER * draw.between(-1, 1, 6))
    # Tangent planes of the ellipsoid with the axes of the box.
    tangent = np.linalg.norm(normals[6:] * half, axis=1)
    distance[6:] = np.sqrt(3.0) * 0.75 * tangent * draw.between(*CUT, FACETS)
    cuts = np.column_stack([normals, -distance])
    return hull(HalfspaceIntersection(cuts, np.zeros(3)).intersections)


def hull(points: np.ndarray, name: str = "block") -> Surface:
    """Convex hull of points (n, 3), centred on their mean and scaled to a largest coordinate of 1;
    vertices are rounded to 1e-6. Refuses points in a plane."""
    from scipy.spatial import ConvexHull, QhullError

    points = points - points.mean(axis=0)
    size = np.abs(points).max()
    try:
        if not size > 0:
            raise RockfallError(f"{name}: the points span no volume")
        convex = ConvexHull(np.unique(np.round(points / size / QUANTUM) * QUANTUM, axis=0))
    except QhullError as error:
        raise RockfallError(f"{name}: the points span no volume") from error
    order = np.argsort(convex.vertices)
    renumber = np.zeros(convex.vertices.max() + 1, "i4")
    renumber[convex.vertices[order]] = np.arange(len(order))
    vertices = convex.points[convex.vertices[order]]
    triangles = renumber[convex.simplices]
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), convex.equations[:, :3]) < 0
    triangles[inwards] = triangles[inwards][:, ::-1]
    return Surface(vertices, triangles[np.lexsort(triangles.T)])


def refine(surface: Surface, edge: float) -> Surface:
    """Split triangles at their longest edge until no edge exceeds `edge` times R_b (radius of the
    sphere of equal volume), so that contacts in the middle of a facet are detected."""
    vertices = list(surface.vertices)
    longest = edge * np.cbrt(3 * volume(surface) / (4 * np.pi))
    middles: dict[tuple[int, int], int] = {}
    done, todo = [], [tuple(int(k) for k in triangle) for triangle in surface.triangles]
    while todo:
        a, b, c = todo.pop()
        lengths = [np.linalg.norm(vertices[p] - vertices[q]) for p, q in ((a, b), (b, c), (c, a))]
        if max(lengths) <= longest:
            done.append((a, b, c))
            continue
        for _ in range(int(np.argmax(lengths))):
            a, b, c = b, c, a
        key = min(a, b), max(a, b)
        if key not in middles:
            middles[key] = len(vertices)
            vertices.append((vertices[a] + vertices[b]) / 2)
        todo += [(a, middles[key], c), (middles[key], b, c)]
    return Surface(np.array(vertices), np.array(done, "i4"))


def volume(surface: Surface) -> float:
    """Volume enclosed by a surface, in the cubed unit of its coordinates."""
    a, b, c = (surface.vertices[surface.triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)
