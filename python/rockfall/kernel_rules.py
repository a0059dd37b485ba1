# SPDX-License-Identifier: BSD-3-Clause
"""Rules of the kernel that files, statistics and products share."""

from rockfall._core import rockfall_f2py as _core

Z = _core.constant("z_95")  # of a normal distribution, 95 % within
PIECE = int(_core.constant("piece"))  # values of a part or a scene that share a checksum
limit_ranks = _core.limit_ranks  # of the interval of a quantile of n values (binomial)
USUAL_DENSITY = _core.constant("usual_density")  # of boulders on tables of impacts [kg/m3]
USUAL_WEIGHT = _core.constant("usual_weight")  # [N/m3]
decimal = _core.decimal  # number that a text spells, as in all files; NaN if none
EAD_ENERGY = tuple(_core.ead_energies().tolist())  # of barriers of classes 0 to 7 [J]
barrier_outcomes = _core.barrier_outcomes  # of a barrier with boulders that reach it
line_quantities = _core.line_quantities  # at a line: of motion (6, n), volumes and masses
points_along = _core.points_along  # a line, at distances
# Of samples (rockfall_samples):
SAMPLE_BINS = int(_core.constant("sample_bins"))
SAMPLE_COARSE = int(_core.constant("coarse_bins"))
SAMPLE_BITS = int(_core.constant("base_bits"))  # per digit of sums
SAMPLE_QUANTITIES = int(_core.constant("sample_quantities"))
SAMPLE_TAILS = int(_core.constant("sample_tails"))
SAMPLE_EDGES = _core.sample_edges(SAMPLE_BINS + 1)  # of bins, in units
#: Units in one of the quantity: (at lines, at ends; quantities).
SAMPLE_UNITS = _core.sample_units(SAMPLE_QUANTITIES).T


def fraction_limits(fraction: float, n: float) -> tuple[float, float]:
    """Limits of the 95 % interval of a fraction of n (Wilson 1927)."""
    low, high = _core.fraction_limits(fraction, n)
    return float(low[0]), float(high[0])
