# SPDX-License-Identifier: BSD-3-Clause
"""From a tally to the variables of a result, by the kernel's table."""

from __future__ import annotations

from datetime import datetime
from typing import Any

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case
from rockfall.io.grid import row_blocks
from rockfall.result import variables
from rockfall.result.contents import Contents
from rockfall.result.dataset import CONVENTIONS, centre_variables, feature_names, provenance
from rockfall.result.samples import sample_variables
from rockfall.result.variables import fields
from rockfall.simulation.maps import HITS, Maps, boulders_per_cluster
from rockfall.simulation.tally import Tally
from rockfall.version import __version__

#: Maps that are maxima of the kernel themselves, and of which quantity; so are counts.
MAXIMA = {
    "energy_max": "energy", "speed_max_map": "speed", "jump_height_max_map": "jump_height",
    "passing_height_max": "passing_height", "tree_impact_height_max": "tree_height",
}  # fmt: skip


def make_result(tally: Tally, maps: bool = True) -> Contents:
    """Everything that a run found, as interface names of `variables`; with or without its maps,
    whose tallies are used up (`settle` comes before)."""
    data = boulder_variables(tally)
    data["boulder"] = ("boulder", tally.numbers(), variables.KEPT["boulder"])
    data |= sample_variables(tally.samples)
    data |= _grounds_themselves(tally) | ground_variables(tally)
    if tally.scene.features is not None:
        names = np.array(tally.scene.features.names, dtype=object)
        data["feature"] = ("feature", names, {"long_name": "polygon or point of sources"})
    if tally.scene.case.lines:
        data |= _line_itself(tally) | line_variables(tally)
    if tally.scene.case.barrier:
        data |= _barrier_variables(tally)
    data["crs"] = ((), np.int32(0), tally.georeference())
    if maps and tally.scene.case.output.get("maps"):
        _add_maps(data, tally)
    if tally.scene.case.output["rebounds"]:
        data |= _bins() | histogram_variables(tally)
    data |= trajectory_variables(tally)
    bins = (name for name in data if name.endswith("_bin"))
    names = {"boulder", "line", "feature", "ground", "ground_model", "threshold", "x", "y", *bins}
    history = {"history": f"rockfall {__version__}: run of {tally.scene.case.name}"}
    return Contents(data, run_attributes(tally) | history, names)


def boulder_variables(tally: Tally) -> dict[str, Any]:
    """Of each row, and counts over all boulders done."""
    data: dict[str, tuple] = {}
    columns = tally.columns()
    for name, about in variables.BOULDER.items():
        values = columns[name].astype("i1") if name == "status" else columns[name]
        flags = _flags(variables.STATUS) if name == "status" else {}
        data[name] = ("boulder", values, about | flags)
    for name, about in variables.COUNT.items():
        before = tally.counted.get(name, np.int64(0))
        data[name] = ((), before + columns[name].sum(dtype="i8"), about)
    if tally.scene.case.output["energy_balance"]:
        for name, values in zip(fields(5), tally.energy[: tally.rows].T, strict=True):
            data[name] = ("boulder", values, variables.ENERGY[name])
    if tally.scene.features is not None:
        feature = tally.feature_of(columns["source"])
        data["source_feature"] = ("boulder", feature, variables.FEATURE["source_feature"])
    if tally.scene.case.has_forest:
        data["trees_hit"] = ("boulder", tally.trees_hit[: tally.rows], variables.TREE["trees_hit"])
    return data


def _flags(meanings: dict[str, int]) -> dict[str, Any]:
    """What numbers mean, as CF says it."""
    return {
        "flag_values": np.array(list(meanings.values()), "i1"),
        "flag_meanings": " ".join(meanings),
    }


def ground_variables(tally: Tally) -> dict[str, Any]:
    """Rebounds by what they followed, where the scene has several grounds."""
    if not tally.scene.grounds:
        return {}
    return {name: ("ground", tally.by_ground, about) for name, about in variables.GROUND.items()}


def _grounds_themselves(tally: Tally) -> dict[str, Any]:
    """Names and models of the grounds."""
    words = {"ground": "name of the ground", "ground_model": "what rebounds on the ground follow"}
    columns = zip(*((one.name, one.model) for one in tally.scene.grounds), strict=True)
    return {
        name: ("ground", np.array(column, dtype=object), {"long_name": long_name})
        for (name, long_name), column in zip(words.items(), columns, strict=False)
    }


def _line_itself(tally: Tally) -> dict[str, Any]:
    """Names and vertices of the evaluation lines."""
    lines = tally.scene.case.lines
    names = np.array([line["name"] for line in lines], dtype=object)
    data: dict[str, Any] = {"line": ("line", names, {"long_name": "name of the evaluation line"})}
    vertices = {
        "line": np.repeat(np.arange(len(lines)), [len(line["x"]) for line in lines]).astype("i4"),
        "x": np.concatenate([line["x"] for line in lines]),
        "y": np.concatenate([line["y"] for line in lines]),
    }
    for name, about in variables.LINE_VERTEX.items():
        data[f"line_vertex_{name}"] = ("line_vertex", vertices[name], about)
    return data


def line_variables(tally: Tally) -> dict[str, Any]:
    """First crossings of the evaluation lines."""
    return {
        f"line_{name}": (
            ("line", "boulder"), tally.crossing[: tally.rows, :, k].T, variables.LINE[name]
        )
        for k, name in enumerate(fields(3))
    }  # fmt: skip


def _barrier_variables(tally: Tally) -> dict[str, Any]:
    """Of the lines that are barriers, what they are, and what they did."""
    case = tally.scene.case
    height, capacity = _core.barriers(case.text().encode(), len(case.lines))
    outcome = np.zeros((len(height), tally.rows), "i1")
    outcome[height > 0] = tally.outcome[: tally.rows].T
    height[capacity == 0] = capacity[capacity == 0] = np.nan
    about = {**variables.BARRIER}
    about["outcome"] = about["outcome"] | _flags({"not_met": 0, **variables.OUTCOME})
    return {
        "barrier_height": ("line", height, about["height"]),
        "barrier_capacity": ("line", capacity, about["capacity"]),
        "barrier_outcome": (("line", "boulder"), outcome, about["outcome"]),
    }


def outcome_variable(tally: Tally) -> dict[str, Any]:
    """What barriers did, as parts have it; {} without barriers."""
    if not tally.scene.case.barrier:
        return {}
    values = tally.outcome[: tally.rows].T
    return {"barrier_outcome": (("barrier", "boulder"), values, variables.BARRIER["outcome"])}


def _add_maps(data: dict[str, Any], tally: Tally) -> None:
    grid, box = tally.scene.grid, tally.maps.box
    requested = tally.scene.case.output["maps"]
    # the same bits as of the whole grid
    data |= centre_variables(grid.x[box.columns], grid.y[box.rows])
    min_passages, columns = tally.scene.case.output["min_passages"], tally.columns()
    per_cluster = boulders_per_cluster(tally.scene.case, columns["start_x"], columns["start_y"])
    if variables.EXCEEDED in requested:
        data |= threshold_variable(tally.scene.case)
    for name in variables.MAP:
        if name in requested:
            data[name] = map_variable(name, tally.maps, tally.done, per_cluster, min_passages)


def threshold_variable(case: Case) -> dict[str, tuple]:
    """The coordinate of counts above thresholds."""
    values = 1000.0 * np.array(case.hazard["thresholds"])
    return {"threshold": ("threshold", values, {"units": "J", "long_name": "threshold of energy"})}


def map_variable(
    name: str, maps: Maps, boulders: int, per_cluster: int, min_passages: int
) -> tuple:
    """A map of the tallies of so many boulders, NaN where it has no number; the tallies themselves
    are used up. `per_cluster` is that of `boulders_per_cluster`."""
    if name == variables.EXCEEDED:
        values, fewest, thin = maps.counts[maps.plan.counts[name] - 1 :], 0, 0
    else:
        values, fewest, thin = _map(name, maps, boulders, per_cluster, min_passages)
    known = {"min_passages": fewest if fewest > 1 else 0, "thin_below": thin}
    if name.endswith(("_low", "_high")) and per_cluster > 1:
        known["boulders_per_cluster"] = per_cluster
    about = {key: np.int32(n) for key, n in known.items() if n}
    return variables.map_dims(name), values, variables.MAP[name] | about | {"grid_mapping": "crs"}


def _map(
    name: str, maps: Maps, boulders: int, per_cluster: int, min_passages: int
) -> tuple[np.ndarray, int, int]:
    """A map, the passages that a number of it needs, and those below which it is hardly known."""
    if name in maps.plan.counts:  # as it is: another copy would take memory
        return maps.counts[maps.plan.counts[name] - 1], 0, 0
    if name == HITS:
        return maps.sums[maps.plan.sums[name] - 1], 0, 0
    if name in MAXIMA:
        values = maps.maxima[maps.plan.maxima[MAXIMA[name]] - 1]
        for rows in row_blocks(values.shape):
            values[rows][values[rows] == 0] = np.nan
        return values, 0, 0
    values = np.empty(maps.box.shape, "f4")
    fewest, thin = _core.map_values(
        name, boulders, per_cluster, min_passages, maps.names, **maps.arguments(), values=values.T
    )
    return values, fewest, thin


def _bins() -> dict[str, Any]:
    """The bins of the histograms."""
    data: dict[str, Any] = {}
    bins, widths = _core.histogram_bins()
    for k, (name, quantity) in enumerate(variables.HISTOGRAM.items()):
        dim, n = f"{name}_bin", int(bins[k])
        edges = np.round(np.arange(n + 1) * widths[k], 10)
        about = {key: quantity[key] for key in ("units", "long_name")}
        data[dim] = (dim, (edges[:-1] + edges[1:]) / 2, about | {"bounds": f"{dim}_bounds"})
        pairs = np.stack([edges[:-1], edges[1:]], axis=1)  # CF: what they are, their bins say
        data[f"{dim}_bounds"] = ((dim, "bound"), pairs, {})
    return data


def histogram_variables(tally: Tally) -> dict[str, Any]:
    """Counts of rebounds, in the bins."""
    data, bins = {}, _core.histogram_bins()[0]
    for k, (name, quantity) in enumerate(variables.HISTOGRAM.items()):
        about = quantity | {"units": "1", "long_name": f"rebounds by {quantity['long_name']}"}
        data[f"{name}_histogram"] = (f"{name}_bin", tally.histogram[k, : bins[k]], about)
    return data


def trajectory_variables(tally: Tally) -> dict[str, Any]:
    """Vertices of boulders, where they were kept."""
    if not tally.trajectories:
        return {}
    vertices = np.concatenate([*tally.trajectories.values()])
    columns = dict(zip(fields(4), vertices.T, strict=True))
    lengths = [len(one) for one in tally.trajectories.values()]
    columns["boulder"] = np.repeat([*tally.trajectories], lengths)
    return {
        f"trajectory_{name}": ("trajectory_vertex", columns[name], about)
        for name, about in variables.VERTEX.items()
    }


def _ground_attributes(tally: Tally) -> dict[str, str]:
    """Names and models of the grounds, a line each."""
    if not (grounds := tally.scene.grounds):
        return {}
    names, models = zip(*((one.name, one.model) for one in grounds), strict=True)
    return {"grounds": "\n".join(names), "ground_models": "\n".join(models)}


def run_attributes(tally: Tally) -> dict[str, Any]:
    """What a result, or a part of one, says of its run."""
    scene = tally.scene
    return {
        "Conventions": CONVENTIONS,
        "title": scene.case.case["title"],
        "source": f"rockfall {__version__}, stochastic impact model of Bourrier et al. (2009)",
        "version": __version__,
        "case": scene.case.text(),
        "case_file": scene.case.name,
        "seed": scene.case.case["seed"],
        "boulder_first": tally.before + 1,
        "boulder_last": tally.before + tally.done,
        "boulders_requested": scene.boulders,
        "complete": int(tally.done == scene.boulders),
        "impact_set": scene.case.impact["sets"],
        **_ground_attributes(tally),
        **feature_names(scene),
        **provenance(scene),
        "threads": _core.team(tally.threads),
        "date_created": tally.date or datetime.now().astimezone().isoformat(timespec="seconds"),
        "wall_seconds": tally.wall,
        "cpu_seconds": tally.cpu,
    }
