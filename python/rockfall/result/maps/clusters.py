# SPDX-License-Identifier: BSD-3-Clause
"""Boulders that count as a single observation in the confidence intervals of map cells."""

import numpy as np

from rockfall.case import Case


def boulders_per_cluster(case: Case, x: np.ndarray, y: np.ndarray) -> int:
    """Number of boulders from these places that count as a single observation in a map cell. With
    sampled sources, boulders from a place may behave alike, which maps do not record: the number is
    the largest number released at a place. With fixed sources it is 1."""
    if case.release["sources"] != "sample" or not len(x):
        return 1
    import pandas as pd

    return int(np.bincount(pd.factorize(x + 1j * y)[0]).max())
