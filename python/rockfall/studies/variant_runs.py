# SPDX-License-Identifier: BSD-3-Clause
"""Runs of the variants of a case, whose results can be compared boulder by boulder."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.analysis.validity.warnings import joint_warnings, warn_each, with_model_warnings
from rockfall.case import Case
from rockfall.case.variants import naming_variant, variants
from rockfall.errors import RockfallError
from rockfall.language import say
from rockfall.scene.read import read_scene
from rockfall.scene.rules.plausible import implausible
from rockfall.scene.scene import Scene
from rockfall.simulation.memory import machine_memory
from rockfall.simulation.simulate import run_scene

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.simulation.parts.checkpoint import Checkpoint

NO_CHECKPOINTS: Mapping[str, Checkpoint] = {}


def run_variants(
    case: Case,
    *,
    progress: bool = False,
    threads: int | None = None,
    memory: float | None = None,
    **arrays: Any,
) -> dict[str, xr.Dataset]:
    """Run each &variant of a case: results by name, for `compare_variants` and `report_variants`.

    All variants have the seed of the case, and so common random numbers. All are read and checked
    before the first is run; one whose boulders would start elsewhere, or have other volumes, is
    refused. `arrays` are the same for all; arguments are as in `rockfall.run`.

    >>> import rockfall
    >>> net = {"name": "net", "x": [600000.0, 600120.0], "y": [4999950.0, 4999950.0]}
    >>> case = rockfall.read_case("case.nml").replace(
    ...     barrier=[net | {"height": 3.0, "class": 4}],
    ...     variant=[{"name": "bare", "without": ["barrier"]}, {"name": "with net"}],
    ... )
    >>> results = rockfall.run_variants(case)
    >>> sorted(set(rockfall.compare_variants(results)["variant"]))
    ['bare', 'with net']
    """
    memory = memory or machine_memory()
    for remark in check_variant_scenes(case, memory=memory, **arrays):
        warnings.warn(remark, stacklevel=2)
    results = run_each(case, progress=progress, threads=threads, memory=memory, **arrays)
    warn_each(joint_warnings(results))
    return {name: with_model_warnings(result) for name, result in results.items()}


def run_each(
    case: Case,
    *,
    progress: bool = False,
    threads: int | None = None,
    memory: float | None = None,
    checkpoints: Mapping[str, Checkpoint] = NO_CHECKPOINTS,
    **arrays: Any,
) -> dict[str, xr.Dataset]:
    """Run variants that `check_variant_scenes` has passed; each resumes from its checkpoint."""
    results = {}
    for name, variant in variants(case).items():
        scene = read_scene(variant, memory=memory, **arrays)
        results[name] = run_scene(
            scene, progress=progress, threads=threads, checkpoint=checkpoints.get(name), keep=False
        )
    return results


def check_variant_scenes(case: Case, **how: Any) -> list[str]:
    """Read every variant, one at a time, and return remarks on likely mistakes. Variants whose
    results could not be compared raise a RockfallError. `how`: see `read_scene`."""
    cases = variants(case)
    if len(cases) < 2:
        raise RockfallError(
            f"{case.name}: &variant: {len(cases)} of them; a comparison needs two or more"
        )
    if case.output["kept"] != "all":
        raise RockfallError(
            f"{case.name}: &output kept = '{case.output['kept']}': variants are compared boulder "
            "by boulder; must be 'all'"
        )
    remarks: list[str] = []
    first: tuple[str, dict[str, Any]] | None = None
    ours: tuple[float, ...] = ()
    for name, variant in cases.items():
        with naming_variant(case, name):
            scene = read_scene(variant, **how)
        starts = _starts(scene)
        first = first or (name, starts)
        if differing := [key for key, value in starts.items() if not _same(value, first[1][key])]:
            raise RockfallError(
                f"{case.name}: &variant name = '{name}': its {differing[0]} are not those of "
                f"'{first[0]}', with which it is compared boulder by boulder"
            )
        for line in implausible(scene):
            remarks.append(f"variant {name}: {line.removeprefix(f'{case.name}: ')}")
        extent = scene.grid.west, scene.grid.south, scene.grid.east, scene.grid.north
        ours = ours or extent
        apart = max(abs(a - b) for a, b in zip(extent, ours, strict=True))
        if apart > scene.grid.cell:
            remarks.append(say("input.other_extent", name=name, apart=apart, first=first[0]))
    return remarks


def _starts(scene: Scene) -> dict[str, Any]:
    """Inputs that decide on the starts and volumes of boulders, by their names in messages."""
    own = None if scene.source_boulders is None else scene.source_boulders.volume
    features = scene.features
    of_case = {key: value for key, value in scene.case.boulder.items() if "volume" in key}
    of_layer = () if features is None else (features.number, features.law, features.value)
    return {
        "sources": (scene.x, scene.y),
        "boulders of each source": (scene.boulders, scene.weight),
        "volumes": (of_case, own, *of_layer[:2], _volumes(of_layer)),
    }


def _volumes(of_layer: tuple[Any, ...]) -> np.ndarray | None:
    """Mean, deviation and limits of the volumes that a layer gives."""
    return of_layer[2][:, :4] if of_layer and of_layer[2] is not None else None


def _same(first: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    """Return True if all values of two tuples, numbers or arrays, are equal."""
    if len(first) != len(other):
        return False
    return all(_equal(a, b) for a, b in zip(first, other, strict=True))


def _equal(first: Any, other: Any) -> bool:
    if isinstance(first, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(first, other, equal_nan=first.dtype.kind == "f")
    return type(first) is type(other) and bool(first == other)
