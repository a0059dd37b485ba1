# SPDX-License-Identifier: BSD-3-Clause
"""Back-analysis of a case: members of its ensemble, weighted by the likelihood of the observations,
with more members where it is high."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.analysis.back.contributions import contributions
from rockfall.analysis.back.evidence import Evidence, as_record, evidence, predictive_p, shares
from rockfall.analysis.back.places import check_on_terrain
from rockfall.analysis.back.sampling import Sampler, effective
from rockfall.analysis.deposits import witnesses
from rockfall.analysis.ensemble.study import lean
from rockfall.analysis.ensemble.uncertain_inputs import (
    INPUTS,
    Uncertain,
    drawn_scene,
    has_rocks,
    normal_scores,
)
from rockfall.analysis.marks import Mark, read_marks, with_lines_at
from rockfall.analysis.observations import Observed, read_observed
from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.interrupts import interrupts
from rockfall.scene.plausible import warn_of
from rockfall.scene.read import read_scene
from rockfall.scene.scene import Scene
from rockfall.simulation.progress import progress_bar
from rockfall.simulation.simulate import Interrupted, StudyInterrupted, run_scene

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

MEMBERS, EFFECTIVE = 1024, 100
ROUND = 128  # members; twice as many in the first
REPLICATES = 24  # runs of the unchanged case, with new draws of inputs that are not parameters
NOT_MEMBERS = 2**30  # draw numbers from here on are not members
STREAM = 1  # of random numbers, in addition to those of the ensemble


@dataclass(frozen=True)
class Back:
    """Results of a back-analysis.

    `members` has a row for each run: the numbers drawn, in the order of `inputs.kept_names`, its
    `log_likelihood`, the one `smooth` over members, and `weight`; `data` one for each set of data:
    n, its weight, the posterior predictive p, and its `contributions`. `effective`: the number of
    equally weighted members with the same information.
    """

    case: Case
    inputs: Uncertain
    sought: np.ndarray  # columns of the cube that are sought; others are drawn and integrated over
    points: np.ndarray  # (members, numbers) of the cube
    members: pd.DataFrame
    data: pd.DataFrame
    notes: tuple[str, ...]
    asked: int  # requested effective members
    noise: float  # variance of the log-likelihood due to the boulders of a member
    boulders: int
    alone: np.ndarray  # (data, members): weights by each set of data alone

    @property
    def weight(self) -> np.ndarray:
        return self.members["weight"].to_numpy()

    @property
    def effective(self) -> float:
        return effective(self.weight)

    @property
    def is_enough(self) -> bool:
        return self.effective >= self.asked


def back_analysis(
    case: Case,
    *observed: str | Path | Observed,
    members: int = MEMBERS,
    enough: int = EFFECTIVE,
    progress: bool = False,
    **arrays: Any,
) -> Back:
    """Posterior of the uncertain inputs in the group &ensemble of a case, given observations: CSV
    files (docs/observed.md), or one `Observed`.

    Members are drawn and run until `enough` of them are effective, or there are `members`. The
    prior is that of the ensemble; errors of the terrain, and rocks that no boulder reaches, are
    drawn for each member and are not parameters. docs/ensemble.md, "Back-analysis", explains it. On
    Ctrl-C it raises `Interrupted`, whose `result` is the posterior of the completed rounds.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> case = case.replace(case={"boulders": 200}, ensemble={"radius_factor": 1.2})
    >>> found = rockfall.back_analysis(case, "observed.csv", members=256, enough=5)
    >>> found.effective > 1
    True
    """
    import pandas as pd

    if members < 2 * ROUND:
        raise RockfallError(f"--members {members}: must be at least {2 * ROUND}")
    if not 2 <= enough <= members:
        raise RockfallError(f"--effective {enough}: must be 2 to --members {members}")
    case = case.replace(ensemble={"runs": ROUND})
    if "draws" in case.ensemble:
        raise RockfallError(f"{case.name}: &ensemble draws: must be absent: they have no density")
    if case.breakage["at"] != "none":
        raise RockfallError(
            f"{case.name}: &breakage at = '{case.breakage['at']}': must be 'none': the end of a "
            "boulder is that of the fragment that came farthest, and no block that was found"
        )
    read = read_scene(case, **arrays)
    warn_of(read)
    scene = lean(read, "a back-analysis", ["passages"])
    inputs = Uncertain(scene)
    seen = read_observed(*observed, grid=scene.grid)
    marks = read_marks(seen)
    check_on_terrain(scene, *_places(marks))
    scene, marks = with_lines_at(scene, marks)
    base = run_scene(scene)
    scene = replace(scene, case=scene.case.replace(output={"maps": None}))
    if witnesses(base, seen):
        check_on_terrain(scene, seen.where["stops"], *np.array(seen.stops).T)
    data, notes = evidence(base, seen, marks)
    notes = [*seen.notes, *notes]
    counts = shares(data, base)
    if "dem" in inputs.names:
        _learn_noise(scene, inputs, data)
    sought = _sought(inputs, base)
    cube = inputs.design.reshape(-1, inputs.design.shape[-1])
    levels = np.where(sought == inputs.ends[INPUTS.index("sets")], len(inputs.sets), 0)
    sampler = Sampler(normal_scores(cube[:, sought]), levels)
    random = np.random.default_rng((case.case["seed"], STREAM))
    kept: list[dict[str, float]] = []
    runs: list[list[np.ndarray]] = [[] for _ in data]
    by_data = np.empty((len(data), 0))
    stopped = False
    with interrupts(), progress_bar(members, progress, "members") as advance:
        while True:
            for k in range(len(kept), len(cube)):
                try:
                    row, values = _member(scene, inputs, cube[k], k, data)
                except Interrupted:
                    stopped = True
                    break
                kept.append(row)
                for kept_runs, value in zip(runs, values, strict=True):
                    kept_runs.append(value)
                advance(1)
            if stopped:
                break
            new = slice(sampler.log_likelihood.size, None)
            new_values = counts[:, None] * np.array([
                item.log_likelihood(np.array(member_runs)[new])
                for item, member_runs in zip(data, runs, strict=True)
            ])  # fmt: skip
            off = np.array([row.get("source_redrawn", 0) > 0 for row in kept[new]])
            new_values[:, off] = -np.inf
            by_data = np.concatenate([by_data, new_values], axis=1)
            sampler.learn(new_values.sum(axis=0))
            weight, ahead = sampler.weights(), sampler.log_prior_weights()
            if effective(weight) >= enough or len(cube) + ROUND > members:
                break
            points = np.random.default_rng((case.case["seed"], STREAM, len(cube))).random(
                (ROUND, cube.shape[1])
            )
            if weight.any():
                points[:, sought] = _uniform(sampler.propose(ROUND, random))
            else:
                sampler.more_of_prior(normal_scores(points[:, sought]))
            cube = np.concatenate([cube, points])
    if not (done := sampler.log_likelihood.size):
        raise KeyboardInterrupt
    cube, kept, runs = (
        cube[:done],
        kept[:done],
        [member_runs[:done] for member_runs in runs],
    )  # complete rounds only
    if not weight.any():
        raise RockfallError(
            f"{case.name}: in none of {len(cube)} members as many as 20 boulders come to where "
            "some were observed: the case, the prior or the number of boulders is wrong"
        )
    table = pd.DataFrame(kept).assign(
        log_likelihood=sampler.log_likelihood, smooth=sampler.smooth, weight=weight
    )
    each = contributions(sampler.points[:done], levels, ahead, weight, by_data)
    records = [
        as_record(item, count, predictive_p(item, np.array(member_runs), weight, random))
        | part.record()
        for item, count, member_runs, part in zip(data, counts, runs, each, strict=True)
    ]
    for item, member_runs in zip(data, runs, strict=True):
        notes += item.remarks(np.array(member_runs), weight)
    noise = sum(c * item.noise(scene.boulders) for c, item in zip(counts, data, strict=True))
    back = Back(case, inputs, sought, cube, table, pd.DataFrame(records), tuple(notes), enough,
                float(noise), scene.boulders, np.array([part.alone for part in each]))  # fmt: skip
    if stopped:
        raise StudyInterrupted(back, done)
    return back


def _places(marks: list[Mark]) -> tuple[list[str], np.ndarray, np.ndarray]:
    x, y = (np.array([getattr(mark, axis) for mark in marks]) for axis in "xy")
    return [mark.where for mark in marks], x, y


def _learn_noise(scene: Scene, inputs: Uncertain, data: list[Evidence]) -> None:
    """Measure the variation between runs that differ only in inputs that are not parameters."""
    results = []
    for k in range(REPLICATES):
        draw = inputs.at("dem", inputs.design[0, 0], NOT_MEMBERS + k)
        results.append(run_scene(drawn_scene(scene, [draw], inputs.boulders_seed(NOT_MEMBERS + k))))
    for item in data:
        item.learn_noise(np.array([item.kept(result) for result in results]))


def _member(
    scene: Scene, inputs: Uncertain, point: np.ndarray, number: int, data: list[Evidence]
) -> tuple[dict[str, float], list[np.ndarray]]:
    """Numbers drawn for a member, and its run's data for each set of observations."""
    draws = [inputs.at(name, point, number) for name in inputs.names]
    result = run_scene(drawn_scene(scene, draws, inputs.boulders_seed(number)))
    row: dict[str, float] = {}
    for draw in draws:
        for name, value in draw.kept.items():
            if name == "radius":
                row |= {f"radius_{i + 1}": float(radius) for i, radius in enumerate(value)}
            else:
                row[name] = float(value)
    return row, [item.kept(result) for item in data]


def _sought(inputs: Uncertain, base: xr.Dataset) -> np.ndarray:
    """Columns of the cube that are parameters; of rock sizes only those that boulders reach."""
    all_columns: list[int] = []
    for name in inputs.names:
        k = INPUTS.index(name)
        columns = range(inputs.ends[k], inputs.ends[k + 1])
        if name == "radius":
            rows = _reached_materials(inputs.scene, base)
            columns = [column for i, column in enumerate(columns) if i in rows]
        if name == "volume":
            given = [inputs.given[key] > 1 for key in ("volume_factor", "volume_std_factor")]
            columns = [column for column, is_given in zip(columns, given, strict=True) if is_given]
        all_columns += columns
    if not all_columns:
        raise RockfallError(f"{inputs.scene.case.name}: &ensemble: nothing that can be sought")
    return np.array(all_columns)


def _reached_materials(scene: Scene, base: xr.Dataset) -> set[int]:
    """Rows of the rock sizes that boulders reach; a factor on others has no effect."""
    if scene.rasters.values is not None:
        return {0}
    rows = {0}
    if scene.rasters.zone is not None:
        rows = set((np.unique(scene.rasters.zone[base["passages"].values > 0]) - 1).tolist())
    reached = {row for row in rows if row >= 0 and has_rocks(scene.rasters.sizes[row])}
    if not reached:
        raise RockfallError(
            f"{scene.case.name}: &ensemble radius_factor: has no effect: boulders come to no zone "
            "with rocks (R_m > 0); take it out"
        )
    return reached


def _uniform(scores: np.ndarray) -> np.ndarray:
    from scipy.special import ndtr

    return np.clip(ndtr(scores), 1e-12, 1 - 1e-12)
