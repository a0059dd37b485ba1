# SPDX-License-Identifier: BSD-3-Clause
"""Random relief for synthetic slopes."""

import numpy as np

SMOOTHING = 1.5  # standard deviation of the Gaussian filter [cells]


def relief(seed: int, cells: tuple[int, int], std: float) -> np.ndarray:
    """Gaussian-filtered white noise [m] with standard deviation `std`, on (rows, columns) of
    `cells`; identical in all NumPy versions."""
    margin = 8  # more than five standard deviations of the filter, which avoids edge effects
    shape = cells[0] + 2 * margin, cells[1] + 2 * margin
    raw = np.random.Philox(key=seed).random_raw(shape[0] * shape[1])
    noise = raw.reshape(shape) / 2.0**64 - 0.5
    weight = np.exp(-0.5 * (np.arange(-margin, margin + 1) / SMOOTHING) ** 2)
    for axis in 0, 1:
        noise = np.apply_along_axis(np.convolve, axis, noise, weight, mode="valid")
    return std * (noise - noise.mean()) / noise.std()
