# SPDX-License-Identifier: BSD-3-Clause
"""Samples of the quantities at lines, for all boulders or for groups, from the boulder rows or, in
a result without rows, from counts and sums."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.analysis.lines.groups import Group, check_by, groups, part_names
from rockfall.analysis.precision.intervals import Sources, are_sampled, sources
from rockfall.analysis.precision.samples import Counts, Passing, Sample, Values
from rockfall.case import case_of
from rockfall.kernel_rules import (
    SAMPLE_BINS,
    SAMPLE_COARSE,
    SAMPLE_QUANTITIES,
    SAMPLE_TAILS,
    SAMPLE_UNITS,
)
from rockfall.quantities import worst_first
from rockfall.result.crossings import AtLine, at_line, line_names
from rockfall.result.samples import check_all_rows, simulated
from rockfall.result.variables import fields

if TYPE_CHECKING:
    from rockfall.result.contents import Held


WORST_BY = "energy_total", "passing_height"


class LineSamples:
    """Samples of the quantities at the lines of a result."""

    def __init__(self, result: Held, source: Sources | None = None) -> None:
        """`source` replaces the sources of the boulders."""
        self.result, self._counted = result, result.sizes["boulder"] < simulated(result)
        self._has_kept = source is None and not self._counted
        if self._has_kept:
            source = sources(result)
        self._source = source
        self._last: tuple[int, AtLine, Passing] | None = None  # data of the line requested last
        self.sampled = are_sampled(result) if source is None else source.sampled

    @property
    def boulders(self) -> int:
        return simulated(self.result) if self._source is None else self._source.number.size

    @property
    def sources(self) -> int:
        """Number of sources; for counts with unequal releases, at most the number of groups."""
        if self._source is not None:
            return self._source.count
        case = case_of(self.result)
        if "boulders" in case.case and not case.release["by_area"]:
            return int(self.result.attrs["boulders_requested"]) // case.case["boulders"]
        return int(np.count_nonzero(self._released(None)))

    def given(self) -> LineSamples:
        """Copy in which the sources are fixed, not sampled."""
        source = None if self._source is None else replace(self._source, sampled=False)
        samples = LineSamples(self.result, source)
        samples.sampled = False
        return samples

    def groups(self, by: str, classes: Sequence[float] | None = None) -> list[Group]:
        """Groups of boulders, as in `rockfall.analysis.lines.groups.groups`; in a result without
        rows, masks of sample parts."""
        if not self._counted:
            return groups(self.result, by, classes)
        check_by(by, classes)
        if by != "source":
            check_all_rows(self.result, f"by = '{by}'")
        names = part_names(self.result)
        chosen = [(name, np.arange(len(names)) == k) for k, name in enumerate(names)]
        return [group for group in chosen if self._released(group[1]).any()]

    def sample(self, line: int, quantity: str, chosen: np.ndarray | None = None) -> Sample:
        """Sample of a quantity at the line with this index, for all boulders or a group."""
        if self._counted:
            return self._counts(line, quantity, chosen)
        at, passing = self._at(line)
        values = at.values(quantity)
        if chosen is None:
            return Values(values, passing)
        assert self._source is not None
        among = chosen[at.boulders]
        places = np.cumsum(chosen) - 1  # index among the chosen boulders
        which = places[at.boulders[among]]
        return Values(values[among], Passing(self._source[chosen], which))

    def kept(self, line: int) -> dict[Any, Any]:
        """Cache for statistics of all boulders at a line, shared by analyses; a new dictionary if
        they cannot be cached."""
        return self._at(line)[0].kept if self._has_kept else {}

    def _at(self, line: int) -> tuple[AtLine, Passing]:
        """Crossings of a line and the boulders that pass it, shared by all quantities."""
        assert self._source is not None
        if self._last is None or self._last[0] != line:
            at = at_line(self.result, line)
            self._last = line, at, Passing(self._source, at.boulders)
        return self._last[1:]

    def ends(self, quantity: str) -> Sample:
        """Sample of a quantity at the boulders' ends, such as plan_distance or path_length."""
        if self._counted:
            return self._counts(-1, quantity, None)
        assert self._source is not None
        return Values(self.result[quantity].values, self._source)

    def _counts(self, line: int, quantity: str, parts: np.ndarray | None) -> Counts:
        """Counts at the line with this index; -1 for the ends of boulders."""
        result, kind = self.result, int(line < 0)
        number = fields("end_quantity" if kind else "line_quantity").index(quantity)
        all_parts = np.full(result.sizes["sample_part"], True)
        part_numbers = np.flatnonzero(all_parts if parts is None else parts)
        chosen = np.isin(result["sample_group_part"].values - 1, part_numbers)
        where = line + 1, number
        tail = np.zeros(0)
        if not kind and number < SAMPLE_TAILS and part_numbers.size == all_parts.size:
            tail = np.asarray(result["sample_largest"][line, number]).astype("f8")
        bins = self._bins(*where, part_numbers)
        return Counts(
            bins,
            result["sample_sums"].values[line + 1, part_numbers, number],
            self._in_groups(*where, np.flatnonzero(chosen)),
            self._released(parts),
            SAMPLE_UNITS[kind, number],
            tail[: bins.sum()],
            self.sampled,
        )

    def _released(self, parts: np.ndarray | None) -> np.ndarray:
        """Boulders released by each source group in these parts, counted at their ends."""
        part_of_group = self.result["sample_group_part"].values - 1
        chosen = np.full(part_of_group.size, True) if parts is None else parts[part_of_group]
        return self._in_groups(0, 0, np.flatnonzero(chosen)).sum(axis=1)

    def _bins(self, place: int, quantity: int, parts: np.ndarray) -> np.ndarray:
        """Counts (bins,) of a quantity summed over parts; empty bins are 0."""
        bins = np.zeros((SAMPLE_COARSE, SAMPLE_BINS // SAMPLE_COARSE), "i8")
        for part in parts:
            first = self._first(place, part, self.result.sizes["sample_part"], quantity)
            blocks = self.result["sample_block"].values
            ends = slice(*np.searchsorted(blocks, [first, first + SAMPLE_COARSE]))
            bins[blocks[ends] - first] += np.asarray(self.result["sample_count"][ends])
        return bins.ravel()

    def _in_groups(self, place: int, quantity: int, groups: np.ndarray) -> np.ndarray:
        """Counts (groups, coarse bins) of a quantity."""
        bins, counts = (self.result[f"sample_group_{name}"].values for name in ("bin", "count"))
        dense = np.zeros((groups.size, SAMPLE_COARSE), "i8")
        for row, group in enumerate(groups):
            first = self._first(place, group, self.result.sizes["sample_group"], quantity)
            ends = slice(*np.searchsorted(bins, [first, first + SAMPLE_COARSE]))
            dense[row, bins[ends] - first] = counts[ends]
        return dense

    @staticmethod
    def _first(place: int, column: int, columns: int, quantity: int) -> int:
        """Number of the first coarse bin of a quantity, for a line and a part or group."""
        return ((place * columns + int(column)) * SAMPLE_QUANTITIES + quantity) * SAMPLE_COARSE


def worst_lines(result: Held, most: int) -> list[int]:
    """Indices, in order, of at most `most` lines: those with the most passing boulders, and those
    with the largest energies and passing heights."""
    lines = range(len(line_names(result)))
    if len(lines) <= most:
        return [*lines]
    samples, loads = LineSamples(result), np.zeros((1 + len(WORST_BY), len(lines)))
    for k in lines:
        at = [samples.sample(k, name) for name in WORST_BY]
        loads[:, k] = at[0].n, *(sample.max() if sample.n else 0.0 for sample in at)
    return sorted(worst_first(*loads)[:most])
