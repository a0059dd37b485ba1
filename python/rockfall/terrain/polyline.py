# SPDX-License-Identifier: BSD-3-Clause
"""Distances to and along a polyline in plan; points and vertices are complex numbers x + iy."""

import numpy as np

TIE = 1e-9  # relative difference of equal distances


def beside(points: np.ndarray, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance [m] of each point from a polyline, and distance [m] along it to the nearest point;
    NaN for a polyline without length."""
    along, apart, before = np.full(points.shape, np.nan), np.full(points.shape, np.inf), 0.0
    for start, side in zip(vertices[:-1], np.diff(vertices), strict=True):
        if side == 0:
            continue
        length = abs(side)
        here = np.clip(((points - start) * np.conj(side)).real / length, 0.0, length)
        off = abs(points - start - here * side / length)
        nearer = off < apart
        along[nearer], apart[nearer] = before + here[nearer], off[nearer]
        before += length
    return np.where(np.isnan(along), np.nan, apart), along


def sides(points: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """Sides of points x + iy: 1 to the left of the nearest segment, -1 to its right, 0 on it. The
    first and the last segment continue straight beyond their ends."""
    offset, distance = np.zeros(points.shape), np.full(points.shape, np.inf)
    steps = [*zip(vertices[:-1], np.diff(vertices), strict=True)]
    steps = [(start, step) for start, step in steps if step]
    for k, (start, step) in enumerate(steps):
        apart = (
            (points - start) * np.conj(step) / abs(step)
        )  # coordinates along the segment, and to its left
        ends = 0.0 if k else -np.inf, np.inf if k == len(steps) - 1 else abs(step)
        here = abs(apart - np.clip(apart.real, *ends))
        # At a bend both segments are equally near: use the one whose straight line is farther away.
        is_tie = abs(here - distance) <= TIE * here
        nearer = np.where(is_tie, abs(apart.imag) > abs(offset), here < distance)
        offset, distance = np.where(nearer, apart.imag, offset), np.minimum(here, distance)
    return np.sign(offset)


def lengths(vertices: np.ndarray) -> np.ndarray:
    """Distances along a polyline to its vertices [m]."""
    return np.concatenate([[0.0], np.cumsum(abs(np.diff(vertices)))])


def spaced(vertices: np.ndarray, number: int) -> np.ndarray:
    """`number` evenly spaced points x + iy along a polyline, from its first to its last vertex."""
    at = lengths(vertices)
    return np.interp(np.linspace(0.0, at[-1], number), at, vertices)


def lattice_cuts(vertices: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Distances along a polyline to its vertices and to its intersections with the lines x = 0 to
    size[0] - 1 and y = 0 to size[1] - 1, in order; coordinates in cells from the first centre."""
    cuts = [lengths(vertices)]
    for start, side, before in zip(vertices[:-1], np.diff(vertices), cuts[0][:-1], strict=True):
        axes = (start.real, side.real, size[0]), (start.imag, side.imag, size[1])
        for begin, step, n in axes:
            low, high = sorted((begin, begin + step))
            lines = np.arange(max(0, np.ceil(low)), min(n - 1, np.floor(high)) + 1)
            if step:
                cuts.append(before + abs(side) * (lines - begin) / step)
    return np.unique(np.concatenate(cuts))


def intersections(vertices: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances [m] along two polylines to their intersections, ordered along the first."""
    start, side = vertices[:-1, None], np.diff(vertices)[:, None]
    begin, across = other[:-1], np.diff(other)
    turn = (np.conj(side) * across).imag
    with np.errstate(divide="ignore", invalid="ignore"):
        part = (np.conj(begin - start) * across).imag / turn
        part_of_other = (np.conj(begin - start) * side).imag / turn
    meet = (turn != 0) & (part >= 0) & (part <= 1) & (part_of_other >= 0) & (part_of_other <= 1)
    along = (lengths(vertices)[:-1, None] + part * abs(side))[meet]
    along_other = (lengths(other)[:-1] + part_of_other * abs(across))[meet]
    _, first = np.unique(along.round(6), return_index=True)  # a vertex belongs to two segments
    return along[first], along_other[first]
