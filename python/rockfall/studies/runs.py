# SPDX-License-Identifier: BSD-3-Clause
"""Runs of a case, and merging of the parts of a run, with model warnings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import xarray as xr

from rockfall.analysis.validity.warnings import warned_of_model
from rockfall.case import Case
from rockfall.scene.read import read_scene
from rockfall.scene.rules.plausible import warn_of
from rockfall.simulation.memory import machine_memory
from rockfall.simulation.parts.merge import join
from rockfall.simulation.simulate import run_scene


def run(
    case: Case,
    *,
    progress: bool = False,
    threads: int | None = None,
    chunk: int | None = None,
    shard: tuple[int, int] = (1, 1),
    memory: float | None = None,
    **arrays: Any,
) -> xr.Dataset:
    """Run a case: an xarray.Dataset of boulders, lines, maps and histograms.

    `arrays` (dem, zones, ...) are as in `rockfall.scene.read.read_scene`. The result does not
    depend on `threads` (default: as in the case) or `chunk`, the number of boulders per kernel call
    (default: about a quarter of a second). `shard` (I, N) runs the I-th of N ranges of boulders: a
    part for `rockfall.merge`, without maps. Ctrl-C raises `Interrupted` with the completed
    boulders. Rasters that need more than half of `memory` [bytes] (default: the machine's memory)
    are read in windows. Invalid cases raise a RockfallError; likely mistakes, and relevant model
    limits, give UserWarnings; the attribute `model_warnings` lists the limits, one per line (not
    for parts).

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> slower = rockfall.run(case.replace(boulder={"density": 2600.0}))
    >>> slower.sizes["boulder"]
    20
    """
    scene = read_scene(case, memory=memory or machine_memory(), **arrays)
    warn_of(scene)
    how: dict[str, Any] = {"progress": progress, "threads": threads, "chunk": chunk, "shard": shard}
    result = run_scene(scene, keep=False, **how)
    return result if shard != (1, 1) else warned_of_model(result)


def merge(parts: Sequence[xr.Dataset | str | Path]) -> xr.Dataset:
    """Merge the parts of a run (results, or their files) into a result, bit-identical to the
    undivided run except for times and threads.

    Raises a RockfallError for parts of another run, and for missing or duplicate boulders. Model
    warnings are as in `run`.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> parts = [rockfall.run(case, shard=(k, 2)) for k in (1, 2)]
    >>> rockfall.merge(parts).sizes["boulder"]
    20
    """
    return warned_of_model(join(parts).dataset())
