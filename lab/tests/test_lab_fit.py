# SPDX-License-Identifier: BSD-3-Clause
"""Impact sets are recovered from artificial impacts of known distribution; bounces down a plane."""

import numpy as np
import pytest
import threadpoolctl
from rockfall._core import rockfall_f2py as kernel

from rockfall import RockfallError
from rockfall.analysis.planes.plane_bounce import (
    growth,
    neutral_slope,
    set_rebound,
)
from rockfall.scene.rebounds.kernel_rebounds import admissible
from rockfall_lab.sets import fit
from rockfall_lab.sets.fit import Impacts, as_rebounds, fit_set
from rockfall_lab.sets.resampled import resampled_rebound
from rockfall_lab.sets.setfile import write_sets

MEAN = np.array([0.75, 0.0, 0.12, 0.15, -0.4, -0.1, 0.3, 0.0, 0.45])


def covariance() -> np.ndarray:
    """Covariance with correlations, as large as for rebounds."""
    root = 0.08 * np.tril(np.random.default_rng(5).normal(size=(9, 9)))
    return root @ root.T + 0.08**2 * np.eye(9)


def incident(n: int, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    angle = np.radians(np.where(random.random(n) < 0.5, 3, 20) + 17 * random.random(n))
    speed, spin = random.uniform(2, 25, n), random.uniform(-0.5, 1.0, n)
    return speed[:, None] * np.stack([np.cos(angle), -np.sin(angle), spin], axis=1)


def impacts(n: int, seed: int = 1) -> Impacts:
    """Admissible impacts drawn from a known set, on 20 layers."""
    v_in = incident(n, seed)
    v_out = set_rebound(MEAN, covariance())(v_in, np.random.default_rng(seed + 100))
    return Impacts(v_in, v_out, np.arange(n) % 20)


@pytest.fixture(scope="module")
def found():
    return fit_set(as_rebounds(impacts(1200)))


def test_the_set_comes_back_within_its_standard_errors(found):
    assert found.impacts == 1200 and 0.2 < found.redrawn < 0.33
    assert (abs(found.mean - MEAN) < 4.5 * found.mean_error).all()
    assert (0.002 < found.mean_error).all() and (found.mean_error < 0.05).all()
    assert np.linalg.eigvalsh(found.covariance).min() > -1e-12


def test_a_fit_that_ignores_the_cut_off_would_not_do(found):
    """Redrawing truncates the distribution, which shifts the means of an ordinary fit."""
    one = impacts(1200)
    length = np.linalg.norm(one.v_in, axis=1, keepdims=True)
    plain = np.linalg.lstsq(one.v_in / length, one.v_out / length, rcond=None)[0].T.ravel()
    assert np.linalg.norm(plain - MEAN) > np.linalg.norm(found.mean - MEAN)


def test_the_law_of_the_rebound_comes_back_where_the_matrix_cannot(found):
    """Only the part of C that affects V_out can be recovered: the covariance of V_out for each
    incident direction."""
    x = incident(200, 7)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    for k in range(3):
        rows = slice(3 * k, 3 * k + 3)
        ours = np.einsum("ni,ij,nj->n", x, found.covariance[rows, rows], x)
        true = np.einsum("ni,ij,nj->n", x, covariance()[rows, rows], x)
        np.testing.assert_allclose(np.sqrt(ours), np.sqrt(true), rtol=0.25)


def test_bounces_by_the_set_are_those_by_the_impacts(found):
    one = impacts(1200)
    ways = set_rebound(found.mean, found.covariance), resampled_rebound(one.v_in, one.v_out)
    true = set_rebound(MEAN, covariance())
    for way in ways:
        assert abs(neutral_slope(way, 500) - neutral_slope(true, 500)) < 2.5
        for slope in (34.0, 42.0):
            ours, theirs = growth(way, slope, 1000), growth(true, slope, 1000)
            assert abs(ours.mean - theirs.mean) < 0.03 and abs(ours.std - theirs.std) < 0.04


def test_drawing_from_impacts_without_scatter_is_their_map():
    """Any neighbour that is drawn is transformed to the incidence of the boulder."""
    known, random = set_rebound(MEAN, np.zeros((9, 9))), np.random.default_rng(1)
    one, now = incident(200, 4), incident(500, 5)
    way = resampled_rebound(one, known(one, random))
    np.testing.assert_allclose(way(now, random), known(now, random), atol=1e-10)


def test_noise_within_an_impact_is_a_covariance_of_its_own():
    """V_out = A V_in + |V_in| e, e with covariance S, is distributed as with C + S (x) I."""
    noise = np.array([[0.02, 0.005, 0.0], [0.005, 0.01, 0.002], [0.0, 0.002, 0.015]])
    x = incident(1, 3)[0]
    x /= np.linalg.norm(x)
    matrix = np.kron(np.eye(3), x)
    folded = matrix @ (covariance() + np.kron(noise, np.eye(3))) @ matrix.T
    np.testing.assert_allclose(folded, matrix @ covariance() @ matrix.T + noise, rtol=1e-12)


def test_neutral_slope_of_one_matrix_is_that_of_its_largest_eigenvalue():
    """Without scatter, a bounce is a linear map; below its neutral slope, boulders slow down."""
    a = MEAN.reshape(3, 3)
    slope = neutral_slope(set_rebound(MEAN, np.zeros((9, 9))), 4)

    def largest(degrees):
        flight = np.array([[1, 2 * np.tan(np.radians(degrees)), 0], [0, -1, 0], [0, 0, 1]])
        return abs(np.linalg.eigvals(a @ flight)).max()

    assert largest(slope - 0.1) < 1 < largest(slope + 0.1)


def test_what_does_not_leave_the_surface_creeps_and_what_gains_energy_is_left_out():
    v_in = np.tile([10.0, -2.0, 5.0], (3, 1))
    v_out = np.array([[5.0, 1.0, 3.0], [5.0, -0.5, 3.0], [11.0, 1.0, 3.0]])
    found = as_rebounds(Impacts(v_in, v_out, np.arange(3)))
    assert found.group.tolist() == [0, 1]
    assert found.v_out[1, 1] == pytest.approx(0.01 * np.hypot(10, 2))
    assert admissible(found.v_in, found.v_out).all()


def test_too_few_and_too_much_alike_are_refused():
    with pytest.raises(RockfallError, match="59 impacts: at least 60 are needed"):
        fit_set(impacts(59))
    one = impacts(100)
    with pytest.raises(RockfallError, match="too much alike"):
        fit_set(Impacts(np.tile(one.v_in[0], (100, 1)), one.v_out, one.group))


def test_a_law_that_has_lost_its_scatter_is_refused():
    """A distribution without scatter may fit few impacts best; its covariance is then invalid."""
    one, z = impacts(60), np.zeros((60, 2, 3))
    lost = np.append(MEAN, -1e-9 * np.eye(9))
    with pytest.raises(RockfallError, match="60 impacts are too few: .* degenerate"):
        fit._step(one.v_in, one.v_out, np.ones(60), z, lost)
    exact = set_rebound(MEAN, np.zeros((9, 9)))(one.v_in, np.random.default_rng(1))
    with pytest.raises(RockfallError, match="do not scatter about one map"):
        fit_set(Impacts(one.v_in, exact, one.group))


def test_a_fit_adds_up_in_one_order(monkeypatch):
    """BLAS rounds differently with more threads: sets would not be bit-identical."""
    threads = []

    def likeliest(*arguments):
        found = threadpoolctl.threadpool_info()
        threads.extend(one["num_threads"] for one in found if one["user_api"] == "blas")
        return known(*arguments)

    known = fit._likeliest
    monkeypatch.setattr(fit, "_likeliest", likeliest)
    with threadpoolctl.threadpool_limits(2, "blas"):
        fit_set(impacts(100), groups=0)
    assert set(threads) == {1}


def test_the_file_reads_back_through_the_kernel(found, tmp_path):
    write_sets(tmp_path / "made.nml", dict.fromkeys(range(1, 6), found), ["made by a test", ""])
    text = (tmp_path / "made.nml").read_bytes()
    mean, matrix, *_, code, message = kernel.read_sets(text, b"made.nml", b"past_aspect", 0)
    assert code == 0, message
    np.testing.assert_allclose(mean[:, 2], found.mean, rtol=1e-11)
    np.testing.assert_allclose(matrix[:, :, 4], found.covariance, rtol=1e-11, atol=1e-12)
