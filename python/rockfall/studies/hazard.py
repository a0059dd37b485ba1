# SPDX-License-Identifier: BSD-3-Clause
"""Hazard study: each scenario of a case runs once, and the results are combined by frequency."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.hazard.combined import HazardInputs, ScenarioRun, combined
from rockfall.analysis.hazard.finished import is_same_case
from rockfall.analysis.hazard.model_warnings import messages_of
from rockfall.analysis.hazard.origins import SOURCES, origins_at, with_origins
from rockfall.analysis.hazard.scenarios import (
    Scenario,
    base_case,
    scenario_remarks,
    scenario_warnings,
    scenarios_of,
)
from rockfall.analysis.objects.at_risk import NOTHING, AtRisk
from rockfall.analysis.objects.exposure import curve_remarks
from rockfall.analysis.objects.object_layers import files_of, frames_of, given_layers
from rockfall.analysis.objects.objects import (
    Objects,
    beyond_remarks,
    check_kept,
    check_room,
    read_objects,
    source_remarks,
)
from rockfall.analysis.objects.segments import check_roads, roads_of
from rockfall.analysis.objects.vulnerability import KILOJOULE, read_curves
from rockfall.analysis.validity.warnings import joined_warnings, warn_each
from rockfall.case import Case, case_in, case_of, check_all_kept, key_table
from rockfall.errors import RockfallError
from rockfall.io.input_warnings import InputWarning
from rockfall.io.tables import plain_decimal
from rockfall.language import Text
from rockfall.result.dataset import read_result
from rockfall.scene.frames import frame_files, of_frames
from rockfall.scene.read import read_scene
from rockfall.scene.scene import Scene
from rockfall.simulation.memory import machine_memory
from rockfall.simulation.parts.checkpoint import Checkpoint
from rockfall.studies.back.places import check_on_terrain
from rockfall.studies.study import Study, run_labels

FARTHEST = 1e12  # limit of coordinates in a case [m]
WIDTH = "hazard", "object_width"  # key of the default width of a place


def hazard(
    case: Case,
    *,
    objects: Any = None,
    objects_layer: str | Sequence[str] | None = None,
    vulnerability: str | Path | None = None,
    segments: Any = None,
    segments_layer: str | None = None,
    segment_length: float | None = None,
    results: Sequence[str | Path] = (),
    progress: bool = False,
    threads: int | None = None,
    memory: float | None = None,
    **arrays: Any,
) -> xr.Dataset:
    """Run each &scenario of a case and combine the results. The returned xarray.Dataset has annual
    frequencies and hazard classes with 95 % intervals, for cells and objects, and the risk if
    objects have values or persons.

    `objects` is a layer of points, lines and polygons, a GeoDataFrame, or a list of these;
    `objects_layer` is the layer name (or a list of names) in files with several layers;
    `vulnerability` is a table of curves for the objects. `segments` is a layer of roads, cut into
    pieces of `segment_length` [m] (default: whole lines). `results` are results of scenarios that
    ran elsewhere. The other arguments are as in `rockfall.run`; see docs/hazard.md. Invalid inputs
    raise a RockfallError; likely mistakes give UserWarnings.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> case = case.replace(scenario=[{"name": "small", "return_period": 10.0}])
    >>> found = rockfall.hazard(case)
    """
    roads = segments, segments_layer, segment_length
    study = read_study(
        case, AtRisk(objects, objects_layer, vulnerability, *roads), memory, **arrays
    )
    for line in study.remarks:
        warnings.warn(line, stacklevel=2)
    combined = run_study(study, results=results, progress=progress, threads=threads)
    warn_each(joined_warnings(messages_of(combined)))
    return combined


def origins(hazard: xr.Dataset, place: str | Sequence[float], **arrays: Any) -> pd.DataFrame:
    """Table of the origins of boulders that reach a place of a hazard, most frequent first.

    `place` is the name of a line or object, or a circle (x, y) or (x, y, radius) [m], by default as
    wide as `&hazard object_width`. For a circle the scenarios run again, with `arrays` as in
    `rockfall.hazard`. Each row is a source cell: its centre `x`, `y` [m]; `frequency` [1/year] of
    its boulders that arrive, with the 95 % limits `frequency_low` and `frequency_high`; `share`,
    their fraction of all arriving boulders; `reach`, the fraction of the cell's boulders that
    arrive; and their kinetic energies [J]: `energy_mean`, and the 95 % quantile `energy_q95` with
    the limits `energy_q95_low` and `energy_q95_high`, NaN if too few boulders arrive. Unknown
    places, points without a width, and changed inputs raise a RockfallError.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> case = case.replace(scenario=[{"name": "small", "return_period": 10.0}])
    >>> found = rockfall.origins(rockfall.hazard(case), "L")
    >>> float(found["share"].sum().round(9))
    1.0
    """
    return origins_at(*traced(hazard, place, **arrays))


def coordinates_of(place: str) -> tuple[float, ...]:
    """Numbers of a place "X,Y" or "X,Y,RADIUS" [m]; NaN for parts that are not numbers."""
    return tuple(map(plain_decimal, place.split(",")))


def traced(
    hazard: xr.Dataset,
    place: str | Sequence[float],
    among: Sequence[str] = SOURCES,
    *,
    progress: bool = False,
    **arrays: Any,
) -> tuple[xr.Dataset, str, int]:
    """Hazard that has the origins of a place (see `origins`), and the kind and index of the place
    in it. A named place must be of a kind in `among`."""
    if isinstance(place, str):
        return hazard, *with_origins(hazard, place, among)
    where, case = f"place {', '.join(f'{value:.12g}' for value in place)}", case_in(hazard.attrs)
    check_all_kept(case, "the origins of a place need")
    limits = (key.high for key in key_table() if (key.group, key.name) == WIDTH)
    most, width = next(limits) or math.inf, case.hazard["object_width"]
    width = 2 * place[2] if len(place) == 3 else width
    if len(place) not in (2, 3) or not ((np.abs(place) < FARTHEST).all() and 0 <= width <= most):
        raise RockfallError(f"{where}: must be X,Y or X,Y,RADIUS, radius at most {most / 2:g} m")
    x, y = map(float, place[:2])
    line = {"name": where, "x": [x, x], "y": [y, y], "object_width": width}
    study = read_study(case.replace(line=[line], variant=[]), **arrays)
    check_on_terrain(study.scene, ["place"], np.array([x]), np.array([y]))
    rerun = run_study(study, progress=progress)
    names = "scenario_hits", "scenario_hits_energy_exceeded"
    if not all(np.array_equal(rerun[name].values, hazard[name].values) for name in names):
        raise RockfallError(f"{where}: inputs or version differ from those of the hazard: rerun it")
    return rerun, "line", 0


def read_study(
    case: Case, given: AtRisk = NOTHING, memory: float | None = None, **arrays: Any
) -> HazardInputs:
    """Read and check all inputs of a hazard before any run."""
    memory, vulnerability = memory or machine_memory(), given.vulnerability
    check_roads(given)
    sources = given_layers(given.objects, given.objects_layer)
    if vulnerability is not None and not sources:
        raise RockfallError(f"{vulnerability}: vulnerability curves require objects")
    curves = read_curves(vulnerability)
    scene = read_scene(base_case(case), memory=memory, **arrays)
    _check_memory(scene, memory)
    remarks: list[str] = []
    found_objects = Objects()
    if sources:
        levels = KILOJOULE * np.array(case.hazard["thresholds"])
        with frame_files(frames_of(sources)) as files:
            layers = files_of(sources, files)
            found_objects = read_objects(layers, scene.grid, levels, remarks, curves)
            remarks += beyond_remarks(found_objects, scene)
            remarks += source_remarks(found_objects, scene)
            if vulnerability is not None:
                remarks += curve_remarks(vulnerability, curves, found_objects.exposed)
        found_objects.paths = [of_frames(path, files) for path in found_objects.paths]
        remarks = [of_frames(remark, files) for remark in remarks]
    segments = roads_of(given, scene, remarks)
    own = scene.case.line if case.output["kept"] == "all" else []
    read = {"barrier": scene.case.barrier, "dam": scene.case.dam} | ({"line": own} if own else {})
    case = case.replace(**read)  # layers become part of the case
    scene = scene.replace(remarks=(*scene.remarks, *scenario_remarks(scene)))
    lines = [*found_objects.lines, *segments.lines]
    scenarios = scenarios_of(scene, [*lines, *own])
    study = HazardInputs(case, scene, scenarios, own, found_objects, segments)
    study.warnings = scenario_warnings(scene, study.scenarios)
    own_remarks = [f"{scene.case.name}: {where}: {text}" for where, text in study.warnings]
    of_layers = [remark.values for remark in remarks if isinstance(remark, Text)]
    study.warnings += [InputWarning(values["where"], values["text"]) for values in of_layers]
    remarks += own_remarks
    paths = [*found_objects.paths, *([segments.path] if len(segments) else [])]
    check_kept(scene.case, len(lines))
    check_room(paths, len(lines), scene.boulders)
    study.remarks = list(dict.fromkeys(remarks))
    return study


def _check_memory(scene: Scene, memory: float) -> None:
    """Raise a RockfallError if the maps of a hazard do not fit in memory, before any run."""
    levels, scenarios = 1 + len(scene.case.hazard["thresholds"]), len(scene.case.scenario)
    cells = scene.grid.nx * scene.grid.ny
    need = cells * (16 * levels * scenarios + 40 * levels + 25)  # measured memory [bytes]
    if need > memory:
        raise RockfallError(
            f"{scene.case.name}: a hazard of {cells:,} cells, {scenarios} scenarios and "
            f"{levels - 1} thresholds needs {need / 1e6:,.1f} MB, of {memory / 1e6:,.1f}: cut the "
            "terrain to the slope, or raise --memory"
        )


def run_study(
    study: HazardInputs,
    *,
    results: Sequence[str | Path] = (),
    progress: bool = False,
    threads: int | None = None,
    checkpoints: Sequence[Checkpoint] = (),
    labels: Sequence[str] = (),
) -> xr.Dataset:
    """Run the scenarios in turn, each from its checkpoint, or read their `results`, one file for
    each. Progress shows `labels` (default: their names)."""
    if results and len(results) != len(study.scenarios):
        many = f"{len(study.scenarios)} scenarios"
        raise RockfallError(f"results: {len(results)} for {many}: give one for each, in this order")
    by_name = {scenario.name: scenario for scenario in study.scenarios}
    saved = dict(zip(by_name, checkpoints, strict=False))
    shown = dict(zip(by_name, labels, strict=True)) if labels else run_labels([*by_name])
    engine = Study(progress=progress, threads=threads, checkpoints=saved, labels=shown)
    scenes = (
        (name, _read_scenario(study, scenario, results[k]) if results
         else replace(study.scene, case=scenario.case))
        for k, (name, scenario) in enumerate(by_name.items())
    )  # fmt: skip
    runs = engine.run(
        scenes, lambda name, result: ScenarioRun(study, by_name[name], result), compared=False
    )
    return combined(study, [run for _, run in runs])


def _read_scenario(study: HazardInputs, scenario: Scenario, path: str | Path) -> xr.Dataset:
    """Result of a scenario that ran elsewhere; it must be complete and have the same inputs."""
    result = read_result(path)
    text = f"{path}: scenario '{scenario.name}'"
    own = case_of(result)
    if not is_same_case(own, scenario.case):
        if is_same_case(own, scenario.case, line=[]):
            raise RockfallError(
                f"{text}: its &line groups do not match the given objects and segments: write the "
                "cases with --write-cases"
            )
        raise RockfallError(f"{text}: is the result of another case: see --write-cases")
    if json.loads(result.attrs["input_checksums"]) != study.scene.checksums:
        raise RockfallError(f"{text}: was run with other input files")
    if not result.attrs["complete"]:
        raise RockfallError(f"{text}: is not complete")
    return result
