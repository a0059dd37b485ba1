# SPDX-License-Identifier: BSD-3-Clause
"""Layers of recorded trajectories, with space and time."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import numpy as np

from rockfall.result.motion import Sampled

if TYPE_CHECKING:
    import xarray as xr

EPOCH = np.datetime64("2000-01-01", "us")  # time stamp of all releases
_LINE_ZM = 3002  # geometry code in well-known binary (ISO/IEC 13249-3)


def lines_zm(paths: list[np.ndarray]) -> np.ndarray:
    """Line strings of samples (n, 4) as well-known binary, with time as measure M, which shapely
    lacks. A single sample becomes a string of zero length."""
    lines = np.empty(len(paths), object)
    for k, path in enumerate(paths):
        path = np.ascontiguousarray(path if len(path) > 1 else np.repeat(path, 2, axis=0), "<f8")
        lines[k] = struct.pack("<BII", 1, _LINE_ZM, len(path)) + path.tobytes()
    return lines


def trajectory_features(
    data: xr.Dataset, sampled: Sampled
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Trajectories as LineString ZM, with number of vertices (contacts, end) and travel time
    [s]."""
    boulder, recorded = np.unique(data["trajectory_boulder"].values, return_counts=True)
    paths = sampled.strings(sampled.motion.boulder)
    _, first = np.unique(sampled.motion.vertex, return_index=True)
    _, contacts = np.unique(sampled.motion.boulder[first], return_counts=True)
    return lines_zm(paths), {
        "boulder": boulder.astype(np.int64),
        "vertices": np.minimum(contacts + 1, recorded).astype(np.int64),  # includes the end
        "travel_time": np.array([path[-1, 3] for path in paths]),
    }


def flight_features(sampled: Sampled) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Lines (LineString ZM) of the motion between contacts, except those of zero duration, and
    their columns: boulder number, number of the first contact (from 1), time stamps from `EPOCH`,
    time since release and duration [s], and speeds [m/s] after the first and before the next
    contact. The duration of a slide includes waiting."""
    strings = sampled.strings(sampled.motion.vertex)
    begin, end = np.array([(string[0, 3], string[-1, 3]) for string in strings]).T
    _, first = np.unique(sampled.motion.vertex, return_index=True)
    piece = sampled.motion.take(first)
    _, release, indices = np.unique(piece.boulder, return_index=True, return_inverse=True)
    columns = {
        "boulder": piece.boulder.astype(np.int64),
        "contact": (np.arange(indices.size) - release[indices] + 1).astype(np.int64),
        "begin": time_stamps(begin),
        "end": time_stamps(end),
        "begin_s": begin,
        "duration_s": end - begin,
        "speed_m_s": piece.at(0.0)[1],
        "speed_end_m_s": piece.at(1.0)[1],
    }
    lasts = end > begin
    return lines_zm(strings)[lasts], {name: column[lasts] for name, column in columns.items()}


def time_stamps(seconds: np.ndarray) -> np.ndarray:
    """Convert times since release [s] to time stamps with microsecond resolution."""
    return EPOCH + np.rint(1e6 * seconds).astype("m8[us]")


def in_milliseconds(fields: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Round time stamps to milliseconds, the resolution of a GeoPackage: `end` up, others down, so
    that every motion lasts at least 1 ms."""
    return {
        name: values
        if values.dtype.kind != "M"
        else (values + np.timedelta64(999 * (name == "end"), "us")).astype("M8[ms]")
        for name, values in fields.items()
    }
