# SPDX-License-Identifier: BSD-3-Clause
"""Uniform random numbers that do not depend on the NumPy version: raw Philox words."""

import numpy as np


class Uniform:
    """Random numbers that depend only on the seed and a stream number."""

    def __init__(self, seed: int, stream: int) -> None:
        self._bits = np.random.Philox(key=seed, counter=[0, 0, 0, stream])

    def between(self, low: float, high: float, shape: int | tuple[int, ...]) -> np.ndarray:
        """Array of uniform numbers between two limits."""
        n = int(np.prod(shape))
        return low + (high - low) * (self._bits.random_raw(n) / 2.0**64).reshape(shape)

    def directions(self, n: int) -> np.ndarray:
        """Unit vectors (n, 3), uniformly distributed on the sphere."""
        vectors = np.empty((0, 3))
        while len(vectors) < n:
            points = self.between(-1, 1, (4 * n, 3))
            inside = points[(points**2).sum(axis=1) <= 1]
            vectors = np.vstack([vectors, inside])[:n]
        return vectors / np.linalg.norm(vectors, axis=1)[:, None]
