# SPDX-License-Identifier: BSD-3-Clause
"""One case by every rebound model, with common random numbers: the same boulders, from the same
places, with the same random words, so that the models alone make the difference."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.analysis.line_statistics import line_numbers, sample_numbers
from rockfall.analysis.lines.values import line_values
from rockfall.analysis.precision.intervals import Sources, fraction_interval, sources
from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.grounds import GroundRule, GroundTable, find_ground, shipped_grounds, table_path
from rockfall.quantities import percent
from rockfall.result.trajectories import left_terrain
from rockfall.scene.read import read_scene
from rockfall.scene.surface import radius_over_rg
from rockfall.simulation.progress import progress_bar
from rockfall.simulation.simulate import run_scene

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from rockfall.scene.scene import Scene

#: Obstacles of this size [m] part the soil types 3 and 4 of Rockyfor3D, scree and talus.
LARGE = 0.1
#: Shipped grounds that stand for rocks below and above it, by model.
ROCKS = {
    "rockyfor3d": ("soil_3", "soil_4"),
    "pfeiffer_bowen": ("pfeiffer_talus", "pfeiffer_rock"),
    "constant": ("talus", "rock_ledge"),
}
QUANTITIES = ("speed", "passing_height", "energy_total")
RUN_OUT = "stopping_distance"
COLUMNS = ["model", "line", "quantity", "statistic", "n", "value", "low", "high",
           "difference", "difference_low", "difference_high"]  # fmt: skip
NO_DIFFERENCE = dict.fromkeys(COLUMNS[-3:], 0.0)


@dataclass(frozen=True)
class Models:
    """What a case does by each model, in SI units.

    `low` and `high` are the limits of 95 % confidence intervals. `difference` is that from the
    first model, boulder by boulder, so that what chance does to both alike is not in its interval.
    """

    title: str
    boulders: int
    names: tuple[str, ...]  # of the models
    table: pd.DataFrame  # COLUMNS; the run-out has no line
    notes: tuple[str, ...]


def run_models(case: Case, grounds: Sequence[str] = (), progress: bool = False) -> Models:
    """Run a case by the impact sets with methods A and B, as far as it has their sizes, and by each
    classical model, or by these `grounds` (rows of its table, impact sets) in place of those.

    Ground that the case gives to zones or cells by name is the same in all; models differ where
    its own impact sets, or its `&surface ground`, hold. There classical models take the shipped
    grounds that `ROCKS` has for rocks of that size.
    """
    import pandas as pd

    case = case.replace(output={"maps": None, "rebounds": False, "trajectories": 0, "kept": "all"})
    scenes = dict(_variants(case, grounds))
    first: xr.Dataset | None = None
    rows: list[dict[str, Any]] = []
    notes: list[str] = []
    total = sum(scene.boulders for scene in scenes.values())
    with progress_bar(total, shown=progress) as advance:
        for name, scene in scenes.items():
            result = run_scene(scene)
            advance(result.sizes["boulder"])
            first = result if first is None else first
            rows += [{"model": name, **row} for row in _rows(result, first)]
            if (gone := left_terrain(result).mean()) > 0:
                notes.append(f"{name}: {percent(gone)} left the terrain, where run-out ends")
    if (named := 1 - _own_share(next(iter(scenes.values())))) > 0:
        notes.append(f"{percent(named)} of the terrain has a ground by name, the same in all")
    table = pd.DataFrame(rows, columns=COLUMNS)
    title = case.case["title"] or case.name
    return Models(title, next(iter(scenes.values())).boulders, tuple(scenes), table, tuple(notes))


def _variants(case: Case, grounds: Sequence[str]) -> Iterator[tuple[str, Scene]]:
    """Scenes by the name of their model, the case's own first."""
    own = read_scene(case)
    if not _own_share(own):
        raise RockfallError(
            f"{case.name}: a ground is named for every place, by zones or &surface ground_map: "
            "models would not differ"
        )
    table = GroundTable(table_path(case))
    chosen = [find_ground(case, table, name, "--ground") for name in grounds]
    if "ground" in case.surface:
        yield case.surface["ground"], own
    method = case.surface["method"]
    for way in (method, "AB".replace(method, "")):
        try:
            one = case.replace(surface={"method": way, "ground": None})
            yield f"impact sets, method {way}", read_scene(one)
        except RockfallError:  # it has no sizes for them
            continue
    if chosen:
        yield from ((rule.name, with_rocks(own, rule, rule)) for rule in chosen)
        return
    shipped = GroundTable(shipped_grounds())
    for model, (small, large) in ROCKS.items():
        yield model, with_rocks(own, shipped.ground(small), shipped.ground(large))


def _own_share(scene: Scene) -> float:
    """Of the terrain, where no zone and no cell names a ground [-]."""
    usual = scene.case.surface.get("ground", scene.case.impact["sets"])
    own = np.array([0, *(one.name == usual for one in scene.grounds)], bool)
    known = ~np.isnan(scene.z)
    if scene.cell_ground is not None:
        return float(own[scene.cell_ground][known].mean())
    if scene.material_ground is None or scene.zone is None:
        return 1.0
    return float(np.append(False, own[scene.material_ground])[scene.zone][known].mean())


def with_rocks(scene: Scene, small: GroundRule, large: GroundRule) -> Scene:
    """The scene with these grounds for its small and large rocks, in place of what its rebounds
    follow where no zone and no cell says otherwise."""
    usual = scene.case.surface.get("ground", scene.case.impact["sets"])
    others = [one for one in scene.grounds if one.name != usual]
    rules = dict.fromkeys((small, large))
    number = {one.name: k for k, one in enumerate([*rules, *others], start=1)}
    names = [one.name for one in scene.grounds] or [usual]
    kept = np.array([0, *(0 if name == usual else number[name] for name in names)], np.int8)
    sizes = scene.sizes[:, 0] if scene.values is None else scene.values[0]
    of_rocks = _choice(scene, sizes, number[small.name], number[large.name])
    everywhere, of_materials, of_cells = None, None, None
    if scene.values is not None or scene.cell_ground is not None:
        zone = np.ones((), int) if scene.zone is None else scene.zone
        here = np.append(np.int8(1), of_rocks)[zone] if scene.values is None else of_rocks
        of_cells = _filled(kept[1 if scene.cell_ground is None else scene.cell_ground], here)
        of_cells = np.broadcast_to(of_cells, scene.z.shape).copy()
    elif scene.zone is not None:
        known = 1 if scene.material_ground is None else scene.material_ground
        of_materials = _filled(kept[known], of_rocks)
    else:
        everywhere = (large if of_rocks[0] == number[large.name] else small,)
    return replace(
        scene, grounds=everywhere or (*rules, *others), material_ground=of_materials,
        cell_ground=of_cells,
    )  # fmt: skip


def _filled(numbers: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Numbers of grounds, those that are zero by others."""
    return np.where(numbers, numbers, others).astype(np.int8)


def _choice(scene: Scene, sizes: np.ndarray, small: int, large: int) -> np.ndarray:
    """Which of two grounds rocks of these sizes have; obstacles are as high as Rockyfor3D has them:
    diameters."""
    obstacles = sizes if scene.case.surface["method"] == "A" else sizes / radius_over_rg(scene.case)
    return np.where(obstacles >= LARGE, np.int8(large), np.int8(small))


def _rows(result: xr.Dataset, first: xr.Dataset) -> Iterator[dict[str, Any]]:
    """The numbers of a result, and how they differ from those of the first."""
    source = sources(result)
    for k, line in enumerate(result["line"].values if "line" in result else []):
        found = line_numbers(result, k, "speed", source)
        crossed, before = (np.isfinite(one["line_time"].values[k]) for one in (result, first))
        apart = NO_DIFFERENCE
        if result is not first:
            apart = _fraction_difference(crossed, before, source)
        yield {
            "line": line, "quantity": "boulders", "statistic": "fraction",
            **_row(found, "fraction"),
            **apart,
        }  # fmt: skip
        for quantity in QUANTITIES:
            numbers = line_numbers(result, k, quantity, source)
            value, other = (line_values(one, quantity, k) for one in (result, first))
            for statistic in ("mean", "q95"):
                row = _row(numbers, statistic)
                row |= _mean_difference(value, other, source) if statistic == "mean" else {}
                yield {"line": line, "quantity": quantity, "statistic": statistic, **row}
    distance, other = (one["plan_distance"].values for one in (result, first))
    numbers = {"n": distance.size, **sample_numbers(distance, source)}
    for statistic in ("mean", "q95"):
        row = _row(numbers, statistic)
        row |= _difference(distance - other, source) if statistic == "mean" else {}
        yield {"line": "", "quantity": RUN_OUT, "statistic": statistic, **row}


def _row(numbers: dict[str, float], statistic: str) -> dict[str, float]:
    found = {end or "value": numbers.get(f"{statistic}{end and '_'}{end}", np.nan)
             for end in ("", "low", "high")}  # fmt: skip
    return {"n": numbers["n"], **found}


def _difference(each: np.ndarray, source: Sources) -> dict[str, float]:
    """The mean of a difference of each boulder, with its interval; one boulder has none."""
    if not each.any():
        return NO_DIFFERENCE
    numbers = sample_numbers(each, source, signed=True)
    limits = (numbers.get(f"mean_{end}", np.nan) for end in ("low", "high"))
    return dict(zip(COLUMNS[-3:], (float(each.mean()), *limits), strict=True))


def _fraction_difference(
    crossed: np.ndarray, other: np.ndarray, source: Sources
) -> dict[str, float]:
    """That of the fractions of boulders that crossed. Where boulders change sides one way only, it
    is the fraction that does: normal distributions know no end at 0 and 1, this interval does."""
    gained, lost = crossed & ~other, other & ~crossed
    if gained.any() and lost.any():
        return _difference(crossed * 1.0 - other, source)
    moved, low, high = fraction_interval(gained | lost, source)
    ends = (moved, low, high) if gained.any() else (-moved, -high, -low)
    return dict(zip(COLUMNS[-3:], ends if moved else (0.0, -high, high), strict=True))


def _mean_difference(value: np.ndarray, other: np.ndarray, source: Sources) -> dict[str, float]:
    """That of the means over the boulders that crossed by either model. Each mean is a ratio of
    means over all boulders; the interval is that of their difference, linearised (Cochran 1977)."""
    fewest = min(np.isfinite(one).sum() for one in (value, other))
    if not fewest:
        return dict.fromkeys(COLUMNS[-3:], np.nan)
    if np.array_equal(value, other, equal_nan=True):
        return NO_DIFFERENCE
    parts, means = [], []
    for one in (value, other):
        crossed = ~np.isnan(one)
        means.append(float(one[crossed].mean()))
        parts.append(np.where(crossed, one - means[-1], 0.0) / crossed.mean())
    if fewest < 2:
        return dict(zip(COLUMNS[-3:], (means[0] - means[1], np.nan, np.nan), strict=True))
    apart = _difference(parts[0] - parts[1], source)
    difference = means[0] - means[1]
    return {name: difference + one - apart["difference"] for name, one in apart.items()}
