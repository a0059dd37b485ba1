# SPDX-License-Identifier: BSD-3-Clause
"""Fit of an impact set to many impacts: means and covariances of a1..a9, with standard errors.

The trajectory model draws A ~ N(M, C) at every rebound (Bourrier et al. 2009, eqs 4 to 7),
repeatedly until V_out = A V_in leaves the surface and does not gain energy. For a given V_in, the
distribution of V_out is thus normal with mean M V_in and covariance X C X^T, truncated by
admissibility. M and C maximise the likelihood of the impacts under this distribution, by
expectation maximisation (Dempster, Laird & Rubin 1977); the missing data are the matrix of each
impact and the draws rejected before it. A normal distribution fitted first and truncated afterwards
would not have these moments. Noise e within an impact, V_out = A V_in + |V_in| e with covariance S,
gives the same distribution as C + S (x) I_3 and is thus included in the fit.

Impacts on one layer are not independent: standard errors omit groups of layers in turn (jackknife).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from rockfall.errors import RockfallError
from rockfall.scene.rebounds.kernel_rebounds import MIN_NORMAL, admissible
from rockfall_lab.sets.lateral import Lateral, fit_lateral, incidence
from rockfall_lab.spheres.experiment import ENDED, STATES, STATUS

if TYPE_CHECKING:
    import xarray as xr

GROUPS = 10  # groups of layers, omitted in turn
DRAWS = 64  # draws per impact, for the rejected rebounds
LEAPS = 60  # maximum number of iterations of three steps each
MIN_EIGENVALUE = 1e-9  # minimum over maximum, of a covariance after a leap
SETTLED = 5e-5  # change of every mean in a step at convergence
MIN_SCATTER = 1e-10  # squared scatter of V_out / |V_in| due to rounding
MIN_IMPACTS = 60  # with fewer impacts, mean and scatter cannot be separated


@dataclass(frozen=True)
class ImpactSet:
    """Mean (9,) and covariance (9, 9) of a1..a9, with standard errors and origin."""

    mean: np.ndarray
    covariance: np.ndarray
    mean_error: np.ndarray
    covariance_error: np.ndarray
    impacts: int
    redrawn: float  # mean number of rejected draws per rebound
    lateral: Lateral | None = None  # if lateral deviations are known
    error_covariance: np.ndarray | None = None  # covariance (9, 9) of the errors of the means
    speed_range: tuple[float, float] | None = None  # range of incident speeds [m/s]
    angle_range: tuple[float, float] | None = None  # range of incidence angles [degree]


@dataclass(frozen=True)
class Impacts:
    """Data for the fit of a set: V_in and V_out (n, 3) [m/s], layer or run of each impact (n,), and
    absolute lateral deviation (n,) [degrees], NaN if unknown."""

    v_in: np.ndarray
    v_out: np.ndarray
    group: np.ndarray
    lateral: np.ndarray | None = None

    def some(self, these: np.ndarray) -> Impacts:
        """Impacts for which the mask `these` (n,) is true."""
        lateral = None if self.lateral is None else self.lateral[these]
        return Impacts(self.v_in[these], self.v_out[these], self.group[these], lateral)


def as_rebounds(impacts: Impacts) -> Impacts:
    """Impacts as rebounds of the model. Normal velocities after the impact are at least MIN_NORMAL
    of the incident speed, as in forced rebounds. Impacts that gained energy by falling into the
    layer, or did not approach it, are omitted."""
    speed = np.sqrt((impacts.v_in[:, :2] ** 2).sum(axis=1))
    v_out = impacts.v_out.copy()
    v_out[:, 1] = np.maximum(v_out[:, 1], MIN_NORMAL * speed)
    kept = admissible(impacts.v_in, v_out) & (impacts.v_in[:, 1] < 0)
    return replace(impacts, v_out=v_out).some(kept)


def impacts_of(data: xr.Dataset, ratio: float, state: str = "peak") -> Impacts:
    """Completed impacts at a ratio, in one of the three recorded states. Raises a RockfallError for
    other states."""
    if state not in STATES:
        raise RockfallError(f"state {state!r}: must be one of {', '.join(STATES)}")
    impacts = data.sel(ratio=ratio)
    ended = np.isin(impacts["status"].values, [STATUS[name] for name in ENDED])
    layer = np.broadcast_to(np.arange(ended.shape[0])[:, None, None], ended.shape)

    def velocity(when: str) -> np.ndarray:
        return np.stack([impacts[f"{v}_{when}"].values[ended] for v in ("vt", "vn", "w")], axis=1)

    sine = np.minimum(np.abs(impacts[f"lateral_{state}"].values[ended]), 1)
    lateral = np.degrees(np.arcsin(sine))
    return Impacts(velocity("in"), velocity(state), layer[ended], lateral)


def fit_impacts(data: xr.Dataset, state: str = "peak") -> dict[int, ImpactSet]:
    """Fit the sets for all ratios. Raises a RockfallError for a ratio other than 1, 2, 3, 4 or 5,
    or if a set cannot be fitted."""
    sets = {}
    for ratio in data["ratio"].values:
        if ratio != int(ratio) or not 1 <= ratio <= 5:
            raise RockfallError(f"R_b/R_m = {ratio:g}: a set has a ratio of 1, 2, 3, 4 or 5")
        sets[int(ratio)] = fit_set(as_rebounds(impacts_of(data, ratio, state)))
    return sets


def within_points(data: xr.Dataset, ratio: float, state: str = "peak") -> np.ndarray:
    """Covariance (3, 3) of V_out/|V_in| within points, about each point's least-squares map: the
    noise of an impact, assumed equal for all points. Raises a RockfallError if no point has 4
    impacts."""
    impacts = data.sel(ratio=ratio)
    ended = np.isin(impacts["status"].values, [STATUS[name] for name in ENDED])
    total, freedom = np.zeros((3, 3)), 0
    for layer, point in np.ndindex(ended.shape[:2]):
        rows = ended[layer, point]
        at = impacts.isel(layer=layer, point=point)
        v_in, v_out = (
            np.stack([at[f"{v}_{when}"].values[rows] for v in ("vt", "vn", "w")], axis=1)
            for when in ("in", state)
        )
        if rows.sum() <= 3:
            continue
        length = np.sqrt((v_in**2).sum(axis=1, keepdims=True))
        x, y = v_in / length, v_out / length
        error = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
        total += error.T @ error
        freedom += len(x) - 3
    if not freedom:
        raise RockfallError("too few impacts at a point to tell their noise: at least 4 are needed")
    return total / freedom


def fit_set(impacts: Impacts, groups: int = GROUPS) -> ImpactSet:
    """Fit M and C by maximum likelihood, with standard errors from `groups` groups of layers (NaN
    without groups).

    The result is bitwise independent of the number of threads. Raises a RockfallError for too few
    impacts, incident velocities that are too similar, and impacts without scatter.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, "blas"):  # more threads would change the order of summation
        return _fit_set(impacts, groups)


def _fit_set(impacts: Impacts, groups: int) -> ImpactSet:
    x, y = _directions(impacts)
    if len(x) < MIN_IMPACTS:
        raise RockfallError(f"{len(x)} impacts: at least {MIN_IMPACTS} are needed for a set")
    if np.linalg.cond(x.T @ x / len(x)) > 1e4:
        raise RockfallError("the incident velocities are too much alike to tell a map from them")
    if np.linalg.eigvalsh(_about_one_map(x, y)[1]).min() < MIN_SCATTER:
        raise RockfallError("the outgoing velocities do not scatter about one map of the incident")
    # equal random numbers in every step, for convergence
    z = np.random.default_rng(1).standard_normal((len(x), DRAWS, 3))
    mean, covariance, redrawn = _likeliest(x, y, z, np.ones(len(x)))
    kinds, group = np.unique(impacts.group, return_inverse=True)
    parts = min(groups, len(kinds))
    lateral = None if impacts.lateral is None else fit_lateral(impacts.v_in, impacts.lateral)
    ranges = _ranges(impacts.v_in)
    if not parts:
        unknown = np.full(9, np.nan), np.full((9, 9), np.nan)
        return ImpactSet(mean, covariance, *unknown, len(x), redrawn, lateral, None, *ranges)
    means, covariances = [], []
    for part in range(parts):
        weight = (group % parts != part).astype(float)
        optimum = _likeliest(x, y, z, weight, (mean, covariance))
        means.append(optimum[0])
        covariances.append(optimum[1])
    errors = (np.sqrt((parts - 1) * np.var(drawn, axis=0)) for drawn in (means, covariances))
    mean_error, covariance_error = errors
    together = (parts - 1) * np.cov(np.transpose(means), bias=True)
    return ImpactSet(
        mean, covariance, mean_error, covariance_error, len(x), redrawn, lateral, together, *ranges
    )


def _ranges(v_in: np.ndarray) -> list[tuple[float, float]]:
    """Minimum and maximum speed [m/s] and incidence angle [degree]."""
    both = np.hypot(v_in[:, 0], v_in[:, 1]), incidence(v_in)
    return [(float(values.min()), float(values.max())) for values in both]


def _directions(impacts: Impacts) -> tuple[np.ndarray, np.ndarray]:
    """V_in and V_out divided by the length of V_in: the model is linear in speed, so scatter is
    proportional to speed. Refuses zero velocities."""
    length = np.sqrt((impacts.v_in**2).sum(axis=1, keepdims=True))
    if not (length > 0).all():
        raise RockfallError("an impact without incident velocity has no linear map")
    return impacts.v_in / length, impacts.v_out / length


def _about_one_map(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least-squares map (3, 3) from V_in to V_out, and covariance (3, 3) about it."""
    a = np.linalg.lstsq(x, y, rcond=None)[0].T
    return a, np.cov((y - x @ a.T).T)


def _likeliest(
    x: np.ndarray, y: np.ndarray, z: np.ndarray, weight: np.ndarray,
    start: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray, float]:  # fmt: skip
    """M and C of weighted impacts, and the mean number of draws rejected per impact."""
    if start is None:
        a, scatter = _about_one_map(x, y)
        mean, covariance = a.ravel(), np.kron(scatter, np.eye(3))
    else:
        mean, covariance = start
    used = weight > 0
    x, y, weight, z = x[used], y[used], weight[used], z[used]
    now = np.concatenate([mean, covariance.ravel()])
    for _ in range(LEAPS):
        first, redrawn = _step(x, y, weight, z, now)
        second, redrawn = _step(x, y, weight, z, first)
        if np.abs(second - first)[:9].max() < SETTLED:
            return *_parts(second), redrawn
        now, redrawn = _step(x, y, weight, z, _leap(now, first, second))
    return *_parts(now), redrawn


def _parts(both: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean (9,) and covariance (9, 9) from the vector that contains both."""
    return both[:9], both[9:].reshape(9, 9)


def _leap(start: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Squared extrapolation from two steps (Varadhan & Roland 2008, scheme S3), limited so that the
    covariance remains valid."""
    change, bend = first - start, second - 2 * first + start
    length = np.linalg.norm(change) / max(float(np.linalg.norm(bend)), 1e-300)
    while length > 1:
        point = start + 2 * length * change + length**2 * bend
        values = np.linalg.eigvalsh(_parts(point)[1])
        if values[0] > MIN_EIGENVALUE * values[-1]:
            return point
        length = (length + 1) / 2 if length > 1.1 else 1
    return second


def _rejections(bad: np.ndarray) -> np.ndarray:
    """Fraction (n, draws) of the start points, in the ring of an impact's draws, from which a draw
    is rejected before the first admissible draw. Sums over the draws are unbiased estimates of the
    number of rejections before a rebound."""
    draws = bad.shape[1]
    run = np.zeros(len(bad))
    times = np.zeros(bad.shape)
    for k in range(2 * draws):
        run = np.where(bad[:, k % draws], np.minimum(run + 1, draws), 0)
        times[:, k % draws] = run
    return times / draws


def _step(
    x: np.ndarray, y: np.ndarray, weight: np.ndarray, z: np.ndarray, both: np.ndarray
) -> tuple[np.ndarray, float]:
    """M and C, joined, after a step of expectation maximisation, and the mean number of draws
    rejected per impact. Refuses impacts whose distribution becomes degenerate."""
    mean, covariance = _parts(both)
    c = covariance.reshape(3, 3, 3, 3)  # twice: rows and columns of A
    gain = np.einsum("ikjl,nl->nikj", c, x)  # Cov(A_ik, y_j)
    sigma = np.einsum("nikj,nk->nij", gain, x)  # Cov(y)
    sigma = (sigma + sigma.transpose(0, 2, 1)) / 2 + 1e-12 * np.eye(3)
    gain = gain.reshape(-1, 9, 3)
    try:
        root = np.linalg.cholesky(sigma)
    except np.linalg.LinAlgError:
        raise RockfallError(
            f"{len(x)} impacts are too few: their likeliest law is degenerate"
        ) from None
    solved = np.linalg.solve(sigma, gain.transpose(0, 2, 1)).transpose(0, 2, 1)  # C X^T Sigma^-1
    rest = covariance - np.einsum("nai,nbi->nab", solved, gain)  # covariance of A given y
    expected = x @ mean.reshape(3, 3).T
    # matrix of each impact
    a = mean + np.einsum("nai,ni->na", solved, y - expected)
    # matrices of the draws rejected before it
    thrown = np.einsum("nij,ndj->ndi", root, z)
    drawn = (expected[:, None] + thrown).reshape(-1, 3)
    bad = ~admissible(np.repeat(x, z.shape[1], axis=0), drawn).reshape(z.shape[:2])
    times = weight[:, None] * _rejections(bad)
    row, draw = np.nonzero(bad)
    each = times[row, draw]
    a_bad = mean + np.einsum("nai,ni->na", solved[row], thrown[row, draw])
    total = weight.sum() + each.sum()
    new = (weight @ a + each @ a_bad) / total
    off, off_bad = a - new, a_bad - new
    second = (off * weight[:, None]).T @ off + (off_bad * each[:, None]).T @ off_bad
    second += np.einsum("n,nab->ab", weight + times.sum(axis=1), rest)
    second = (second + second.T) / (2 * total)
    return np.concatenate([new, second.ravel()]), float(each.sum() / weight.sum())
