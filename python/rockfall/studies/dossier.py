# SPDX-License-Identifier: BSD-3-Clause
"""Dossier of a case: the hazard of each variant and their differences, from the same runs of the
scenarios with common random numbers."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.hazard.combined import HazardInputs, ScenarioRun, combined
from rockfall.analysis.hazard.scenarios import base_case, scenarios_of
from rockfall.analysis.objects.at_risk import NOTHING, AtRisk
from rockfall.analysis.objects.objects import object_hits
from rockfall.case import Case, check_all_kept
from rockfall.case.variants import naming_variant, variants
from rockfall.errors import RockfallError
from rockfall.language import say
from rockfall.protection.yearly import YEARS, YearlyDesign
from rockfall.result.variables import ENDS
from rockfall.scene.lines import numbered
from rockfall.scene.stages import KeptStages
from rockfall.simulation.parts.checkpoint import Checkpoint
from rockfall.studies.hazard import read_study, run_study
from rockfall.studies.model_scenes import second_model
from rockfall.studies.study import NO_CHECKPOINTS, Study, run_labels
from rockfall.studies.variants import COLUMNS, check_variant_scenes, verdict_on
from rockfall.studies.yearly_variants import YearlyRun, yearly_run, yearly_table


class Second(NamedTuple):
    """Hazard from a second model, and the name of the model."""

    model: str
    hazard: xr.Dataset


@dataclass(frozen=True)
class Dossier:
    """Contents of a dossier."""

    hazards: Mapping[str, xr.Dataset]  # by variant; "" for a case without variants
    #: As in `rockfall.yearly_variants`, with the `place` of each row: line, barrier or object.
    frequencies: pd.DataFrame
    period: float = YEARS  # return period of the answers [year]
    second: Second | None = None  # hazard of the first variant by a second model
    costs: Mapping[str, float] = field(default_factory=dict)  # by variant

    @property
    def first(self) -> xr.Dataset:
        """Hazard of the first variant."""
        return next(iter(self.hazards.values()))


class Run(NamedTuple):
    """A run of a dossier."""

    variant: str  # "" for a case without variants
    scenario: str
    is_second: bool = False  # True for a run with the second model

    def __str__(self) -> str:
        return "/".join(
            filter(None, ("second model" * self.is_second, self.variant, self.scenario))
        )


class Designs(NamedTuple):
    """Barrier designs for the hazards with evaluation lines: by variant, and by the second model
    for the first variant."""

    by_variant: Mapping[str, YearlyDesign]
    second: YearlyDesign | None = None


@dataclass(frozen=True)
class DossierInputs:
    """Checked inputs of a dossier: hazard inputs of each variant, likely mistakes, and the first
    variant's inputs for a second model, with the model name."""

    case: Case
    studies: Mapping[str, HazardInputs]
    remarks: tuple[str, ...]
    second: tuple[str, HazardInputs] | None = None

    @property
    def runs(self) -> list[Run]:
        """Each scenario of each variant, then those of the second model."""
        of_variants = [
            Run(name, scenario.name)
            for name, study in self.studies.items()
            for scenario in study.scenarios
        ]
        scenarios = self.second[1].scenarios if self.second else []
        return of_variants + [Run("", scenario.name, True) for scenario in scenarios]


def read_dossier(
    case: Case,
    given: AtRisk = NOTHING,
    memory: float | None = None,
    *,
    one_model: bool = False,
    **arrays: Any,
) -> DossierInputs:
    """Read and check all inputs of a dossier before any run; arguments are as in
    `rockfall.studies.hazard.read_study`. With `one_model` no second model is run."""
    base_case(case)  # raises a RockfallError without scenarios
    arrays = {"stages": KeptStages()} | arrays  # inputs that variants share are read once
    check_all_kept(case, "a dossier needs")
    cases = variants(case) or {"": case}
    remarks = list(check_variant_scenes(case, **arrays)) if len(cases) > 1 else []
    studies = {}
    for name, own in cases.items():
        if name:
            with naming_variant(case, name):
                studies[name] = read_study(own, given, memory, **arrays)
        else:
            studies[name] = read_study(own, given, memory, **arrays)
        remarks += studies[name].remarks
    first = next(iter(studies.values()))
    second = None if one_model else _second(first)
    if second is None and not one_model:
        remarks.append(say("dossier.no_second"))
    inputs = DossierInputs(case, studies, tuple(dict.fromkeys(remarks)), second)
    if not (first.lines or len(first.objects) or len(first.segments)):
        raise RockfallError(
            f"{case.name}: a dossier needs a road or houses: give a &line, --objects or --segments"
        )
    return inputs


def _second(study: HazardInputs) -> tuple[str, HazardInputs] | None:
    """Inputs of a hazard with a second model; None for ground without one, or in windows."""
    model = second_model(study.scene) if study.scene.rasters.z.size else None
    if model is None:
        return None
    name, scene = model
    lines = [*study.objects.lines, *study.segments.lines, *study.lines]
    return name, replace(study, scene=scene, scenarios=scenarios_of(scene, lines))


def run_dossier(
    inputs: DossierInputs,
    *,
    period: float = YEARS,
    progress: bool = False,
    threads: int | None = None,
    checkpoints: Mapping[Run, Checkpoint] = NO_CHECKPOINTS,
) -> Dossier:
    """Run the scenarios of each variant once, and combine them."""
    labels = run_labels(inputs.runs)
    engine = Study(progress=progress, threads=threads, checkpoints=checkpoints, labels=labels)
    hazards, yearly = {}, {}
    lines = {
        own["name"]
        for study in inputs.studies.values()
        for own in (*study.lines, *study.case.barrier)
    }
    for name, study in inputs.studies.items():
        by_run = {Run(name, scenario.name): scenario for scenario in study.scenarios}

        def numbers(
            run: Run, result: xr.Dataset, study: HazardInputs = study, by_run: Any = by_run
        ) -> tuple[ScenarioRun, YearlyRun]:
            own = ScenarioRun(study, by_run[run], result)
            at_objects = _at_objects(study, result, lines)
            return own, yearly_run(result, by_run[run].frequency, own.lines, at_objects)

        scenes = ((run, replace(study.scene, case=own.case)) for run, own in by_run.items())
        ran = engine.run(scenes, numbers, compared=False)
        runs, rows = zip(*(each for _, each in ran), strict=True)
        hazards[name], yearly[name] = combined(study, list(runs)), rows
    frequencies = pd.concat(
        [yearly_table(yearly, inputs.case.hazard), _at_points(inputs.studies, hazards, lines)]
    ).reset_index(drop=True)
    barriers = {own["name"] for study in inputs.studies.values() for own in study.case.barrier}
    kinds = dict.fromkeys(lines, "line") | dict.fromkeys(barriers, "barrier")
    place = [kinds.get(name, "object") for name in frequencies["line"]]
    frequencies.insert(0, "place", place)
    second = None
    if inputs.second:
        name, study = inputs.second
        own_runs = [run for run in inputs.runs if run.is_second]
        own_checkpoints = [checkpoints[run] for run in own_runs if run in checkpoints]
        hazard = run_study(
            study, progress=progress, threads=threads, checkpoints=own_checkpoints,
            labels=[labels[run] for run in own_runs],
        )  # fmt: skip
        second = Second(name, hazard)
    costs = {own["name"]: own["cost"] for own in inputs.case.variant if "cost" in own}
    return Dossier(hazards, frequencies, period, second, costs)


def _at_objects(
    study: HazardInputs, result: xr.Dataset, lines: Collection[str]
) -> dict[str, np.ndarray]:
    """Energies and heights of all boulders at objects with a width, by name."""
    names = _object_names(study, lines)
    return {names[number]: hits for number, hits in object_hits(study.objects, result)}


def _object_names(study: HazardInputs, lines: Collection[str]) -> list[str]:
    """Names of the objects, with the layer added to a name that is also in `lines`."""
    layers = zip(study.objects.names, study.objects.layers, strict=True)
    return [*numbered([f"{name} ({on})" if name in lines else name for name, on in layers])]


def _at_points(
    studies: Mapping[str, HazardInputs], hazards: Mapping[str, xr.Dataset], lines: Collection[str]
) -> pd.DataFrame:
    """Rows of `frequencies` at points without a width. Only the numbers of their boulders are
    known, so differences have no intervals, and there are no energies by return period."""
    first, rows = next(iter(hazards.values())), []
    for variant, study in studies.items():
        if not study.objects.point.size:
            continue
        hazard, names = hazards[variant], _object_names(study, lines)
        thresholds = (1e-3 * hazard["threshold"].values).tolist()
        statistics = ["all", *(f"above_{threshold:.10g}" for threshold in thresholds)]
        rates = {end: _object_rates(hazard, end) for end in ENDS}
        before = _object_rates(first, "")
        for k in study.objects.point.tolist():
            n = int(hazard["object_passages"].values[:, k].sum())
            for row, statistic in enumerate(statistics):
                own = {"line": names[k], "variant": variant, "quantity": "frequency", "n": n}
                own |= {f"value{end}": float(rate[row, k]) for end, rate in rates.items()}
                if hazard is not first:
                    apart = own["value"] - float(before[row, k])
                    own |= verdict_on(apart, np.nan, np.nan)
                rows.append(own | {"statistic": statistic})
    return pd.DataFrame(rows, columns=COLUMNS)


def _object_rates(hazard: xr.Dataset, end: str) -> np.ndarray:
    """Frequencies (1 + thresholds, objects) of all boulders, and above each threshold [1/year]."""
    names = f"object_frequency{end}", f"object_exceedance_frequency{end}"
    return np.vstack([hazard[name].values for name in names])
