# SPDX-License-Identifier: BSD-3-Clause
"""Likelihood of blocks mapped at rest, given the boulders at rest of a run.

Each block has the predictive density of `rockfall.analysis.observed.deposits` at its position. In
the underlying urn model, earlier blocks count like simulated boulders; as the order of the blocks
is arbitrary, half of the other blocks count. With bins instead of kernels, the product over the
blocks is then the Dirichlet-multinomial probability of `rockfall.studies.back.evidence` (midpoint
rule). With few boulders the density is uncertain, and adjacent blocks are not independent evidence.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from rockfall.analysis.observed.deposits import (
    ANYWHERE,
    Blocks,
    Kernel,
    Rest,
    at_rest,
    fitted_kernel,
    kernel_sums,
    kernel_values,
    kernel_widths,
    log_densities_again,
    outside,
)
from rockfall.analysis.observed.run_out import Starts, starts
from rockfall.quantities import count, number
from rockfall.studies.back.witnesses import Witnesses, worth_of

HALF = 0.5  # fraction of the other blocks that count


@dataclass
class Deposited(Witnesses):
    """Blocks at rest by source, with sums of kernels, squares and weights."""

    SUMS, AGAIN = 3, 4

    sets: list[Blocks]
    kernels: list[Kernel]
    widths: list[np.ndarray]  # kernel widths at the blocks [m]
    name: str = "blocks at rest"
    #: Sums of kernels and weights over half of the other blocks, by set.
    own: list[tuple[np.ndarray, np.ndarray]] = field(init=False)

    def __post_init__(self) -> None:
        kept_sets = zip(self.kernels, self.sets, self.widths, strict=True)
        self.own = [_others(*arguments) for arguments in kept_sets]

    @classmethod
    def of_run(cls, sets: list[Blocks], base: xr.Dataset, cell: float) -> Deposited:
        """Blocks with kernels from the boulders of a run."""
        origins = _starts(base, sets)
        rests = [at_rest(base, impact_set, origins) for impact_set in sets]
        kernels = [fitted_kernel(*pair, cell) for pair in zip(sets, rests, strict=True)]
        widths = [_widths_at(*arguments) for arguments in zip(kernels, sets, rests, strict=True)]
        noise = sum(map(_noise, kernels, sets, rests, widths))
        return cls(sets, kernels, widths, noise_alone=noise)

    @property
    def n(self) -> int:
        return sum(len(impact_set.place) for impact_set in self.sets)

    def kept(self, result: xr.Dataset) -> np.ndarray:
        origins, random = _starts(result, self.sets), np.random.default_rng(0)
        sums, again = [], np.zeros(self.AGAIN)
        for kernel, blocks in zip(self.kernels, self.sets, strict=True):
            rest = at_rest(result, blocks, origins)
            sums.append(np.array(kernel_sums(kernel, blocks, rest)))
            again += log_densities_again(kernel, blocks, rest, self.AGAIN, random)
        return np.concatenate([np.concatenate(sums, axis=1).ravel(), again])

    def log_likelihood(self, runs: np.ndarray) -> np.ndarray:
        near, _, boulders = self._sums(runs)
        others = np.concatenate([np.array(overlap) for overlap in self.own], axis=1)
        counts = self.worth * np.array([near, boulders]) + others[:, None]
        return np.log((counts[0] + self._floor) / (counts[1] + ANYWHERE)).sum(axis=1)

    @property
    def _floor(self) -> np.ndarray:
        pairs = zip(self.kernels, self.sets, strict=True)
        return np.concatenate([np.full(len(block.place), kernel.floor) for kernel, block in pairs])

    def learn_noise(self, runs: np.ndarray) -> None:
        """Set the weight of a simulated boulder, from repeated runs with equal inputs."""
        near, squares, boulders = self._sums(runs)
        part = near / np.maximum(boulders, 1)
        expected = (squares / np.maximum(boulders, 1) - part**2) / np.maximum(boulders, 1)
        scale = np.maximum(part.mean(axis=0), self._floor / np.maximum(boulders.mean(axis=0), 1))
        variance = (part.var(axis=0, ddof=1) / scale**2).sum()
        times = variance / max((expected.mean(axis=0) / scale**2).sum(), 1e-12)
        self.worth = worth_of(times)

    def discrepancy(
        self, runs: np.ndarray, picked: np.ndarray, weight: np.ndarray, random: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Negative log-densities of the blocks, and of an equal number of boulders from the same
        run: parameter-dependent discrepancies (Gelman, Meng and Stern 1996)."""
        near, _, boulders = self._sums(runs[picked])
        densities = np.log((near + self._floor) / (boulders + ANYWHERE)).sum(axis=1)
        which = random.integers(self.AGAIN, size=picked.size)
        return -densities, -runs[picked, runs.shape[1] - self.AGAIN + which]

    def remarks(self, runs: np.ndarray, weight: np.ndarray) -> list[str]:
        """Remarks on blocks outside the deposits of all weighted runs, and on kernel widths."""
        near = weight @ self._sums(runs)[0]
        first, notes = 0, []
        for kernel, blocks, widths in zip(self.kernels, self.sets, self.widths, strict=True):
            last = first + len(blocks.place)
            far = np.flatnonzero(outside(kernel, near[first:last]))
            place = f" of source {blocks.source}" if blocks.source else ""
            text = (
                f"{count(last - first, 'block')} at rest{place}: kernels are as wide as the "
                f"{number(kernel.neighbours)} nearest of {kernel.boulders:,} boulders, "
                f"{number(np.median(widths))} m there"
            )
            lost = f": {far.size} outside of all deposits" if far.size else ""
            where = ", ".join(f"{x:.0f} {y:.0f}" for x, y in blocks.place[far[:5]])
            notes.append(f"{text}{lost}{f' (x y: {where})' if where else ''}.")
            first = last
        return notes


def _starts(result: xr.Dataset, sets: list[Blocks]) -> Starts | None:
    """Release groups of a result; None if no block has a known source."""
    return starts(result) if any(impact_set.source for impact_set in sets) else None


def _widths_at(kernel: Kernel, blocks: Blocks, rest: Rest) -> np.ndarray:
    """Kernel width [m] of the boulder nearest to each block."""
    from scipy.spatial import KDTree

    return kernel_widths(kernel, rest)[0][KDTree(rest.place).query(blocks.place)[1]]


def _others(kernel: Kernel, blocks: Blocks, widths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each block, half of the sums of kernels, and of weights, over the other blocks."""
    both = kernel_values(kernel, blocks, Rest(blocks.place, blocks.volume, blocks.shape), widths)
    for overlap in both:
        np.fill_diagonal(overlap, 0.0)
    return HALF * both[1].sum(axis=1), HALF * both[0].sum(axis=1)


def _noise(kernel: Kernel, blocks: Blocks, rest: Rest, widths: np.ndarray) -> float:
    """Variance of the log-likelihood due to sampling boulders, to first order (delta method)."""
    own_near, own_count = _others(kernel, blocks, widths)
    alike, near = kernel_values(kernel, blocks, rest, kernel_widths(kernel, rest)[0])
    influence = near / (near.sum(axis=1) + own_near + kernel.floor)[:, None]
    influence -= alike / (alike.sum(axis=1) + own_count + ANYWHERE)[:, None]
    return float(len(rest.place) * influence.sum(axis=0).var())
