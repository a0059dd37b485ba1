# SPDX-License-Identifier: BSD-3-Clause
"""A scene that stays open: only changed inputs are read again."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from threading import Event, RLock
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from rockfall.case import Case, key_table
from rockfall.errors import RockfallError
from rockfall.scene.frames import FrameFiles
from rockfall.scene.read import read_scene
from rockfall.scene.releases.source_frame import source_frame
from rockfall.scene.rules.plausible import implausible
from rockfall.scene.scene import Scene
from rockfall.scene.stages import KeptStages
from rockfall.session.batch import Batch
from rockfall.simulation.batches import Batches
from rockfall.simulation.memory import machine_memory
from rockfall.simulation.simulate import check_overflow, check_team, start
from rockfall.studies.run_until import Rule, read_rules

if TYPE_CHECKING:
    from geopandas import GeoDataFrame

BATCH_SECONDS = 0.1


def open_session(case: Case, *, threads: int | None = None, **arrays: Any) -> Session:
    """Open a case for repeated runs: a Session that keeps the inputs in memory.

    `arrays` (dem, zones, lines, ...) are as in `rockfall.run` and must not be changed in place.
    `threads` applies to all runs (default: as in the case). A terrain that needs more than half of
    the memory raises a RockfallError. Likely mistakes in the case give a UserWarning.

    >>> import rockfall
    >>> with rockfall.open(rockfall.read_case("case.nml")) as session:
    ...     session.change(release={"drop_height": 3.0}, boulder={"density": 2600.0})
    ...     for batch in session.run(40):
    ...         reached = batch.line_statistics(quantities=["energy_total"])
    >>> batch.complete, batch.dataset().sizes["boulder"]
    (True, 40)
    """
    session = Session(case, threads, arrays)
    session._warn(set())
    return session


class Session:
    """An open case, from `rockfall.open`. Methods may be called from any thread; a run in progress
    keeps the case with which it started.

    >>> import rockfall
    >>> session = rockfall.open(rockfall.read_case("case.nml"))
    >>> session.change(boulder={"density": 2600.0})
    >>> session.case.boulder["density"], session.warnings
    (2600.0, [])
    """

    def __init__(self, case: Case, threads: int | None, arrays: dict[str, Any]) -> None:
        self._threads, self._lock, self._memory = threads, RLock(), machine_memory()
        self._stages, self._frames = KeptStages(), FrameFiles()
        self._boulders: int | None = None  # boulders of the scene; None: as in the case
        self._case, self._arrays = case, arrays
        self._scene: Scene | None = None
        try:
            self._read(case, arrays, None)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self.close()

    def close(self) -> None:
        """Free the session's memory. Runs in progress and their batches remain usable.

        >>> import rockfall
        >>> session = rockfall.open(rockfall.read_case("case.nml"))
        >>> session.close()
        >>> session.change()
        Traceback (most recent call last):
        rockfall.errors.RockfallError: the session is closed
        """
        with self._lock:
            self._stages, self._scene = KeptStages(), None
            self._frames.remove()

    @property
    def case(self) -> Case:
        """The case, including all changes.

        >>> import rockfall
        >>> session = rockfall.open(rockfall.read_case("case.nml"))
        >>> session.case.boulder["density"] > 0
        True
        """
        return self._case

    @property
    def warnings(self) -> list[str]:
        """Likely mistakes in the case, one per line.

        >>> import rockfall
        >>> session = rockfall.open(rockfall.read_case("case.nml"))
        >>> all(isinstance(line, str) for line in session.warnings)
        True
        """
        return implausible(self._opened())

    @property
    def sources(self) -> GeoDataFrame:
        """Source points with their release attributes, as a GeoDataFrame that
        `rockfall.run(case, sources=...)` and `change(sources=...)` accept, with or without
        changes. Needs geopandas.

        >>> import rockfall
        >>> session = rockfall.open(rockfall.read_case("case.nml"))
        >>> len(session.sources)
        1
        """
        return source_frame(self._opened())

    def change(self, **changes: Any) -> None:
        """Change the case, and read the inputs that depend on the changes.

        `changes` are groups of the case as in `case.replace` (`release={"x": [120.0]}`; a key that
        is None is removed; `line=[...]`, `barrier=[...]`, `dam=[...]` replace all groups of the
        name), and rasters and layers as in `rockfall.run` (`lines`, `barriers`, `sources`, `dem`,
        ...), which replace those of the same name; None removes them. Files modified since they
        were read are read again, also by `change()` alone. New warnings are issued as
        UserWarnings. An error leaves the session unchanged.

        >>> import rockfall
        >>> session = rockfall.open(rockfall.read_case("case.nml"))
        >>> session.change(line=[{"name": "road", "x": [600000.0, 600120.0], "y": [4999900.0] * 2}])
        >>> [line["name"] for line in session.case.line]
        ['road']
        """
        with self._lock:
            before = {*self.warnings}
            names = {key.group for key in key_table()}
            groups = {name: value for name, value in changes.items() if name in names}
            others = {name: value for name, value in changes.items() if name not in names}
            case = self._case.replace(**groups) if groups else self._case
            self._read(case, _changed_arrays(self._arrays, others), self._boulders)
            self._warn(before)

    def run(
        self,
        boulders: int | None = None,
        until: str | None = None,
        cancel: Event | None = None,
        batch_seconds: float = BATCH_SECONDS,
    ) -> Iterator[Batch]:
        """Run the case and yield a `Batch` with the results so far about every `batch_seconds` [s];
        the last batch is complete. Raises a RockfallError for invalid numbers or rules.

        `boulders` is the total over all sources, instead of the case's number; the last batch then
        equals `rockfall.run` with `&case boulders_total`. The run ends early if a batch meets the
        rules of `until` (as in `rockfall.run_until`). It ends without another batch within 0.05 s
        after another thread sets the Event `cancel`.

        >>> import rockfall
        >>> session = rockfall.open(rockfall.read_case("case.nml"))
        >>> [batch.boulders for batch in session.run(100, batch_seconds=10.0)]
        [100]
        """
        with self._lock:
            scene = self._opened()
            if boulders is not None and boulders < 1:
                raise RockfallError(f"boulders = {boulders}: must be at least 1")
            if not batch_seconds > 0:
                raise RockfallError(f"batch_seconds = {batch_seconds}: must be > 0")
            if boulders != self._boulders:
                self._read(self._case, self._arrays, boulders)
                scene = self._opened()
            criteria = (
                read_rules(until, [line["name"] for line in scene.case.lines]) if until else []
            )
            tally = start(scene, self._team(scene))
        batches = Batches(tally)
        return _batches(batches, until or "", criteria, cancel or Event(), batch_seconds)

    def _opened(self) -> Scene:
        if self._scene is None:
            raise RockfallError("the session is closed")
        return self._scene

    def _team(self, scene: Scene) -> int:
        return scene.case.case["threads"] if self._threads is None else self._threads

    def _read(self, case: Case, arrays: dict[str, Any], boulders: int | None) -> None:
        """Read a case with this number of boulders; after an error, the session is unchanged."""
        total = {"boulders": None, "boulders_total": boulders}
        stages = self._stages.copy()
        scene = read_scene(
            case if boulders is None else case.replace(case=total),
            memory=self._memory, stages=stages, frame_store=self._frames, **arrays,
        )  # fmt: skip
        if scene.windows:
            raise RockfallError(
                f"{case.name}: &terrain dem = '{case.terrain['dem']}': needs more than half of the "
                "memory, and an open session keeps it there: use rockfall.run"
            )
        check_team(self._team(scene))
        check_overflow(scene, scene.survey())
        implausible(scene)
        self._case, self._arrays, self._boulders = case, arrays, boulders
        self._stages, self._scene = stages, scene

    def _warn(self, before: set[str]) -> None:
        """Issue the warnings that are not in `before`, attributed to the caller of the calling
        function."""
        for line in self.warnings:
            if line not in before:
                warnings.warn(line, stacklevel=3)


def scene_of(session: Session) -> Scene:
    """Scene read by an open session; it must not be changed."""
    return session._opened()


def _changed_arrays(before: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Rasters and layers after changes. The transform is removed together with the elevations that
    need it."""
    arrays = {**before, **changes}
    if arrays.get("dem") is None or hasattr(arrays["dem"], "coords"):
        arrays["transform"] = changes.get("transform")
    return {name: array for name, array in arrays.items() if array is not None}


def _batches(
    batches: Batches, until: str, criteria: list[Rule], cancelled: Event, seconds: float
) -> Iterator[Batch]:
    """Advance a run and yield its results until it is complete, meets the rules, or stops."""
    complete = met = False
    while not complete and not met:
        batches.advance(seconds, cancelled.is_set)
        if cancelled.is_set():
            return
        batch = Batch(batches, until, criteria)
        complete = batch.complete
        met = bool(criteria) and batch.until_met
        yield batch
