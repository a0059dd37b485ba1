# SPDX-License-Identifier: BSD-3-Clause
"""Partial results of a run in progress."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.line_statistics import line_statistics
from rockfall.analysis.validity.remarks import model_warnings
from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.result.contents import Contents
from rockfall.result.motion import motion_of
from rockfall.result.trajectories import Trajectory, curves
from rockfall.scene.scene import Scene
from rockfall.simulation.batches import Batches
from rockfall.simulation.simulate import recorded_numbers, trajectory
from rockfall.simulation.tally_dataset import make_result, trajectory_variables
from rockfall.studies.run_until import Rule, evaluate

RECORDED = 100  # default number of trajectories


class Batch:
    """Results of the boulders that a session's run has completed so far, spread evenly over all
    sources (with maps by source: from the first sources). A complete batch equals
    `rockfall.run` bit for bit.

    Statistics and trajectories are available at any time; a Dataset, which includes the maps, only
    until the run continues.

    >>> import rockfall
    >>> session = rockfall.open(rockfall.read_case("case.nml"))
    >>> *_, batch = session.run(30)
    >>> batch
    <rockfall batch: 30 of 30 boulders>
    >>> batch.line_statistics(quantities=["speed"]).line[0]
    'L'
    >>> len(batch.trajectories(5))
    5
    """

    def __init__(self, run: Batches, until: str, criteria: Sequence[Rule] = ()) -> None:
        tally = run.tally
        goes_on = tally.done < tally.boulders
        marks = tally.marks.copy() if goes_on and tally.marks is not None else None
        self._run, self._lock, self._begun = run, run.lock, run.begun
        self._tally = replace(tally, marks=marks, goes_on=goes_on)
        self._until, self._criteria = until, criteria
        self._result: Contents | None = None

    def __repr__(self) -> str:
        return f"<rockfall batch: {self.boulders:,} of {self.total:,} boulders>"

    @property
    def case(self) -> Case:
        """Case of the run; `rockfall.run` gives the same result for it.

        >>> import rockfall
        >>> with rockfall.open(rockfall.read_case("case.nml")) as session:
        ...     *_, batch = session.run(40)
        >>> batch.case.case["boulders_total"]
        40
        """
        return self._tally.scene.case

    @property
    def boulders(self) -> int:
        """Number of completed boulders.

        >>> import rockfall
        >>> with rockfall.open(rockfall.read_case("case.nml")) as session:
        ...     *_, batch = session.run(40)
        >>> batch.boulders
        40
        """
        return self._tally.done

    @property
    def total(self) -> int:
        """Number of boulders of the complete run.

        >>> import rockfall
        >>> with rockfall.open(rockfall.read_case("case.nml")) as session:
        ...     *_, batch = session.run(40)
        >>> batch.total
        40
        """
        return self._tally.boulders

    @property
    def complete(self) -> bool:
        """True if all boulders are completed.

        >>> import rockfall
        >>> with rockfall.open(rockfall.read_case("case.nml")) as session:
        ...     *_, batch = session.run(40)
        >>> batch.complete
        True
        """
        return self.boulders == self.total

    @property
    def seconds(self) -> float:
        """Elapsed time in the kernel so far [s].

        >>> import rockfall
        >>> with rockfall.open(rockfall.read_case("case.nml")) as session:
        ...     *_, batch = session.run(40)
        >>> batch.seconds > 0
        True
        """
        return self._tally.wall

    @property
    def cpu_seconds(self) -> float:
        """CPU time of the kernel so far, summed over threads [s].

        >>> import rockfall
        >>> with rockfall.open(rockfall.read_case("case.nml")) as session:
        ...     *_, batch = session.run(40)
        >>> 0 <= batch.cpu_seconds < 60
        True
        """
        return self._tally.cpu

    @cached_property
    def until_met(self) -> bool:
        """True if all rules of `until` are met; False if there are none.

        >>> import rockfall
        >>> with rockfall.open(rockfall.read_case("case.nml")) as session:
        ...     *_, batch = session.run(40)
        >>> batch.until_met  # no rules were given
        False
        """
        return bool(self._criteria) and all(
            status.met for status in evaluate([*self._criteria], self._rows)
        )

    @cached_property
    def warnings(self) -> list[str]:
        """Model warnings for the completed boulders, as in the report.

        >>> import rockfall
        >>> with rockfall.open(rockfall.read_case("case.nml")) as session:
        ...     *_, batch = session.run(40)
        >>> isinstance(batch.warnings, list)
        True
        """
        return [*model_warnings(self._rows, self.case)]

    def line_statistics(
        self,
        by: str | None = None,
        classes: Sequence[float] | None = None,
        quantities: Sequence[str] | None = None,
    ) -> pd.DataFrame:
        """Statistics at the lines for the completed boulders; see `rockfall.line_statistics`.

        >>> import rockfall
        >>> with rockfall.open(rockfall.read_case("case.nml")) as session:
        ...     *_, batch = session.run(40)
        >>> set(batch.line_statistics(quantities=["speed"])["quantity"])
        {'speed'}
        """
        return line_statistics(self._result or self._rows, by, classes, quantities)

    def trajectories(self, number: int = RECORDED, skip: Collection[int] = ()) -> list[Trajectory]:
        """Trajectories of at most `number` completed boulders, evenly spread over the run, as in
        `rockfall.trajectories`. Boulders whose numbers are in `skip` are left out.

        >>> import rockfall
        >>> with rockfall.open(rockfall.read_case("case.nml")) as session:
        ...     *_, batch = session.run(40)
        >>> len(batch.trajectories(5))
        5
        """
        recorded = {k: path for k, path in self._recorded(number).items() if k not in skip}
        vertices = Contents(trajectory_variables(recorded), {})
        return curves(motion_of(vertices, gravity=self.case.flight["gravity"]))

    def dataset(self) -> xr.Dataset:
        """Result so far, with maps, in the form of `rockfall.run`; the attribute `complete` is 0
        before the last batch. If the case has maps, raises a RockfallError once the run has
        continued, because they have changed.

        >>> import rockfall
        >>> with rockfall.open(rockfall.read_case("case.nml")) as session:
        ...     *_, batch = session.run(40)
        >>> batch.dataset().sizes["boulder"]
        40
        """
        with self._lock:
            if self._result is None:
                self._result = self._make()
        return self._result.dataset()

    @cached_property
    def _rows(self) -> Contents:
        """Results without maps."""
        with self._lock:
            return make_result(self._tally, maps=False)

    def _make(self) -> Contents:
        """Results of the completed boulders, with all variables; refuses maps that have changed
        since."""
        tally = self._tally
        if self._run.begun != self._begun and tally.scene.case.output.get("maps"):
            raise RockfallError(
                "the run has continued since this batch and changed its maps: take the dataset of "
                "a batch before the next batch"
            )
        recorded = self._recorded(tally.scene.case.output["trajectories"])
        tally.settle()
        result = make_result(replace(tally, trajectories=recorded))
        if tally.goes_on:
            tally.settle(-1)
        if self._until:
            result.attrs |= {"until": self._until, "until_met": int(self.until_met)}
        return result

    def _recorded(self, number: int) -> dict[int, np.ndarray]:
        """Vertices of completed boulders, from a selection of `number` over the whole run."""
        scene, kept, marks = self._tally.scene, self._tally.trajectories, self._tally.marks
        assert isinstance(scene, Scene)
        if number < 1:
            return {}
        last = self.boulders if marks is None else self.total
        numbers = recorded_numbers(scene, min(number, self.total), 1, last)
        chosen = [number for number in numbers if marks is None or marks[number - 1]]
        for boulder in chosen:
            if boulder not in kept:
                kept[boulder] = trajectory(scene, boulder)
        return {number: kept[number] for number in chosen}
