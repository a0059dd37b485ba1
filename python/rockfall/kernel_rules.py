# SPDX-License-Identifier: BSD-3-Clause
"""Rules of the kernel shared by files, statistics and products."""

import numpy as np

from rockfall._core import rockfall_f2py as _core

ROOM = 2**14  # longer than any list of numbers


def kernel_numbers(name: str) -> np.ndarray:
    """Numerical constants of the kernel, by name."""
    values, n = _core.constants(name, ROOM)
    return values[:n]


Z = _core.constant("z_95")  # of a normal distribution, 95 % within
PIECE = int(_core.constant("piece"))  # values of a part or a scene with a common checksum
limit_ranks = _core.limit_ranks  # binomial interval of a quantile of n values
USUAL_DENSITY = _core.constant("usual_density")  # of boulders on tables of impacts [kg/m3]
USUAL_WEIGHT = _core.constant("usual_weight")  # [N/m3]
decimal = _core.decimal  # number in a text, as in all files; NaN if invalid
EAD_ENERGY = tuple(kernel_numbers("ead_energy").tolist())  # of barriers of classes 0 to 7 [J]
barrier_outcomes = _core.barrier_outcomes  # of a barrier with boulders that reach it
line_quantities = _core.line_quantities  # at a line: of motion (6, n), volumes and masses
points_along = _core.points_along  # a line, at distances
# Constants of samples (rockfall_samples):
SAMPLE_BINS = int(_core.constant("sample_bins"))
SAMPLE_COARSE = int(_core.constant("coarse_bins"))
SAMPLE_BITS = int(_core.constant("base_bits"))  # per digit of sums
SAMPLE_QUANTITIES = int(_core.constant("sample_quantities"))
SAMPLE_TAILS = int(_core.constant("sample_tails"))
SAMPLE_EDGES = kernel_numbers("sample_edges")  # of bins, in units
#: Units per unit of the quantity: (at lines, at ends; quantities).
SAMPLE_UNITS = kernel_numbers("sample_units").reshape(2, SAMPLE_QUANTITIES)


def fraction_limits(fraction: float, n: float) -> tuple[float, float]:
    """Limits of the 95 % interval of a fraction of n (Wilson 1927)."""
    low, high = _core.fraction_limits(fraction, n)
    return float(low[0]), float(high[0])


def count_limits(
    counts: np.ndarray, boulders: int, per_cluster: float | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Limits of the 95 % intervals of fractions of the boulders, computed by the kernel;
    `per_cluster` boulders count as one, everywhere or at each place (the last dimension)."""
    if np.ndim(per_cluster):
        columns = zip(np.moveaxis(counts, -1, 0), np.asarray(per_cluster), strict=True)
        limits = [count_limits(column, boulders, float(each)) for column, each in columns]
        low, high = np.array(limits).reshape(-1, 2, *np.shape(counts)[:-1]).swapaxes(0, 1)
        return np.moveaxis(low, 0, -1), np.moveaxis(high, 0, -1)
    low, high = _core.fraction_limits(np.ravel(counts) / boulders, boulders / per_cluster)
    return low.reshape(np.shape(counts)), high.reshape(np.shape(counts))
