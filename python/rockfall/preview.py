# SPDX-License-Identifier: BSD-3-Clause
"""What a case would run, what it needs, and about how long it takes."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rockfall.crs import crs_name
from rockfall.grid import row_blocks
from rockfall.result import TALLIES
from rockfall.scene import SIZE_TO_RADIUS, Scene, used_zones
from rockfall.simulate import Tally, fields, run_chunks, start
from rockfall.sources import threshold

PILOT_SECONDS = 0.3
PILOT_BOULDERS = 10_000  # at most
BASE = 120_000_000  # bytes of the program and its packages


def preview(scene: Scene) -> str:
    """A page about a scene. Some of its boulders are followed, for the time; nothing is kept."""
    case = scene.case
    pilot = _pilot(scene)
    rows = [
        ("terrain", _terrain(scene)),
        ("surface", _surface(scene)),
        ("sizes", _ratios(scene, pilot)),
        ("impact sets", case.impact["sets"]),
        ("boulders", _boulders(scene)),
        ("lines", ", ".join(line["name"] for line in case.line) or "none"),
        ("maps", ", ".join(case.output.get("maps", [])) or "none"),
        ("memory", _memory(scene)),
        ("time", _time(scene, pilot)),
    ]
    title = f"{case.name}: {case.case['title']}".removesuffix(": ")
    return "\n".join([title, *(f"  {name:13}{about}" for name, about in rows)])


def memory(scene: Scene) -> dict[str, int]:
    """Bytes that a run takes: rasters of the scene, maps, rows of results, the program itself."""
    tally = start(scene, threads=1)
    derived = set(scene.case.output.get("maps", [])) - set(TALLIES)
    maps = [tally.maps.counts, tally.maps.sums, tally.maps.maxima, tally.maps.column]
    maps.append(tally.maps.stamp)
    classes = tally.maps.class_counts
    cells = scene.z.size if classes.size > 1 else 0  # the system may grant fewer
    row = 8 * len(fields(1)) + 4 * len(fields(2)) + 8 * len(fields(3)) * len(scene.case.line)
    rasters = [scene.z, scene.zone, scene.values, scene.x, scene.y]
    return {
        "rasters": sum(array.nbytes for array in rasters if array is not None),
        "maps": sum(m.nbytes for m in maps if m.size > 1) + 4 * scene.z.size * len(derived),
        "classes at most": classes.itemsize * classes.shape[1] * cells,  # every cell is reached
        "results": row * scene.boulders,
        "program": BASE,
    }


def _pilot(scene: Scene) -> Tally:
    """Some boulders from sources drawn at random, followed for about `PILOT_SECONDS`."""
    start(scene, threads=1)  # does it fit in memory? can boulders start?
    number = min(scene.boulders, PILOT_BOULDERS)
    drawn = np.random.default_rng(0).integers(scene.x.size, size=number)
    if scene.area is not None:  # steeper cells release more
        drawn = np.searchsorted(scene.ends, scene.ends[-1] * (drawn + 0.5) / scene.x.size)
    case = scene.case.replace(case={"boulders": 1})
    few = start(replace(scene, case=case, x=scene.x[drawn], y=scene.y[drawn], area=None), threads=1)
    end = time.perf_counter() + PILOT_SECONDS
    run_chunks(few, None, lambda: time.perf_counter() > end and few.done > 0, lambda _: None)
    return few


def _terrain(scene: Scene) -> str:
    grid = scene.grid
    crs = crs_name(grid.crs) if grid.crs else "no CRS"
    cells = f"{grid.nx} x {grid.ny} cells of {grid.cell:g} m"
    if scene.tiles:
        cells += f", in windows of about {scene.tiles.cells:,} cells"
    else:
        empty = sum(np.count_nonzero(np.isnan(scene.z[rows])) for rows in row_blocks(grid.shape))
        cells += f", {empty / scene.z.size:.1%} nodata"
    return f"{cells}, {scene.z.dtype}, {crs}"


def _surface(scene: Scene) -> str:
    surface = scene.case.surface
    how = "one value everywhere"
    if scene.zone is not None:
        how = f"{surface['zones']}: {used_zones(scene).size} of {len(scene.sizes)} zones used"
    elif scene.values is not None:
        how = "a raster of values"
    return f"method {surface['method']}, {how}"


def _boulders(scene: Scene) -> str:
    each, kind = scene.case.case["boulders"], "points"
    if "x" not in scene.case.release:
        kind = "cells within polygons" if "polygons" in scene.case.release else "cells"
    if scene.case.release["steep_cells"]:
        kind += f" of {threshold(scene):.1f} degrees or more"
    of = "each source" if scene.area is None else "a flat cell, more by area"
    return f"{scene.boulders:,}, {each:,} from {of}; sources: {scene.x.size:,} ({kind})"


def _mean_radii(scene: Scene) -> Iterator[float]:
    """The least and the greatest R_m of the scene, or of parts of it [m]."""
    surface = scene.case.surface
    scale = SIZE_TO_RADIUS[surface["rg_reading"]] if surface["method"] == "A" else 1.0
    if scene.values is None:
        sizes = scene.sizes if scene.zone is None else scene.sizes[used_zones(scene)]
        parts = [sizes[np.isfinite(sizes)]]
    else:
        blocks = (layer[rows] for layer in scene.values for rows in row_blocks(scene.grid.shape))
        parts = (block[np.isfinite(block)] for block in blocks)
    for part in parts:
        if part.size:
            yield from (scale * float(part.min()), scale * float(part.max()))


def _ratios(scene: Scene, pilot: Tally) -> str:
    """R_b/R_m of the pilot's boulders, and the share of rebounds for which no set was made."""
    volumes = pilot.boulder[: pilot.done, fields(1).index("volume")]
    counts = dict(zip(fields(2), pilot.count[: pilot.done].sum(axis=0, dtype="i8"), strict=True))
    outside = counts["rebounds_out_of_range"] / max(1, counts["rebounds"])
    radii = np.cbrt(0.75 / np.pi * volumes)
    stones = list(_mean_radii(scene))
    if not stones:
        return "every zone absorbs"
    return (
        f"R_b {_range(radii.min(), radii.max())} m, R_m {_range(min(stones), max(stones))} m, "
        f"R_b/R_m {_range(radii.min() / max(stones), radii.max() / min(stones))}; "
        f"{outside:.1%} of rebounds outside 0.5 to 5.5"
    )


def _range(least: float, most: float) -> str:
    texts = f"{least:.3g}", f"{most:.3g}"
    return " to ".join(dict.fromkeys(texts))


def _memory(scene: Scene) -> str:
    need = memory(scene)
    have = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    parts = ", ".join(f"{name} {_bytes(size)}" for name, size in need.items() if size)
    total = sum(need.values())
    much = "; more than this machine has" if total > have else ""
    return f"about {_bytes(total)} ({parts}){much}"


def _bytes(number: float) -> str:
    return f"{number / 1e9:.1f} GB" if number >= 1e9 else f"{max(1, number / 1e6):.0f} MB"


def _time(scene: Scene, pilot: Tally) -> str:
    seconds = pilot.cpu / pilot.done * scene.boulders
    threads = scene.case.case["threads"] or len(os.sched_getaffinity(0))
    return (
        f"about {_duration(seconds)} of CPU, {_duration(seconds / threads)} on {threads} cores "
        f"(estimated from {pilot.done:,} boulders)"
    )


def _duration(seconds: float) -> str:
    for size, unit in ((86400, "days"), (3600, "h"), (60, "min")):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.1f} s"
