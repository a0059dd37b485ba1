# SPDX-License-Identifier: BSD-3-Clause
"""Hazard from the results of scenarios, combined by frequency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any

import numpy as np
import xarray as xr

from rockfall.analysis.hazard.classes import Frequencies, Matrix, classify, frequencies, intensities
from rockfall.analysis.hazard.exceedance import (
    Passing,
    Sample,
    behind,
    class_behind,
    exceedance_numbers,
    passing_of,
)
from rockfall.analysis.hazard.finished import layers_checksum
from rockfall.analysis.hazard.origins import Arrivals, Origins, origin_numbers
from rockfall.analysis.hazard.released import released_numbers
from rockfall.analysis.hazard.scenarios import Scenario
from rockfall.analysis.hazard.variables import (
    CLASS_ENDS,
    CLASS_ENERGY,
    COORDINATES,
    EXCEEDED,
    EXTREMES,
    LEVELS,
    PERIODS,
    TABLE,
)
from rockfall.analysis.lines.around import barriers_above, goes_around
from rockfall.analysis.objects.objects import Objects, object_counts, object_hits, risks
from rockfall.analysis.objects.risk import Points, RunRisk, annual, diameters
from rockfall.analysis.objects.segment_hits import (
    Weighted,
    hit_counts,
    segment_hits,
    segment_numbers,
)
from rockfall.analysis.objects.segments import Segments
from rockfall.analysis.precision.clusters import Clusters
from rockfall.analysis.validity.ends import end_remarks, roll_remarks
from rockfall.analysis.validity.extrapolation import fractions_outside
from rockfall.analysis.validity.remarks import model_warnings
from rockfall.case import Case, case_of
from rockfall.io.input_warnings import InputWarning, stored_warnings
from rockfall.language import packed_texts
from rockfall.result.contents import Contents
from rockfall.result.crossings import boulders_at, line_names
from rockfall.result.grounds import rebounds_by_ground, source_text
from rockfall.result.samples import simulated
from rockfall.result.variables import ENDS
from rockfall.scene.scene import Scene

LAYOUT = 4  # version of the file layout
RISK_TEXTS = "risk_assumptions", "risk_messages"  # attributes with the assumptions of the risk


@dataclass
class HazardInputs:
    """Checked inputs of a hazard."""

    case: Case
    scene: Scene
    scenarios: list[Scenario]
    #: Evaluation lines of the case; in the scene they follow the lines of objects and segments.
    lines: list[dict[str, Any]]
    objects: Objects
    segments: Segments
    remarks: list[str] = field(default_factory=list)  # likely mistakes, as text lines
    warnings: list[InputWarning] = field(default_factory=list)  # warnings of all scenes


class ScenarioRun:
    """Counts and samples of a scenario's result, from which the hazard is computed."""

    def __init__(self, inputs: HazardInputs, scenario: Scenario, result: xr.Dataset) -> None:
        self.boulders, self.yearly = simulated(result), scenario.frequency
        clusters = Clusters.of(result)
        self.per_cluster = clusters.most  # boulders that count as one observation, for cells
        self.sample = self.boulders, self.per_cluster, self.yearly
        # Cell counts (intensities, y, x).
        self.passages = _counts(result, "passages", "energy_exceeded")
        self.hits = _counts(result, "hits", "hits_energy_exceeded")
        self.extremes = {name: result[name].values for name in EXTREMES}
        first = len(inputs.objects.lines)
        self.segments = [*segment_hits(inputs.segments, result, first, clusters)]
        self.segment_counts = hit_counts(self.segments, result["threshold"].values)
        self.at_objects: list[Passing | None] = [None] * len(inputs.objects)
        came_to_objects: list[Arrivals | None] = [None] * len(inputs.objects)
        at_objects = np.full(len(inputs.objects), float(clusters.most))
        for number, hits in object_hits(inputs.objects, result):
            boulders = np.flatnonzero(np.isfinite(hits[0]))
            self.at_objects[number] = at = Passing(*hits[:, boulders])
            came_to_objects[number] = Arrivals(boulders, at.energy)
            at_objects[number] = clusters.at(boulders, at.energy, at.height)
        energies = {k: at.energy for k, at in enumerate(self.at_objects) if at}
        thresholds = result["threshold"].values
        self.objects = object_counts(
            inputs.objects, energies, thresholds, inputs.scene.grid, self.hits
        )
        self.risk = self._risk(inputs.objects, result, clusters) if inputs.objects.exposed else None
        lines = self._read_lines(inputs, result)
        at_lines = [
            (boulders_at(result, k), at) for k, at in zip(lines, self.at_lines, strict=True)
        ]
        #: Boulders that count as one observation, at each place.
        self.per_place = {
            "line": np.array(
                [clusters.at(boulders, at.energy, at.height) for boulders, at in at_lines]
            ),
            "object": at_objects,
            "segment": np.array([segment.per_cluster for segment in self.segments]),
        }
        came = [Arrivals(boulders, at.energy) for boulders, at in at_lines]
        self.origins = Origins.of(
            result, inputs.scene.grid, {"line": came, "object": came_to_objects}
        )
        self.variable_attrs = {name: result[name].attrs for name in ("x", "y", "threshold", "crs")}
        self.places = {axis: result[axis].values for axis in ("x", "y", "threshold")}
        self.attrs = result.attrs
        self.grounds = rebounds_by_ground(result)
        self.released = released_numbers(result, replace(inputs.scene, case=scenario.case))
        self.out_of_range = fractions_outside(result)["range"]
        # without crossings, warnings cover exits from the terrain anywhere, as needed for zones
        without_objects = result.drop_vars("row_size", errors="ignore")
        case = case_of(result)
        self.warnings = model_warnings(without_objects, case)
        for text, *_ in (*end_remarks(result, case), *roll_remarks(result, case)):
            if text.key == "model.lost" or text.values.get("line") in self.lines:
                self.warnings.append(text)

    def _read_lines(self, inputs: HazardInputs, result: xr.Dataset) -> list[int]:
        """Read the boulders at lines and barriers; return the indices of these lines: none if only
        part of the boulders is kept. Lying logs are skipped."""
        names, first = line_names(result), len(inputs.objects.lines) + len(inputs.segments.lines)
        logs = {barrier["name"] for barrier in inputs.case.barrier if "diameter" in barrier}
        has_rows = inputs.case.output["kept"] == "all"
        lines = [k for k in range(first, len(names)) if has_rows and names[k] not in logs]
        self.lines = [names[k] for k in lines]
        self.at_lines = [passing_of(result, k) for k in lines]
        self.behind = [behind(result, k) for k in lines]
        above = [barriers_above(result, k) for k in lines]
        self.nets = [[names[net] for net in nets] for nets in above]
        self.around = [
            int(goes_around(result, k, nets).sum()) for k, nets in zip(lines, above, strict=True)
        ]
        unknown = np.full(len(names), np.nan)
        self.barriers = {
            name: np.asarray(result.get(f"barrier_{name}", unknown))[lines]
            for name in ("height", "capacity")
        }
        return lines

    def samples(self, kind: str) -> list[Sample]:
        """Samples (boulders, boulders that count as one, boulders per year) at each line, object or
        segment (`kind`)."""
        return [(self.boulders, each, self.yearly) for each in self.per_place[kind].tolist()]

    def _risk(self, objects: Objects, result: xr.Dataset, clusters: Clusters) -> RunRisk:
        points = Points(objects.point, self.objects, result["threshold"].values)
        energies = ((number, energy) for number, (energy, _) in object_hits(objects, result))
        return RunRisk(objects.exposed, energies, diameters(result), points, clusters)


Runs = list[ScenarioRun]


def _counts(result: xr.Dataset, name: str, exceeded: str) -> np.ndarray:
    return np.concatenate([result[name].values[None], result[exceeded].values])


def combined(inputs: HazardInputs, runs: Runs) -> xr.Dataset:
    """Hazard dataset from the runs of all scenarios."""
    matrix, case = Matrix.of(inputs.case), inputs.case
    values = _scenarios(inputs, runs)
    factor = case.hazard["frequency_factor"]
    passages = frequencies(((run.passages, *run.sample) for run in runs), factor)
    hits = frequencies(((run.hits, *run.sample) for run in runs), factor)
    values |= _frequencies(passages, sum(run.yearly for run in runs))
    values |= _with_ends("hit_frequency", "hit_exceedance_frequency", hits, "f4")
    values |= _classes("", hits, matrix)
    for name, extreme in EXTREMES.items():
        values[name] = extreme.reduce([run.extremes[name] for run in runs])
    data = _places(inputs, runs[0], matrix)
    if len(inputs.objects):
        values |= _objects(inputs, runs, matrix)
        names = np.array(inputs.objects.names, dtype=object)
        data["object"] = ("object", names, {"long_name": "name of the object"})
    if len(inputs.segments):
        values |= _segments(inputs, runs, matrix)
        labels = np.array(inputs.segments.labels, dtype=object)
        data["segment"] = ("segment", labels, {"long_name": "road, and chainage of the segment"})
    if runs[0].lines:
        values |= _lines(inputs, runs)
        names = np.array(runs[0].lines, dtype=object)
        data["line"] = ("line", names, {"long_name": "name of the evaluation line or barrier"})
        attrs = {"long_name": "barrier class of EAD 340059"}
        data["ead_class"] = ("ead_class", np.arange(CLASS_ENERGY.size), attrs)
    if runs[0].lines or len(inputs.objects) or len(inputs.segments):
        data |= _levels()
    weights = [run.yearly / run.boulders for run in runs]
    # Boulders with the same number may behave alike in all runs, which share random numbers.
    unit = sum(run.per_cluster * weight for run, weight in zip(runs, weights, strict=True))
    values |= origin_numbers([run.origins for run in runs], weights, unit, inputs.scene.grid)
    values |= _grounds(runs)
    if "ground" in values:
        data["ground"] = ("ground", values["ground"], {"long_name": "name of the ground"})
    for name, variable in TABLE.items():
        if name in values:
            data[name] = (variable.dims, values[name], variable.about(case))
    attrs = _attributes(inputs, runs) | {"source": source_text(values)}
    return Contents(data, attrs, COORDINATES).dataset()


def _grounds(runs: Runs) -> dict[str, np.ndarray]:
    """Names and models of the grounds, and their rebounds over all scenarios; empty if all rebounds
    use impact sets."""
    counts: dict[tuple[str, str], int] = {}
    for ground in (ground for run in runs for ground in run.grounds):
        key = ground.name, ground.model
        counts[key] = counts.get(key, 0) + ground.rebounds
    if not counts:
        return {}
    names, models = (np.array(column, dtype=object) for column in zip(*counts, strict=True))
    rebounds = np.array([*counts.values()], "i8")
    return {"ground": names, "ground_model": models, "rebounds_by_ground": rebounds}


def _places(inputs: HazardInputs, run: ScenarioRun, matrix: Matrix) -> dict[str, tuple]:
    """Coordinates of cells, thresholds, return periods and scenarios, and the grid mapping."""
    names = np.array([scenario.name for scenario in inputs.scenarios], dtype=object)
    attrs = {"units": "year", "long_name": "longest return period of a frequency class"}
    return {
        **{axis: (axis, values, run.variable_attrs[axis]) for axis, values in run.places.items()},
        "crs": ((), np.int32(0), run.variable_attrs["crs"]),
        "return_period": ("return_period", matrix.periods, attrs),
        "scenario": ("scenario", names, {"long_name": "boulder class"}),
    }


def _scenarios(inputs: HazardInputs, runs: Runs) -> dict[str, np.ndarray]:
    """Frequency, boulders, counts and warnings of each scenario, so that other frequencies can be
    applied later."""
    warnings = [packed_texts(run.warnings) for run in runs]
    return {
        "frequency": np.array([run.yearly for run in runs]),
        "boulders": np.array([run.boulders for run in runs]),
        "boulders_per_cluster": np.array([run.per_cluster for run in runs]),
        **{name: np.array([run.released[name] for run in runs]) for name in runs[0].released},
        "fraction_out_of_range": np.array([run.out_of_range for run in runs]),
        "scenario_warnings": np.array([lines for lines, _ in warnings], dtype=object),
        "scenario_messages": np.array([data for _, data in warnings], dtype=object),
        "scenario_passages": np.stack([run.passages[0] for run in runs]),
        "scenario_energy_exceeded": np.stack([run.passages[1:] for run in runs]),
        "scenario_hits": np.stack([run.hits[0] for run in runs]),
        "scenario_hits_energy_exceeded": np.stack([run.hits[1:] for run in runs]),
    }


def _frequencies(rates: Frequencies, yearly: float) -> dict[str, np.ndarray]:
    """Passage and exceedance frequencies [1/year] of cells with their limits; return periods
    [year]; reach and exceedance probabilities: frequencies divided by `yearly` boulders
    [1/year]."""
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
    """Frequencies of all boulders and of boulders above each threshold, with limits."""
    values = {}
    for end, rate in zip(ENDS, rates, strict=True):
        values[f"{name}{end}"] = rate[0].astype(kind)
        values[f"{exceeded}{end}"] = rate[1:].astype(kind)
    return values


def _classes(prefix: str, rates: Frequencies, matrix: Matrix) -> dict[str, np.ndarray]:
    classes = classify(rates, matrix)
    values = {f"{prefix}intensity": intensities(rates.value, matrix.periods).astype("i1")}
    for end, numbers in zip(CLASS_ENDS, classes, strict=True):
        values[f"{prefix}hazard_class{end}"] = numbers
    values[f"{prefix}hazard_class_certain"] = classes.certain.astype("i1")
    return values


def _objects(inputs: HazardInputs, runs: Runs, matrix: Matrix) -> dict[str, np.ndarray]:
    factor = inputs.case.hazard["frequency_factor"]
    rates = _rates("object", runs, [run.objects for run in runs], factor)
    values = {
        "object_layer": np.array(inputs.objects.layers, dtype=object),
        "object_geometry": np.array([shape.wkt for shape in inputs.objects.shapes], dtype=object),
        "object_passages": np.stack([run.objects[0] for run in runs]),
        "object_energy_exceeded": np.stack([run.objects[1:] for run in runs]),
    }
    values |= _with_ends("object_frequency", "object_exceedance_frequency", rates)
    values |= _classes("object_", rates, matrix)
    if risk := risks(inputs.objects, rates):
        values |= {f"object_risk{end}": value for end, value in zip(ENDS, risk, strict=True)}
    if exposed := inputs.objects.exposed:
        values["object_kind"] = np.array(exposed.kinds, dtype=object)
        values |= annual(((run.risk, run.yearly) for run in runs if run.risk), factor)
    return values | _by_period("object", inputs, runs, [run.at_objects for run in runs])


def _lines(inputs: HazardInputs, runs: Runs) -> dict[str, np.ndarray]:
    """Frequencies, energies and heights at lines, and boulders that pass or go around barriers."""
    counts = [np.array([[at.energy.size for at in run.at_lines]]) for run in runs]
    rates = _rates("line", runs, counts, inputs.case.hazard["frequency_factor"])
    values = {f"line_frequency{end}": rate[0] for end, rate in zip(ENDS, rates, strict=True)}
    values["line_passages"] = np.concatenate(counts)
    values["line_behind"] = np.array([run.behind for run in runs], "i4")
    values["line_around"] = np.array([run.around for run in runs], "i4")
    nets = [dict.fromkeys(chain(*each)) for each in zip(*(run.nets for run in runs), strict=True)]
    values["line_barriers"] = np.array(["\n".join(each) for each in nets], dtype=object)
    values["line_class_behind"] = np.stack(
        [np.stack([class_behind(at) for at in run.at_lines]) for run in runs]
    )
    values |= {f"line_barrier_{name}": each for name, each in runs[0].barriers.items()}
    return values | _by_period("line", inputs, runs, [run.at_lines for run in runs])


def _rates(
    kind: str, runs: Runs, counts: Sequence[np.ndarray], factor: Sequence[float]
) -> Frequencies:
    """Frequencies from counts (..., places) of each run, at lines, objects or segments (`kind`)."""
    parts = (
        (count, run.boulders, run.per_place[kind], run.yearly)
        for count, run in zip(counts, runs, strict=True)
    )
    return frequencies(parts, factor)


def _by_period(
    kind: str,
    inputs: HazardInputs,
    runs: Runs,
    places: Sequence[Sequence[Passing | None]],
) -> dict[str, np.ndarray]:
    """Energies and heights by return period at places, and counts above each energy and height."""
    samples = [run.samples(kind) for run in runs]
    numbers = exceedance_numbers(places, samples, inputs.case.hazard["frequency_factor"])
    numbers["boulders_per_cluster"] = np.stack([run.per_place[kind] for run in runs])
    return {f"{kind}_{name}": values for name, values in numbers.items()}


def _levels() -> dict[str, tuple]:
    """Coordinates: return periods of energies and heights, and levels of the exceedance counts."""
    periods = {"units": "year", "long_name": "return period of an event"}
    return {"event_period": ("event_period", np.array(PERIODS), periods)} | {
        f"exceeded_{name}": (
            f"exceeded_{name}",
            EXCEEDED[name],
            {"units": units, "long_name": f"{name} above which boulders are counted"},
        )
        for name, (units, _) in LEVELS.items()
    }


def _segments(inputs: HazardInputs, runs: Runs, matrix: Matrix) -> dict[str, np.ndarray]:
    """Frequencies, classes and statistics of road segments."""
    segments, factor = inputs.segments, inputs.case.hazard["frequency_factor"]
    rates = _rates("segment", runs, [run.segment_counts for run in runs], factor)
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
    weighted = [Weighted(run.segments, run.yearly / run.boulders) for run in runs]
    numbers = segment_numbers(weighted)
    values |= {f"segment_{name}": number for name, number in numbers.items()}
    at = [[Passing(hit.energy, hit.passing_height) for hit in run.segments] for run in runs]
    values |= _by_period("segment", inputs, runs, at)
    return values | _classes("segment_", rates, matrix)


def _attributes(inputs: HazardInputs, runs: Runs) -> dict[str, Any]:
    first, exposed = runs[0].attrs, inputs.objects.exposed
    kept = ("Conventions", "history", "version", "case_file", "seed", "impact_set")
    kept += ("impact_set_checksum", "input_checksums", "decoded_checksums", "dams", "stands")
    kept += ("threads", "date_created")
    clocks = ("wall_seconds", "cpu_seconds")
    return {
        "hazard_layout": LAYOUT,
        "title": inputs.case.case["title"],
        **{name: first[name] for name in kept if name in first},
        **(
            dict(zip(RISK_TEXTS, packed_texts(exposed.assumptions), strict=True)) if exposed else {}
        ),
        "layers_checksum": layers_checksum(inputs.objects, inputs.segments),
        "input_warnings": stored_warnings(inputs.warnings),
        "case": inputs.case.text(),
        **{clock: sum(run.attrs[clock] for run in runs) for clock in clocks},
    }
