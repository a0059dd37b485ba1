# SPDX-License-Identifier: BSD-3-Clause
"""Likelihood of impact marks at known heights, given the boulders of a run that pass there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from rockfall.analysis.observed.deposits import ANYWHERE
from rockfall.analysis.observed.marks import (
    Heights,
    Mark,
    fitted_heights,
    height_sums,
    log_density,
    log_reach,
    passing_at,
)
from rockfall.quantities import count
from rockfall.studies.back.witnesses import Witnesses, worth_of

FEW = 20  # a mark that fewer boulders pass gets a remark


@dataclass
class Marked(Witnesses):
    """Marks with their lines in the case. Data kept from a run: for each mark, sums of kernels,
    their squares and distribution functions, and the number of boulders that pass; then AGAIN
    log-densities of all marks, and AGAIN log-densities of simulated hits in their place."""

    SUMS, AGAIN = 4, 8

    marks: list[Mark]
    kernels: list[Heights]
    boulders: int  # number of boulders in a run
    name: str = "marks"

    @classmethod
    def of_run(cls, marks: list[Mark], base: xr.Dataset) -> Marked:
        """Marks with kernels from the boulders of a run."""
        passing = [passing_at(base, mark) for mark in marks]
        every = [mark.height for mark in marks]
        greatest = max([*every, *(crossing.heights.max(initial=0.0) for crossing in passing)])
        kernels = [fitted_heights(*pair, greatest) for pair in zip(marks, passing, strict=True)]
        data = cls(marks, kernels, base.sizes["boulder"])
        near, squares, _, crossed = data._sums(data.kept(base)[None])[:, 0]
        n = np.maximum(crossed, 1)
        scale = (near + ANYWHERE / kernels[0].top) / n
        data.noise_alone = float(((squares / n - (near / n) ** 2) / (n * scale**2)).clip(0).sum())
        return data

    @property
    def n(self) -> int:
        return len(self.marks)

    def kept(self, result: xr.Dataset) -> np.ndarray:
        random, sums, again = np.random.default_rng(0), [], np.zeros((2, Marked.AGAIN))
        for mark, kernel in zip(self.marks, self.kernels, strict=True):
            heights = passing_at(result, mark).heights
            near, squares, below = height_sums(kernel, mark.height, heights)
            sums.append([near, squares, below, heights.size])
            again += _again(mark, kernel, heights, near, below, random)
        return np.concatenate([np.array(sums).T.ravel(), again.ravel()])

    def log_likelihood(self, runs: np.ndarray) -> np.ndarray:
        near, _, below, crossed = self._sums(runs)
        likelihood = np.zeros(len(runs))
        for k, (mark, kernel) in enumerate(zip(self.marks, self.kernels, strict=True)):
            a, b, n = (self.worth * sums[:, k] for sums in (near, below, crossed))
            likelihood += log_density(a, b, n, mark, kernel.top)
            likelihood += log_reach(crossed[:, k], self.boulders)
        return likelihood

    def learn_noise(self, runs: np.ndarray) -> None:
        """Set the weight of a simulated boulder, from repeated runs with equal inputs."""
        near, squares, _, crossed = self._sums(runs)
        n = np.maximum(crossed, 1)
        part = near / n
        expected = ((squares / n - part**2) / n).mean(axis=0)
        is_possible = (expected > 0) & (part.mean(axis=0) > 0)
        if is_possible.any():
            scale = part.mean(axis=0)[is_possible] ** 2
            times = (part.var(axis=0, ddof=1)[is_possible] / scale).sum() / (
                expected[is_possible] / scale
            ).sum()
            self.worth = worth_of(times)

    def discrepancy(
        self, runs: np.ndarray, picked: np.ndarray, weight: np.ndarray, random: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Negative log-densities of the marks, and of equally many simulated hits; marks that
        fewer than two boulders of the run pass are left out of both."""
        which = random.integers(Marked.AGAIN, size=picked.size)
        both = runs[:, -2 * Marked.AGAIN :].reshape(len(runs), 2, Marked.AGAIN)[picked, :, which]
        return -both[:, 0], -both[:, 1]

    def remarks(self, runs: np.ndarray, weight: np.ndarray) -> list[str]:
        """Notes on the boulders of the weighted runs that pass the marks, and on marks with few."""
        crossed = weight @ self._sums(runs)[3]
        notes = [f"{count(self.n, 'mark')}, {crossed.min():,.0f} to {crossed.max():,.0f} boulders "
                 "of a run pass there."]  # fmt: skip
        few = np.flatnonzero(crossed < FEW)
        if few.size:
            where = ", ".join(self.marks[k].where for k in few[:5].tolist())
            notes.append(
                f"At {few.size} of {count(self.n, 'mark')}, fewer than {FEW} boulders of a run "
                f"pass, so they hardly constrain the height: {where}."
            )
        return notes


def _again(
    mark: Mark,
    kernel: Heights,
    heights: np.ndarray,
    near: float,
    below: float,
    random: np.random.Generator,
) -> np.ndarray:
    """Log-densities (2, AGAIN) of a mark given the boulders, and of simulated hits given the other
    boulders; 0 for fewer than two boulders."""
    n = heights.size
    uniform = random.random((Marked.AGAIN, mark.hits))
    if n < 2:
        return np.zeros((2, Marked.AGAIN))
    chosen = (uniform * n).astype(int)
    highest = heights[chosen].max(axis=1)
    resampled = np.empty((2, Marked.AGAIN))
    resampled[0] = log_density(np.array(near), np.array(below), np.array(n), mark, kernel.top)
    for k, height in enumerate(highest.tolist()):
        sums = height_sums(kernel, height, np.delete(heights, int(np.argmax(heights == height))))
        hit = Mark("", mark.x, mark.y, height, hits=mark.hits)
        resampled[1, k] = log_density(
            np.array(sums[0]), np.array(sums[2]), np.array(n - 1.0), hit, kernel.top
        )
    return resampled
