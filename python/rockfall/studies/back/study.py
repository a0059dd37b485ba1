# SPDX-License-Identifier: BSD-3-Clause
"""Back-analysis of a case: ensemble members are weighted by the likelihood of the observations,
and more members are run where the likelihood is high."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.observed.deposits import witnesses
from rockfall.analysis.observed.marks import read_marks, with_lines_at
from rockfall.analysis.observed.observations import Observed, read_observed
from rockfall.analysis.observed.observed_doubts import check_exchanged, unit_notes
from rockfall.analysis.validity.remarks import model_warnings
from rockfall.analysis.validity.warnings import warn_each
from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.interrupts import interrupts
from rockfall.result.grounds import rebounds_by_ground
from rockfall.scene.read import read_scene
from rockfall.scene.rules.plausible import warn_of
from rockfall.scene.scene import Scene
from rockfall.simulation.simulate import Interrupted, StudyInterrupted, run_scene
from rockfall.studies.back.contributions import contributions
from rockfall.studies.back.evidence import Evidence, as_record, evidence, predictive_p, shares
from rockfall.studies.back.places import check_on_terrain
from rockfall.studies.back.sampling import Sampler, effective
from rockfall.studies.ensemble.study import lean
from rockfall.studies.ensemble.uncertain_inputs import (
    INPUTS,
    PAIR_FACTORS,
    Draw,
    Uncertain,
    drawn_scene,
    has_rocks,
    normal_scores,
)
from rockfall.studies.study import LEAN_RUNS, Study

MEMBERS, EFFECTIVE = 1024, 100
ROUND = 128  # members per round; twice as many in the first
REPLICATES = 24  # runs of the unchanged case, with new draws of non-parameter inputs
NOT_MEMBERS = 2**30  # draw numbers from here on do not belong to members
STREAM = 1  # random stream, distinct from the ensemble's streams


@dataclass(frozen=True)
class Back:
    """Results of a back-analysis.

    `members` has a row for each run: the drawn values, `log_likelihood`, the smoothed
    log-likelihood `smooth`, and `weight`. `data` has a row for each data set: n, weight, the
    posterior predictive p, and its `contributions`. `effective` is the number of equally weighted
    members with equal information.
    """

    case: Case
    inputs: Uncertain
    sought: np.ndarray  # columns of the cube that are parameters; the other inputs are averaged out
    points: np.ndarray  # (members, numbers): coordinates in the cube
    members: pd.DataFrame
    data: pd.DataFrame
    notes: tuple[str, ...]
    asked: int  # requested effective members
    noise: float  # variance of the log-likelihood due to the boulders in a member
    boulders: int
    alone: np.ndarray  # (data, members): weights from each data set alone
    model_warnings: tuple[str, ...]  # warnings of the unchanged case

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
    """Posterior of the uncertain inputs in a case's group &ensemble, given observations: CSV files
    (docs/observed.md), or an `Observed`.

    Members are drawn and run until the effective number reaches `enough`, or another round would
    exceed `members`. The prior is the distribution of the ensemble. Terrain errors, and rocks that
    no boulder reaches, are drawn for each member but are not parameters (docs/back_analysis.md).
    Invalid numbers, unusable observations, and observations that no member can explain raise a
    RockfallError. Ctrl-C raises `Interrupted`; its `result` is the posterior from the completed
    rounds.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> case = case.replace(case={"boulders": 200}, ensemble={"radius_factor": 1.2})
    >>> found = rockfall.back_analysis(case, "observed.csv", members=256, enough=5)
    >>> found.effective > 1
    True
    """
    _check_request(case, members, enough)
    rounds = _Rounds(_read(case.replace(ensemble={"runs": ROUND}), observed, arrays))
    stopped = False
    with interrupts(), Study(members, "members", progress=progress) as study:
        try:
            rounds.run(study)
            while effective(rounds.weight) < enough and len(rounds.cube) + ROUND <= members:
                rounds.propose()
                rounds.run(study)
        except Interrupted:
            stopped = True
    back = rounds.posterior(enough)
    warn_each(back.model_warnings)
    if stopped:
        raise StudyInterrupted(back, len(back.members))
    return back


def _check_request(case: Case, members: int, enough: int) -> None:
    """Raise a RockfallError for invalid numbers, or a case whose members have no likelihood."""
    if members < 2 * ROUND:
        raise RockfallError(f"--members {members}: must be at least {2 * ROUND}")
    if not 2 <= enough <= members:
        raise RockfallError(f"--effective {enough}: must be 2 to --members {members}")
    if "draws" in case.ensemble:
        raise RockfallError(f"{case.name}: &ensemble draws: must be absent: they have no density")
    if case.breakage["at"] != "none":
        raise RockfallError(
            f"{case.name}: &breakage at = '{case.breakage['at']}': must be 'none': a boulder ends "
            "where its farthest fragment stops, not where an observed block does"
        )


@dataclass(frozen=True)
class _Read:
    """Case, inputs and observations of a back-analysis."""

    case: Case
    scene: Scene
    inputs: Uncertain
    sought: np.ndarray  # columns that are parameters, as in `Back`
    data: list[Evidence]
    counts: np.ndarray  # weight of each data set in the likelihood
    notes: list[str]
    model_warnings: tuple[str, ...]


def _read(
    case: Case, observed: tuple[str | Path | Observed, ...], arrays: Mapping[str, Any]
) -> _Read:
    """Read case and observations, and run the unchanged case."""
    read = read_scene(case, **arrays)
    warn_of(read)
    scene = lean(read, "a back-analysis", ["passages"])
    inputs = Uncertain(scene)
    seen = read_observed(*observed, grid=scene.grid)
    check_exchanged(seen, scene.grid)
    marks = read_marks(seen)
    x, y = (np.array([getattr(mark, axis) for mark in marks]) for axis in "xy")
    check_on_terrain(scene, [mark.where for mark in marks], x, y)
    scene, marks = with_lines_at(scene, marks)
    base = run_scene(scene)
    scene = replace(scene, case=scene.case.replace(output={"maps": None}))
    if witnesses(base, seen):
        check_on_terrain(scene, seen.where["stops"], *np.array(seen.stops).T)
    data, notes = evidence(base, seen, marks)
    counts = shares(data, base)
    if "dem" in inputs.names:
        _learn_noise(scene, inputs, data)
    notes = [*seen.notes, *unit_notes(seen), *notes]
    limits = tuple(model_warnings(base, scene.case))
    return _Read(case, scene, inputs, _sought(inputs, base), data, counts, notes, limits)


class _Rounds:
    """Members of a study, run in rounds; each round uses the likelihoods from earlier rounds."""

    def __init__(self, read: _Read) -> None:
        inputs, sought = read.inputs, read.sought
        self.read = read
        self.cube = inputs.design.reshape(-1, inputs.design.shape[-1])  # a row for each member
        is_set = sought == inputs.ends[INPUTS.index("sets")]
        self.levels = np.where(is_set, len(inputs.sets), 0)
        self.sampler = Sampler(normal_scores(self.cube[:, sought]), self.levels)
        self.random = np.random.default_rng((read.case.case["seed"], STREAM))
        self.rows: list[dict[str, float]] = []  # values drawn for each member
        self.runs: list[list[np.ndarray]] = [[] for _ in read.data]  # kept data of each data set
        # From complete rounds: log-likelihoods by data set, weights, and log weights without a
        # likelihood.
        self.by_data = np.empty((len(read.data), 0))
        self.weight = self.ahead = np.empty(0)

    def run(self, study: Study) -> None:
        """Run the members of a round, and compute their likelihoods."""
        read = self.read
        runs = study.run(
            self._scenes(), lambda _, run: [item.kept(run) for item in read.data], **LEAN_RUNS
        )
        for _, kept in runs:
            for of_item, value in zip(self.runs, kept, strict=True):
                of_item.append(value)
        new = slice(self.by_data.shape[1], None)
        values = [
            item.log_likelihood(np.array(runs)[new])
            for item, runs in zip(read.data, self.runs, strict=True)
        ]
        by_data = read.counts[:, None] * np.array(values)
        by_data[:, [row.get("source_redrawn", 0) > 0 for row in self.rows[new]]] = -np.inf
        self.by_data = np.concatenate([self.by_data, by_data], axis=1)
        self.sampler.learn(by_data.sum(axis=0))
        self.weight, self.ahead = self.sampler.weights(), self.sampler.log_prior_weights()

    def _scenes(self) -> Iterator[tuple[int, Scene]]:
        """Scenes of a round's members, by number; the drawn values are added to `rows`."""
        scene, inputs = self.read.scene, self.read.inputs
        for number in range(len(self.rows), len(self.cube)):
            draws = [inputs.at(name, self.cube[number], number) for name in inputs.names]
            self.rows.append(_row(draws))
            yield number, drawn_scene(scene, draws, inputs.boulders_seed(number))

    def propose(self) -> None:
        """Add the members of the next round, near likely members or from the prior."""
        seed, sought = self.read.case.case["seed"], self.read.sought
        shape = ROUND, self.cube.shape[1]
        points = np.random.default_rng((seed, STREAM, len(self.cube))).random(shape)
        if self.weight.any():
            points[:, sought] = _uniform(self.sampler.propose(ROUND, self.random))
        else:
            self.sampler.more_of_prior(normal_scores(points[:, sought]))
        self.cube = np.concatenate([self.cube, points])

    def posterior(self, enough: int) -> Back:
        """Result from the complete rounds. Raises KeyboardInterrupt if there are none, and a
        RockfallError if no member has a likelihood."""
        read, sampler, weight = self.read, self.sampler, self.weight
        if not (done := sampler.log_likelihood.size):
            raise KeyboardInterrupt
        if not weight.any():
            raise RockfallError(
                f"{read.case.name}: in none of {done} members do 20 boulders reach observations: "
                "check the case, the prior and the number of boulders"
            )
        table = pd.DataFrame(self.rows[:done]).assign(
            log_likelihood=sampler.log_likelihood, smooth=sampler.smooth, weight=weight
        )
        parts = contributions(sampler.points[:done], self.levels, self.ahead, weight, self.by_data)
        records, notes, noise = [], [*read.notes], 0.0
        for item, count, runs, part in zip(read.data, read.counts, self.runs, parts, strict=True):
            values = np.array(runs[:done])
            fit = predictive_p(item, values, weight, self.random)
            records.append(as_record(item, count, fit) | part.record())
            notes += item.remarks(values, weight)
            noise += float(count * item.noise(read.scene.boulders))
        return Back(
            read.case, read.inputs, read.sought, self.cube[:done], table,
            pd.DataFrame(records), tuple(notes), enough, noise, read.scene.boulders,
            np.array([part.alone for part in parts]), read.model_warnings,
        )  # fmt: skip


def _learn_noise(scene: Scene, inputs: Uncertain, data: list[Evidence]) -> None:
    """Measure the variation between runs that differ only in non-parameter inputs."""
    scenes = (
        (k, drawn_scene(scene, [inputs.at("dem", inputs.design[0, 0], k)], inputs.boulders_seed(k)))
        for k in range(NOT_MEMBERS, NOT_MEMBERS + REPLICATES)
    )
    runs = Study().run(scenes, lambda _, run: [item.kept(run) for item in data], **LEAN_RUNS)
    for item, values in zip(data, zip(*(kept for _, kept in runs), strict=True), strict=True):
        item.learn_noise(np.array(values))


def _row(draws: Iterable[Draw]) -> dict[str, float]:
    row: dict[str, float] = {}
    for draw in draws:
        for name, value in draw.kept.items():
            if np.ndim(value):
                row |= {f"{name}_{i + 1}": float(number) for i, number in enumerate(value)}
            else:
                row[name] = float(value)
    return row


def _sought(inputs: Uncertain, base: xr.Dataset) -> np.ndarray:
    """Columns of the cube that are parameters; rock sizes and grounds count only where boulders
    reach them. Raises a RockfallError if there are none."""
    all_columns: list[int] = []
    for name in inputs.names:
        k = INPUTS.index(name)
        columns = range(inputs.ends[k], inputs.ends[k + 1])
        if name == "radius":
            rows = _reached_materials(inputs.scene, base)
            columns = [column for i, column in enumerate(columns) if i in rows]
        if name == "ground":
            columns = [columns[i] for i in _reached_pairs(inputs, base)]
        if name == "volume":
            given = [inputs.given[key] > 1 for key in ("volume_factor", "volume_std_factor")]
            columns = [column for column, is_given in zip(columns, given, strict=True) if is_given]
        all_columns += columns
    if not all_columns:
        raise RockfallError(f"{inputs.scene.case.name}: &ensemble: nothing to fit")
    return np.array(all_columns)


def _reached_pairs(inputs: Uncertain, base: xr.Dataset) -> list[int]:
    """Positions of uncertain strengths and reliefs among the columns of grounds, for grounds on
    which boulders rebound."""
    reached = {ground.name for ground in rebounds_by_ground(base) if ground.rebounds}
    is_given = [inputs.given[key] > 1 for key in PAIR_FACTORS]
    return [
        2 * i + j
        for i, k in enumerate(inputs.pairs)
        if inputs.scene.grounds[k].name in reached
        for j in (0, 1)
        if is_given[j]
    ]


def _reached_materials(scene: Scene, base: xr.Dataset) -> set[int]:
    """Rows of rock sizes that boulders reach; factors on other rows have no effect. Raises a
    RockfallError if there are none."""
    if scene.rasters.values is not None:
        return {0}
    rows = {0}
    if scene.rasters.zone is not None:
        rows = set((np.unique(scene.rasters.zone[base["passages"].values > 0]) - 1).tolist())
    reached = {row for row in rows if row >= 0 and has_rocks(scene.rasters.sizes[row])}
    if not reached:
        raise RockfallError(
            f"{scene.case.name}: &ensemble radius_factor: has no effect: boulders reach no zone "
            "with rocks (R_m > 0): remove it"
        )
    return reached


def _uniform(scores: np.ndarray) -> np.ndarray:
    from scipy.special import ndtr

    return np.clip(ndtr(scores), 1e-12, 1 - 1e-12)
