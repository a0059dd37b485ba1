# SPDX-License-Identifier: BSD-3-Clause
"""A run of a scene in the kernel, which accumulates its results."""

from __future__ import annotations

import sys

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.io.rasters.grid import Box
from rockfall.result.run_arrays import RunArrays, window
from rockfall.scene.scene import Scene

MAX_COLUMNS = int(_core.constant("max_columns"))  # maximum columns of `bin_counts` (one is spare)


class Run(RunArrays):
    """Handle of a run of a scene that can be advanced."""

    successor: Run | None = None  # run that has taken over the tallies

    @classmethod
    def of_scene(cls, scene: Scene, numbers: range, box: Box, threads: int) -> Run:
        """Create a run of boulders with these 0-based numbers, with maps for the cells in `box`."""
        handle, name = scene.kernel.handle, scene.case.name
        extent = numbers.start, len(numbers), window(box), threads, MAX_COLUMNS
        return cls(_core.open_run(handle, *extent), name)

    def continued(self, scene: Scene) -> Run:
        """Create a run of a scene with more boulders that continues from these results."""
        self.changed()
        self.successor = Run(_core.continue_run(scene.kernel.handle, self.handle), scene.case.name)
        return self.successor

    def advance(
        self,
        scene: Scene,
        first: int,
        size: int,
        step: int = 1,
        seconds: float = sys.float_info.max,
    ) -> tuple[int, np.ndarray, np.ndarray]:
        """Simulate every `step`-th boulder on a scene or window, from number `first` (1-based); no
        boulder starts after `seconds`. Returns the number of completed boulders (at least one),
        and the numbers and exit positions (2, n) of boulders that left the window; these are not
        counted."""
        done, left, code, message = _core.advance(
            self.handle, scene.kernel.handle, first, step, size, seconds
        )
        self.changed()
        scene.kernel.check(code, message)
        if not left:
            return done, np.empty(0, "i8"), np.empty((2, 0))
        return done, self.array("left").copy(), self.array("left_at").copy()
