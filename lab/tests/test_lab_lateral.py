# SPDX-License-Identifier: BSD-3-Clause
"""Lateral deviations of a set: quantiles, incidence classes, and boulders that turn by them."""

import numpy as np
import pytest
from rockfall._core import rockfall_f2py as kernel

import rockfall
import scenes
from made import refused
from rockfall_lab.sets.fit import ImpactSet
from rockfall_lab.sets.lateral import PROBABILITY, fit_lateral, incidence, lateral_line
from rockfall_lab.sets.setfile import write_sets

MEAN, COVARIANCE = (one[2] for one in scenes.sets())


def incoming(angles):
    """V_in (n, 3) for given angles of incidence [degrees]."""
    angles = np.radians(angles)
    return 7.0 * np.stack([np.cos(angles), -np.sin(angles), 0.3 + 0 * angles], axis=1)


def spread(*numbers):
    """Angles with given numbers of impacts below 10, 10 to 20, 20 to 40, above 40 degrees."""
    middles = np.repeat([5.0, 15.0, 30.0, 60.0], numbers)
    return middles + np.random.default_rng(1).uniform(-4, 4, middles.size)


def a_set(lateral):
    return ImpactSet(MEAN, COVARIANCE, np.zeros(9), np.zeros((9, 9)), 99, 0.0, lateral)


def test_the_angle_of_incidence_is_from_the_ground():
    np.testing.assert_allclose(incidence(incoming([0.5, 30.0, 90.0])), [0.5, 30, 90], rtol=1e-12)


def test_quantiles_are_those_of_each_class():
    angles = spread(101, 101, 101, 101)
    turn = np.tile(np.arange(101) / 2, 4) + 10.0 * np.searchsorted([10, 20, 40], angles)
    order = np.random.default_rng(2).permutation(turn.size)
    found = fit_lateral(incoming(angles)[order], turn[order])
    assert found.incidence.tolist() == [10, 20, 40] and found.impacts.tolist() == [101] * 4
    known = 50 * PROBABILITY + 10.0 * np.arange(4)[:, None]
    np.testing.assert_allclose(found.quantiles, known, atol=1e-12)


@pytest.mark.parametrize(
    ("numbers", "between", "impacts"),
    [
        ((30, 30, 30, 30), [10, 20, 40], [30, 30, 30, 30]),
        ((29, 30, 30, 30), [20, 40], [59, 30, 30]),  # merged with the next steeper class
        ((30, 29, 30, 30), [10, 40], [30, 59, 30]),
        ((30, 30, 30, 29), [10, 20], [30, 30, 59]),  # the steepest joins the class before it
        ((30, 30, 20, 9), [10], [30, 59]),  # 29 above 20 degrees: also too few
        ((0, 0, 0, 30), [], [30]),
    ],
)
def test_classes_with_too_few_impacts_are_joined(numbers, between, impacts):
    angles = spread(*numbers)
    found = fit_lateral(incoming(angles), np.linspace(0, 90, angles.size))
    assert found.incidence.tolist() == between and found.impacts.tolist() == impacts


def test_what_is_not_known_is_left_out_and_too_few_are_refused():
    angles, turn = spread(20, 20, 20, 20), np.full(80, 12.0)
    turn[30:50] = np.nan
    assert fit_lateral(incoming(angles), turn).impacts.sum() == 60
    turn[:50] = turn[79] = np.nan
    with refused("29 lateral deviations: at least 30 are needed for quantiles"):
        fit_lateral(incoming(angles), turn)


def test_shares_are_printed_in_the_classes_of_the_paper():
    turn = np.repeat([0.0, 22.5, 44.9, 45.0, np.nan], [65, 10, 15, 10, 7])
    assert lateral_line(turn) == (
        "  lateral deviation below 22.5 degrees 65.0%, to 45 25.0%, above 10.0% (100 impacts)"
    )


@pytest.mark.parametrize("numbers", [(50, 50, 50, 50), (10, 10, 10, 10)])
def test_the_kernel_reads_what_is_written(tmp_path, numbers):
    angles = spread(*numbers)
    turn = 90 * np.random.default_rng(3).random(angles.size) ** 2
    found = fit_lateral(incoming(angles), turn)
    path = tmp_path / "made.nml"
    write_sets(path, dict.fromkeys(range(1, 6), a_set(found)), ["made by a test"])
    _, _, between, lateral, *_, code, message = kernel.read_sets(
        path.read_bytes(), b"made.nml", b"lab", 0
    )
    assert code == 0, message
    classes = len(found.quantiles)
    np.testing.assert_allclose(between[: classes - 1, 3], found.incidence)
    np.testing.assert_allclose(lateral[:, :classes, 3].T, found.quantiles, rtol=1e-11)


def test_boulders_turn_by_the_deviations_of_the_set(tmp_path):
    """On a plane, a set without deviations keeps boulders on the fall line, and a set with constant
    turns does not; a set without lateral data is refused."""

    def offsets(lateral):
        path = tmp_path / "made.nml"
        write_sets(path, dict.fromkeys(range(1, 6), a_set(lateral)), ["made by a test"])
        y, _ = np.mgrid[59:-1:-1, :40] * 5.0 + 2.5
        z = 500 + 0.8 * y
        case = scenes.make_case(
            tmp_path, *scenes.sets(), impact={"sets": str(path), "turning": "lab"},
            release={"x": 100.0, "y": 250.0, "drop_height": 5.0}, case={"boulders": 20},
        )  # fmt: skip
        return rockfall.run(case, dem=z, transform=scenes.grid(z).transform)["stop_x"] - 100

    angles = spread(20, 20, 20, 20)
    still, turned = (
        fit_lateral(incoming(angles), np.full(angles.size, turn)) for turn in (0.0, 30.0)
    )
    assert abs(offsets(still)).max() < 1e-9
    assert abs(offsets(turned)).min() > 0
    with pytest.raises(rockfall.RockfallError, match="lateral: is missing"):
        offsets(None)
