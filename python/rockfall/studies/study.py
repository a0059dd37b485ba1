# SPDX-License-Identifier: BSD-3-Clause
"""Engine for all studies: runs of named scenes in sequence, with common random numbers.

A study lists its scenes and the values to take from each result. A boulder has the same random
numbers in all scenes, so that results can be compared boulder by boulder (see
`rockfall.analysis.precision.paired`). This module handles progress, checkpoints and warnings. Each
result is freed before the next run, unless the study keeps it.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Self, TypeVar

from rockfall.analysis.validity.remarks import model_warnings
from rockfall.analysis.validity.warnings import joined_warnings
from rockfall.case import case_of
from rockfall.language import Text
from rockfall.result.samples import simulated
from rockfall.scene.scene import Scene
from rockfall.simulation.progress import progress_bar
from rockfall.simulation.simulate import run_scene, simulate

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.simulation.parts.checkpoint import Checkpoint

Name = TypeVar("Name", bound=Hashable)
Numbers = TypeVar("Numbers")

#: Changes of &output for scenes whose results are compared only by boulders.
ROWS_ONLY: dict[str, Any] = {"maps": None, "rebounds": False, "trajectories": 0, "kept": "all"}
#: Options of `Study.run` for many small runs, each with its own seed.
LEAN_RUNS: dict[str, bool] = {"compared": False, "as_dataset": False}
NO_CHECKPOINTS: Mapping[Any, Checkpoint] = {}
NO_LABELS: Mapping[Any, str] = {}


def run_labels(names: Sequence[Name]) -> dict[Name, str]:
    """Text on the position and name of each run, for progress."""
    return {name: f"run {k} of {len(names)} ({name!s})" for k, name in enumerate(names, start=1)}


class Study:
    """Runs of named scenes; within a `with` block they share a progress bar.

    The bar counts to `total`, in boulders or another unit; without a total, each run has a
    separate bar, with the text of its name in `labels`. A run resumes from the checkpoint of its
    name. For `how` see `rockfall.simulation.simulate.simulate`.
    """

    def __init__(
        self,
        total: int | None = None,
        unit: str = "boulders",
        *,
        progress: bool = False,
        checkpoints: Mapping[Any, Checkpoint] = NO_CHECKPOINTS,
        labels: Mapping[Any, str] = NO_LABELS,
        **how: Any,
    ) -> None:
        self.limits: dict[Any, list[Text]] = {}  # name of the scene -> model warnings
        self._bar = progress_bar(total or 0, progress and total is not None, unit)
        self._advance: Callable[..., None] = lambda *_: None
        self._counts_boulders = unit == "boulders"
        self._checkpoints, self._labels = checkpoints, labels
        self._how = how | {"progress": progress and total is None}

    def __enter__(self) -> Self:
        self._advance = self._bar.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self._bar.__exit__(*error)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Model warnings of all runs, each once."""
        return tuple(joined_warnings(self.limits))

    def run(
        self,
        scenes: Iterable[tuple[Name, Scene | xr.Dataset]],
        numbers: Callable[[Name, Any], Numbers],
        *,
        compared: bool = True,
        as_dataset: bool = True,
    ) -> Iterator[tuple[Name, Numbers]]:
        """Run the scenes and yield the name of each, with the values taken from its result.

        Scenes may be created on demand; each is freed before the next is created. `compared`
        scenes use the seed of the first scene, and their warnings are collected; otherwise, as for
        members of a sample, each scene keeps its seed. A result instead of a scene is used
        unchanged. `numbers` gets a Dataset, or the faster `Contents`. Ctrl-C raises `Interrupted`
        with the result of the stopped run.
        """
        seed: int | None = None
        for name, scene in scenes:
            if isinstance(scene, Scene):
                seed = scene.case.case["seed"] if seed is None or not compared else seed
                scene = with_numbers(scene, seed=seed)
                run = run_scene if as_dataset else simulate
                how = dict(self._how)
                if how["progress"]:
                    how["progress"] = self._labels.get(name, True)
                result = run(scene, checkpoint=self._checkpoints.get(name), **how)
            else:
                result = scene
            del scene
            self._advance(simulated(result) if self._counts_boulders else 1)
            if compared and name not in self.limits:
                self.limits[name] = model_warnings(result, case_of(result))
            taken = numbers(name, result)
            del result
            yield name, taken
            del taken


def with_numbers(scene: Scene, **numbers: Any) -> Scene:
    """Scene with `numbers` in &case, such as a seed."""
    if all(scene.case.case.get(key) == number for key, number in numbers.items()):
        return scene
    return replace(scene, case=scene.case.replace(case=numbers))
