# SPDX-License-Identifier: BSD-3-Clause
"""Distances to and along a polyline in plan; points and vertices are x + iy."""

from __future__ import annotations

import numpy as np


def beside(points: np.ndarray, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances of points from a polyline, and distances of their nearest places along it from its
    first vertex [m]; NaN where a point is NaN."""
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


def lengths(vertices: np.ndarray) -> np.ndarray:
    """Distances of the vertices along a polyline [m]."""
    return np.concatenate([[0.0], np.cumsum(abs(np.diff(vertices)))])


def spaced(vertices: np.ndarray, number: int) -> np.ndarray:
    """Places at equal distances along a polyline, from its first vertex to its last."""
    at = lengths(vertices)
    return np.interp(np.linspace(0.0, at[-1], number), at, vertices)
