# SPDX-License-Identifier: BSD-3-Clause
"""Covariances of impact sets: kernel, laboratory and planes have one rule. Invalid covariances are
refused with file, line and entry, singular ones are used unchanged."""

import numpy as np
import pytest

import rockfall
import scenes
from made import every_third
from rockfall.analysis.planes.plane_bounce import set_rebound
from rockfall.errors import RockfallError
from rockfall.scene.rebounds.coefficients import covariance_root
from rockfall.scene.rebounds.sets import read_sets, restitution

LOSES = np.array([0.2, 0, 0, 0, -0.3, 0, 0, 0, 0.2])  # mean far from the limits of a rebound


def of_rank(rank, seed, decades=0.0):
    """Covariance (9, 9) of a given rank; standard deviations fall from 0.01 by `decades` powers of
    ten."""
    root = np.random.default_rng(seed).normal(size=(9, rank))
    deviation = 0.01 * 10 ** -np.linspace(0, decades, 9)
    root *= (deviation / np.linalg.norm(root, axis=1))[:, None]
    return root @ root.T


def printed(c, digits):
    return np.array([[float(f"{x:.{digits}g}") for x in row] for row in c])


def correlations(c):
    deviation = np.sqrt(np.diag(c))
    return c / deviation / deviation[:, None]


def nearest(c):
    """Correlations of a covariance, with negative eigenvalues set to zero."""
    values, vectors = np.linalg.eigh(correlations(c))
    return (vectors * np.maximum(values, 0)) @ vectors.T


def with_entries(**entries):
    """Matrix (9, 9) of zeros except the given entries, such as c87=9e-9 and its mirror image."""
    c = np.zeros((9, 9))
    for name, value in entries.items():
        i, j = int(name[1]) - 1, int(name[2]) - 1
        c[i, j] = c[j, i] = value
    return c


SINGULAR = {
    **{f"rank {rank}": of_rank(rank, rank) for rank in range(1, 10)},
    **{f"rank 2 with {n} digits": printed(of_rank(2, 20 + n), n) for n in (6, 7, 9, 12)},
    **{f"rank 8 with {n} digits": printed(of_rank(8, 30 + n), n) for n in (6, 7, 9, 12)},
    "rank 2, variances of 1e-4 to 3e-13": printed(of_rank(2, 40, decades=4.25), 6),
    "rank 3, deviations of 1e-8": printed(of_rank(3, 41, decades=6), 6),
    "rank 1, deviations of 1e-12": of_rank(1, 42, decades=10),
    "one entry": with_entries(c55=1e-4),
    "two entries, opposite": with_entries(c11=1e-4, c88=4e-10, c81=-2e-7),
}
REFUSED = {
    "no variance": (with_entries(c11=1e-2, c77=1e-16, c87=9e-9), "(8, 8) above 0"),
    "no variance, among small": (with_entries(c11=0.3, c22=1e-12, c32=1e-13), "(3, 3) above 0"),
    "correlation of 1.01": (with_entries(c11=1e-2, c44=1e-2, c41=1.01e-2), "(4, 1) implies a corr"),
    "correlation of 900": (
        with_entries(c11=0.1, c77=1e-16, c88=1e-6, c87=9e-9), "(8, 7) implies a correlation of 900",
    ),
    "correlation of -1.001, small": (
        with_entries(c11=0.3, c88=1e-14, c99=1e-12, c98=-1.001e-13),
        "(9, 8) implies a correlation of -1.001",
    ),
    "three against each other": (
        with_entries(c11=1e-2, c22=1e-4, c33=1e-6, c21=-7e-4, c31=-7e-5, c32=-7e-6),
        "smallest eigenvalue of its correlation matrix is -0.4",
    ),
    "the same, small": (
        with_entries(c44=0.3, c11=1e-12, c22=1e-14, c33=1e-16, c21=-7e-14, c31=-7e-15, c32=-7e-16),
        "smallest eigenvalue of its correlation matrix is -0.4",
    ),
    "two digits": (printed(of_rank(2, 50), 2), "indefinite"),
    "three digits": (printed(of_rank(2, 51), 3), "indefinite"),
    "negative variance": (with_entries(c11=1e-2, c22=-1e-4), "variance (2, 2) = -0.0001"),
    "small negative variance": (with_entries(c11=0.3, c22=-1e-9), "variance (2, 2) = -1e-9"),
}  # fmt: skip


def a_file(folder, c, mean=LOSES):
    means, covariances = np.tile(mean, (5, 1)), np.tile(c, (5, 1, 1))
    return scenes.write_sets(folder / "sets.nml", means, covariances)


@pytest.mark.parametrize("name", SINGULAR)
def test_the_product_of_a_root_is_the_nearest_covariance(name):
    c = SINGULAR[name]
    root = covariance_root(c)
    has = np.diag(c) > 0
    deviation = np.sqrt(np.diag(c)[has])
    found = (root @ root.T)[np.ix_(has, has)] / deviation / deviation[:, None]
    np.testing.assert_allclose(found, nearest(c[np.ix_(has, has)]), atol=1e-12)
    assert not root[~has].any()
    assert (abs(np.diag(found) - 1) < 1e-4).all()  # variances


@pytest.mark.family(2)
@pytest.mark.parametrize("name", every_third(SINGULAR))
def test_kernel_and_planes_draw_with_the_covariance(name, tmp_path):
    """Covariances of V_out in 4,000 rebounds of the kernel, and of the planes, are within 4.5
    standard errors."""
    c, n, v_in = SINGULAR[name], 4000, np.array([6.0, -4.0, 0.0])
    rebound = set_rebound(LOSES, c)
    planes = rebound(np.tile(v_in, (n, 1)), np.random.default_rng(7)).T
    check_scatter(planes, c, v_in)
    a_file(tmp_path, c)
    out, v_in = first_rebounds(tmp_path, n)
    check_scatter(out, c, v_in)


def check_scatter(out, c, v_in):
    n = out.shape[1]
    want = np.einsum("ikjl,k,l->ij", c.reshape(3, 3, 3, 3), v_in, v_in)
    off = out - (LOSES.reshape(3, 3) @ v_in)[:, None]
    found = off @ off.T / n
    variance = np.diag(want)
    error = np.sqrt((np.outer(variance, variance) + want**2) / n)
    assert (abs(found - want) <= 4.5 * error + 1e-4 * np.sqrt(np.outer(variance, variance))).all()


def first_rebounds(folder, n):
    """V_out (3, n) of the first rebounds on a plane, and their common V_in."""
    z = 100 + np.tan(np.radians(30.0)) * 2.5 * np.mgrid[59:-1:-1, 0:20][0]
    case = rockfall.Case(
        folder=folder,
        case={"boulders": n, "seed": 3},
        impact={"form": "matrix", "sets": "sets.nml", "impact_limit": 1},
        surface={"uniform_mean_radius": 0.25},
        boulder={"volume": "fixed", "volume_mean": 0.5},
        release={"x": [25.0], "y": [120.0], "drop_height": 2.0, "velocity": [0.0, -4.0, 0.0]},
        output={"trajectories": n},
    )
    result = rockfall.run(case, dem=z, transform=scenes.grid(z, 2.5))
    met = result["trajectory_ratio"].values > 0
    before, out = (
        np.array([result[f"trajectory_{when}_{axis}"].values[met] for axis in "tnw"])
        for when in ("in", "out")
    )
    assert out.shape == (3, n) and np.ptp(before, axis=1).max() < 1e-9
    return out, before[:, 0]


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_covariance_is_refused_everywhere(name, tmp_path):
    c, said = REFUSED[name]
    for draw in (
        covariance_root,
        lambda c: set_rebound(LOSES, c),
        lambda c: restitution(LOSES, c, 30.0),
        lambda c: read_sets(a_file(tmp_path, c)),
    ):
        with pytest.raises(RockfallError) as caught:
            draw(c)
        text = str(caught.value)
        assert said in text and "covariance" in text and "\n" not in text
        assert len(text.replace(str(tmp_path), "").split()) <= 25
    assert text.startswith(f"{tmp_path / 'sets.nml'}: line ")


@pytest.mark.parametrize("unit", [1e-6, 1e-3, 1e3])
@pytest.mark.parametrize("name", REFUSED)
def test_units_change_no_decision(name, unit):
    """Another unit of W scales covariances, but does not change which are refused."""
    other = np.repeat([1.0, 1.0, unit], 3)
    with pytest.raises(RockfallError):
        covariance_root(REFUSED[name][0] * other * other[:, None])
    for c in SINGULAR.values():
        covariance_root(c * other * other[:, None])


@pytest.mark.parametrize(
    "noise, said",
    [
        (
            [1e-4, 2e-5, 0, 0, 0, 0],
            "noise: entry (2, 1) = 0.00002 requires a variance (2, 2) above 0",
        ),
        ([1e-4, 1.01e-4, 1e-4, 0, 0, 0], "noise is indefinite: entry (2, 1) implies a correlation"),
        ([0, 0, 1e-4, 0, 0, -1e-9], "noise: variance (3, 3) = -1e-9 but must be >= 0"),
        ([1e-4, -7e-5, 1e-4, -7e-5, -7e-5, 1e-4], "noise is indefinite: the smallest eigenvalue"),
        ([1e-4, 1e-4, 1e-4, 0, 0, 0], ""),
        ([1e-4, 2e-4, 4e-4, -1e-4, -2e-4, 1e-4], ""),
        ([0, 0, 0, 0, 0, 0], ""),
    ],
)
def test_noise_must_be_a_covariance_too(noise, said, tmp_path):
    c = of_rank(2, 60)
    path = a_file(tmp_path, c)
    values = ", ".join(map(str, noise))
    path.write_text(path.read_text().replace("\n/", f"\n  noise = {values}\n/"))
    if said:
        with pytest.raises(RockfallError) as caught:
            read_sets(path)
        assert said in str(caught.value) and "sets.nml: line " in str(caught.value)
        return
    full = np.zeros((3, 3))
    full[np.tril_indices(3)] = noise
    full += np.tril(full, -1).T
    total = c + np.kron(full, np.eye(3))
    np.testing.assert_allclose(read_sets(path)[0].covariance[3], total, rtol=1e-9, atol=1e-16)
