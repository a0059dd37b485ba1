# SPDX-License-Identifier: BSD-3-Clause
"""How sure a result is: runs over what is uncertain in a case, and where variance comes from."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rockfall.analysis.line_statistics import Z, line_numbers, line_values
from rockfall.analysis.sobol_indices import Shares, deviations, shares
from rockfall.analysis.uncertain_inputs import Draw, Uncertain, drawn_scene
from rockfall.case import Case
from rockfall.case_files import files_behind
from rockfall.errors import RockfallError
from rockfall.io.output_files import ENSEMBLE, ENSEMBLE_TABLE, check_output
from rockfall.io.tables import write_csv
from rockfall.result.dataset import write_result
from rockfall.scene.read import read_scene
from rockfall.scene.scene import Scene
from rockfall.scene.sources import refuse_by_area
from rockfall.simulation.simulate import run_scene

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

#: At each line: name, quantity and number of `statistics.line_numbers`, units.
RESULTS = {
    "fraction": ("speed", "fraction", "1"),
    "speed.mean": ("speed", "mean", "m s-1"),
    "speed.q95": ("speed", "q95", "m s-1"),
    "passing_height.mean": ("passing_height", "mean", "m"),
    "passing_height.q95": ("passing_height", "q95", "m"),
    "energy_total.mean": ("energy_total", "mean", "J"),
    "energy_total.q95": ("energy_total", "q95", "J"),
}
REACHED = 0.01  # share of the boulders: the outline of a hazard map
KEPT = {  # of the draws: units, meaning
    "radius": ("1", "factor on the sizes of the rocks in each row of the table of zones"),
    "volume": ("1", "factor on all volumes"),
    "volume_std": ("1", "factor on the standard deviation of the volume"),
    "drop_height": ("1", "factor on the drop height"),
    "source_east": ("m", "shift of the sources eastwards"),
    "source_north": ("m", "shift of the sources northwards"),
    "source_redrawn": ("1", "shifts drawn before, which left a source off the terrain"),
    "set": ("1", "draw of the impact sets, by its place in all files of the case, from 0"),
}

NUMBERS = {  # as printed
    "the case as it is": "case_value",
    "mean of the draws": "mean",
    "5 % of them below": "q05",
    "5 % of them above": "q95",
    "chance, std": "chance",
    "ignorance, std": "ignorance",
}
KINDS = {"total": "with all that an input does", "first_order": "of an input alone"}


class _Run(NamedTuple):
    """Results of a run, and for each of them its `variance.deviations`."""

    values: np.ndarray  # (lines * RESULTS)
    deviations: list[np.ndarray]
    result: xr.Dataset


class _Maps:
    """Sums over runs of the boulders that passed each cell: integers, exact in any order."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self.runs, self.boulders = 0, 0
        self.sum, self.squares = np.zeros(shape, "i8"), np.zeros(shape, "i8")
        self.reached = np.zeros(shape, "i4")

    def add(self, result: xr.Dataset) -> None:
        passed = result["passages"].values.astype("i8")
        self.runs, self.boulders = self.runs + 1, result.sizes["boulder"]
        self.sum += passed
        self.squares += passed**2
        self.reached += passed > REACHED * self.boulders

    def variables(self) -> dict[str, Any]:
        mean = self.sum / self.runs
        variance = np.maximum(self.squares / self.runs - mean**2, 0.0)
        deviation = np.sqrt(variance * self.runs / (self.runs - 1))
        maps = {
            "reach_probability_mean": (mean / self.boulders, "mean over the runs"),
            "reach_probability_std": (
                deviation / self.boulders,
                "standard deviation over the runs, chance included",
            ),
            "reached_runs": (
                self.reached / self.runs,
                f"share of the runs in which more than {REACHED:.0%} of the boulders passed",
            ),
        }
        about = {"units": "1", "grid_mapping": "crs"}
        return {
            name: (("y", "x"), values.astype("f4"), about | {"long_name": long_name})
            for name, (values, long_name) in maps.items()
        }


def run_ensemble(case: Case, *, progress: bool = False, **arrays: Any) -> xr.Dataset:
    """Run a case over what its group &ensemble calls uncertain: an xarray.Dataset.

    For each line and result it holds the value of the case as it is, the mean over the runs, and
    two standard deviations: `chance`, of a run with so many boulders, which more of them would
    cure, and `ignorance`, which they would not; and of the variance of ignorance the shares of each
    input (`first_order`, `total`). docs/ensemble.md explains them,
    `rockfall.analysis.sobol_indices` how they are estimated. NaN where in some run too few boulders
    pass, or where ignorance cannot be told from nothing. Beside them are the draws, the results of
    every run, and, where the case asks for passages or reach_probability, maps over the runs.
    `arrays` are as in `rockfall.run`.
    """
    from rockfall.simulation.progress import progress_bar

    scene = _lean(read_scene(case, **arrays))
    inputs = Uncertain(scene)
    names, blocks = inputs.names, case.ensemble["runs"]
    maps = _Maps(scene.grid.shape) if scene.case.output.get("maps") else None
    base = _run(scene)
    size = (blocks, 2 + len(names), base.values.size)
    y, covariance = np.empty(size), np.empty((*size[:2], *size[1:]))
    draws, seeds = [], []
    with progress_bar(blocks * size[1], progress, "runs") as advance:
        for k in range(blocks):
            seeds.append(inputs.boulders_seed(k))
            a, b = ([inputs.draw(name, k, side) for name in names] for side in (0, 1))
            draws += [a, b]
            by_run = []
            for j, drawn in enumerate(_design(a, b)):
                run = _run(drawn_scene(scene, drawn, seeds[-1]))
                y[k, j] = run.values
                by_run.append(run.deviations)
                if maps is not None and j < 2:
                    maps.add(run.result)
                advance(1)
            for i, of in enumerate(map(np.array, zip(*by_run, strict=True))):
                covariance[k, :, :, i] = of @ of.T
    data = _dataset(base, names, y, shares(y, covariance)) | _drawn(draws, seeds)
    if maps is not None:
        data |= maps.variables()
    return _with_attributes(data, case, base, inputs)


def _lean(scene: Scene) -> Scene:
    """The scene without outputs that an ensemble does not look at."""
    case = scene.case
    refuse_by_area(scene, "an ensemble")
    maps = {"passages", "reach_probability"} & set(case.output.get("maps", []))
    if not case.line and not maps:
        raise RockfallError(
            f"{case.name}: an ensemble needs a &line, or &output maps = 'reach_probability'"
        )
    if case.case["sampling"] != "random":
        raise RockfallError(
            f"{case.name}: &case sampling = '{case.case['sampling']}': must be 'random' for an "
            "ensemble: the chance of other boulders is not known"
        )
    output = {"maps": ["passages"] if maps else None, "map_extent": "terrain"}
    output |= {"rebounds": False, "trajectories": 0}
    return replace(scene, case=case.replace(output=output))


def _design(a: list[Draw], b: list[Draw]) -> Iterator[list[Draw]]:
    """A, B, and A with each of its inputs in turn as in B."""
    yield a
    yield b
    for i in range(len(a)):
        yield [*a[:i], b[i], *a[i + 1 :]]


def _run(scene: Scene) -> _Run:
    result, per_source = run_scene(scene), scene.case.case["boulders"]
    values, deviates = [], []
    alone = np.zeros(scene.boulders, int)  # the intervals are not looked at
    for k in range(len(scene.case.line)):
        at_line = {q: line_values(result, q, k) for q, *_ in RESULTS.values()}
        rows = {q: line_numbers(result, k, q, alone) for q in at_line}
        for quantity, number, _ in RESULTS.values():
            row = rows[quantity]
            deviates.append(deviations(at_line[quantity], number, row, per_source))
            values.append(row[number] if np.isfinite(deviates[-1]).all() else np.nan)
    return _Run(np.array(values), deviates, result)


def _dataset(base: _Run, names: list[str], y: np.ndarray, found: Shares) -> dict[str, Any]:
    """Results of the runs and the parts of their variance; dimensions run, variant, input, line,
    result."""
    lines = base.result["line"].values if "line" in base.result else []
    shape, per_line = (len(lines), len(RESULTS)), ("line", "result")

    def table(values: np.ndarray, about: str) -> tuple:
        values = np.asarray(values)
        ahead = values.shape[:-1]
        dims = {0: (), 1: ("input",), 2: ("run", "variant")}[len(ahead)]
        return (*dims, *per_line), values.reshape(*ahead, *shape), {"long_name": about}

    texts = {
        "line": lines,
        "result": list(RESULTS),
        "input": names,
        "variant": ["A", "B", *(f"A with {name} of B" for name in names)],
    }
    data = {dim: (dim, np.array(list(text), dtype=object)) for dim, text in texts.items()}
    units = np.array([unit for *_, unit in RESULTS.values()], dtype=object)
    data["result_units"] = ("result", units, {"long_name": "units of each result"})
    two = y[:, :2].reshape(2 * len(y), -1)
    ignorance = np.sqrt(found.parts.ignorance.clip(0))
    of = "share of an input in that variance: "
    return data | {
        "value": table(y, "results of the runs"),
        "case_value": table(base.values, "result of the case as it is"),
        "mean": table(two.mean(axis=0), "mean over the runs A and B"),
        "q05": table(np.quantile(two, 0.05, axis=0), "5 % of the runs A and B lie below"),
        "q95": table(np.quantile(two, 0.95, axis=0), "5 % of the runs A and B lie above"),
        "chance": table(np.sqrt(found.parts.chance), "standard deviation by chance in a run"),
        "ignorance": table(ignorance, "standard deviation by what is uncertain"),
        "ignorance_variance": table(found.parts.ignorance, "unbiased; below zero by chance"),
        "ignorance_variance_error": table(found.ignorance_error, "its standard error"),
        "first_order": table(found.first, f"{of}alone, first-order Sobol' index"),
        "first_order_error": table(found.first_error, "its standard error"),
        "total": table(found.total, f"{of}with all it does, total Sobol' index"),
        "total_error": table(found.total_error, "its standard error"),
        "too_few": table(
            np.isnan(y).sum(axis=(0, 1)), "runs in which too few boulders pass, so no number"
        ),
    }  # fmt: skip


def _drawn(draws: list[list[Draw]], seeds: list[int]) -> dict[str, Any]:
    """The numbers drawn for A and B of each run; dimensions run, side (and zone)."""
    kept = [{key: value for one in drawn for key, value in one.kept.items()} for drawn in draws]
    data: dict[str, Any] = {
        "side": ("side", np.array(["A", "B"], dtype=object)),
        "seed": ("run", np.array(seeds), {"long_name": "of the boulders in all variants of a run"}),
    }
    for key in kept[0]:
        values = np.array([one[key] for one in kept])
        units, meaning = KEPT[key]
        dims = ("run", "side", "zone")[: values.ndim + 1]
        about = {"units": units, "long_name": meaning}
        data[f"drawn_{key}"] = (dims, values.reshape(len(seeds), 2, *values.shape[1:]), about)
    return data


def _with_attributes(data: dict[str, Any], case: Case, base: _Run, inputs: Uncertain) -> xr.Dataset:
    import xarray as xr

    run = base.result
    names = ("Conventions", "title", "source", "case_file", "seed")
    attrs = {name: run.attrs[name] for name in names}
    checksums = json.loads(run.attrs["input_checksums"])
    checksums |= {f"ensemble sets {name}": one for name, one in inputs.set_checksums.items()}
    attrs |= {
        "case": case.text(),
        "boulders": inputs.scene.boulders,
        "input_checksums": json.dumps(checksums, sort_keys=True),
    }
    if "reach_probability_mean" in data:
        data |= {name: run[name].variable for name in ("x", "y", "crs")}
    texts = {"line", "result", "input", "variant", "side", "result_units", "x", "y"}
    return xr.Dataset(data, attrs=attrs).set_coords(sorted(texts & set(data)))


def ensemble_table(found: xr.Dataset) -> pd.DataFrame:
    """One row for each line and result: its numbers, then the shares of each input."""
    import pandas as pd

    names = ("case_value", "mean", "q05", "q95", "chance", "ignorance", "too_few")
    rows = []
    for line in found["line"].values:
        for result in found["result"].values:
            at = found.sel(line=line, result=result)
            row = {"line": line, "result": result, "units": at["result_units"].item()}
            row |= {name: at[name].item() for name in names}
            for name in found["input"].values:
                for kind in ("first_order", "total"):
                    row[f"{name}_{kind}"] = at[kind].sel(input=name).item()
                    row[f"{name}_{kind}_error"] = at[f"{kind}_error"].sel(input=name).item()
            rows.append(row)
    return pd.DataFrame(rows)


def write_ensemble(found: xr.Dataset, path: Path) -> None:
    """Write all of it as netCDF, or the table as CSV, as the name ends; whole or not at all."""
    check_place(path, found.sizes["line"], files_behind(found))
    if path.suffix == ".nc":
        write_result(found, path, ENSEMBLE)
        return
    write_csv(ensemble_table(found), path)


def check_place(path: Path, lines: int, inputs: Iterable[Path] = ()) -> None:
    """Refuse a place where nothing can be written, before the runs and not after them; `lines`:
    how many there are. A file that is there is replaced if it is an ensemble of before."""
    if path.suffix not in (".nc", ".csv"):
        raise RockfallError(f"{path}: must end in .nc (everything) or .csv (the table)")
    if path.suffix == ".csv" and not lines:
        raise RockfallError(f"{path}: without a &line there is no table; maps go to a file .nc")
    check_output(path, ENSEMBLE_TABLE if path.suffix == ".csv" else ENSEMBLE, inputs)


def ensemble_summary(found: xr.Dataset) -> str:
    """The table for a reader: for each line its results side by side, inputs sorted by share."""
    blocks, variants = found.sizes["run"], found.sizes["variant"]
    text = [
        f"{found.attrs['title'] or 'rockfall'}: {blocks} draws of {variants} runs, "
        f"{found.attrs['boulders']:,} boulders each"
    ]
    for line in found["line"].values:
        text += _line_block(found.sel(line=line), str(line))
    if "drawn_source_redrawn" in found and found["drawn_source_redrawn"].any():
        redrawn = int(found["drawn_source_redrawn"].sum())
        text.append(f"  shifts drawn again, as a source left the terrain: {redrawn:,}")
    return "\n".join(text)


def _line_block(at: xr.Dataset, line: str) -> Iterator[str]:
    wide = max(23, len(line))

    def row(label: str, cells: Iterable[str]) -> str:
        return f"  {label:{wide}}" + "".join(f"{cell:>15}" for cell in cells)

    names = [str(name).partition(".") for name in at["result"].values]
    printed = [_printed(units) for units in at["result_units"].values]
    factors = np.array([factor for _, factor in printed])
    yield row(line, (quantity.replace("_", " ") for quantity, *_ in names))
    yield row("", (f"{n[2]} [{p[0]}]".strip() for n, p in zip(names, printed, strict=True)))
    for label, name in NUMBERS.items():
        yield row(label, map(_number, at[name].values * factors))
    for kind, label in KINDS.items():
        yield f"  share of the ignorance {label} [%], +- 95 %"
        for name in _sorted_inputs(at):
            one = at.sel(input=name)
            pairs = zip(one[kind].values, one[f"{kind}_error"].values, strict=True)
            yield row(f"  {name}", (_share(*pair) for pair in pairs))
    if at["too_few"].any():
        yield row("too few pass, in runs", (f"{n:,}" for n in at["too_few"].values))


def _sorted_inputs(at: xr.Dataset) -> list[str]:
    """Names of the inputs, the one with the greatest share over all results first."""
    order = np.argsort(-np.nansum(at["total"].values, axis=1), kind="stable")
    return [str(name) for name in at["input"].values[order]]


def _printed(units: str) -> tuple[str, float]:
    """The units that a result is printed in, and the factor to them."""
    return {"1": ("%", 100.0), "J": ("kJ", 1e-3), "m s-1": ("m/s", 1.0)}.get(units, (units, 1.0))


def _number(value: float) -> str:
    if np.isnan(value):
        return "-"
    return f"{value:,.0f}" if abs(value) >= 99.95 else f"{value:#.3g}"


def _share(value: float, error: float) -> str:
    return "-" if np.isnan(value) else f"{100 * value:.0f} +- {100 * Z * error:.0f}"
