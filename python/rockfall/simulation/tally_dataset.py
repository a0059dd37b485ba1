# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of a tally to result variables, using the kernel's table."""

from collections.abc import Iterable, Sequence
from datetime import datetime
from typing import Any

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case, in_kernel
from rockfall.errors import check_kernel
from rockfall.io.rasters.grid import row_blocks
from rockfall.kernel_rules import kernel_numbers
from rockfall.result import variables
from rockfall.result.contents import Contents
from rockfall.result.dataset import CONVENTIONS, centre_variables, feature_names, provenance
from rockfall.result.grounds import source_text
from rockfall.result.maps.clusters import boulders_per_cluster
from rockfall.result.names import distinct_words
from rockfall.result.run_arrays import Array
from rockfall.result.variables import fields
from rockfall.simulation.map_plan import HITS, plan_of
from rockfall.simulation.tally import Tally
from rockfall.version import __version__

#: Maps that equal a maximum stack of the kernel, with their quantities; maps of counts equal their
#: stacks directly.
MAXIMA = {
    "energy_max": "energy", "speed_max_map": "speed", "jump_height_max_map": "jump_height",
    "passing_height_max": "passing_height", "tree_impact_height_max": "tree_height",
}  # fmt: skip


def make_result(tally: Tally, maps: bool = True) -> Contents:
    """Create the results of a run, named as in `variables`, with or without maps (call `settle`
    first). Unless the run continues, the map tallies are consumed."""
    groups = "boulder", "count", "energy", "feature", "shape", "mass", "shadow", "tree", "breakage"
    data = table_variables(tally, *groups)
    data["boulder"] = ("boulder", tally.numbers(), variables.KEPT["boulder"])
    data |= sample_variables(tally)
    data |= _grounds_themselves(tally) | table_variables(tally, "ground")
    if tally.scene.features is not None:
        data |= numbered("feature", tally.scene.features.names, "polygon or point of sources")
    if tally.scene.case.lines:
        data |= line_variables(tally)
    data["crs"] = ((), np.int32(0), tally.georeference())
    if maps:
        if requested := tally.scene.case.output.get("maps", []):
            _add_maps(data, tally)
        stacks = plan_of(tally.scene.case).counts, [HITS], MAXIMA  # stacks that maps view
        held = (any(name in stack for name in requested) for stack in stacks)
        if not tally.goes_on:
            tally.run.forget_tallies(*held)
    if tally.scene.case.output["rebounds"]:
        data |= _bins() | table_variables(tally, "histogram")
    data |= trajectory_variables(tally.trajectories)
    bins = (name for name in data if name.endswith("_bin"))
    names = {"boulder", "line", "feature", "ground", "ground_model", "threshold", "x", "y", *bins}
    own = {
        "source": source_text({name: values for name, (_, values, _) in data.items()}),
        "history": f"rockfall {__version__}: run of {tally.scene.case.name}",
    }
    return Contents(data, run_attributes(tally) | own, names)


def table_variables(tally: Tally, *groups: str) -> dict[str, Any]:
    """Variables from the kernel arrays of some groups, for rows of completed boulders."""
    return described(sorted(tally.arrays(*groups), key=lambda array: groups.index(array.group)))


def described(arrays: Iterable[Array]) -> dict[str, Any]:
    """Convert arrays to variables with the attributes of the variable table."""
    data: dict[str, tuple] = {}
    for array in arrays:
        attrs: dict[str, Any] = {**variables.about(array.group, array.name)}
        if flags := variables.FLAGS.get(array.file_name):
            attrs |= {
                "flag_values": np.array(list(flags.values()), array.values.dtype),
                "flag_meanings": " ".join(flags),
            }
        if array.group == "histogram":
            attrs |= {"units": "1", "long_name": f"rebounds by {attrs['long_name']}"}
        data[array.file_name] = (array.dims, array.values, attrs)
    return data


def sample_variables(tally: Tally) -> dict[str, Any]:
    """Sample variables, with non-empty bins only; empty if all rows are kept."""
    if tally.number is None:
        return {}
    tally.run.pack_part(only_samples=True)
    order = [*variables.SAMPLE]
    samples = (array for array in tally.part_arrays() if array.group == "sample")
    data = described(sorted(samples, key=lambda array: order.index(array.name)))
    numbers = tally.array("known")  # number of tail values at each line
    for tails, n in zip(data["sample_largest"][1], numbers, strict=True):
        tails[:, :n].sort()  # sorted in place: tails stay heaps
    return data


def _grounds_themselves(tally: Tally) -> dict[str, Any]:
    """Names, models and block radii of the grounds; empty if the scene has only impact sets."""
    if not (grounds := tally.scene.grounds):
        return {}
    names, models, radii = (
        np.array([getattr(ground, name) for ground in grounds], dtype=kind)
        for name, kind in (("name", object), ("model", object), ("block_radius", "f8"))
    )
    words = {"units": "m", "long_name": "R_b of the largest blocks behind its impact table"}
    return {
        "ground": ("ground", names, {"long_name": "name of the ground"}),
        "ground_model": ("ground", models, {"long_name": "rebound model of the ground"}),
        "ground_block_radius": ("ground", radii, words),
    }


def line_variables(tally: Tally) -> dict[str, Any]:
    """Lines, barrier flags, and first crossings by line and boulder."""
    case, lines = tally.scene.case, tally.scene.case.lines
    names = [str(line["name"]) for line in lines]
    data = numbered("line", names, "name of the evaluation line")
    vertices = {
        "line": np.repeat(np.arange(len(lines)), [len(line["x"]) for line in lines]).astype("i4"),
        "x": np.concatenate([line["x"] for line in lines]),
        "y": np.concatenate([line["y"] for line in lines]),
    }
    for name, attrs in variables.LINE_VERTEX.items():
        data[f"line_vertex_{name}"] = ("line_vertex", vertices[name], attrs)
    if case.barrier:
        height, capacity = _core.barriers(in_kernel(case), len(lines))
        height[capacity == 0] = capacity[capacity == 0] = np.nan
        data["barrier_height"] = ("line", height, variables.BARRIER["height"])
        data["barrier_capacity"] = ("line", capacity, variables.BARRIER["capacity"])
    crossings = described(tally.crossings())
    if tally.spilled is None:
        sizes = np.bincount(crossings["crossing_line"][1], minlength=len(lines))
    else:
        sizes = np.diff(tally.spilled.ends)
    words = {"units": "1", "long_name": "crossings of the line", "sample_dimension": "crossing"}
    return data | {"row_size": ("line", sizes.astype("i4"), words)} | crossings


def numbered(dim: str, names: Sequence[str], long_name: str) -> dict[str, Any]:
    """Coordinate of a named dimension, and a variable with its names. The coordinate has numbers
    from 0 with the names as flag words, because programs refuse or lose variables with a text
    coordinate."""
    numbers = np.arange(len(names), dtype="i4")
    flags = {
        "flag_values": numbers if numbers.size > 1 else np.int32(0),  # a scalar in netCDF
        "flag_meanings": " ".join(distinct_words(names, only_ascii=True)),
    }
    return {
        dim: (dim, numbers, {"long_name": f"index, {long_name}"} | flags),
        f"{dim}_name": (dim, np.array(names, dtype=object), {"long_name": long_name}),
    }


def _add_maps(data: dict[str, Any], tally: Tally) -> None:
    grid, box = tally.scene.grid, tally.box
    requested = tally.scene.case.output["maps"]
    # Bit-identical to the values of the whole grid.
    data |= centre_variables(grid.x[box.columns], grid.y[box.rows])
    columns = tally.columns()
    per_cluster = boulders_per_cluster(tally.scene.case, columns["start_x"], columns["start_y"])
    if {*variables.EXCEEDED} & {*requested}:
        data |= threshold_variable(tally.scene.case)
    for name in variables.MAP:
        if name in requested:
            data[name] = map_variable(name, tally, per_cluster)


def threshold_variable(case: Case) -> dict[str, tuple]:
    """Coordinate `threshold` [J] of the maps of counts above energy thresholds."""
    values = 1000.0 * np.array(case.hazard["thresholds"])
    return {"threshold": ("threshold", values, {"units": "J", "long_name": "threshold of energy"})}


def map_variable(name: str, tally: Tally, per_cluster: int) -> tuple:
    """Create a map from its tallies, which are consumed unless the run continues; NaN where
    undefined."""
    values, fewest, thin = _map(name, tally, per_cluster)
    counts = {"min_passages": fewest if fewest > 1 else 0, "thin_below": thin}
    if name.endswith(("_low", "_high")) and per_cluster > 1:
        counts["boulders_per_cluster"] = per_cluster
    attrs = {key: np.int32(n) for key, n in counts.items() if n}
    return variables.map_dims(name), values, variables.MAP[name] | attrs | {"grid_mapping": "crs"}


def _map(name: str, tally: Tally, per_cluster: int) -> tuple[np.ndarray, int, int]:
    """Values (y, x) of a map, or by threshold, and the minimum numbers of passages for a value, and
    for a reliable value."""
    if (layers := _layers(name, tally)) is not None:  # not copied, to save memory
        values = layers.copy() if tally.goes_on else layers
        if name in MAXIMA:
            for rows in row_blocks(values.shape):
                values[rows][values[rows] == 0] = np.nan
        return values, 0, 0
    values, run = np.empty(tally.box.shape, "f4"), tally.run.handle
    check_kernel(*_core.map(run, name, (tally.done, per_cluster), values.ctypes.data))
    fewest, thin = map(int, _core.map_passages(run, name, per_cluster))
    return values, fewest, thin


def _layers(name: str, tally: Tally) -> np.ndarray | None:
    """Kernel layer of a map, or layers by threshold; None if the map is not a stored layer."""
    plan = plan_of(tally.scene.case)
    if name in variables.EXCEEDED:
        first = plan.counts[name] - 1
        thresholds = len(tally.scene.case.hazard["thresholds"])
        return tally.array("tally_counts")[first : first + thresholds]
    if name in plan.counts:
        return tally.array("tally_counts")[plan.counts[name] - 1]
    if name == HITS:
        return tally.array("tally_sums")[plan.sums[name] - 1]
    if name in MAXIMA:
        return tally.array("tally_maxima")[plan.maxima[MAXIMA[name]] - 1]
    return None


def _bins() -> dict[str, Any]:
    """Variables with the centres and bounds of the histogram bins."""
    data: dict[str, Any] = {}
    bins, widths = map(kernel_numbers, ("histogram_bins", "histogram_widths"))
    for k, (name, quantity) in enumerate(variables.HISTOGRAM.items()):
        dim, n = f"{name}_bin", int(bins[k])
        edges = np.round(np.arange(n + 1) * widths[k], 10)
        attrs = {key: quantity[key] for key in ("units", "long_name")}
        data[dim] = (dim, (edges[:-1] + edges[1:]) / 2, attrs | {"bounds": f"{dim}_bounds"})
        pairs = np.stack([edges[:-1], edges[1:]], axis=1)  # CF: bounds inherit attributes
        data[f"{dim}_bounds"] = ((dim, "bound"), pairs, {})
    return data


def trajectory_variables(recorded: dict[int, np.ndarray]) -> dict[str, Any]:
    """Variables of the recorded vertices, given by boulder number."""
    if not recorded:
        return {}
    vertices = np.concatenate([*recorded.values()])
    columns = dict(zip(fields("vertex"), vertices.T, strict=True))
    numbers = np.array([*recorded], "i8")
    columns["boulder"] = np.repeat(numbers, [len(rows) for rows in recorded.values()])
    return {
        f"trajectory_{name}": ("trajectory_vertex", columns[name], attrs)
        for name, attrs in variables.VERTEX.items()
    }


def _ground_attributes(tally: Tally) -> dict[str, str]:
    """Names and models of the grounds, one per line."""
    if not (grounds := tally.scene.grounds):
        return {}
    names, models = zip(*((ground.name, ground.model) for ground in grounds), strict=True)
    return {"grounds": "\n".join(names), "ground_models": "\n".join(models)}


def run_attributes(tally: Tally) -> dict[str, Any]:
    """Attributes of a result or part that describe its run. A result overwrites `source` with a
    text that includes the rebound models."""
    scene = tally.scene
    return {
        "Conventions": CONVENTIONS,
        "title": scene.case.case["title"],
        "source": f"rockfall {__version__}",
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
        **({"block_shapes": " ".join(variables.BLOCK_SHAPE)} if scene.shapes else {}),
        **provenance(scene),
        "threads": _core.team(tally.threads),
        "date_created": tally.date or datetime.now().astimezone().isoformat(timespec="seconds"),
        "wall_seconds": tally.wall,
        "cpu_seconds": tally.cpu,
    }
