# SPDX-License-Identifier: BSD-3-Clause
"""Relief of a ground: random surfaces with a given spectrum, spectrum of a measured patch."""

from dataclasses import dataclass

import numpy as np

from rockfall.errors import RockfallError
from rockfall.grounds.random_numbers import Uniform

CELLS = 512  # cells along a side of a patch
CELLS_OF_WAVE = 16  # cells per shortest wave of a generated patch
WAVES_OF_PATCH, CELLS_OF_MEASURED_WAVE = (
    4,
    4,
)  # minima of a measured patch
WINDOWED = 35 / 18  # waves per independent wave in a Hann window, along each axis
RINGS = 12  # rings of wavenumbers for the fit of the Hurst exponent
QUANTUM = 2.0**-20  # rounding of heights [R_b], because the last bits of FFTs differ


@dataclass(frozen=True)
class Spectrum:
    """Isotropic random surface whose power decreases as wavenumber**(-2 - 2 hurst) between two
    wavelengths (in units of the block radius R_b). `slope` is the standard deviation of the slope
    along a line [degree]; 0 is flat ground."""

    slope: float
    shortest: float = 2.0
    longest: float = 16.0
    hurst: float = 0.8


def patches(spectrum: Spectrum, count: int, seed: int) -> tuple[np.ndarray, float]:
    """Heights (CELLS, CELLS, count; flat: 1, 1, 1) and width of periodic patches, in R_b."""
    if spectrum.slope == 0:
        return np.zeros((1, 1, 1)), 1.0
    width = spectrum.shortest * CELLS / CELLS_OF_WAVE
    return np.stack([_patch(spectrum, width, seed, k) for k in range(count)], axis=-1), width


def _patch(spectrum: Spectrum, width: float, seed: int, number: int) -> np.ndarray:
    """Heights (CELLS, CELLS) in R_b: filtered white noise, scaled so that the standard deviation of
    its slope is exact."""
    wave = np.fft.fftfreq(CELLS, width / CELLS)  # cycles per R_b
    square = wave[:, None] ** 2 + wave[None, :] ** 2
    inside = (square >= spectrum.longest**-2) & (square <= spectrum.shortest**-2)
    gain = np.zeros_like(square)
    gain[inside] = square[inside] ** (-0.5 - 0.5 * spectrum.hurst)
    noise = Uniform(seed, number).between(-1, 1, (CELLS, CELLS))
    spectrum_of_noise = gain * np.fft.fft2(noise)
    # Mean square slope along x, by Parseval's theorem.
    power = np.abs(spectrum_of_noise) ** 2 * square / 2
    slope = 2 * np.pi * np.sqrt(power.sum()) / CELLS**2
    heights = np.fft.ifft2(spectrum_of_noise).real * np.tan(np.radians(spectrum.slope)) / slope
    return np.round(heights / QUANTUM) * QUANTUM


def slope_between(spectrum: Spectrum, band: Spectrum) -> float:
    """Slope [degree] of a surface in another band of wavelengths, extrapolated by its Hurst
    exponent."""

    def variance(waves: Spectrum) -> float:
        """Integral of wavenumber**(1 - 2 hurst) over a band."""
        low, high, power = 1 / waves.longest, 1 / waves.shortest, 2 - 2 * spectrum.hurst
        if abs(power) < 1e-6:
            return float(np.log(high / low))
        return (high**power - low**power) / power

    tangent = np.tan(np.radians(spectrum.slope)) * np.sqrt(variance(band) / variance(spectrum))
    return float(np.degrees(np.arctan(tangent)))


def measure(
    heights: np.ndarray, cell: float, radius: float, band: Spectrum, name: str
) -> tuple[Spectrum, float]:
    """Spectrum of measured heights (rows, columns) [m] in square cells [m] within a band of
    wavelengths, for blocks of radius R_b [m]; and the standard error of its slope [degree], from
    the number of independent waves in the patch.

    A patch with missing heights, smaller than four times the longest wavelength, or too coarse for
    the shortest, raises a RockfallError; `name` is the file name for messages. The power is
    computed with a Hann window, after removing the best-fitting plane.
    """
    if not np.isfinite(heights).all():
        raise RockfallError(f"{name}: has cells without an elevation: cut out a complete patch")
    shortest, longest = band.shortest * radius, band.longest * radius
    side = min(heights.shape) * cell
    if longest > side / WAVES_OF_PATCH:
        raise RockfallError(
            f"{name}: {side:.4g} m wide: waves of {longest:.4g} m ({band.longest:g} R_b) need "
            f"{WAVES_OF_PATCH * longest:.4g} m: use --longest {side / WAVES_OF_PATCH / radius:.3g}"
        )
    if shortest < CELLS_OF_MEASURED_WAVE * cell:
        least = CELLS_OF_MEASURED_WAVE * cell
        raise RockfallError(
            f"{name}: cells of {cell:.4g} m: waves of {shortest:.4g} m ({band.shortest:g} R_b) "
            f"need {shortest / CELLS_OF_MEASURED_WAVE:.4g} m: use --shortest {least / radius:.3g}"
        )
    y, x = np.indices(heights.shape)
    terms = np.column_stack([x.ravel(), y.ravel(), np.ones(heights.size)])
    plane = terms @ np.linalg.lstsq(terms, heights.ravel(), rcond=None)[0]
    window = np.outer(*(np.hanning(n + 2)[1:-1] for n in heights.shape))
    noise = (heights - plane.reshape(heights.shape)) * window
    power = np.abs(np.fft.fft2(noise)) ** 2 / (window**2).sum() / heights.size
    wave = np.hypot(*np.meshgrid(*(np.fft.fftfreq(n, cell) for n in heights.shape), indexing="ij"))
    inside = (wave >= 1 / longest) & (wave <= 1 / shortest)
    squares = (power * (2 * np.pi * wave) ** 2)[inside]
    slope = np.sqrt(squares.sum() / 2)
    # Powers are exponentially distributed, so their mean square is twice the squared mean. Each
    # wave occurs with both signs, and the window correlates neighbours.
    variance = WINDOWED**2 * (squares**2).sum() / max(squares.sum(), 1e-300) ** 2
    error = np.degrees(slope / (1 + slope**2)) * np.sqrt(variance) / 2
    edges = np.geomspace(1 / longest, 1 / shortest, RINGS + 1)
    ring = np.digitize(wave[inside], edges[1:-1])
    cells = np.bincount(ring, minlength=RINGS)
    mean = np.bincount(ring, power[inside], RINGS)[cells > 0] / cells[cells > 0]
    middle = np.bincount(ring, wave[inside], RINGS)[cells > 0] / cells[cells > 0]
    fall = 0.0 if not slope > 0 else np.polyfit(np.log(middle), np.log(mean), 1)[0]
    hurst = float(np.clip(-1 - fall / 2, 0, 2))
    angle = float(np.degrees(np.arctan(slope)))
    return Spectrum(angle, band.shortest, band.longest, hurst), float(error)
