# SPDX-License-Identifier: BSD-3-Clause
"""Stretches of evaluation lines off the terrain, where no boulder moves, as stored in results."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np

#: Start and end of each stretch [m] by line, for all lines that were checked.
LinesBeyond = Mapping[str, list[list[float]]]


def vertices_key(x: np.ndarray, y: np.ndarray) -> str:
    """Key of a line: a checksum of its vertices [m], because a line of a prepared case may be
    edited before `rockfall-batch` runs it."""
    return f"{zlib.crc32(np.column_stack([x, y]).round(3).astype('<f8').tobytes()):08x}"


def length_beyond(stretches: Any, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Length [m] of windows from `start` to `end` that lies in these stretches."""
    first, last = np.reshape(stretches, (-1, 2)).T
    return np.clip(np.minimum(end[:, None], last) - np.maximum(start[:, None], first), 0, None).sum(
        axis=1
    )
