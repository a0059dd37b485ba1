# SPDX-License-Identifier: BSD-3-Clause
"""Turns on a plane of 38 degrees: the lateral spread of boulders compared with an independent
bounce map, and the frequency of each class of angles.

The map needs no raster, patches or kernel, because a flight over a plane has a closed form."""

import functools
from pathlib import Path

import numpy as np
import pytest

import rockfall
import scenes
from rockfall.case.text import read_groups
from rockfall.result.crossings import at_lines

VAUJANY = Path(__file__).parents[2] / "cases/vaujany"
RULES = "past_aspect", "to_aspect", "lab"
SLOPE = np.radians(38)
GRAVITY, DROP, STOP = 9.81, 5.0, 0.5
DOWN = -np.array([0.6, 0.8])  # oblique to the raster: rounding must not choose a side
ACROSS = np.array([0.8, -0.6])
DISTANCES = np.array([40.0, 80.0, 120.0, 160.0])  # distances from release to lines, in plan [m]
START = np.array([302.4, 332.1])
BOULDERS = 5000


@functools.cache
def coefficients():
    """Mean and covariance of a set that throws no boulder backwards."""
    covariance = np.zeros((9, 9))
    covariance[np.tril_indices(9)] = np.fromstring(scenes.CALM_ROWS, sep=",")
    return np.fromstring(scenes.CALM_MEAN, sep=","), covariance + np.tril(covariance, -1).T


@pytest.fixture(scope="module")
def plane(tmp_path_factory):
    """Function that runs boulders down the plane with a turning rule and R_b/R_m = 2.3."""

    @functools.cache
    def run(rule, boulders=BOULDERS, trajectories=0):
        mean, covariance = coefficients()
        y, x = np.mgrid[99:-1:-1, :90] * 5.0 + 2.5
        z = 2000.0 + np.tan(SLOPE) * (0.6 * x + 0.8 * y)
        lines = []
        for distance in DISTANCES:
            ends = START + distance * DOWN + np.outer([-150.0, 150.0], ACROSS)
            lines.append({"name": f"{distance:.0f}", "x": ends[:, 0], "y": ends[:, 1]})
        case = scenes.make_case(
            tmp_path_factory.mktemp(rule), np.tile(mean, (5, 1)), np.tile(covariance, (5, 1, 1)),
            line=lines, case={"boulders": boulders},
            impact={"turning": rule, "rest_angle": 90.0, "ratio": "nearest"},
            release={"x": [START[0]], "y": [START[1]], "drop_height": DROP},
            output={"trajectories": trajectories},
        )  # fmt: skip
        return rockfall.run(case, dem=z, transform=scenes.grid(z))

    return run


# ---- the map


def bounce_map(rule, n, seed=5):
    """Offsets (n, lines) of n boulders at the lines; NaN if they stopped earlier.

    Directions in the plane: `ahead` down the slope, `aside` along the contour, `up` along the
    normal.
    """
    random = np.random.default_rng(seed)
    mean, covariance = coefficients()
    root = np.linalg.cholesky(covariance)
    offsets = np.full((n, DISTANCES.size), np.nan)
    fall = np.sqrt(2 * GRAVITY * DROP)
    ahead, aside, spin = np.full(n, fall * np.sin(SLOPE)), np.zeros(n), np.zeros(n)
    up = np.full(n, -fall * np.cos(SLOPE))
    x, y = np.zeros(n), np.zeros(n)  # contact: down the slope in plan, along the contour
    before = np.zeros((2, n))
    alive = np.arange(n)
    while alive.size:
        incoming = np.stack([np.hypot(ahead, aside), up, spin])
        heading = np.arctan2(aside, ahead * np.cos(SLOPE))  # in plan, from the aspect
        vector = np.stack([np.cos(heading), np.sin(heading)])
        incoming[2] *= np.where((vector * before).sum(axis=0) < 0, -1, 1)
        out = rebounds(incoming, mean, root, random)
        back = out[0] < 0
        heading = np.where(back, np.angle(-np.exp(1j * heading)), heading)
        out[[0, 2]] *= np.where(back, -1, 1)
        heading = new_headings(rule, heading, incoming, random)
        before = np.stack([np.cos(heading), np.sin(heading)])
        tangent = before / [[np.cos(SLOPE)], [1]]
        ahead, aside = out[0] * tangent / np.hypot(*tangent)
        up, spin = out[1], out[2]
        time = 2 * up / (GRAVITY * np.cos(SLOPE))
        along = ahead * np.cos(SLOPE) + up * np.sin(SLOPE)  # unchanged during the flight
        going = np.hypot(np.hypot(ahead, aside), up) >= STOP
        for line, distance in enumerate(DISTANCES):
            met = going & (x < distance) & (x + along * time >= distance)
            met &= np.isnan(offsets[alive, line])
            offsets[alive[met], line] = (y + aside * (distance - x) / along)[met]
        x, y = x + along * time, y + aside * time
        ahead, up = ahead + GRAVITY * np.sin(SLOPE) * time, -up
        keep = going & (x < DISTANCES[-1] + 50)
        ahead, aside, up, spin, x, y, alive = (
            one[keep] for one in (ahead, aside, up, spin, x, y, alive)
        )
        before = before[:, keep]
    return offsets


def rebounds(incoming, mean, root, random):
    """Outgoing velocities, redrawn until a boulder leaves the ground without a gain of energy;
    after 32 draws they are limited."""

    def energy(v):
        return v[0] ** 2 + v[1] ** 2 + 0.4 * v[2] ** 2

    out, left = np.empty_like(incoming), np.arange(incoming.shape[1])
    for _ in range(32):
        a = mean + random.normal(size=(left.size, 9)) @ root.T
        v = incoming[:, left]
        v = np.stack([sum(a[:, 3 * i + j] * v[j] for j in range(3)) for i in range(3)])
        out[:, left] = v
        left = left[(v[1] <= 0) | (energy(v) > energy(incoming[:, left]))]
    speed = np.hypot(*incoming[:2, left])
    out[1, left] = np.where(out[1, left] <= 0, speed / 100, out[1, left])
    out[:, left] *= np.minimum(1, np.sqrt(energy(incoming) / energy(out)))[left]
    return out


def new_headings(rule, heading, incoming, random):
    n = heading.size
    either = random.choice([-1.0, 1.0], n)
    rising = np.abs(heading) > np.pi / 2
    class_ = np.digitize(random.uniform(size=n), [0.72, 0.96])
    low, high = np.array([[0, 22.5, 45], [22.5, 45, 50]])[:, class_]
    turn = np.radians(random.uniform(low, high))
    side = np.where(heading == 0, either, -np.sign(heading))
    if rule == "to_aspect":
        turn = np.minimum(turn, np.abs(heading))
    after = heading + side * turn
    if rule == "lab":
        block = read_groups(f"&set {scenes.lateral(2)} /", "set")["set"]
        angle = np.degrees(np.arctan2(-incoming[1], incoming[0]))
        shares = [0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 1]
        u, class_ = random.uniform(size=n), np.digitize(angle, block["incidence"])
        by_class = [np.interp(u, shares, one) for one in np.reshape(block["lateral"], (3, 13))]
        turn = np.choose(class_, by_class)
        on_slope = np.arctan2(np.sin(heading) * np.cos(SLOPE), np.cos(heading))
        on_slope += either * np.radians(turn)
        after = np.arctan2(np.sin(on_slope), np.cos(on_slope) * np.cos(SLOPE))
    return np.where(rising, heading + np.radians(random.uniform(-22.5, 22.5, n)), after)


# ---- comparison with the kernel


def offsets_of(result):
    """Offsets (boulders, lines) along the contour from below the release."""
    x, y = (at_lines(result)[f"line_{axis}"].values.T for axis in "xy")
    return ACROSS[0] * (x - START[0]) + ACROSS[1] * (y - START[1])


def moments(v):
    """Mean and standard deviation of values that are not NaN, and the standard errors of both."""
    v = v[~np.isnan(v)]
    std = v.std(ddof=1)
    kurtosis = ((v - v.mean()) ** 4).mean() / std**4
    return v.mean(), std, std / np.sqrt(v.size), std * np.sqrt((kurtosis - 1) / v.size) / 2


@pytest.mark.all
@pytest.mark.parametrize("rule", ["past_aspect", "lab"])
def test_lateral_spread_is_that_of_the_bounce_map(plane, rule):
    """Standard deviations differ by less than three standard errors, which are below 3 %."""
    found, expected = offsets_of(plane(rule)), bounce_map(rule, 2 * BOULDERS)
    for line in range(DISTANCES.size):
        (mean, std, d_mean, d_std), (_, right, e_mean, e_std) = (
            moments(one[:, line]) for one in (found, expected)
        )
        assert right > 3 and np.hypot(d_std, e_std) < 0.03 * right
        assert abs(std - right) < 3 * np.hypot(d_std, e_std), (std, right)
        assert abs(mean) < 3 * d_mean
        shares = [(~np.isnan(one[:, line])).mean() for one in (found, expected)]
        error = np.sqrt(shares[1] * (1 - shares[1]) * 1.5 / BOULDERS)
        assert abs(shares[0] - shares[1]) < 3 * error + 1e-12, shares


def test_turns_that_end_at_the_aspect_spread_nothing(plane):
    found, expected = offsets_of(plane("to_aspect")), bounce_map("to_aspect", 1000)
    assert np.nanmax(np.abs(found)) < 1e-6 and np.nanmax(np.abs(expected)) < 1e-9
    assert np.isfinite(found).mean() > 0.5


def turns(result):
    """Angles [degree, anticlockwise] at each recorded contact that is not upslope: from the heading
    before to that after, and from the heading before to the aspect."""
    normal = np.array([*(np.sin(SLOPE) * DOWN), np.cos(SLOPE)])

    def headings(v):
        tangent = v - np.outer(v @ normal, normal)
        return np.angle(tangent[:, 0] + 1j * tangent[:, 1])

    after = np.stack([result[f"trajectory_velocity_{axis}"].values for axis in "xyz"], axis=1)
    time, number = result["trajectory_time"].values, result["trajectory_boulder"].values
    hit = np.flatnonzero((number[1:] == number[:-1]) & (result["trajectory_ratio"].values[1:] > 0))
    before = after[hit] - np.outer(GRAVITY * np.diff(time)[hit], [0, 0, 1])
    heading = headings(before) + np.pi * (result["trajectory_out_t"].values[hit + 1] < 0)
    aspect = np.angle(DOWN[0] + 1j * DOWN[1])
    apart = np.angle(np.exp(1j * (aspect - heading)))
    turn = np.angle(np.exp(1j * (headings(after[hit + 1]) - heading)))
    down = np.abs(apart) < np.pi / 2
    return np.degrees(turn[down]), np.degrees(apart[down])


def test_the_printed_classes_occur(plane):
    """Turns in the classes are 72, 24 and 4 %, within three standard errors, all to the side of the
    aspect."""
    turn, apart = turns(plane("past_aspect", 400, 400))
    share = np.histogram(np.abs(turn), [0, 22.5, 45, 50 + 1e-6])[0] / turn.size
    print(f"classes of {turn.size:,} turns: {np.round(100 * share, 2)} %")
    expected = np.array([0.72, 0.24, 0.04])
    assert turn.size > 10_000 and share.sum() == 1
    assert (np.abs(share - expected) < 3 * np.sqrt(expected * (1 - expected) / turn.size)).all()
    side = np.abs(apart) > 1e-6
    assert (turn * apart > 0)[side].all() and 0.2 < (np.abs(turn) > np.abs(apart)).mean() < 0.8
    tied = turn[~side]  # first contacts, after a vertical fall
    assert tied.size == 400 and abs((tied > 0).mean() - 0.5) < 3 * 0.5 / 20


def test_turns_at_most_to_the_aspect_leave_the_classes(plane):
    turn, apart = turns(plane("to_aspect", 50, 50))
    assert np.abs(turn).max() < 1e-5 and np.abs(apart).max() < 1e-5


def test_the_rule_is_that_of_the_paper_by_default():
    case = rockfall.read_case(VAUJANY / "case.nml")
    assert case.impact["turning"] == "past_aspect"
