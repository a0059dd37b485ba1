# SPDX-License-Identifier: BSD-3-Clause
"""Uncertainty of a result: runs with uncertain inputs, and the influence of each input."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.line_statistics import numbers
from rockfall.analysis.lines.samples import LineSamples
from rockfall.analysis.precision.intervals import Sources, sources
from rockfall.analysis.validity.warnings import warned_of_model
from rockfall.case import Case
from rockfall.case.files import files_behind
from rockfall.errors import RockfallError
from rockfall.interrupts import interrupts
from rockfall.io.output_files import check_output
from rockfall.io.tables import write_csv
from rockfall.quantities import AT_LINES, QUANTITIES
from rockfall.result.contents import Held
from rockfall.result.crossings import AtLine, line_names
from rockfall.result.dataset import write_result
from rockfall.result.variables import ENDS
from rockfall.scene.lines import with_lines_of
from rockfall.scene.read import read_scene
from rockfall.scene.releases.sources import refuse_by_area
from rockfall.scene.rules.plausible import warn_of
from rockfall.scene.scene import Scene
from rockfall.simulation.simulate import Interrupted, StudyInterrupted, run_scene
from rockfall.studies.ensemble.maps import RANGED, MemberMaps
from rockfall.studies.ensemble.sobol_indices import Indices, deviations, indices, limits
from rockfall.studies.ensemble.uncertain_inputs import Draw, Uncertain, drawn_scene
from rockfall.studies.study import LEAN_RUNS, ROWS_ONLY, Study

#: Results at each line: name, then quantity and statistic of `line_statistics`.
RESULTS = {
    "fraction": ("speed", "fraction"),
    **{
        f"{quantity}.{number}": (quantity, number)
        for quantity in AT_LINES
        for number in ("mean", "q95")
    },
}
KINDS = ("first_order", "total")  # Sobol' indices
KEPT = {  # values stored for each draw: units, meaning
    "radius": ("1", "factor on the sizes of the rocks in each row of the table of zones"),
    "volume": ("1", "factor on all volumes"),
    "volume_std": ("1", "factor on the standard deviation of the volume"),
    "drop_height": ("1", "factor on the drop height"),
    "source_east": ("m", "shift of the sources eastwards"),
    "source_north": ("m", "shift of the sources northwards"),
    "strength": ("1", "factor on the strength of each ground"),
    "relief": ("1", "factor on the relief of each ground"),
    "source_redrawn": ("1", "shifts rejected because a source left the terrain"),
    "draw": ("1", "row of the file of draws, from 0"),
    "set": ("1", "draw of the impact sets, by its place in all files of the case, from 0"),
}


def run_ensemble(case: Case, *, progress: bool = False, **arrays: Any) -> xr.Dataset:
    """Run a case over the uncertain inputs in its group &ensemble. The returned xarray.Dataset
    extends the result of the unchanged case.

    For each line and result it has the value for the unchanged case, the mean over the runs, and
    two standard deviations: `monte_carlo_std`, due to the finite number of boulders in a run, and
    `epistemic_std`, due to the uncertain inputs; more boulders reduce only the first. `first_order`
    and `total` are the fractions of the epistemic variance that each input explains (see
    docs/ensemble.md; their estimation is described in `rockfall.studies.ensemble.sobol_indices`).
    Values are NaN if too few boulders pass in some run, or if the epistemic variance is not
    significant. The Dataset also has the draws, the results of all runs and, if the case requests
    passages or reach_probability, maps over the runs. `arrays` are as in `rockfall.run`. An invalid
    group &ensemble, or a case with neither lines nor such maps, raises a RockfallError. Ctrl-C
    raises `Interrupted`; its `result` is the ensemble of the completed draws, if there are enough.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> case = case.replace(ensemble={"runs": 8, "radius_factor": 1.2})
    >>> found = rockfall.ensemble(case)
    >>> rockfall.ensemble_table(found)["line"].iloc[0]
    'L'
    """
    asked = {*case.output.get("maps", [])}
    needs_maps = bool({"passages", "reach_probability"} & asked)
    if not case.lines and not needs_maps:
        raise RockfallError(
            f"{case.name}: an ensemble requires a &line, or &output maps = 'reach_probability'"
        )
    read = read_scene(case, **arrays)
    warn_of(read)
    kept = ["passages", *(name for name in RANGED if name in asked)]
    scene = lean(read, "an ensemble", kept if needs_maps else None)
    inputs = Uncertain(scene)
    names, blocks = inputs.names, case.ensemble["runs"]
    maps = MemberMaps(scene) if scene.case.output.get("maps") else None
    output = {"kept": "all"} | ({"map_extent": "terrain"} if "maps" in case.output else {})
    base = run_scene(replace(read, case=read.case.replace(output=output)))
    own, _ = _numbers(base)
    size = (blocks, 2 + len(names), own.size)
    y, covariance = np.empty(size), np.empty((*size[:2], *size[1:]))
    draws: list[list[Draw]] = []
    seeds: list[int] = []

    def taken(j: int, result: Held) -> tuple[np.ndarray, list[np.ndarray], list[Held]]:
        return *_numbers(result), [result] if maps is not None and j < 2 else []

    with interrupts(), Study(blocks * size[1], "runs", progress=progress) as study:
        for k in range(blocks):
            seed = inputs.boulders_seed(k)
            a, b = ([inputs.draw(name, k, side) for name in names] for side in (0, 1))
            scenes = ((j, drawn_scene(scene, drawn, seed)) for j, drawn in enumerate(_design(a, b)))
            by_run, shown = [], []
            try:
                for j, (values, deviates, with_maps) in study.run(scenes, taken, **LEAN_RUNS):
                    y[k, j] = values
                    by_run.append(deviates)
                    shown += with_maps
            except Interrupted:
                break
            for i, of_runs in enumerate(map(np.array, zip(*by_run, strict=True))):
                covariance[k, :, :, i] = of_runs @ of_runs.T
            for result in shown:
                assert maps is not None
                maps.add(result)
            draws += [a, b]
            seeds.append(seed)
    done = len(seeds)
    try:
        case = case.replace(ensemble={"runs": done})
    except RockfallError:  # too few draws for an ensemble
        raise KeyboardInterrupt from None
    of_inputs = indices(y[:done], covariance[:done])
    data = _dataset(line_names(base), own, names, y[:done], of_inputs)
    data |= _drawn(draws, seeds)
    if maps is not None:
        data |= maps.variables()
    ensemble = _with_attributes(data, with_lines_of(case, scene.case), base, inputs)
    ensemble = warned_of_model(ensemble)
    if done < blocks:
        raise StudyInterrupted(ensemble, done)
    return ensemble


def lean(scene: Scene, what: str, maps: list[str] | None) -> Scene:
    """Scene without outputs that studies do not use, except `maps`. Raises a RockfallError if
    sources release different numbers of boulders."""
    case = scene.case
    refuse_by_area(scene.case, scene, what)
    output = ROWS_ONLY | {"maps": maps, "energy_balance": False}
    output |= {"map_extent": "terrain"} if maps else {}
    return replace(scene, case=case.replace(output=output))


def _design(a: list[Draw], b: list[Draw]) -> Iterator[list[Draw]]:
    """Draws A and B, and for each input a copy of A that has this input from B."""
    yield a
    yield b
    for i in range(len(a)):
        yield [*a[:i], b[i], *a[i + 1 :]]


def _numbers(result: Held) -> tuple[np.ndarray, list[np.ndarray]]:
    """Results of a run (lines * RESULTS), NaN from too few boulders, and the
    `sobol_indices.deviations` of each."""
    source, values, deviates = sources(result), [], []
    # a single source, because the intervals are unused
    alone = Sources.alone(result.sizes["boulder"])
    samples = LineSamples(result, alone)
    for k in range(len(line_names(result))):
        at, at_line, rows = AtLine(result, k), {}, {}
        for quantity in dict.fromkeys(quantity for quantity, _ in RESULTS.values()):
            at_line[quantity] = np.full(result.sizes["boulder"], np.nan)
            at_line[quantity][at.boulders] = at.values(quantity)
            rows[quantity] = numbers(samples.sample(k, quantity), quantity)
        for quantity, number in RESULTS.values():
            row = rows[quantity]
            deviates.append(deviations(at_line[quantity], number, row, source))
            values.append(row[number] if np.isfinite(deviates[-1]).all() else np.nan)
    return np.array(values), deviates


def _dataset(
    lines: list[str], own: np.ndarray, names: list[str], y: np.ndarray, indices: Indices
) -> dict[str, Any]:
    """Variables: results and parts of their variance, by run, variant, input, line and result."""
    shape, per_line = (len(lines), len(RESULTS)), ("line", "result")

    def table(values: np.ndarray, long_name: str) -> tuple:
        values = np.asarray(values)
        ahead = values.shape[:-1]
        dims = {0: (), 1: ("input",), 2: ("run", "variant")}[len(ahead)]
        return (*dims, *per_line), values.reshape(*ahead, *shape), {"long_name": long_name}

    texts = {
        "result": list(RESULTS),
        "input": names,
        "variant": ["A", "B", *(f"A with {name} of B" for name in names)],
    }
    data: dict[str, tuple] = {
        dim: (dim, np.array(list(text), dtype=object)) for dim, text in texts.items()
    }
    units = np.array([_units(*quantity) for quantity in RESULTS.values()], dtype=object)
    data["result_units"] = ("result", units, {"long_name": "units of each result"})
    two = y[:, :2].reshape(2 * len(y), -1)
    fraction_of = "fraction of the epistemic variance: an input "
    error = "standard error of this estimate"
    return data | {
        "value": table(y, "results of the runs"),
        "case_value": table(own, "result of the unchanged case"),
        "mean": table(two.mean(axis=0), "mean over the runs A and B"),
        "q05": table(np.quantile(two, 0.05, axis=0), "5 % of the runs A and B are below it"),
        "q95": table(np.quantile(two, 0.95, axis=0), "5 % of the runs A and B are above it"),
        "monte_carlo_std": table(
            np.sqrt(indices.parts.monte_carlo), "standard deviation of a run of this size"
        ),
        "epistemic_std": table(
            np.sqrt(indices.parts.epistemic.clip(0)), "standard deviation due to uncertain inputs"
        ),
        "epistemic_variance": table(
            indices.parts.epistemic, "unbiased estimate; may be below zero"
        ),
        "epistemic_variance_error": table(indices.epistemic_error, error),
        "first_order": table(indices.first, f"{fraction_of}alone, first-order Sobol' index"),
        "first_order_error": table(indices.first_error, error),
        "total": table(indices.total, f"{fraction_of}with its interactions, total Sobol' index"),
        "total_error": table(indices.total_error, error),
        "too_few": table(
            np.isnan(y).sum(axis=(0, 1)), "runs with too few passing boulders for a value"
        ),
    }  # fmt: skip


def _units(quantity: str, number: str) -> str:
    return QUANTITIES["fraction" if number == "fraction" else quantity].units


def _drawn(draws: list[list[Draw]], seeds: list[int]) -> dict[str, Any]:
    """Drawn values for A and B in each run; dimensions run, side (and zone or ground)."""
    kept = [{key: value for draw in drawn for key, value in draw.kept.items()} for drawn in draws]
    data: dict[str, Any] = {
        "side": ("side", np.array(["A", "B"], dtype=object)),
        "seed": ("run", np.array(seeds), {"long_name": "of the boulders in all variants of a run"}),
    }
    for key in kept[0]:
        values = np.array([draw[key] for draw in kept])
        units, meaning = KEPT[key]
        each = "zone" if key == "radius" else "ground_with_relief"
        dims = ("run", "side", each)[: values.ndim + 1]
        attrs = {"units": units, "long_name": meaning}
        data[f"drawn_{key}"] = (dims, values.reshape(len(seeds), 2, *values.shape[1:]), attrs)
    return data


def _with_attributes(
    data: dict[str, Any], case: Case, run: xr.Dataset, inputs: Uncertain
) -> xr.Dataset:
    attrs = dict(run.attrs)
    checksums = json.loads(run.attrs["input_checksums"])
    checksums |= {f"ensemble sets {name}": sha256 for name, sha256 in inputs.set_checksums.items()}
    attrs |= {
        "case": case.text(),
        "ensemble_runs": case.ensemble["runs"],
        "input_checksums": json.dumps(checksums, sort_keys=True),
    }
    texts = {"result", "input", "variant", "side", "result_units"}
    data = {name: variable for name, variable in data.items() if name not in run.variables}
    own = xr.Dataset(data).set_coords(sorted(texts & set(data)))
    own = own if case.lines else own.drop_dims("line")
    return run.assign_coords(own.coords).assign(own.data_vars).assign_attrs(attrs)


def ensemble_table(found: xr.Dataset) -> pd.DataFrame:
    """Table with a row for each line and result: its statistics, then the variance fraction of
    each input with its 95 % interval, NaN if undecided.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> case = case.replace(ensemble={"runs": 8, "radius_factor": 1.2})
    >>> table = rockfall.ensemble_table(rockfall.ensemble(case))
    >>> table[["line", "units"]].iloc[0].tolist()
    ['L', '1']
    """
    names = ("case_value", "mean", "q05", "q95", "monte_carlo_std", "epistemic_std")
    names += ("too_few",)
    rows = []
    for k, line in enumerate(line_names(found)):
        for result in found["result"].values:
            at = found.isel(line=k).sel(result=result)
            row = {"line": line, "result": result, "units": at["result_units"].item()}
            row |= {name: at[name].item() for name in names}
            for name in found["input"].values:
                for kind in KINDS:
                    at_input = at.sel(input=name)
                    bounds = limits(at_input[kind].item(), at_input[f"{kind}_error"].item())
                    ends = (f"{name}_{kind}{end}" for end in ENDS)
                    row |= dict(zip(ends, bounds, strict=True))
            rows.append(row)
    return pd.DataFrame(rows)


def write_ensemble(data: xr.Dataset, path: Path) -> None:
    """Write the ensemble as netCDF, or its table as CSV, by file extension; atomically."""
    check_place(path, data.sizes["line"], files_behind(data))
    if path.suffix == ".nc":
        write_result(data, path)
        return
    write_csv(ensemble_table(data), path)


def check_place(path: Path, lines: int, inputs: Iterable[Path] = ()) -> None:
    """Raise a RockfallError for an output that cannot be written, before the runs; `lines` is the
    number of lines."""
    if path.suffix not in (".nc", ".csv"):
        raise RockfallError(f"{path}: must end in .nc (everything) or .csv (the table)")
    if path.suffix == ".csv" and not lines:
        raise RockfallError(f"{path}: without a &line there is no table: write maps to a file .nc")
    check_output(path, inputs)
