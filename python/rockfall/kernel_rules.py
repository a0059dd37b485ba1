# SPDX-License-Identifier: BSD-3-Clause
"""Rules and constants of the kernel that files, statistics and products share."""

import numpy as np

from rockfall._core import rockfall_f2py as _core

ROOM = 2**14  # exceeds the length of every list of constants


def kernel_numbers(name: str) -> np.ndarray:
    """Numerical constants in the kernel's list with this name."""
    values, n = _core.constants(name, ROOM)
    return values[:n]


Z = _core.constant("z_95")  # two-sided 95 % quantile of the normal distribution
PIECE = int(_core.constant("piece"))  # values per checksum in parts and scenes
limit_ranks = _core.limit_ranks  # order statistics that limit the 95 % interval of a quantile
USUAL_DENSITY = _core.constant("usual_density")  # boulder density on impact tables [kg/m3]
USUAL_WEIGHT = _core.constant("usual_weight")  # unit weight of boulders on impact tables [N/m3]
decimal = _core.decimal  # parse a number as in all input files; NaN if invalid
EAD_ENERGY = tuple(kernel_numbers("ead_energy").tolist())  # barrier classes 0 to 7 [J]
barrier_outcomes = _core.barrier_outcomes  # outcomes of boulders that reach a barrier
line_quantities = _core.line_quantities  # arguments: motion (n, 6), volumes, masses
points_along = _core.points_along  # points on a line at given distances
# Constants of the sample sums (rockfall_samples):
SAMPLE_BINS = int(_core.constant("sample_bins"))
SAMPLE_COARSE = int(_core.constant("coarse_bins"))
SAMPLE_BITS = int(_core.constant("base_bits"))  # bits in a digit of the sums
SAMPLE_QUANTITIES = int(_core.constant("sample_quantities"))
SAMPLE_TAILS = int(_core.constant("sample_tails"))
SAMPLE_EDGES = kernel_numbers("sample_edges")  # bin edges, in stored units
#: Stored units per unit of the quantity, for (lines, ends) and each quantity.
SAMPLE_UNITS = kernel_numbers("sample_units").reshape(2, SAMPLE_QUANTITIES)


def fraction_limits(fraction: float, n: float) -> tuple[float, float]:
    """Limits of the 95 % interval of a fraction observed in n trials (Wilson 1927)."""
    low, high = _core.fraction_limits(fraction, n)
    return float(low[0]), float(high[0])


def count_limits(
    counts: np.ndarray, boulders: int | np.ndarray, per_cluster: float | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Limits (low, high) of the 95 % intervals of `counts` / `boulders`, in the shape of `counts`.
    `per_cluster` boulders count as one observation. `boulders` and `per_cluster` are numbers, or
    arrays along the last dimension of `counts`."""
    if np.ndim(per_cluster) or np.ndim(boulders):
        sizes = (np.broadcast_to(size, np.shape(counts)[-1:]) for size in (boulders, per_cluster))
        columns = zip(np.moveaxis(counts, -1, 0), *sizes, strict=True)
        limits = [count_limits(column, int(n), float(each)) for column, n, each in columns]
        low, high = np.array(limits).reshape(-1, 2, *np.shape(counts)[:-1]).swapaxes(0, 1)
        return np.moveaxis(low, 0, -1), np.moveaxis(high, 0, -1)
    low, high = _core.fraction_limits(np.ravel(counts) / boulders, boulders / per_cluster)
    return low.reshape(np.shape(counts)), high.reshape(np.shape(counts))
