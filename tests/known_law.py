# SPDX-License-Identifier: BSD-3-Clause
"""Boulders with lognormal speeds of known parameters, some of which cross a line, and runs that end
by a rule."""

import numpy as np
import xarray as xr
from scipy.stats import norm

from crossed import crossed
from rockfall.kernel_rules import Z
from rockfall.studies.run_until import FIRST, evaluate, next_stage

SHARE, SIGMA = 0.6, 0.4  # fraction of boulders that cross, and parameter of their lognormal speeds


SAMPLE = {  # attributes of a result with sampled sources
    "case": "&case boulders = 1 / &terrain dem = 'd' / &surface uniform_mean_radius = 1.0 / "
    "&boulder volume_mean = 1.0 / &release x = 0.0, y = 0.0, sources = 'sample' / &impact /",
    "case_file": "made",
}


def made(values, source=None, attrs=None):
    """Result in which boulders of 1 m3 and 1 kg cross a line at the speeds `values` [m/s]; NaN is
    for no crossing."""
    source = np.zeros(values.size, int) if source is None else source
    start = source.astype(float)
    one, number = np.ones(values.size), np.arange(values.size)
    data = {"boulder": number, "start_x": start, "start_y": 0 * start, "source": source,
            "volume": one, "mass": one}  # fmt: skip
    data = {name: ("boulder", of) for name, of in data.items()}
    return xr.Dataset(data | crossed(number, speed=values), attrs=attrs)


def lognormal(random, n):
    values = np.exp(random.normal(0, SIGMA, n))
    return np.where(random.random(n) < SHARE, values, np.nan)


def theory(statistic: str, limit: float) -> tuple[float, float]:
    """True value of a statistic, and the number of boulders for which the half width of its
    interval is `limit` times the value."""
    w, scale = np.exp(SIGMA**2), (Z / limit) ** 2 / SHARE
    if statistic == "fraction":
        return SHARE, scale * (1 - SHARE)
    if statistic == "mean":
        return np.sqrt(w), scale * (w - 1)
    if statistic == "std":
        kurtosis = w**4 + 2 * w**3 + 3 * w**2 - 3
        return np.sqrt(w * (w - 1)), scale * (kurtosis - 1) / 4
    share = int(statistic[1:]) / 100
    z = norm.ppf(share)
    return np.exp(SIGMA * z), scale * share * (1 - share) * (SIGMA / norm.pdf(z)) ** 2


def stages(rules, random, draw=lognormal, cap=10**7):
    """Run in stages, with values of boulders from `draw`, until the rules are met or `cap` boulders
    are run; return the last result."""
    n, values = min(FIRST, cap), np.empty(0)
    while True:
        values = np.concatenate([values, draw(random, n - values.size)])
        larger = next_stage(evaluate(rules, made(values)), n, cap)
        if larger == n:
            return made(values)
        n = larger
