# SPDX-License-Identifier: BSD-3-Clause
"""Hazard study: each scenario of a case is run once, and combined by frequency."""

from __future__ import annotations

import json
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.analysis.hazard.classes import (
    Frequencies,
    Matrix,
    classify,
    frequencies,
    intensities,
)
from rockfall.analysis.hazard.exceedance import (
    Passed,
    Passing,
    exceedance_numbers,
    passing_of,
)
from rockfall.analysis.hazard.finished import is_same_case, layers_checksum
from rockfall.analysis.hazard.scenarios import (
    Scenario,
    base_case,
    scenario_remarks,
    scenario_warnings,
    scenarios_of,
)
from rockfall.analysis.hazard.variables import (
    CLASS_ENDS,
    COORDINATES,
    ENDS,
    EXCEEDED,
    EXTREMES,
    PERIODS,
    TABLE,
)
from rockfall.analysis.objects.exposure import curve_remarks
from rockfall.analysis.objects.object_layers import files_of, frames_of, given_layers
from rockfall.analysis.objects.objects import (
    Objects,
    beyond_remarks,
    check_kept,
    check_room,
    object_counts,
    object_hits,
    read_objects,
    risks,
    source_remarks,
)
from rockfall.analysis.objects.risk import Points, RunRisk, annual, diameters
from rockfall.analysis.objects.segment_hits import (
    Weighted,
    hit_counts,
    segment_hits,
    segment_numbers,
)
from rockfall.analysis.objects.segments import NO_ROADS, Roads, Segments, check_roads, roads_of
from rockfall.analysis.objects.vulnerability import KILOJOULE, read_curves
from rockfall.analysis.validity.remarks import model_warnings
from rockfall.analysis.validity.warnings import joined_warnings, warn_each
from rockfall.case import Case, case_of
from rockfall.errors import RockfallError
from rockfall.io.input_warnings import InputWarning, stored_warnings
from rockfall.language import Text, packed, unpacked
from rockfall.result.contents import Contents
from rockfall.result.dataset import read_result
from rockfall.result.grounds import rebounds_by_ground, source_text
from rockfall.result.samples import simulated
from rockfall.scene.frames import frame_files, of_frames
from rockfall.scene.read import read_scene
from rockfall.scene.scene import Scene
from rockfall.simulation.maps import boulders_per_cluster
from rockfall.simulation.memory import machine_memory
from rockfall.studies.study import Study

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.simulation.parts.checkpoint import Checkpoint

LAYOUT = 2  # of the file


@dataclass
class HazardInputs:
    """Checked inputs of a hazard."""

    case: Case
    scene: Scene
    scenarios: list[Scenario]
    lines: list[dict[str, Any]]  # evaluation lines of the case, after those of objects and segments
    objects: Objects
    segments: Segments
    remarks: list[str] = field(default_factory=list)  # likely mistakes, one line each
    warnings: list[InputWarning] = field(default_factory=list)  # of its scenes


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
    """Run each &scenario of a case and combine them: an xarray.Dataset of annual frequencies and
    hazard classes, with 95 % intervals, for each cell and each of the `objects` (a layer of points,
    lines and polygons, or a GeoDataFrame, or a list of these; `objects_layer` is its name in a file
    with several, or a list of names), and of risk where these say what is exposed; `vulnerability`
    is a table of curves for them. The lines of another layer, roads, are cut into `segments` of
    `segment_length` [m], each with its own frequencies; without a length each line is a segment.
    `results` are those of the scenarios, if they have been run elsewhere. docs/hazard.md explains
    it; the other arguments are as in `rockfall.run`.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> case = case.replace(scenario=[{"name": "small", "return_period": 10.0}])
    >>> found = rockfall.hazard(case)
    """
    roads = Roads(segments, segments_layer, segment_length)
    study = read_study(case, objects, memory, objects_layer, vulnerability, roads, **arrays)
    for line in study.remarks:
        warnings.warn(line, stacklevel=2)
    combined = run_study(study, results=results, progress=progress, threads=threads)
    warn_each(joined_warnings(_model_warnings(combined)))
    return combined


def _model_warnings(hazard: xr.Dataset) -> dict[str, list[Text]]:
    """Warnings on the model of each scenario."""
    names, messages = (hazard[f"scenario{end}"].values for end in ("", "_messages"))
    by_name: dict[str, list[Text]] = {}
    for name, packed_texts in zip(names, messages, strict=True):
        texts = (unpacked(data, "") for data in json.loads(packed_texts))
        by_name[str(name)] = [text for text in texts if isinstance(text, Text)]
    return by_name


def read_study(
    case: Case,
    objects: Any = None,
    memory: float | None = None,
    objects_layer: str | Sequence[str] | None = None,
    vulnerability: str | Path | None = None,
    roads: Roads = NO_ROADS,
    **arrays: Any,
) -> HazardInputs:
    """Read and check all inputs of a hazard before any run."""
    memory = memory or machine_memory()
    check_roads(roads)
    sources = given_layers(objects, objects_layer)
    if vulnerability is not None and not sources:
        raise RockfallError(f"{vulnerability}: curves of vulnerability need objects")
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
    segments = roads_of(roads, scene, remarks)
    case = case.replace(barrier=scene.case.barrier, dam=scene.case.dam)  # layers have been read
    scene = scene.replace(remarks=(*scene.remarks, *scenario_remarks(scene)))
    lines = [*found_objects.lines, *segments.lines]
    own = case.line if case.output["kept"] == "all" else []
    scenarios = scenarios_of(scene, [*lines, *own])
    study = HazardInputs(case, scene, scenarios, own, found_objects, segments)
    study.warnings = scenario_warnings(scene, study.scenarios)
    remarks += [f"{scene.case.name}: {where}: {text}" for where, text in study.warnings]
    paths = [*found_objects.paths, *([segments.path] if len(segments) else [])]
    check_kept(scene.case, len(lines))
    check_room(paths, len(lines), scene.boulders)
    study.remarks = list(dict.fromkeys(remarks))
    return study


def _check_memory(scene: Scene, memory: float) -> None:
    """Refuse maps that do not fit in memory, before any run."""
    levels, scenarios = 1 + len(scene.case.hazard["thresholds"]), len(scene.case.scenario)
    cells = scene.grid.nx * scene.grid.ny
    need = cells * (16 * levels * scenarios + 40 * levels + 25)  # measured memory
    if need > memory:
        raise RockfallError(
            f"{scene.case.name}: a hazard of {cells:,} cells, {scenarios} scenarios and "
            f"{levels - 1} thresholds takes {need / 1e6:,.1f} MB, of {memory / 1e6:,.1f}: cut the "
            "terrain to the slope, or raise --memory"
        )


def run_study(
    study: HazardInputs,
    *,
    results: Sequence[str | Path] = (),
    progress: bool = False,
    threads: int | None = None,
    checkpoints: Sequence[Checkpoint] = (),
) -> xr.Dataset:
    """Run the scenarios in turn; each resumes from its checkpoint, or is taken from its result."""
    if results and len(results) != len(study.scenarios):
        many = f"{len(study.scenarios)} scenarios"
        raise RockfallError(f"results: {len(results)} for {many}: one is needed for each, in order")
    by_name = {scenario.name: scenario for scenario in study.scenarios}
    saved = dict(zip(by_name, checkpoints, strict=False))
    engine = Study(progress=progress, threads=threads, checkpoints=saved)
    scenes = (
        (name, _read_scenario(study, scenario, results[k]) if results
         else replace(study.scene, case=scenario.case))
        for k, (name, scenario) in enumerate(by_name.items())
    )  # fmt: skip
    runs = engine.run(
        scenes, lambda name, result: _Run(study, by_name[name], result), compared=False
    )
    return _dataset(study, [run for _, run in runs])


def _read_scenario(study: HazardInputs, scenario: Scenario, path: str | Path) -> xr.Dataset:
    """Result of a scenario that was run elsewhere: complete, with the same inputs."""
    result = read_result(path)
    text = f"{path}: scenario '{scenario.name}'"
    own = case_of(result)
    if not is_same_case(own, scenario.case):
        if is_same_case(own, scenario.case, line=[]):
            raise RockfallError(
                f"{text}: its &line groups are not those of the objects and segments given here: "
                "--write-cases writes the cases with them"
            )
        raise RockfallError(f"{text}: is the result of another case; see --write-cases")
    if json.loads(result.attrs["input_checksums"]) != study.scene.checksums:
        raise RockfallError(f"{text}: was run with other input files")
    if not result.attrs["complete"]:
        raise RockfallError(f"{text}: is not complete")
    return result


class _Run:
    """Retained data of the run of a scenario."""

    def __init__(self, study: HazardInputs, scenario: Scenario, result: xr.Dataset) -> None:
        self.boulders, self.yearly = simulated(result), scenario.frequency
        starts = (result[f"start_{axis}"].values for axis in "xy")
        self.per_cluster = boulders_per_cluster(study.case, *starts)
        self.sample = self.boulders, self.per_cluster, self.yearly
        # counts by cell (intensities, y, x)
        self.passages = _counts(result, "passages", "energy_exceeded")
        self.hits = _counts(result, "hits", "hits_energy_exceeded")
        self.extremes = {name: result[name].values for name in EXTREMES}
        self.segments = [*segment_hits(study.segments, result, len(study.objects.lines))]
        self.segment_counts = hit_counts(self.segments, result["threshold"].values)
        self.objects = object_counts(study.objects, result, study.scene.grid, self.hits)
        self.risk = self._risk(study.objects, result) if study.objects.exposed else None
        self.at_objects: list[Passing | None] = [None] * len(study.objects)
        for number, hits in object_hits(study.objects, result):
            self.at_objects[number] = Passing(*hits[:, np.isfinite(hits[0])])
        first = len(study.objects.lines) + len(study.segments.lines)
        self.at_lines = [passing_of(result, first + k) for k in range(len(study.lines))]
        self.variable_attrs = {name: result[name].attrs for name in ("x", "y", "threshold", "crs")}
        self.places = {axis: result[axis].values for axis in ("x", "y", "threshold")}
        self.attrs = result.attrs
        self.grounds = rebounds_by_ground(result)
        without_objects = result.drop_vars("row_size", errors="ignore")  # zones end at any edge
        self.warnings = model_warnings(without_objects, case_of(result))

    def _risk(self, objects: Objects, result: xr.Dataset) -> RunRisk:
        points = Points(objects.point, self.objects, result["threshold"].values)
        energies = ((number, energy) for number, (energy, _) in object_hits(objects, result))
        return RunRisk(objects.exposed, energies, diameters(result), points, self.per_cluster)


def _counts(result: xr.Dataset, name: str, exceeded: str) -> np.ndarray:
    return np.concatenate([result[name].values[None], result[exceeded].values])


def _dataset(study: HazardInputs, runs: list[_Run]) -> xr.Dataset:
    matrix, case = Matrix.of(study.case), study.case
    values = _scenarios(study, runs)
    factor = case.hazard["frequency_factor"]
    passages = frequencies(((run.passages, *run.sample) for run in runs), factor)
    hits = frequencies(((run.hits, *run.sample) for run in runs), factor)
    values |= _frequencies(passages, sum(run.yearly for run in runs))
    values |= _with_ends("hit_frequency", "hit_exceedance_frequency", hits, "f4")
    values |= _classes("", hits, matrix)
    for name, extreme in EXTREMES.items():
        values[name] = extreme.reduce([run.extremes[name] for run in runs])
    data = _places(study, runs[0], matrix)
    if len(study.objects):
        values |= _objects(study, runs, matrix)
        names = np.array(study.objects.names, dtype=object)
        data["object"] = ("object", names, {"long_name": "name of the object"})
    if len(study.segments):
        values |= _segments(study, runs, matrix)
        labels = np.array(study.segments.labels, dtype=object)
        data["segment"] = ("segment", labels, {"long_name": "road, and chainage of the segment"})
    if study.lines:
        values |= _lines(study, runs)
        names = np.array([line["name"] for line in study.lines], dtype=object)
        data["line"] = ("line", names, {"long_name": "name of the evaluation line"})
    if study.lines or len(study.objects) or len(study.segments):
        data |= _levels()
    values |= _grounds(runs)
    if "ground" in values:
        data["ground"] = ("ground", values["ground"], {"long_name": "name of the ground"})
    for name, variable in TABLE.items():
        if name in values:
            data[name] = (variable.dims, values[name], variable.about(case))
    attrs = _attributes(study, runs) | {"source": source_text(values)}
    return Contents(data, attrs, COORDINATES).dataset()


def _grounds(runs: list[_Run]) -> dict[str, np.ndarray]:
    """Grounds, their models, and the rebounds on each in all scenarios; none where the scene has
    only its impact sets."""
    counts: dict[tuple[str, str], int] = {}
    for ground in (ground for run in runs for ground in run.grounds):
        key = ground.name, ground.model
        counts[key] = counts.get(key, 0) + ground.rebounds
    if not counts:
        return {}
    names, models = (np.array(column, dtype=object) for column in zip(*counts, strict=True))
    rebounds = np.array([*counts.values()], "i8")
    return {"ground": names, "ground_model": models, "rebounds_by_ground": rebounds}


def _places(study: HazardInputs, run: _Run, matrix: Matrix) -> dict[str, tuple]:
    """Coordinates, and the grid mapping."""
    names = np.array([scenario.name for scenario in study.scenarios], dtype=object)
    attrs = {"units": "year", "long_name": "longest return period of a class of frequency"}
    return {
        **{axis: (axis, values, run.variable_attrs[axis]) for axis, values in run.places.items()},
        "crs": ((), np.int32(0), run.variable_attrs["crs"]),
        "return_period": ("return_period", matrix.periods, attrs),
        "scenario": ("scenario", names, {"long_name": "class of boulders"}),
    }


def _scenarios(study: HazardInputs, runs: list[_Run]) -> dict[str, np.ndarray]:
    """Properties and counts of each scenario, sufficient to apply other frequencies without another
    run."""
    return {
        "frequency": np.array([run.yearly for run in runs]),
        "boulders": np.array([run.boulders for run in runs]),
        "boulders_per_cluster": np.array([run.per_cluster for run in runs]),
        "scenario_warnings": np.array(["\n".join(run.warnings) for run in runs], dtype=object),
        "scenario_messages": np.array(
            [json.dumps([packed(text) for text in run.warnings]) for run in runs], dtype=object
        ),
        "scenario_passages": np.stack([run.passages[0] for run in runs]),
        "scenario_energy_exceeded": np.stack([run.passages[1:] for run in runs]),
        "scenario_hits": np.stack([run.hits[0] for run in runs]),
        "scenario_hits_energy_exceeded": np.stack([run.hits[1:] for run in runs]),
    }


def _frequencies(rates: Frequencies, yearly: float) -> dict[str, np.ndarray]:
    """Frequencies of cells with their limits, and quantities derived from them."""
    values = _with_ends("passage_frequency", "exceedance_frequency", rates, "f4")
    with np.errstate(divide="ignore"):
        periods = np.where(rates.value > 0, 1 / rates.value, np.nan).astype("f4")
    values["passage_return_period"], values["exceedance_return_period"] = periods[0], periods[1:]
    part = (rates.value / yearly).astype("f4")
    values["reach_probability"], values["exceedance_probability"] = part[0], part[1:]
    return values


def _with_ends(
    name: str, exceeded: str, rates: Frequencies, kind: str = "f8"
) -> dict[str, np.ndarray]:
    """Frequencies of all boulders, and of those above each threshold, with their limits."""
    values = {}
    for end, rate in zip(ENDS, rates, strict=True):
        values[f"{name}{end}"] = rate[0].astype(kind)
        values[f"{exceeded}{end}"] = rate[1:].astype(kind)
    return values


def _classes(prefix: str, rates: Frequencies, matrix: Matrix) -> dict[str, np.ndarray]:
    """Intensities and hazard classes."""
    classes = classify(rates, matrix)
    values = {f"{prefix}intensity": intensities(rates.value, matrix.periods).astype("i1")}
    for end, numbers in zip(CLASS_ENDS, classes, strict=True):
        values[f"{prefix}hazard_class{end}"] = numbers
    values[f"{prefix}hazard_class_certain"] = classes.certain.astype("i1")
    return values


def _objects(study: HazardInputs, runs: list[_Run], matrix: Matrix) -> dict[str, np.ndarray]:
    factor = study.case.hazard["frequency_factor"]
    rates = frequencies(((run.objects, *run.sample) for run in runs), factor)
    values = {
        "object_layer": np.array(study.objects.layers, dtype=object),
        "object_geometry": np.array([shape.wkt for shape in study.objects.shapes], dtype=object),
        "object_passages": np.stack([run.objects[0] for run in runs]),
        "object_energy_exceeded": np.stack([run.objects[1:] for run in runs]),
    }
    values |= _with_ends("object_frequency", "object_exceedance_frequency", rates)
    values |= _classes("object_", rates, matrix)
    if risk := risks(study.objects, rates):
        values |= {f"object_risk{end}": value for end, value in zip(ENDS, risk, strict=True)}
    if exposed := study.objects.exposed:
        values["object_kind"] = np.array(exposed.kinds, dtype=object)
        values |= annual(((run.risk, run.yearly) for run in runs if run.risk), factor)
    return values | _by_period("object_", study, runs, [run.at_objects for run in runs])


def _lines(study: HazardInputs, runs: list[_Run]) -> dict[str, np.ndarray]:
    """Frequencies at the evaluation lines, and energies and heights by return period."""
    counts = [np.array([[at.energy.size for at in run.at_lines]]) for run in runs]
    samples = ((count, *run.sample) for count, run in zip(counts, runs, strict=True))
    rates = frequencies(samples, study.case.hazard["frequency_factor"])
    values = {f"line_frequency{end}": rate[0] for end, rate in zip(ENDS, rates, strict=True)}
    values["line_passages"] = np.concatenate(counts)
    return values | _by_period("line_", study, runs, [run.at_lines for run in runs])


def _by_period(
    prefix: str, study: HazardInputs, runs: list[_Run], places: Sequence[Sequence[Passing | None]]
) -> dict[str, np.ndarray]:
    """Energies and heights by return period at places, and counts above levels of both."""
    passed = [Passed(at, *run.sample) for at, run in zip(places, runs, strict=True)]
    numbers = exceedance_numbers(passed, study.case.hazard["frequency_factor"])
    return {f"{prefix}{name}": values for name, values in numbers.items()}


def _levels() -> dict[str, tuple]:
    """Coordinates of energies and heights by return period, and of the counts above levels."""
    periods = {"units": "year", "long_name": "return period of an event"}
    return {"event_period": ("event_period", np.array(PERIODS), periods)} | {
        f"exceeded_{name}": (
            f"exceeded_{name}",
            EXCEEDED[name],
            {"units": units, "long_name": f"{name} above which boulders are counted"},
        )
        for name, units in (("energy", "J"), ("height", "m"))
    }


def _segments(study: HazardInputs, runs: list[_Run], matrix: Matrix) -> dict[str, np.ndarray]:
    """Frequencies, classes and numbers of the segments of roads."""
    segments, factor = study.segments, study.case.hazard["frequency_factor"]
    rates = frequencies(((run.segment_counts, *run.sample) for run in runs), factor)
    values = {
        "segment_geometry": np.array([axis.wkt for axis in segments.axes], dtype=object),
        "segment_road": np.array(segments.roads, dtype=object),
        "segment_name": np.array(segments.names, dtype=object),
        "segment_start": segments.start,
        "segment_end": segments.end,
        "segment_width": segments.width,
        "segment_within": segments.within.astype("i1"),
        "segment_passages": np.stack([run.segment_counts[0] for run in runs]),
        "segment_energy_exceeded": np.stack([run.segment_counts[1:] for run in runs]),
    }
    values |= _with_ends("segment_frequency", "segment_exceedance_frequency", rates)
    weighted = [Weighted(run.segments, run.yearly / run.boulders, run.per_cluster) for run in runs]
    numbers = segment_numbers(weighted)
    values |= {f"segment_{name}": number for name, number in numbers.items()}
    at = [[Passing(hit.energy, hit.passing_height) for hit in run.segments] for run in runs]
    values |= _by_period("segment_", study, runs, at)
    return values | _classes("segment_", rates, matrix)


def _attributes(study: HazardInputs, runs: list[_Run]) -> dict[str, Any]:
    first, exposed = runs[0].attrs, study.objects.exposed
    kept = ("Conventions", "history", "version", "case_file", "seed", "impact_set")
    kept += ("impact_set_checksum", "input_checksums", "decoded_checksums", "dams", "stands")
    kept += ("threads", "date_created")
    clocks = ("wall_seconds", "cpu_seconds")
    return {
        "hazard_layout": LAYOUT,
        "title": study.case.case["title"],
        **{name: first[name] for name in kept if name in first},
        **({"risk_assumptions": "\n".join(exposed.assumptions)} if exposed else {}),
        "layers_checksum": layers_checksum(study.objects, study.segments),
        "input_warnings": stored_warnings(study.warnings),
        "case": study.case.text(),
        **{clock: sum(run.attrs[clock] for run in runs) for clock in clocks},
    }
