# SPDX-License-Identifier: BSD-3-Clause
"""Scorecard: statistics of impact sets on the slope of the paper, and their evaluation."""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import rockfall
import scenes
from rockfall.cli import main
from rockfall.errors import RockfallError
from rockfall.result.crossings import at_lines
from rockfall.scene.rebounds.kernel_rebounds import INERTIA_FACTOR
from rockfall.scene.rebounds.sets import Sets, read_sets, restitution
from rockfall_lab.scorecard import score as scorecard
from rockfall_lab.scorecard.score import (
    OTHERS,
    Score,
    Target,
    _between,
    neutral_slopes,
    score,
    table,
    targets,
    verdict,
)
from rockfall_lab.scorecard.site import Site, _turns, tangential_above
from rockfall_lab.scorecard.vaujany_slope import Talus
from rockfall_lab.sets.fit import ImpactSet
from rockfall_lab.sets.setfile import write_sets

VAUJANY = Path(__file__).parents[2] / "cases" / "vaujany"
INF = np.inf


@pytest.mark.parametrize("angle", [15.0, 45.0, 90.0])
def test_restitution_of_one_matrix_is_known(angle):
    a = scenes.LIVELY_MEAN
    r_t, r_n = restitution(a, np.zeros((9, 9)), angle)
    tangent = np.tan(np.radians(angle))
    assert r_t.size == r_n.size > 1000
    if angle == 90:
        assert np.isnan(r_t).all()
        np.testing.assert_allclose(r_n, -a[4], rtol=1e-12)
    else:
        np.testing.assert_allclose(r_t, a[0] - a[1] * tangent, rtol=1e-12)
        np.testing.assert_allclose(r_n, a[3] / tangent - a[4], rtol=1e-12)


@pytest.mark.parametrize("index, value", [(4, 0.5), (0, 1.3), (6, 2.0)])
def test_draws_that_cannot_be_are_left_out(index, value):
    """Draws into the ground, or with a gain of translational or rotational energy, are left out."""
    mean = scenes.LIVELY_MEAN.copy()
    mean[index] = value
    r_t, r_n = restitution(mean, np.zeros((9, 9)), 30.0)
    assert r_t.size == r_n.size == 0


def test_only_draws_that_can_be_enter_the_restitution():
    covariance = 6 * scenes.LIVELY_COVARIANCE
    r_t, r_n = restitution(scenes.LIVELY_MEAN, covariance, 40.0)
    v_t, v_n = r_t * np.cos(np.radians(40)), r_n * np.sin(np.radians(40))
    assert 500 < r_t.size < 3500 and (v_n > 0).all() and (v_t**2 + v_n**2 <= 1).all()
    draws = np.random.default_rng(3).multivariate_normal(scenes.LIVELY_MEAN, covariance, 20_000)
    v_in = np.array([np.cos(np.radians(40)), -np.sin(np.radians(40)), 0.0])
    out = draws.reshape(-1, 3, 3) @ v_in
    good = (out[:, 1] > 0) & (out**2 @ [1, 1, INERTIA_FACTOR] <= 1)
    assert r_t.size / 4000 == pytest.approx(good.mean(), abs=0.03)
    assert v_n.mean() == pytest.approx(out[good, 1].mean(), abs=0.02)


def test_the_tangential_share_is_counted_from_its_limit():
    edges = np.linspace(0, 1, 51)
    even = xr.Dataset(
        {
            "tangential_share_histogram": ("bin", np.full(50, 4)),
            "tangential_share_bin_bounds": (("bin", "bound"), np.stack([edges[:-1], edges[1:]], 1)),
        }
    )
    for limit in (0.0, 0.3, 0.745, 0.75, 0.76, 1.0):
        assert tangential_above(even, limit) == pytest.approx(1 - limit)


def test_turns_are_between_the_flights_of_one_boulder():
    """No turn is counted within a ground leg, between two boulders, or at a point at rest."""
    headings = np.radians([0, 10, 10, -20, 90, 90, 135])
    boulder, leg = np.array([1, 1, 1, 1, 2, 2, 2]), np.array([1, 2, 2, 1, 1, 1, 1])
    path = {
        "trajectory_velocity_x": ("vertex", 3 * np.cos(headings)),
        "trajectory_velocity_y": ("vertex", 3 * np.sin(headings)),
        "trajectory_boulder": ("vertex", boulder),
        "trajectory_leg": ("vertex", leg),
    }
    np.testing.assert_allclose(_turns(xr.Dataset(path)), [10, 30, 0, 45], atol=1e-9)
    path["trajectory_velocity_x"][1][5] = path["trajectory_velocity_y"][1][5] = 0  # at rest
    np.testing.assert_allclose(_turns(xr.Dataset(path)), [10, 30], atol=1e-9)


def test_targets_hold_every_number_of_the_paper():
    known = targets(VAUJANY)
    names = [one.name for one in known]
    assert len(set(names)) == len(names) == 2 * 2 * 3 * 3 + len(OTHERS)
    by_name = {one.name: one for one in known}
    speed = by_name["B_EL1_speed"]
    assert speed.printed == "12.7" and (speed.low, speed.high) == pytest.approx((11.43, 13.97))
    assert by_name["A_EL1_energy_translational_std"].high == pytest.approx(126 * 1.25)
    assert not speed.held_out and not by_name["A_EL1_passing_height_std"].held_out
    assert all(one.held_out for one in known if "EL2" in one.name or one.name.endswith("_max"))


@pytest.mark.parametrize(
    "low, high, value, error, word",
    [
        (1.0, 2.0, 1.5, 0.1, "met"),
        (1.0, 2.0, 2.5, 0.1, "NOT"),
        (1.0, 2.0, 1.95, 0.1, "undecided"),
        (1.0, 2.0, 2.05, 0.1, "undecided"),
        (1.0, 2.0, 0.95, 0.1, "undecided"),
        (0.0, INF, 0.0, 0.0, "NOT"),  # "> 0" is strict
        (0.0, INF, 0.2, 0.1, "met"),
        (-INF, 0.0, 0.2, 0.1, "NOT"),
        (-INF, 0.0, -0.05, 0.1, "undecided"),
        (0.0, 1.0, np.nan, np.nan, "NOT"),
    ],
)
def test_a_standard_error_across_a_bound_decides_nothing(low, high, value, error, word):
    assert verdict(Target("one", "one", low, high, "-"), value, error) == word


def test_a_score_is_a_mean_over_slopes():
    one = Score("one", {"a": np.array([1.0, 2.0, 3.0, np.nan]), "b": np.full(4, np.nan)})
    assert one.mean("a") == 2 and one.error("a") == pytest.approx(1 / 3**0.5)
    assert replace(one, of_sets={"a": 2.0}).error("a") == pytest.approx((1 / 3 + 4) ** 0.5)
    assert one.range("a") == pytest.approx((1.1, 2.9))
    assert np.isnan([one.mean("b"), one.error("b"), *one.range("b")]).all()


def test_what_groups_are_off_is_told_from_chance():
    rng = np.random.default_rng(6)
    group = np.arange(4000) % 8
    chance = rng.normal(size=group.size)
    assert _between(chance, group) < 0.06
    off = np.array([1.0, -1, 1, -1, 1, -1, 1, -1])[group]
    assert _between(chance + off, group) == pytest.approx(1, abs=0.1)
    assert _between(np.array([3.0, -4.0]), np.arange(2)) == pytest.approx(12.5**0.5)
    assert np.isnan(_between(np.full(4, np.nan), np.arange(4)))


def test_the_greatest_rise_of_the_neutral_slope():
    mean, covariance = scenes.sets()
    mean = mean[[0, 1, 4, 3, 2]]
    found = neutral_slopes(Sets("one", mean, covariance))
    slopes = [found[f"neutral_{k}"] for k in range(1, 6)]
    assert found["neutral_rise"] == max(np.diff(slopes)) > 0


@pytest.fixture(scope="module")
def site():
    """Site with few boulders, also for the neutral slope."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scorecard, "SLOPE_BOULDERS", 40)
        yield Site(VAUJANY, boulders=200, trajectories=20)


def test_the_numbers_of_the_site_are_those_of_its_runs(site, tmp_path):
    mean, covariance = (np.round(one, 10) for one in scenes.sets())  # rounded as in the file
    sets = str(scenes.write_sets(tmp_path / "sets.nml", mean, covariance))
    one = Sets("one", mean, covariance)
    numbers = site.numbers(one)
    wanted = {one.name for one in targets(VAUJANY)} - {"neutral_rise"}
    assert wanted <= set(numbers) and np.isfinite(list(numbers.values())).all()
    results = {
        method: rockfall.run(
            rockfall.read_case(VAUJANY / name).replace(
                case={"boulders": 200, "seed": 1}, impact={"sets": sets}
            )
        )
        for method, name in (("A", "case_A.nml"), ("B", "case.nml"))
    }
    for method, result in results.items():
        for line in "EL1", "EL2":
            at = at_lines(result).sel(line=line)
            values = at["line_energy_translational"].values / 1e3
            name = f"{method}_{line}_energy_translational"
            assert numbers[name] == pytest.approx(np.nanmean(values))
            assert numbers[f"{name}_std"] == pytest.approx(np.nanstd(values, ddof=1))
            assert numbers[f"{name}_max"] == pytest.approx(np.nanmax(values))
            assert numbers[f"{method}_{line}_passing"] == np.isfinite(values).mean()
            spread = np.nanstd(at["line_x"].values, ddof=1)
            assert numbers[f"{method}_{line}_spread"] == pytest.approx(spread)
    slower = numbers["B_EL1_speed"] - numbers["A_EL1_speed"]
    assert numbers["a_slower"] == pytest.approx(slower) != 0
    assert sum(numbers[f"used_{k}"] for k in range(1, 6)) == pytest.approx(1)
    assert site.numbers(one, seed=2)["B_EL1_speed"] != numbers["B_EL1_speed"]
    other = site.numbers(one, talus=Talus(3), reading="diameter", turning="to_aspect")
    assert other["A_EL1_speed"] != numbers["A_EL1_speed"]
    assert site.numbers(one, talus=Talus()) == numbers  # the terrain of the case


def test_several_draws_take_turns(site):
    mean, covariance = scenes.sets()
    one, other = Sets("one", mean, covariance), Sets("other", 0.98 * mean, covariance)
    alone, both = score([one], site, 3), score([one, other], site, 3)
    speeds = [each.numbers["B_EL1_speed"] for each in (alone, both)]
    assert (speeds[0] == speeds[1]).tolist() == [True, False, True]
    assert len(set(speeds[0])) == 3  # slopes have different boulders


def test_the_error_of_the_sets_is_part_of_that_of_the_numbers(site, tmp_path):
    mean, covariance = scenes.sets()
    rng = np.random.default_rng(4)
    root = 1e-2 * rng.normal(size=(9, 9))
    one = ImpactSet(
        mean[0], covariance[0], np.zeros(9), np.zeros((9, 9)), 99, 0.0, None, root @ root.T
    )
    write_sets(tmp_path / "told.nml", dict.fromkeys(range(1, 6), one), ["made by a test"])
    (told,) = read_sets(tmp_path / "told.nml")
    np.testing.assert_allclose(told.error, np.broadcast_to(root @ root.T, (5, 9, 9)), rtol=0.06)
    drawn = [told.redrawn(rng).mean - told.mean for _ in range(400)]
    np.testing.assert_allclose(np.std(drawn, axis=0)[2], np.sqrt(np.diag(told.error[2])), rtol=0.2)
    known, exact = score([told], site, 4), score([replace(told, error=None)], site, 4)
    assert (known.numbers["B_EL1_speed"] == exact.numbers["B_EL1_speed"]).all()
    assert known.error("B_EL1_speed") > exact.error("B_EL1_speed")
    text = (tmp_path / "told.nml").read_text()
    head = "means, lower triangle by rows:\n!   "
    for bad in text.replace(head, head + "x"), text.replace(head, head + "nan #"):
        (tmp_path / "bad.nml").write_text(bad)
        with pytest.raises(RockfallError, match="bad.nml: the errors of the means cannot be read"):
            read_sets(tmp_path / "bad.nml")


def test_the_scorecard_is_printed(site, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("rockfall_lab.commands.Site", partial(Site, boulders=200, trajectories=20))
    path = scenes.write_sets(tmp_path / "mine.nml", *scenes.sets())
    assert (
        main(["lab", "scorecard", str(path), "--site", str(VAUJANY), "--slopes", "2", "--quiet"])
        == 0
    )
    out, err = capsys.readouterr()
    known = targets(VAUJANY)
    assert err == "" and all(one.label in out for one in known)
    wanted = sum(not one.held_out for one in known)
    assert re.search(rf"^mine: \d+ of {wanted} met, \d+ undecided$", out, re.MULTILINE)
    found = score(read_sets(path), site, 2)
    row = next(line for line in out.splitlines() if line.startswith("EL1, B: speed, mean"))
    assert f" {found.mean('B_EL1_speed'):.2f} +- {found.error('B_EL1_speed'):.2f} " in row
    assert table([found], known) in out
