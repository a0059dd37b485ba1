# SPDX-License-Identifier: BSD-3-Clause
"""Run in batches of a given duration, each with boulders from all sources. The run can be
cancelled between pieces of a few milliseconds.
"""

import time
from collections.abc import Callable, Iterator
from threading import RLock

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.errors import OUR_FAULT, RockfallError
from rockfall.scene.scene import Scene
from rockfall.simulation.map_plan import tells_sources
from rockfall.simulation.tally import Tally

PIECE_SECONDS = 0.012  # duration between checks; a cancel may take 0.05 s
FIRST_PIECE = int(_core.constant("first_chunk"))  # small, because boulders may be slow
LANES = int(_core.constant("lanes"))  # boulders per thread and call; with fewer, lanes stay empty
RECOVERY = 1.5  # maximum growth of the rate after a slow piece


class Batches:
    """Runs the boulders of an empty tally: evenly spread, or in sequence for maps by source."""

    def __init__(self, tally: Tally) -> None:
        self.tally, self.lock = tally, RLock()
        self.begun = 0  # number of pieces started
        self._threads = int(_core.team(tally.threads))
        self._rate = 0.0  # boulders per second, from the slowest recent piece; 0: unknown
        if tells_sources(tally.scene.case):  # maps by source need the sources in order
            self._pieces = self._in_order()
        else:
            tally.marks = np.zeros(tally.boulders, bool)
            self._pieces = self._spread()

    def advance(self, seconds: float, cancelled: Callable[[], bool]) -> None:
        """Simulate boulders for a duration, until all are complete, or until cancelled."""
        stop = time.perf_counter() + seconds
        while self.tally.done < self.tally.boulders and not cancelled():
            with self.lock:
                self._run(next(self._pieces))
            if time.perf_counter() >= stop:
                return

    def _size(self) -> int:
        """Number of boulders in a piece of PIECE_SECONDS."""
        return max(1, int(PIECE_SECONDS * self._rate)) if self._rate else FIRST_PIECE

    def _in_order(self) -> Iterator[range]:
        """Yield pieces of boulders in sequence, from 0."""
        while self.tally.done < self.tally.boulders:
            stop = min(self.tally.done + self._size(), self.tally.boulders)
            yield range(self.tally.done, stop)

    def _spread(self) -> Iterator[range]:
        """Yield evenly spread pieces: every n-th boulder, then those halfway between, and so on."""
        boulders = range(self.tally.boulders)
        for part in spread_parts(boulders, -(-len(boulders) // (LANES * self._threads))):
            for piece in spread_parts(part, -(-len(part) // self._size())):
                # Use smaller pieces if boulders took more than twice the planned time.
                yield from spread_parts(piece, -(-len(piece) // (2 * self._size())))

    def _run(self, piece: range) -> None:
        """Simulate boulders (0-based numbers)."""
        tally = self.tally
        scene = tally.scene
        assert isinstance(scene, Scene)
        self.begun += 1
        clocks = time.perf_counter, time.process_time, time.thread_time
        before = [clock() for clock in clocks]
        scene.kernel.keep_within(tally.box)
        first = tally.before + piece.start + 1
        _, left, _ = tally.run.advance(scene, first, len(piece), piece.step)
        if left.size:
            raise RockfallError(
                f"internal error: boulder {left[0]} left the reachable area", code=OUR_FAULT
            )
        wall, cpu, own = (clock() - begun for clock, begun in zip(clocks, before, strict=True))
        tally.wall, tally.cpu = tally.wall + wall, tally.cpu + cpu
        tally.done += len(piece)
        if tally.marks is not None:
            tally.marks[piece.start : piece.stop : piece.step] = True
        # CPU time, because smaller pieces do not help on a busy machine. Windows counts it in
        # steps of 1/64 s, so it may be zero, or exceed the elapsed time.
        computed = min(max(own, cpu / self._threads), wall) or wall
        rate = len(piece) / max(computed, 1e-9)
        self._rate = min(rate, RECOVERY * self._rate) if self._rate else rate


def spread_parts(numbers: range, parts: int) -> Iterator[range]:
    """Yield every `parts`-th number, in `parts` ranges with different first numbers; each range
    fills a gap between earlier ranges (van der Corput's order)."""
    parts = min(parts, len(numbers))
    bits = max(0, parts - 1).bit_length()
    for k in range(1 << bits):
        first = int(f"{k:0{bits}b}"[::-1], 2) if bits else 0
        if first < parts:
            yield numbers[first::parts]
