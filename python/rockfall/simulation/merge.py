# SPDX-License-Identifier: BSD-3-Clause
"""Parts of a run, joined to the result of all of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rockfall.errors import RockfallError
from rockfall.result.samples import empty_like, rows_kept
from rockfall.simulation.maps import no_maps
from rockfall.simulation.part_file import Part, read_part, when
from rockfall.simulation.source_maps import join_sources
from rockfall.simulation.tally import Tally, empty_tally
from rockfall.simulation.tally_dataset import make_result

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.result.contents import Contents, Held


def merge(parts: Sequence[xr.Dataset | str | Path]) -> xr.Dataset:
    """The result of a whole run from its parts (results, or their files), bit for bit that of a run
    in one piece; only times and threads are their own.

    A RockfallError names parts of another run, and boulders that are missing or there twice.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> parts = [rockfall.run(case, shard=(k, 2)) for k in (1, 2)]
    >>> rockfall.merge(parts).sizes["boulder"]
    20
    """
    return join(parts).dataset()


def join(parts: Iterable[Held | str | Path]) -> Contents:
    """What `merge` makes."""
    joined = Joined()
    for part in parts:
        joined.add(part)
    return joined.result()


class Joined:
    """Parts of one run put together as they come, in any order: rows, sums and tallies of maps."""

    def __init__(self) -> None:
        self.first: Part | None = None  # that came, without its values
        self.ranges: list[tuple[int, int, str]] = []  # first and last boulder, name
        self.tally: Tally | None = None
        self.shared: list[dict[str, np.ndarray]] = []  # by sources that a part cuts
        self.trajectories: dict[int, np.ndarray] = {}  # by boulder

    def add(self, part: Held | str | Path) -> None:
        """Add a part, or its file."""
        part = read_part(part)
        if self.first is None or self.tally is None:
            self.first, self.tally = part, _tally_for(part)
        what = self.first.origin.difference(part.origin)
        if not what and (samples := self.tally.samples) and not samples.fits(part.arrays):
            what = "sources"
        if what:
            raise RockfallError(
                f"{part.name}: is of another run than {self.first.name}: its {what} differs"
            )
        part.add_to(self.tally)
        self.tally.threads = max(self.tally.threads, part.threads)
        self.tally.date = max(filter(None, (self.tally.date, part.date)), key=when, default="")
        self.shared += [part.shared()] if part.shared() else []
        self.trajectories |= part.trajectories()
        self.ranges.append((part.first, part.last, part.name))
        part.arrays = {}

    def result(self) -> Contents:
        """That of the whole run; the parts are used up."""
        tally = self.tally
        if tally is None:
            raise RockfallError("merge: needs the parts of a run")
        _check_whole(sorted(self.ranges), tally)
        numbers = sorted(self.trajectories)
        wanted = min(tally.boulders, tally.scene.case.output["trajectories"])
        if len(numbers) != wanted:
            raise RockfallError(
                "merge: trajectories are missing: a run that was stopped ends with --resume"
            )
        join_sources(tally.maps, self.shared)
        tally.done = tally.boulders
        tally.sort_rows()
        tally.trajectories = {number: self.trajectories[number] for number in numbers}
        result = make_result(tally)
        result.attrs["threads"] = tally.threads
        return result


def _tally_for(part: Part) -> Tally:
    """Room for all boulders of the run of a part."""
    origin = part.origin
    try:
        maps = no_maps(origin.case, origin.window)
        kept, samples = rows_kept(origin.case, origin.boulders), None
        if kept is not None:
            layout = (part.arrays[f"sample_{name}"] for name in ("part_last", "group_part"))
            samples = empty_like(origin.case, origin.boulders, *layout)
        number = None if kept is None else np.zeros(kept, "i8")
        tally = empty_tally(origin, maps, range(origin.boulders), 0, number, samples)
    except (MemoryError, ValueError) as error:
        raise RockfallError(f"merge: {origin.boulders} boulders do not fit in memory") from error
    tally.crs = part.crs
    return tally


def _check_whole(ranges: Sequence[tuple[int, int, str]], tally: Tally) -> None:
    """All boulders are there, once."""
    done, requested, wrong = 0, tally.boulders, []
    for first, last, name in ranges:
        if first > done + 1:
            wrong.append(f"boulders {done + 1} to {first - 1} are missing")
        if first <= done:
            wrong.append(f"boulders {first} to {min(done, last)} are twice: {name}")
        done = max(done, last)
    if done < requested:
        wrong.append(f"boulders {done + 1} to {requested} are missing")
    if wrong:
        raise RockfallError("merge: " + "; ".join(wrong))
