# SPDX-License-Identifier: BSD-3-Clause
"""From made impacts, whose distribution is known, back to their impact set."""

import numpy as np
import pytest
from rockfall._core import rockfall_f2py as kernel

from rockfall import RockfallError
from rockfall.lab.fit import fit_set, linearity, point_maps, write_sets

MEAN = np.array([0.62, 0.0, 0.13, 0.19, -0.41, -0.19, 0.24, 0.0, 0.34])


def covariance() -> np.ndarray:
    """Some covariance with correlations, of the size that rebounds have."""
    root = np.tril(np.random.default_rng(5).normal(0, 0.02, (9, 9)))
    return root @ root.T + 1e-3 * np.eye(9)


def impacts(points: int, each: int, noise: float, seed: int = 1, scatter=None):
    """Impacts (point, V_in, V_out) at `points` points, with relative noise within a point."""
    random = np.random.default_rng(seed)
    a = random.multivariate_normal(MEAN, covariance() if scatter is None else scatter, points)
    point = np.repeat(np.arange(points), each)
    angle = np.radians(random.uniform(10, 90, point.size))
    speed = random.uniform(5, 30, point.size)
    spin = random.uniform(-0.5, 1.0, point.size)
    v_in = speed[:, None] * np.stack([np.cos(angle), -np.sin(angle), spin], axis=1)
    v_out = np.einsum("nij,nj->ni", a.reshape(-1, 3, 3)[point], v_in)
    size = np.sqrt((v_in**2).sum(axis=1, keepdims=True))
    return point, v_in, v_out + noise * size * random.normal(size=v_out.shape)


def test_without_noise_the_maps_come_back():
    point, v_in, v_out = impacts(20, 10, 0.0)
    maps = point_maps(point, v_in, v_out)
    predicted = np.einsum("nij,nj->ni", maps.a.reshape(-1, 3, 3)[point], v_in)
    np.testing.assert_allclose(predicted, v_out, rtol=1e-9, atol=1e-9)
    assert maps.skipped == 0 and maps.residual.max() < 1e-12


def test_the_set_comes_back_within_its_standard_errors():
    found = fit_set(point_maps(*impacts(2000, 12, 0.05)), replicates=200)
    assert (abs(found.mean - MEAN) < 4 * found.mean_error).all()
    assert (abs(found.covariance - covariance()) < 4 * found.covariance_error + 1e-12).all()
    assert found.lost_variance < 1e-6 and found.points == 2000


def test_noise_within_points_is_not_taken_for_scatter_between_them():
    """All points have the same matrix: little is left of the covariance of the fitted ones."""
    maps = point_maps(*impacts(1500, 10, 0.2, scatter=np.zeros((9, 9))))
    found = fit_set(maps, replicates=50)
    assert np.trace(found.covariance) < 0.1 * np.trace(np.cov(maps.a, rowvar=False))


def test_standard_errors_are_those_of_repetitions():
    sets = [fit_set(point_maps(*impacts(100, 10, 0.05, seed)), 200) for seed in range(40)]
    spread = np.std([one.mean for one in sets], axis=0)
    told = np.mean([one.mean_error for one in sets], axis=0)
    np.testing.assert_allclose(told, spread, rtol=0.4)


def test_linearity_is_found_and_its_lack_too():
    point, v_in, v_out = impacts(300, 40, 0.02)
    difference, error = linearity(point, v_in, v_out)
    assert (abs(difference) < 4 * error).all()
    speed = np.sqrt((v_in**2).sum(axis=1, keepdims=True))
    difference, error = linearity(point, v_in, v_out * (1 - 0.01 * speed))
    assert abs(difference[0]) > 10 * error[0]


def test_points_that_tell_too_little_are_skipped_and_counted():
    point, v_in, v_out = impacts(12, 10, 0.01)
    few = np.concatenate([np.flatnonzero(point > 0), np.flatnonzero(point == 0)[:5]])
    assert point_maps(point[few], v_in[few], v_out[few]).skipped == 1
    v_in[point == 3] = v_in[point == 3][0]
    assert point_maps(point, v_in, v_out).skipped == 1
    with pytest.raises(RockfallError, match="9 points with a map: at least 10"):
        fit_set(point_maps(*impacts(9, 10, 0.01)))


def test_the_file_reads_back_through_the_kernel(tmp_path):
    found = fit_set(point_maps(*impacts(50, 12, 0.05)), replicates=20)
    write_sets(tmp_path / "made.nml", dict.fromkeys(range(1, 6), found), ["made by a test", ""])
    text = (tmp_path / "made.nml").read_bytes()
    mean, matrix, *_, code, message = kernel.read_sets(text, b"made.nml", 1)
    assert code == 0, message
    np.testing.assert_allclose(mean[:, 2], found.mean, rtol=1e-11)
    np.testing.assert_allclose(matrix[:, :, 4], found.covariance, rtol=1e-11, atol=1e-16)
