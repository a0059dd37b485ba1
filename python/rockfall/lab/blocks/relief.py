# SPDX-License-Identifier: BSD-3-Clause
"""Relief of a ground: random surfaces of a given spectrum, and the spectrum of a measured patch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rockfall.lab.blocks.random import Uniform

CELLS = 512  # along a patch's side
CELLS_OF_WAVE = 16  # along the shortest wave
QUANTUM = 2.0**-20  # heights are rounded to it, of R_b: an FFT's last bits differ between libraries


@dataclass(frozen=True)
class Spectrum:
    """An isotropic random surface whose power falls as wave number**(-2 - 2 hurst) between two wave
    lengths (over R_b, the block's radius), with the standard deviation of its slope along a line
    [degree]; slope 0 is flat ground."""

    slope: float
    shortest: float = 2.0
    longest: float = 16.0
    hurst: float = 0.8


def patches(spectrum: Spectrum, count: int, seed: int) -> tuple[np.ndarray, float]:
    """Heights (CELLS, CELLS, count) of periodic patches and their width, over R_b."""
    if spectrum.slope == 0:
        return np.zeros((1, 1, 1)), 1.0
    width = spectrum.shortest * CELLS / CELLS_OF_WAVE
    return np.stack([_patch(spectrum, width, seed, k) for k in range(count)], axis=-1), width


def _patch(spectrum: Spectrum, width: float, seed: int, number: int) -> np.ndarray:
    """White noise, filtered; scaled so that the slope has just its standard deviation."""
    wave = np.fft.fftfreq(CELLS, width / CELLS)  # cycles per R_b
    square = wave[:, None] ** 2 + wave[None, :] ** 2
    inside = (square >= spectrum.longest**-2) & (square <= spectrum.shortest**-2)
    gain = np.zeros_like(square)
    gain[inside] = square[inside] ** (-0.5 - 0.5 * spectrum.hurst)
    noise = Uniform(seed, number).between(-1, 1, (CELLS, CELLS))
    spectrum_of_noise = gain * np.fft.fft2(noise)
    # mean square of the slope along x, by Parseval
    power = np.abs(spectrum_of_noise) ** 2 * square / 2
    slope = 2 * np.pi * np.sqrt(power.sum()) / CELLS**2
    heights = np.fft.ifft2(spectrum_of_noise).real * np.tan(np.radians(spectrum.slope)) / slope
    return np.round(heights / QUANTUM) * QUANTUM
