# SPDX-License-Identifier: BSD-3-Clause
"""Impact sets at any setting of the laboratory, interpolated from the settings in design.nc.

    python emulator.py      # accuracy of each setting, predicted from the others

A set is a vector of means and covariances of V_out for given incident directions. Its principal
components over the settings, for all ratios together, are Gaussian processes of the parameters
(scikit-learn). R_b/R_m = 4 is the mean of 3 and 5.
"""

from __future__ import annotations

import warnings

import numpy as np
import xarray as xr
from design import HERE, PARAMETERS, to_unit
from sklearn.decomposition import PCA
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from rockfall.analysis.planes.plane_bounce import growth, neutral_slope, set_rebound
from rockfall_lab.spheres.experiment import STATES

COMPONENTS = 10
#: Incidence angles [degrees] and spins W/V at which sets are compared: those of rebounds on slopes.
ANGLES, SPINS = (5.0, 10.0, 15.0, 20.0, 30.0), (0.0, 0.4, 0.8)
LOWER = np.tril_indices(9)


def metric() -> tuple[np.ndarray, np.ndarray]:
    """Root of the mean of x x^T over incident directions x, and its inverse."""
    x = np.array([(np.cos(a), -np.sin(a), s) for a in np.radians(ANGLES) for s in SPINS])
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(x.T @ x / len(x))
    return (vectors * np.sqrt(values)) @ vectors.T, (vectors / np.sqrt(values)) @ vectors.T


ROOT, BACK = metric()


def to_vector(mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Vectors (..., 54) from means (..., 9) and covariances (..., 9, 9)."""
    seen = np.kron(np.eye(3), ROOT)
    return np.concatenate([mean @ seen, (seen @ covariance @ seen)[..., *LOWER]], axis=-1)


def from_vector(vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means and covariances from a vector; the covariance is the nearest valid one."""
    back = np.kron(np.eye(3), BACK)
    covariance = np.zeros((*vector.shape[:-1], 9, 9))
    covariance[..., *LOWER] = vector[..., 9:]
    covariance += np.tril(covariance, -1).swapaxes(-1, -2)
    values, vectors = np.linalg.eigh(covariance)
    covariance = (vectors * np.maximum(values, 0)[..., None, :]) @ vectors.swapaxes(-1, -2)
    return vector[..., :9] @ back, back @ covariance @ back


class Emulator:
    """Emulator of five sets as a function of the parameters (0 to 1), for one boulder state."""

    def __init__(self, table: xr.Dataset, state: str = "peak") -> None:
        self.unit = to_unit(np.stack([table[name].values for name in PARAMETERS], axis=1))
        one = table.sel(state=state).sortby("ratio").transpose("setting", "ratio", ...)
        self.vectors = to_vector(one["mean"].values, one["covariance"].values)
        flat = self.vectors.reshape(len(self.unit), -1)
        self.pca = PCA(min(COMPONENTS, len(flat) - 1)).fit(flat)
        self.scores = self.pca.transform(flat)
        self.processes = [process(self.unit, score) for score in self.scores.T]
        off = [self._left_out_scores(number) for number in range(len(self.unit))]
        # median error of each left-out component, in predicted deviations; robust, because the
        # loosest layers are far from all others
        self.scale = np.maximum(1.0, 1.48 * np.median(np.abs(off), axis=0)[1])

    def predict(self, unit: np.ndarray, z: np.ndarray | None = None) -> tuple:
        """Means (5, 9) and covariances (5, 9, 9) at a setting; `z` (components,) are normal numbers
        for the errors of the emulator."""
        found = [one.predict(unit[None], return_std=True) for one in self.processes]
        score = np.array([float(mean[0]) for mean, _ in found])
        if z is not None:
            stds = [float(std[0]) for _, std in found]
            pairs = zip(self.processes, stds, strict=True)
            score = score + z[: len(found)] * self.scale * [unknown(*pair) for pair in pairs]
        return five(self.pca.inverse_transform(score[None]).reshape(-1, 54))

    def left_out(self, number: int) -> tuple:
        """Sets of a setting, predicted from the others."""
        score, _ = self._left_out_scores(number)
        return five(self.pca.inverse_transform(score[None]).reshape(-1, 54))

    def _left_out_scores(self, number: int) -> np.ndarray:
        """Scores predicted from the other settings, and errors in standard deviations, (2, n)."""
        others = np.arange(len(self.unit)) != number
        found = []
        for one, values in zip(self.processes, self.scores.T, strict=True):
            again = GaussianProcessRegressor(one.kernel_, optimizer=None, normalize_y=True)
            again.fit(self.unit[others], values[others])
            mean, std = again.predict(self.unit[[number]], return_std=True)
            found.append((mean[0], (values[number] - mean[0]) / std[0]))
        return np.array(found).T

    def fitted(self, number: int) -> tuple:
        """Sets fitted to the impacts of a setting."""
        return five(self.vectors[number])


def process(unit: np.ndarray, values: np.ndarray) -> GaussianProcessRegressor:
    """Gaussian process fitted to `values` at parameters `unit` (scaled to 0 to 1), with a noise
    term."""
    scales = np.full(unit.shape[1], 2.0)
    smooth = ConstantKernel(1.0, (1e-2, 1e2)) * RBF(scales, (0.5, 10.0))
    kernel = smooth + WhiteKernel(0.1, (1e-2, 2))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return GaussianProcessRegressor(
            kernel, normalize_y=True, n_restarts_optimizer=2, random_state=1
        ).fit(unit, values)


def unknown(one: GaussianProcessRegressor, std: float) -> float:
    """Standard deviation of a score without the noise of the fits."""
    noise = one.kernel_.k2.noise_level * one._y_train_std**2
    return float(np.sqrt(max(std**2 - noise, 0.0)))


def five(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sets for R_b/R_m = 1, 2, 3, 4, 5 from those for 1, 2, 3, 5 (4, 54)."""
    all_five = np.stack([*vectors[:3], (vectors[2] + vectors[3]) / 2, vectors[3]])
    return from_vector(all_five)


def check(table: xr.Dataset, state: str) -> None:
    """Compare each setting's own fit with its prediction from the others: neutral slopes, and
    growth at 38 degrees."""
    emulator = Emulator(table, state)
    print(
        f"state {state}: the components explain {emulator.pca.explained_variance_ratio_.round(3)}"
    )
    print(
        f"{'setting':>7}{'':4}"
        + "".join(f"{f'neutral {r}':>16}" for r in (1, 3, 5))
        + f"{'log growth 5 at 38':>22}"
    )
    off = []
    for number in range(len(emulator.unit)):
        row = []
        for found in emulator.fitted(number), emulator.left_out(number):
            rebounds = [set_rebound(found[0][k], found[1][k]) for k in (0, 2, 4)]
            row.append(
                [neutral_slope(one, 300) for one in rebounds]
                + [growth(rebounds[2], 38.0, 500).mean]
            )
        off.append(np.subtract(*row))
        cells = "".join(f"{a:8.1f}{b:8.1f}" for a, b in zip(row[0][:3], row[1][:3], strict=True))
        print(f"{number:7d}    {cells}{row[0][3]:11.3f}{row[1][3]:11.3f}", flush=True)
    print("root mean square of the differences:", np.sqrt(np.mean(np.square(off), axis=0)).round(3))


if __name__ == "__main__":
    for chosen in STATES:
        check(xr.load_dataset(HERE / "design.nc"), chosen)
