# SPDX-License-Identifier: BSD-3-Clause
"""Moving boulders and evaluation lines as CZML, for Cesium.

One packet, a JSON object, for each; https://github.com/AnalyticalGraphicsInc/czml-writer/wiki says
what they hold.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.io.files import atomic_write
from rockfall.result.geographic import Geographic
from rockfall.result.motion import Sampled
from rockfall.result.trajectories import lines
from rockfall.result.trajectory_layers import time_stamps
from rockfall.result.vector_style import STYLES, paint

if TYPE_CHECKING:
    import xarray as xr

BOULDER = (230, 67, 43)  # red, green, blue


def write_czml(
    path: Path, data: xr.Dataset, sampled: Sampled, title: str, way: Geographic, geoid: float
) -> Path:
    """Write a document of packets, atomically. Heights are those of the DEM plus the height
    `geoid` [m] of its datum above the ellipsoid."""
    with atomic_write(path) as part, open(part, "w", encoding="utf-8") as file:
        for k, packet in enumerate(_packets(data, sampled, title, way, geoid)):
            file.write("[\n" if k == 0 else ",\n")
            json.dump(packet, file, allow_nan=False, separators=(",", ":"))
        file.write("\n]\n")
    return path


def _packets(
    data: xr.Dataset, sampled: Sampled, title: str, way: Geographic, geoid: float
) -> Iterator[dict[str, Any]]:
    """The document, the lines, and the boulders from release to the end of the slowest."""
    start, end = (_iso(time) for time in (0.0, sampled.samples[:, 3].max()))
    text = (
        f"Heights: of the DEM (vertical datum: {way.heights}) plus {geoid:g} m for the ellipsoid. "
        f"Places: {way.crs} to WGS 84. All boulders start together."
    )
    yield {
        "id": "document", "name": title, "version": "1.0", "description": text,
        "clock": {"interval": f"{start}/{end}", "currentTime": start, "multiplier": 1,
                  "range": "LOOP_STOP", "step": "SYSTEM_CLOCK_MULTIPLIER"},
    }  # fmt: skip
    for name, x, y in lines(data):
        yield _line(name, way.degrees(np.column_stack([x, y, np.zeros(x.size)])))
    volumes = _volumes(data)
    numbers = np.unique(sampled.motion.boulder).tolist()
    for number, path in zip(numbers, sampled.strings(sampled.motion.boulder), strict=True):
        places = way.degrees(path[:, :3]) + (0.0, 0.0, geoid)
        yield _boulder(number, path[:, 3], places, f"{start}/{end}", volumes.get(number))


def _line(name: str, places: np.ndarray) -> dict[str, Any]:
    """An evaluation line, draped over the viewer's ground."""
    (_, _, symbol), *_ = STYLES["lines"].symbols
    return {
        "id": f"line {name}", "name": name,
        "polyline": {
            "positions": {"cartographicDegrees": _rounded(places)}, "clampToGround": True,
            "width": 3, "material": _plain(paint(symbol)),
        },
    }  # fmt: skip


def _boulder(
    number: int, time: np.ndarray, places: np.ndarray, shown: str, volume: float | None
) -> dict[str, Any]:
    """A boulder that moves from sample to sample, and stays where it stopped; its path; a sphere of
    its volume where that is known."""
    samples = np.column_stack([time, places])
    samples = samples[np.append(time[1:] > time[:-1], True)]  # the last of those at one time
    packet: dict[str, Any] = {
        "id": f"boulder {number}", "name": f"boulder {number}", "availability": shown,
        "position": {
            "epoch": _iso(0.0), "interpolationAlgorithm": "LINEAR",
            "forwardExtrapolationType": "HOLD", "cartographicDegrees": _rounded(samples),
        },
        "point": {"pixelSize": 5, "color": {"rgba": [*BOULDER, 255]}},
        "path": {"width": 1.5, "leadTime": 0, "resolution": 1, "material": _plain(BOULDER)},
    }  # fmt: skip
    if volume is not None:
        radius = round((3 * volume / (4 * np.pi)) ** (1 / 3), 3)
        material = _plain(BOULDER)
        packet["ellipsoid"] = {"radii": {"cartesian": [radius] * 3}, "material": material}
        packet["properties"] = {"volume_m3": {"number": volume}}
    return packet


def _volumes(data: xr.Dataset) -> dict[int, float]:
    """Volume [m3] of the boulders that have a row."""
    if "volume" not in data:
        return {}
    size = data.sizes["boulder"]
    numbers = data["boulder"].values if "boulder" in data.coords else np.arange(1, size + 1)
    volumes = zip(numbers.tolist(), data["volume"].values.tolist(), strict=True)
    return {number: volume for number, volume in volumes if volume == volume}


def _rounded(values: np.ndarray) -> list[float]:
    """Numbers in a row; degrees to 0.1 mm, seconds and metres finer than that too."""
    return np.round(values, 9).ravel().tolist()


def _plain(colour: tuple[int, int, int]) -> dict[str, Any]:
    return {"solidColor": {"color": {"rgba": [*colour, 255]}}}


def _iso(seconds: float) -> str:
    """Time stamp of a time since release, in UTC."""
    return f"{time_stamps(np.array(seconds))}Z"
