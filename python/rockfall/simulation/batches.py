# SPDX-License-Identifier: BSD-3-Clause
"""A run in batches of a given time, with boulders from all its sources in each, that can be
cancelled between pieces of a few milliseconds."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from threading import Lock

from rockfall._core import rockfall_f2py as _core
from rockfall.simulation.maps import tells_sources
from rockfall.simulation.simulate import FIRST_CHUNK, run_range
from rockfall.simulation.tally import Tally

PIECE_SECONDS = 0.012  # between looks at a cancel, which is to be answered within 0.05 s
LANES = 128  # boulders of a thread in one call of the kernel, below which lanes run empty
RECOVERY = 1.5  # growth of the rate that is expected, after a slow piece


class Batches:
    """The remaining boulders of a tally, in an order in which those done are spread over all."""

    def __init__(self, tally: Tally) -> None:
        self.tally, self.lock = tally, Lock()
        self.pieces = 0  # begun
        whole = tells_sources(tally.scene.case)  # maps of sources count them one after the other
        self._threads = int(_core.team(tally.threads))
        size = tally.boulders if whole else LANES * self._threads
        tally.spans = None if whole else []
        self._blocks = spread_blocks(tally.boulders, size)
        self._block = range(0)  # what remains of the block begun
        self._rate = 0.0  # boulders in a second: the slowest of late; 0: not known

    def advance(self, seconds: float, cancelled: Callable[[], bool]) -> None:
        """Simulate boulders for a time, up to the last, or until cancelled."""
        stop = time.perf_counter() + seconds
        while self.tally.done < self.tally.boulders and not cancelled():
            with self.lock:
                self._run_piece()
            if time.perf_counter() >= stop:
                return

    def _run_piece(self) -> None:
        """Simulate as many boulders of a block as take a piece of time, by the slowest of late."""
        tally = self.tally
        self._block = self._block or next(self._blocks)
        size = max(1, int(PIECE_SECONDS * self._rate)) if self._rate else FIRST_CHUNK
        piece = self._block[:size]
        self.pieces += 1
        clocks = time.perf_counter, time.process_time, time.thread_time
        before = [clock() for clock in clocks]
        run_range(tally, tally.before + piece.start + 1, len(piece))
        wall, cpu, own = (clock() - begun for clock, begun in zip(clocks, before, strict=True))
        self._block = self._block[len(piece) :]
        tally.wall, tally.cpu = tally.wall + wall, tally.cpu + cpu
        tally.done += len(piece)
        if tally.spans is not None:
            tally.spans.append(piece)
        # by the time computed: while a busy machine waits, smaller pieces would be no help
        rate = len(piece) / max(own, cpu / self._threads, 1e-9)
        self._rate = min(rate, RECOVERY * self._rate) if self._rate else rate


def spread_blocks(boulders: int, size: int) -> Iterator[range]:
    """Blocks of boulders, counted from 0, each of which lies in a gap between those before it (van
    der Corput's order)."""
    blocks = -(-boulders // size)
    bits = max(0, blocks - 1).bit_length()
    for k in range(1 << bits):
        block = int(f"{k:0{bits}b}"[::-1], 2) if bits else 0
        if block < blocks:
            yield range(block * size, min((block + 1) * size, boulders))
