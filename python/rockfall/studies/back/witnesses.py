# SPDX-License-Identifier: BSD-3-Clause
"""Base class for blocks at rest and marks: observations of unknown boulders."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np


def worth_of(times: float) -> float:
    """Weight of a simulated boulder when run-to-run scatter exceeds the binomial scatter by the
    factor `times`, in the member and in the field."""
    return 1 / (2 * max(times, 1.0) - 1)


@dataclass(kw_only=True)
class Witnesses:
    """Base class of `Deposited` and `Marked`; see `evidence.Counted` for the methods. The data
    kept from a run are sums over boulders for each block or mark, and log-densities of the run's
    own boulders, which give the noise."""

    SUMS: ClassVar[int]  # number of sums over boulders for each block or mark
    AGAIN: ClassVar[int]  # samples of equal size from each run, for predictive probabilities

    noise_alone: float = 0.0  # variance of the log-likelihood due to the boulders in a run
    worth: float = 1.0

    @property
    def n(self) -> int:
        raise NotImplementedError

    def _sums(self, runs: np.ndarray) -> np.ndarray:
        """Sums over boulders, (SUMS, runs, blocks or marks)."""
        kept = runs[:, : self.SUMS * self.n].reshape(len(runs), self.SUMS, self.n)
        return np.moveaxis(kept, 1, 0)

    def noise(self, boulders: float) -> float:
        """Variance of the log-likelihood due to the number of boulders in a run, to first order."""
        return self.noise_alone / self.worth
