# SPDX-License-Identifier: BSD-3-Clause
"""Maps by source of runs in parts: a source that a part cuts may be counted by others too.

The kernel knows the cells of such a source (rockfall_source_maps). They are kept with a part,
so that all parts together count it once a cell, and with a checkpoint, so that it goes on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from rockfall.scene.scene import Scene

if TYPE_CHECKING:
    from rockfall.simulation.maps import Maps
    from rockfall.simulation.tally import Tally

SHARED = ("shared_cell", "shared_source", "shared_boulders")  # of the sources that a range cuts


def tells_sources(maps: Maps) -> bool:
    """Whether a map asks which source a boulder has."""
    return bool(maps.plan.counts["sources"] or maps.plan.counts["released"])


def follow_sources(maps: Maps, scene: Scene, before: int) -> None:
    """Room for stamps; a source that the run begins in the middle of has a layer to itself."""
    if not tells_sources(maps):
        return
    source = scene.source_of(before + 1)
    maps.head = source + 1 if scene.numbers_of(source).start <= before else 0
    maps.stamp = np.zeros((2 if maps.head else 1, *maps.box.shape), "i4")


def shared_cells(tally: Tally) -> dict[str, np.ndarray]:
    """The cells that the sources feed which the boulders done cut, by source: index of the cell,
    number of the source, and its boulders among those done; {} where no map asks."""
    if not tells_sources(tally.maps):
        return {}
    done, columns = range(tally.before + 1, tally.before + tally.done + 1), []
    assert isinstance(tally.scene, Scene)
    for source in _cut_sources(tally.scene, done):
        own = tally.scene.numbers_of(source)
        stamp = tally.maps.stamp[int(source + 1 == tally.maps.head)]
        cell = np.flatnonzero(stamp == source + 1)
        boulders = min(own.stop, done.stop) - max(own.start, done.start)
        numbers = (np.full(cell.size, n, "i4") for n in (source + 1, boulders))
        columns.append((cell, *numbers))
    empty = (np.empty(0, "i8"), np.empty(0, "i4"), np.empty(0, "i4"))
    return dict(zip(SHARED, map(np.concatenate, zip(empty, *columns, strict=True)), strict=True))


def _cut_sources(scene: Scene, numbers: range) -> list[int]:
    """The sources, from 0, of which some but not all boulders have these numbers."""
    if not numbers:
        return []
    ends = dict.fromkeys(scene.source_of(number) for number in (numbers[0], numbers[-1]))
    own = {source: scene.numbers_of(source) for source in ends}
    return [s for s in ends if own[s][0] not in numbers or own[s][-1] not in numbers]


def restore_stamps(maps: Maps, shared: Mapping[str, np.ndarray]) -> None:
    """Go on from what `shared_cells` gave."""
    source = shared["shared_source"]
    for layer, mine in enumerate((source != maps.head, source == maps.head)):
        if mine.any():
            stamp = maps.stamp[layer].reshape(-1)
            stamp[shared["shared_cell"][mine]] = source[mine]


def settle(tally: Tally, shared: Mapping[str, np.ndarray], sign: int = 1) -> None:
    """Leave only the boulders done of cut sources in the cells that they feed (`shared`, as
    `shared_cells` gives it), as a part has it; with sign -1 all of them again, as a run that goes
    on."""
    if shared and tally.maps.plan.counts["released"]:
        assert isinstance(tally.scene, Scene)
        released = _layer(tally.maps, "released")
        source = shared["shared_source"]
        all_of = {s: len(tally.scene.numbers_of(s - 1)) for s in np.unique(source)}
        missing = np.array([all_of[s] for s in source], "i4") - shared["shared_boulders"]
        np.subtract.at(released, shared["shared_cell"], sign * missing)


def join_sources(maps: Maps, parts: Sequence[Mapping[str, np.ndarray]]) -> None:
    """Count the sources that several parts cut once a cell, with all their boulders: what the parts
    counted of them is taken out, and put back once."""
    if not parts or not tells_sources(maps):
        return
    cell, source, boulders = (np.concatenate([part[name] for part in parts]) for name in SHARED)
    cells = maps.counts[0].size
    once_source, once_cell = np.divmod(np.unique(source * np.int64(cells) + cell), cells)
    if maps.plan.counts["sources"]:
        layer = _layer(maps, "sources")
        np.subtract.at(layer, cell, np.int32(1))
        np.add.at(layer, once_cell, np.int32(1))
    if maps.plan.counts["released"]:
        numbers, total = _boulders_of(parts)
        layer = _layer(maps, "released")
        np.subtract.at(layer, cell, boulders)
        np.add.at(layer, once_cell, total[np.searchsorted(numbers, once_source)])


def _boulders_of(parts: Sequence[Mapping[str, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the cut sources, and the boulders of each over all parts."""
    rows = []
    for part in parts:
        source, first = np.unique(part["shared_source"], return_index=True)
        rows.append((source, part["shared_boulders"][first]))
    source, boulders = (np.concatenate(column) for column in zip(*rows, strict=True))
    numbers, which = np.unique(source, return_inverse=True)
    total = np.zeros(numbers.size, "i4")
    np.add.at(total, which, boulders)
    return numbers, total


def _layer(maps: Maps, name: str) -> np.ndarray:
    """A layer of counts by cell, flat; a view."""
    return maps.counts[maps.plan.counts[name] - 1].reshape(-1)
