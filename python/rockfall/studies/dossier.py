# SPDX-License-Identifier: BSD-3-Clause
"""Dossier of a case: the hazard of each variant, and what differs between them, from the same runs
of the scenarios with common random numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.analysis.hazard.combined import HazardInputs, ScenarioRun, combined
from rockfall.analysis.hazard.scenarios import base_case
from rockfall.analysis.objects.objects import object_hits
from rockfall.case import Case
from rockfall.case.variants import naming_variant, variants
from rockfall.errors import RockfallError
from rockfall.protection.yearly import YEARS
from rockfall.studies.hazard import read_study
from rockfall.studies.study import NO_CHECKPOINTS, Study
from rockfall.studies.variants import check_variant_scenes
from rockfall.studies.yearly_variants import YearlyRun, run_name, yearly_run, yearly_table

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from rockfall.scene.scene import Scene
    from rockfall.simulation.parts.checkpoint import Checkpoint


@dataclass(frozen=True)
class Dossier:
    """Hazards by variant, "" for a case without; frequencies at lines and objects as the table of
    `rockfall.yearly_variants`; the return period [year] of its answers; and the warnings on the
    models of its runs."""

    hazards: Mapping[str, xr.Dataset]
    frequencies: pd.DataFrame
    period: float = YEARS
    warnings: tuple[str, ...] = ()

    @property
    def first(self) -> xr.Dataset:
        """Hazard of the first variant."""
        return next(iter(self.hazards.values()))


@dataclass(frozen=True)
class DossierInputs:
    """Checked inputs of a dossier: the hazard of each variant, and likely mistakes."""

    case: Case
    studies: Mapping[str, HazardInputs]
    remarks: tuple[str, ...]

    @property
    def runs(self) -> list[str]:
        """Names of the runs: of each scenario of each variant."""
        return [
            _run_name(name, scenario.name)
            for name, study in self.studies.items()
            for scenario in study.scenarios
        ]


def read_dossier(case: Case, *given: Any, **arrays: Any) -> DossierInputs:
    """Read and check all inputs of a dossier before any run; arguments are those of
    `rockfall.studies.hazard.read_study`."""
    base_case(case)  # refuses a case without scenarios
    if case.output["kept"] != "all":
        raise RockfallError(
            f"{case.name}: &output kept = '{case.output['kept']}': a dossier needs the boulders at "
            "lines and objects; must be 'all'"
        )
    cases = variants(case) or {"": case}
    remarks = list(check_variant_scenes(case, **arrays)) if len(cases) > 1 else []
    studies = {}
    for name, own in cases.items():
        if name:
            with naming_variant(case, name):
                studies[name] = read_study(own, *given, **arrays)
        else:
            studies[name] = read_study(own, *given, **arrays)
        remarks += studies[name].remarks
    inputs = DossierInputs(case, studies, tuple(dict.fromkeys(remarks)))
    first = next(iter(studies.values()))
    if not (first.lines or len(first.objects) or len(first.segments)):
        raise RockfallError(
            f"{case.name}: a dossier needs a road or houses: give a &line, --objects or --segments"
        )
    return inputs


def run_dossier(
    inputs: DossierInputs,
    *,
    period: float = YEARS,
    progress: bool = False,
    threads: int | None = None,
    checkpoints: Mapping[str, Checkpoint] = NO_CHECKPOINTS,
) -> Dossier:
    """Run the scenarios of each variant once, and combine them."""
    engine = Study(progress=progress, threads=threads, checkpoints=checkpoints)
    hazards, yearly = {}, {}
    for name, study in inputs.studies.items():
        by_name = {_run_name(name, scenario.name): scenario for scenario in study.scenarios}

        def numbers(
            run: str, result: xr.Dataset, study: HazardInputs = study, by_name: Any = by_name
        ) -> tuple[ScenarioRun, YearlyRun]:
            own = ScenarioRun(study, by_name[run], result)
            at_objects = _at_objects(study, result, own.lines)
            return own, yearly_run(result, by_name[run].frequency, own.lines, at_objects)

        runs, rows = zip(*(each for _, each in engine.run(_scenes(study, by_name), numbers)),
                         strict=True)  # fmt: skip
        hazards[name], yearly[name] = combined(study, list(runs)), rows
    frequencies = yearly_table(yearly, inputs.case.hazard)
    return Dossier(hazards, frequencies, period, engine.warnings)


def _run_name(variant: str, scenario: str) -> str:
    return run_name(variant, scenario) if variant else scenario


def _scenes(study: HazardInputs, by_name: Mapping[str, Any]) -> Iterator[tuple[str, Scene]]:
    for name, scenario in by_name.items():
        yield name, replace(study.scene, case=scenario.case)


def _at_objects(study: HazardInputs, result: xr.Dataset, lines: list[str]) -> dict[str, np.ndarray]:
    """Energies of all boulders at objects with a width, by name: with the layer where a line has
    the same."""
    energies = {}
    for number, (energy, _) in object_hits(study.objects, result):
        name = study.objects.names[number]
        named = f"{name} ({study.objects.layers[number]})" if name in lines else name
        energies[named] = energy
    return energies
