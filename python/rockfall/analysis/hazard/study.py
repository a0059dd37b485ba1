# SPDX-License-Identifier: BSD-3-Clause
"""A hazard: each scenario of a case run once, and put together by how often it comes."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.analysis.hazard.classes import (
    CLASSES,
    Frequencies,
    Matrix,
    classify,
    frequencies,
    intensities,
    intensity_words,
)
from rockfall.analysis.hazard.objects import (
    Objects,
    check_room,
    object_counts,
    read_objects,
    risks,
)
from rockfall.analysis.hazard.scenarios import Scenario, base_case, scenarios_of
from rockfall.case import Case
from rockfall.result.dataset import as_dataset
from rockfall.scene.plausible import implausible
from rockfall.scene.read import read_scene
from rockfall.scene.scene import Scene
from rockfall.simulation.memory import machine_memory
from rockfall.simulation.simulate import run_scene

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.simulation.checkpoint import Checkpoint

    _Variables = dict[str, tuple]

LAYOUT = 1  # of the file
EXTREMES = {  # maps of which the extreme over the scenarios is kept
    "energy_line_angle_max": np.fmax,
    "energy_line_angle_min": np.fmin,
    "travel_time_min": np.fmin,
}
YEARLY = {"units": "year-1"}
PART = {"units": "1"}
ENDS = (
    ("", ""),
    ("_low", "lower limit of the 95 % interval of "),
    ("_high", "upper limit of the 95 % interval of "),
)


@dataclass
class Study:
    """What a hazard runs: read and checked."""

    case: Case
    scene: Scene
    scenarios: list[Scenario]
    objects: Objects
    remarks: list[str] = field(default_factory=list)  # what is likely a mistake, a line each


def hazard(
    case: Case,
    *,
    objects: str | Path | None = None,
    progress: bool = False,
    threads: int | None = None,
    memory: float | None = None,
    **arrays: Any,
) -> xr.Dataset:
    """Run each &scenario of a case and put them together: an xarray.Dataset of annual frequencies
    and classes of hazard, with 95 % intervals, for each cell and each of the `objects` (a layer of
    points, lines and polygons). docs/hazard.md explains it; the other arguments are as in
    `rockfall.run`."""
    study = read_study(case, objects, memory, **arrays)
    for line in study.remarks:
        warnings.warn(line, stacklevel=2)
    return run_study(study, progress=progress, threads=threads)


def read_study(
    case: Case, objects: str | Path | None = None, memory: float | None = None, **arrays: Any
) -> Study:
    """Read and check everything that a hazard needs, before anything is run."""
    scene = read_scene(base_case(case), memory=memory or machine_memory(), **arrays)
    remarks: list[str] = []
    found = Objects()
    if objects is not None:
        found = read_objects(objects, scene.grid, 1 + len(case.hazard["thresholds"]), remarks)
    study = Study(case, scene, scenarios_of(scene, found.lines), found)
    for scenario in study.scenarios:
        remarks += implausible(replace(scene, case=scenario.case))
    check_room(found, scene.boulders)
    study.remarks = list(dict.fromkeys(remarks))
    return study


def run_study(
    study: Study,
    *,
    progress: bool = False,
    threads: int | None = None,
    checkpoints: Sequence[Checkpoint] = (),
) -> xr.Dataset:
    """Run the scenarios, one after the other; each goes on from its checkpoint."""
    runs = []
    for k, scenario in enumerate(study.scenarios):
        scene = replace(study.scene, case=scenario.case)
        checkpoint = checkpoints[k] if checkpoints else None
        result = run_scene(scene, progress=progress, threads=threads, checkpoint=checkpoint)
        runs.append(_Run(study, scenario, result))
    return _dataset(study, runs)


class _Run:
    """What is kept of the run of a scenario."""

    def __init__(self, study: Study, scenario: Scenario, result: xr.Dataset) -> None:
        self.boulders, self.yearly = result.sizes["boulder"], scenario.frequency
        passages, exceeded = result["passages"].values, result["energy_exceeded"].values
        self.counts = np.concatenate([passages[None], exceeded])  # (intensities, y, x)
        self.extremes = {name: result[name].values for name in EXTREMES}
        self.objects = object_counts(study.objects, result, self.counts)
        maps = ("x", "y", "threshold", "crs", "passages", "energy_exceeded", *EXTREMES)
        self.about = {name: (result[name].dims, result[name].attrs) for name in maps}
        self.places = {axis: result[axis].values for axis in ("x", "y", "threshold")}
        self.attrs = result.attrs


def _dataset(study: Study, runs: list[_Run]) -> xr.Dataset:
    matrix, yearly = Matrix.of(study.case), sum(run.yearly for run in runs)
    found = frequencies((run.counts, run.boulders, run.yearly) for run in runs)
    data = _scenarios(study, runs) | _places(runs[0], matrix)
    data |= _frequencies(found, yearly)
    data |= _classes(found, matrix, study.case, ("y", "x"))
    data |= _extremes(runs)
    if len(study.objects):
        data |= _objects(study, runs, matrix)
    for dims, _, about in data.values():
        if dims[-2:] == ("y", "x"):
            about["grid_mapping"] = "crs"
    coordinates = {"x", "y", "threshold", "return_period", "scenario", "object"}
    return as_dataset(data, _attributes(study, runs)).set_coords(sorted(coordinates & set(data)))


def _scenarios(study: Study, runs: list[_Run]) -> _Variables:
    names = np.array([one.name for one in study.scenarios], dtype=object)
    passages, exceeded = (runs[0].about[name][1] for name in ("passages", "energy_exceeded"))
    return {
        "scenario": ("scenario", names, {"long_name": "class of boulders"}),
        "frequency": (
            "scenario", np.array([run.yearly for run in runs]),
            YEARLY | {"long_name": "boulders that come loose, of all sources together"},
        ),
        "boulders": (
            "scenario", np.array([run.boulders for run in runs]),
            PART | {"long_name": "boulders that were simulated"},
        ),
        "passages": (
            ("scenario", "y", "x"), np.stack([run.counts[0] for run in runs]), {**passages}
        ),
        "energy_exceeded": (
            ("scenario", "threshold", "y", "x"), np.stack([run.counts[1:] for run in runs]),
            {**exceeded},
        ),
    }  # fmt: skip


def _places(run: _Run, matrix: Matrix) -> _Variables:
    about = {"units": "year", "long_name": "longest return period of a class of frequency"}
    return {
        **{axis: (axis, values, run.about[axis][1]) for axis, values in run.places.items()},
        "crs": ((), np.int32(0), run.about["crs"][1]),
        "return_period": ("return_period", matrix.periods, about),
    }


def _frequencies(found: Frequencies, yearly: float) -> _Variables:
    """Frequencies of cells with their limits, and what follows from them."""
    data: _Variables = {}
    cells, levels = ("y", "x"), ("threshold", "y", "x")
    for (end, of), values in zip(ENDS, found, strict=True):
        about = YEARLY | {"long_name": f"{of}annual frequency of boulders that pass the cell"}
        data[f"passage_frequency{end}"] = (cells, values[0].astype("f4"), about)
    for (end, of), values in zip(ENDS, found, strict=True):
        what = "annual frequency of boulders whose energy in the cell exceeds a threshold"
        about = YEARLY | {"long_name": of + what}
        data[f"exceedance_frequency{end}"] = (levels, values[1:].astype("f4"), about)
    with np.errstate(divide="ignore"):
        periods = np.where(found.value > 0, 1 / found.value, np.nan).astype("f4")
    share = (found.value / yearly).astype("f4")
    years = {"units": "year"}
    return data | {
        "passage_return_period": (
            cells, periods[0], years | {"long_name": "return period of a boulder that passes"}
        ),
        "exceedance_return_period": (
            levels, periods[1:],
            years | {"long_name": "return period of a boulder whose energy exceeds a threshold"},
        ),
        "reach_probability": (
            cells, share[0], PART | {"long_name": "fraction of all boulders that pass the cell"}
        ),
        "exceedance_probability": (
            levels, share[1:],
            PART | {"long_name": "fraction of all boulders whose energy exceeds a threshold"},
        ),
    }  # fmt: skip


def _classes(found: Frequencies, matrix: Matrix, case: Case, dims: tuple[str, ...]) -> _Variables:
    """Intensities and classes of hazard."""
    prefix = "object_" if dims == ("object",) else ""
    classes = classify(found, matrix)
    data: _Variables = {
        f"{prefix}intensity": (
            ("return_period", *dims), intensities(found.value, matrix.periods).astype("i1"),
            _flags(intensity_words(case))
            | {"long_name": "intensity met at least once in a return period"},
        )
    }  # fmt: skip
    what = "class of hazard"
    for end, values, of in zip(
        ("", "_lower", "_upper"), classes, ("", "lowest ", "highest "), strict=True
    ):
        within = f"{of}{what} within the 95 % interval" if of else what
        about = _flags(CLASSES) | {"long_name": within}
        data[f"{prefix}hazard_class{end}"] = (dims, values, about)
    about = _flags(["no", "yes"]) | {"long_name": "whether the interval leaves no other class"}
    data[f"{prefix}hazard_class_certain"] = (dims, classes.certain.astype("i1"), about)
    return data


def _flags(words: Sequence[str]) -> dict[str, Any]:
    """What numbers from 0 mean, as CF says it."""
    numbers = np.arange(len(words), dtype="i1")
    return PART | {"flag_values": numbers, "flag_meanings": " ".join(words)}


def _extremes(runs: list[_Run]) -> _Variables:
    """Energy lines and travel times: the extreme of all scenarios."""
    data: _Variables = {}
    for name, extreme in EXTREMES.items():
        dims, about = runs[0].about[name]
        data[name] = (dims, extreme.reduce([run.extremes[name] for run in runs]), {**about})
    return data


def _objects(study: Study, runs: list[_Run], matrix: Matrix) -> _Variables:
    objects = study.objects
    found = frequencies((run.objects, run.boulders, run.yearly) for run in runs)
    texts = {
        "object": (objects.names, "name of the object"),
        "object_geometry": ([shape.wkt for shape in objects.shapes], "well-known text"),
    }
    data: _Variables = {
        name: ("object", np.array(values, dtype=object), {"long_name": what})
        for name, (values, what) in texts.items()
    }
    data["object_passages"] = (
        ("scenario", "object"), np.stack([run.objects[0] for run in runs]),
        PART | {"long_name": "boulders that met the object, each counted once"},
    )  # fmt: skip
    data["object_energy_exceeded"] = (
        ("scenario", "threshold", "object"), np.stack([run.objects[1:] for run in runs]),
        PART | {"long_name": "of these, boulders whose energy exceeds a threshold"},
    )  # fmt: skip
    for (end, of), values in zip(ENDS, found, strict=True):
        about = YEARLY | {"long_name": f"{of}annual frequency of boulders that meet the object"}
        data[f"object_frequency{end}"] = ("object", values[0], about)
    for (end, of), values in zip(ENDS, found, strict=True):
        what = "annual frequency of boulders that meet it with more energy than a threshold"
        data[f"object_exceedance_frequency{end}"] = (
            ("threshold", "object"), values[1:], YEARLY | {"long_name": of + what}
        )  # fmt: skip
    data |= _classes(found, matrix, study.case, ("object",))
    return data | _risks(objects, found)


def _risks(objects: Objects, found: Frequencies) -> _Variables:
    data: _Variables = {}
    risk = risks(objects, found)
    if risk is None or objects.vulnerability is None:
        return data
    for (end, of), values in zip(ENDS, risk, strict=True):
        about = {"units": "year-1", "long_name": f"{of}annual risk, in the unit of the value"}
        data[f"object_risk{end}"] = ("object", values, about)
    return data


def _attributes(study: Study, runs: list[_Run]) -> dict[str, Any]:
    first = runs[0].attrs
    kept = ("Conventions", "source", "version", "case_file", "seed", "impact_set")
    kept += ("impact_set_checksum", "input_checksums", "decoded_checksums", "threads")
    return {
        "hazard_layout": LAYOUT,
        "title": study.case.case["title"],
        **{name: first[name] for name in kept},
        "case": study.case.text(),
        **{
            clock: sum(run.attrs[clock] for run in runs)
            for clock in ("wall_seconds", "cpu_seconds")
        },
    }
