# SPDX-License-Identifier: BSD-3-Clause
"""From many impacts to one impact set: means and covariances of a1..a9, and how sure they are.

The rebound is V_out = A V_in with A random (Bourrier et al. 2009, eqs 4 and 5): one matrix for each
point of the layer that is hit. So a linear map is fitted to the impacts at each point, and the set
is the distribution of these maps over the points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rockfall.errors import RockfallError
from rockfall.files import whole_file
from rockfall.lab.case import COEFFICIENTS, LabCase, lab_case_of
from rockfall.lab.experiment import STATUS, checksum

if TYPE_CHECKING:
    import xarray as xr

ENDED = "rebounded", "lifted", "captured"  # results; the others are counted, never averaged in
CASE_MARK = "! | "  # begins the lines of a set file that hold its laboratory case
MOST_CONDITION = 1e4  # of the scaled incident velocities of a point; beyond, its map is not known
LEAST_IMPACTS = 6  # at a point: three unknowns a row, and as many to tell the noise from


@dataclass(frozen=True)
class PointMaps:
    """The linear map of each point, rows (a1..a9), and the estimation noise that is in it."""

    a: np.ndarray  # (points, 9)
    noise: np.ndarray  # (points, 9, 9): covariance of the error of `a`
    residual: np.ndarray  # (points,): r.m.s. of |V_out - A V_in| / |V_in| within the point
    skipped: int  # points with too few rebounds, or incident velocities too much alike


@dataclass(frozen=True)
class ImpactSet:
    """Mean (9,) and covariance (9, 9) of a1..a9 over points, with standard errors (bootstrap)."""

    mean: np.ndarray
    covariance: np.ndarray
    mean_error: np.ndarray
    covariance_error: np.ndarray
    lost_variance: float  # share of the variance that no semidefinite covariance can hold
    points: int


def point_maps(point: np.ndarray, v_in: np.ndarray, v_out: np.ndarray) -> PointMaps:
    """Fit V_out = A V_in at each point, by least squares through the origin.

    `point` (impacts,) numbers the points; `v_in`, `v_out` (impacts, 3) are (V_t, V_n, W) [m/s] of
    impacts that rebounded. Each impact is divided by its incident speed: the form is linear in
    speed, so its errors grow with it too. Where all rows of a point have the same regressors, the
    error of its map is the Kronecker product of the residual covariance and (X^T X)^-1.
    """
    speed = np.sqrt((v_in**2).sum(axis=1, keepdims=True))
    if not (speed > 0).all():
        raise RockfallError("an impact without incident velocity has no linear map")
    x, y = v_in / speed, v_out / speed
    maps, noise, residual, skipped = [], [], [], 0
    for k in np.unique(point):
        rows = point == k
        if rows.sum() < LEAST_IMPACTS or np.linalg.cond(x[rows]) > MOST_CONDITION:
            skipped += 1
            continue
        inverse = np.linalg.inv(x[rows].T @ x[rows])
        a = (inverse @ x[rows].T @ y[rows]).T
        error = y[rows] - x[rows] @ a.T
        scatter = error.T @ error / (rows.sum() - 3)
        maps.append(a.ravel())
        noise.append(np.kron(scatter, inverse))
        residual.append(np.sqrt((error**2).sum(axis=1).mean()))
    shape = (len(maps), 9)
    return PointMaps(
        np.reshape(maps, shape), np.reshape(noise, (*shape, 9)), np.array(residual), skipped
    )


def fit_set(maps: PointMaps, replicates: int = 1000, seed: int = 1) -> ImpactSet:
    """The distribution of the maps over points, without the noise of their estimation.

    Method of moments: the covariance of the fitted maps is that of the true ones plus the mean
    noise, which is subtracted. What is then negative (few points, much noise) is cut off at zero,
    and its share told. Standard errors: bootstrap over points.
    """
    n = len(maps.a)
    if n < 10:
        raise RockfallError(f"{n} points with a map: at least 10 are needed for a covariance")
    mean, covariance, lost = _moments(maps.a, maps.noise)
    generator = np.random.Generator(np.random.PCG64(seed))
    means, covariances = np.empty((replicates, 9)), np.empty((replicates, 9, 9))
    for k in range(replicates):
        pick = generator.integers(0, n, n)
        means[k], covariances[k], _ = _moments(maps.a[pick], maps.noise[pick])
    return ImpactSet(mean, covariance, means.std(axis=0), covariances.std(axis=0), lost, n)


def _moments(a: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Mean, covariance less the mean noise, and the share of variance that was cut off."""
    raw = np.cov(a, rowvar=False) - noise.mean(axis=0)
    values, vectors = np.linalg.eigh((raw + raw.T) / 2)
    kept = np.maximum(values, 0)
    lost = float((kept - values).sum() / max(np.trace(np.cov(a, rowvar=False)), 1e-300))
    return a.mean(axis=0), (vectors * kept) @ vectors.T, lost


def impacts_of(data: xr.Dataset, ratio: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Point (impacts,), V_in and V_out (impacts, 3) [m/s] of the impacts that ended at a ratio.

    A captured sphere counts with what upward motion it had: none, or next to none.
    """
    one = data.sel(ratio=ratio)
    ended = np.isin(one["status"].values, [STATUS[name] for name in ENDED])
    point = np.broadcast_to(np.arange(ended.shape[0])[:, None], ended.shape)
    v_in, v_out = (
        np.stack([one[f"{v}_{when}"].values[ended] for v in ("vt", "vn", "w")], axis=1)
        for when in ("in", "out")
    )
    return point[ended], v_in, v_out


def fit_impacts(data: xr.Dataset, replicates: int = 1000) -> dict[int, ImpactSet]:
    """The sets of all ratios, their means multiplied by the case's correction."""
    factors = correction_of(lab_case_of(data.attrs["lab_case"], "impacts"))
    sets = {}
    for ratio in data["ratio"].values:
        if ratio != int(ratio) or not 1 <= ratio <= 5:
            raise RockfallError(f"R_b/R_m = {ratio:g}: a set has a ratio of 1, 2, 3, 4 or 5")
        found = fit_set(point_maps(*impacts_of(data, ratio)), replicates)
        sets[int(ratio)] = replace(
            found, mean=found.mean * factors, mean_error=found.mean_error * abs(factors)
        )
    return sets


def plain(case: LabCase) -> LabCase:
    """What of a case decides about its impacts: no title, no correction."""
    return case.replace(lab={"title": ""}, correction=dict.fromkeys(COEFFICIENTS, 1.0))


def uncorrected(data: xr.Dataset) -> xr.Dataset:
    """The same impacts of a case without a correction."""
    case = lab_case_of(data.attrs["lab_case"], "impacts")
    case = case.replace(correction=dict.fromkeys(COEFFICIENTS, 1.0))
    return data.assign_attrs(lab_case=case.text())


def with_case(data: xr.Dataset, case: LabCase) -> xr.Dataset:
    """The same impacts of a case that differs in title and correction at most."""
    if plain(case) != plain(lab_case_of(data.attrs["lab_case"], "impacts")):
        raise RockfallError(f"{case.name}: these are impacts of another laboratory case")
    return data.assign_attrs(lab_case=case.text(), title=case.lab["title"])


def correction_of(case: LabCase) -> np.ndarray:
    """Factors on the means of a1..a9, (9,)."""
    return np.array([case.correction[name] for name in COEFFICIENTS])


def provenance(data: xr.Dataset) -> list[str]:
    """What a set file says of its origin: enough to make it again."""
    if missing := int((data["status"].values == STATUS["not_done"]).sum()):
        raise RockfallError(f"{missing} of {data['status'].size} impacts are not done: no set yet")
    case = lab_case_of(data.attrs["lab_case"], "impacts")
    corrected = (correction_of(case) != 1).any()
    lines = [
        f"{data.attrs['title']}",
        "",
        "Means and covariances of a1..a9 from discrete-element impacts of a sphere on a layer:",
        "the means times the factors of &correction." if corrected else "uncorrected.",
        f"Made by rockfall {data.attrs['version']}; `rockfall lab remake FILE` makes it again.",
        f"SHA-256 of the outcomes: {checksum(data)}",
    ]
    for ratio in data["ratio"].values:
        status = data["status"].sel(ratio=ratio).values
        ended = ", ".join(
            f"{int((status == value).sum())} {name}"
            for name, value in STATUS.items()
            if name != "not_done"
        )
        lines.append(f"R_b/R_m = {ratio:g}: {status.size} impacts, {ended}")
    lines += ["The laboratory case:"]
    return lines + [CASE_MARK[2:] + line for line in case.text().splitlines()]


def case_in(path: str | Path) -> LabCase:
    """The laboratory case that a set file was made from."""
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise RockfallError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise RockfallError(f"{path}: is not text (UTF-8)") from error
    text = [line[len(CASE_MARK) :] for line in lines if line.startswith(CASE_MARK)]
    if not text:
        raise RockfallError(f"{path}: does not say what laboratory case it was made from")
    return lab_case_of("\n".join(text), str(path))


def normality(a: np.ndarray) -> np.ndarray:
    """p of Shapiro and Wilk's test that each of a1..a9 is normal over the points, (9,)."""
    from scipy.stats import shapiro

    return np.array([shapiro(one).pvalue for one in a.T])


def points_needed(found: ImpactSet, error: float = 0.01) -> int:
    """Points until the standard errors of all means are at most `error`."""
    return int(np.ceil(found.points * (found.mean_error.max() / error) ** 2))


def linearity(
    point: np.ndarray, v_in: np.ndarray, v_out: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Difference of the mean map of fast and of slow impacts, and its standard error, both (9,).

    Each point's impacts are parted at their median speed. Where the rebound is linear in speed, the
    difference is zero within its error.
    """
    speed = np.sqrt((v_in**2).sum(axis=1))
    differences = []
    for k in np.unique(point):
        rows = np.flatnonzero(point == k)
        fast = speed[rows] > np.median(speed[rows])
        halves = [
            point_maps(point[half], v_in[half], v_out[half]) for half in (rows[fast], rows[~fast])
        ]
        if all(len(half.a) for half in halves):
            differences.append(halves[0].a[0] - halves[1].a[0])
    if len(differences) < 2:
        raise RockfallError("too few points with fast and slow impacts to compare them")
    difference = np.array(differences)
    return difference.mean(axis=0), difference.std(axis=0, ddof=1) / np.sqrt(len(difference))


def write_sets(path: str | Path, sets: dict[int, ImpactSet], provenance: list[str]) -> None:
    """Write an impact-set file: `provenance` as comments, then a group for each ratio.

    The numbers have twelve digits: enough for a covariance to stay semidefinite.
    """
    text = [f"! {line}".rstrip() for line in provenance]
    for ratio, found in sorted(sets.items()):
        rows = _lower(found.covariance)
        text += ["", f"! {found.points} points; standard errors of the means:"]
        text += [f"!   {_short(found.mean_error)}", "! and of the covariance:"]
        text += [f"!   {_short(row)}" for row in _lower(found.covariance_error)]
        text += [f"&impact_set ratio = {ratio}", f"  mean = {_numbers(found.mean)}"]
        text += ["  covariance =   ! lower triangle by rows"]
        text += [",\n".join(f"    {_numbers(row)}" for row in rows), "/"]
    with whole_file(path) as part:
        part.write_text("\n".join(text) + "\n", encoding="utf-8")


def _lower(matrix: np.ndarray) -> list[np.ndarray]:
    """The lower triangle by rows."""
    return [matrix[k, : k + 1] for k in range(len(matrix))]


def _short(values: np.ndarray) -> str:
    return ", ".join(f"{value:.2g}" for value in values)


def _numbers(values: np.ndarray) -> str:
    return ", ".join(f"{value:.12g}" for value in values)
