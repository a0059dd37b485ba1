# SPDX-License-Identifier: BSD-3-Clause
"""Merging of run parts into the complete result."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rockfall.errors import RockfallError
from rockfall.simulation.parts.part_file import LAYOUT_OF, Part, read_part, when
from rockfall.simulation.parts.split_sources import join_sources
from rockfall.simulation.tally import Tally
from rockfall.simulation.tally_dataset import make_result

if TYPE_CHECKING:
    from rockfall.result.contents import Contents, Held


def join(parts: Iterable[Held | str | Path]) -> Contents:
    """Merge the parts of a run (results, or their files) into a result that is bit-identical to an
    undivided run, except for times and threads.

    Raises a RockfallError for parts of another run, and for missing or duplicate boulders.
    """
    joined = Joined()
    for part in parts:
        joined.add(part)
    return joined.result()


class Joined:
    """Merge of the parts of a run in any order of arrival: rows, sums and map tallies."""

    def __init__(self) -> None:
        self.first: Part | None = None  # the part that arrived first, without its values
        self.ranges: list[tuple[int, int, str]] = []  # first boulder, last boulder, name
        self.tally: Tally | None = None
        self.shared: list[dict[str, np.ndarray]] = []  # tallies of sources that parts split
        self.trajectories: dict[int, np.ndarray] = {}  # boulder number -> vertices

    def add(self, part: Held | str | Path) -> None:
        """Add a part, or its file; refuses parts of another run."""
        part = read_part(part)
        if self.first is None or self.tally is None:
            origin = part.origin
            run, self.first = part.empty_run(0, origin.boulders), part
            self.tally = Tally(origin, run, origin.window, origin.boulders, crs=part.crs)
        what = self.first.origin.difference(part.origin)
        if not what and self.tally.differs_in(part.arrays, *LAYOUT_OF.values()):
            what = "sources"
        if what:
            different = f"belongs to a different run than {self.first.name}"
            raise RockfallError(f"{part.name}: {different}: its {what} differs")
        self.tally.run.merge(part.loaded_run())
        self.tally.wall += part.clocks["wall_seconds"]
        self.tally.cpu += part.clocks["cpu_seconds"]
        self.tally.threads = max(self.tally.threads, part.threads)
        self.tally.date = max(filter(None, (self.tally.date, part.date)), key=when, default="")
        self.shared += [part.shared()] if part.shared() else []
        self.trajectories |= part.trajectories()
        self.ranges.append((part.first, part.last, part.name))
        part.arrays = {}

    def result(self) -> Contents:
        """Result of the complete run; the parts cannot be used afterwards. Raises a RockfallError
        if boulders are missing or duplicate, or if rows or trajectories are missing."""
        tally = self.tally
        if tally is None:
            raise RockfallError("merge requires the parts of a run")
        _check_whole(sorted(self.ranges), tally)
        numbers = sorted(self.trajectories)
        wanted = min(tally.boulders, tally.scene.case.output["trajectories"])
        if len(numbers) != wanted:
            raise RockfallError(
                "merge: trajectories are missing: finish stopped runs with --resume"
            )
        if self.shared:
            join_sources(tally.scene.case, tally.array("tally_counts"), self.shared)
        tally.done = tally.boulders
        tally.sort_rows()
        if tally.number is not None and tally.rows < tally.number.size:
            raise RockfallError("merge: rows of boulders are missing")
        tally.trajectories = {number: self.trajectories[number] for number in numbers}
        result = make_result(tally)
        result.attrs["threads"] = tally.threads
        return result


def _check_whole(ranges: Sequence[tuple[int, int, str]], tally: Tally) -> None:
    """Check that each boulder occurs exactly once."""
    done, requested, wrong = 0, tally.boulders, []
    for first, last, name in ranges:
        if first > done + 1:
            wrong.append(f"boulders {done + 1} to {first - 1} are missing")
        if first <= done:
            wrong.append(f"boulders {first} to {min(done, last)} occur twice: {name}")
        done = max(done, last)
    if done < requested:
        wrong.append(f"boulders {done + 1} to {requested} are missing")
    if wrong:
        raise RockfallError("merge: " + "; ".join(wrong))
