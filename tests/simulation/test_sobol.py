# SPDX-License-Identifier: BSD-3-Clause
"""&case sampling = 'sobol': volumes and first rebounds spread evenly, and else as ever."""

import numpy as np
import pytest
from scipy.stats import kstest, norm

import rockfall
from made import refused
from rockfall.analysis.line_statistics import line_numbers
from rockfall.analysis.precision.intervals import Sources
from same import same_numbers
from scenes import grid, make_case, rough, sets

LINE = [{"name": "L", "x": [0.0, 300.0], "y": [280.0, 280.0]}]
X, Y = 152.25, 385.125
LAWS = {
    "uniform": ({"volume_mean": None, "volume_min": 0.1, "volume_max": 2.1},
                lambda v: (v - 0.1) / 2.0),
    "normal": ({"volume_mean": 0.8, "volume_std": 0.1}, norm(0.8, 0.1).cdf),
    "lognormal": ({"volume_mean": 1.0, "volume_std": 1.0},
                  lambda v: norm.cdf(np.log(v * 2**0.5) / np.log(2.0) ** 0.5)),
}  # fmt: skip


def sobol_case(folder, boulders, sources=1, law="uniform", **groups):
    """A case with sources at one place."""
    groups["case"] = {"boulders": boulders, "sampling": "sobol"} | groups.get("case", {})
    groups["release"] = {"x": [X] * sources, "y": [Y] * sources} | groups.get("release", {})
    groups["boulder"] = {"volume": law, **LAWS[law][0]}
    return make_case(folder, *groups.pop("sets", sets()), **groups)


def run(case, relief=3.0, **how):
    z = rough(relief=relief)
    return rockfall.run(case, dem=z, transform=grid(z), **how)


def one_in_each_stratum(share):
    """Whether each of n equal parts of 0..1 holds one of n numbers."""
    return np.array_equal(np.sort(np.floor(share * share.size)), np.arange(share.size))


@pytest.mark.parametrize("law", LAWS)
def test_volumes_of_each_source_hit_each_stratum_once(tmp_path, law):
    """Of 256; more boulders come after them."""
    result = run(sobol_case(tmp_path, 300, sources=3, law=law))
    samples = LAWS[law][1](result["volume"].values).reshape(3, 300)[:, :256]
    assert all(one_in_each_stratum(sample) for sample in samples)
    assert len(np.unique(samples)) == samples.size  # no source repeats another


def test_volumes_of_many_sources_are_those_of_their_law(tmp_path):
    result = run(sobol_case(tmp_path, 1, sources=5000), threads=2)
    assert kstest(LAWS["uniform"][1](result["volume"].values), "uniform").pvalue > 0.01


def first_contacts(folder, **groups):
    """What the trajectories of 1024 boulders record at their first contact with a plane."""
    groups = {"impact": {"impact_limit": 1}, "output": {"trajectories": 1024}} | groups
    return contacts(run(sobol_case(folder, 1024, **groups), relief=0.0), 1)


def contacts(result, k):
    """The k-th contact of each trajectory."""
    release = np.flatnonzero(np.diff(result["trajectory_boulder"].values, prepend=0))
    return result.isel(trajectory_vertex=release + k)


def one_entry(k):
    """Impact sets with scatter in one entry of A alone: it can be read from the rebound."""
    mean, spread = np.zeros(9), np.full(9, 1e-12)
    mean[[0, 4, 6]], spread[k] = (0.5, -0.3, 0.2), 0.01
    return mean[k], (np.tile(mean, (5, 1)), np.tile(np.diag(spread**2), (5, 1, 1)))


@pytest.mark.parametrize(("k", "out", "into"), [(0, "t", "t"), (4, "n", "n"), (6, "w", "t")])
def test_the_first_matrix_hits_each_stratum_once(tmp_path, k, out, into):
    mean, one = one_entry(k)
    first = first_contacts(tmp_path, sets=one)
    entry = first[f"trajectory_out_{out}"].values / first[f"trajectory_in_{into}"].values
    assert one_in_each_stratum(norm(mean, 0.01).cdf(entry))


def test_the_second_matrix_has_nothing_in_common_with_the_first(tmp_path):
    case = sobol_case(
        tmp_path, 1024, sets=one_entry(0)[1], impact={"impact_limit": 2},
        release={"velocity": [0.0, -20.0, 0.0]}, output={"trajectories": 1024},
    )  # fmt: skip
    result = run(case, relief=0.0)
    first, second = (
        (at["trajectory_out_t"] / at["trajectory_in_t"]).values
        for at in (contacts(result, 1), contacts(result, 2))
    )
    assert second.std() == pytest.approx(0.01, rel=0.15)
    assert abs(np.corrcoef(first, second)[0, 1]) < 4 / 32


def test_first_obstacles_and_turns_have_their_shares(tmp_path):
    """Of 1024 points, as many as a share says lie below it, to one point."""
    first = first_contacts(
        tmp_path, surface={"uniform_rg": [0.2, 0.4, 0.6], "method": "A"},
        release={"velocity": [30.0, 0.0, 0.0], "drop_height": 1.0},
    )  # fmt: skip
    radius = np.cbrt(0.75 / np.pi * first["volume"].values) / first["trajectory_ratio"].values
    for share, least in ((0.3, 0.15), (0.1, 0.25)):  # R_m = 0.1, 0.2, 0.3 m
        assert abs((radius > least).sum() - share * 1024) < 1
    normal = np.array([0.0, -0.8, 1.0]) / np.sqrt(1.64)
    before = np.array([30.0, 0.0, -9.81 * first["trajectory_time"].values[0]])
    before -= before @ normal * normal
    after = np.stack([first[f"trajectory_velocity_{axis}"].values for axis in "xyz"], axis=1)
    after -= first["trajectory_out_n"].values[:, None] * normal
    assert (first["trajectory_out_t"] > 0).all()  # none turned round
    east, north, _ = after.T
    turn = np.degrees(np.arctan2(before[1], before[0]) - np.arctan2(north, east))
    for share, most in ((0.72, 22.5), (0.96, 45.0)):
        assert abs((turn < most).sum() - share * 1024) < 1
    assert 49 < turn.max() < 50 and 0 < turn.min() < 0.1


def test_fewer_boulders_are_the_first_of_more(tmp_path):
    few, many = (run(sobol_case(tmp_path, n, line=LINE)) for n in (100, 333))
    names = [name for name, values in few.items() if "boulder" in values.dims]
    same_numbers(few[names + ["rebounds"]], many.isel(boulder=slice(100))[names].assign(
        rebounds=few["rebounds"]))  # fmt: skip


def test_random_is_the_default_and_differs(tmp_path):
    sobol = sobol_case(tmp_path, 50)
    random = sobol.replace(case={"sampling": "random"})
    same_numbers(run(random), run(sobol.replace(case={"sampling": None})))
    assert (run(random)["volume"].values != run(sobol)["volume"].values).all()


def test_intervals_hold_at_least_as_often_as_they_say(tmp_path):
    """400 samples of 64; the truth from as many random boulders."""
    case = sobol_case(tmp_path, 64, sources=400, law="lognormal", line=LINE)
    result, random = run(case), run(case.replace(case={"sampling": "random"}))
    for quantity in ("speed", "energy_translational"):
        truth = line_numbers(random, 0, quantity, Sources.alone(25600))
        samples = [
            line_numbers(result.isel(boulder=slice(k, k + 64)), 0, quantity, Sources.alone(64))
            for k in range(0, 25600, 64)
        ]
        for name in ("fraction", "mean", "q50"):
            held = [s[f"{name}_low"] <= truth[name] <= s[f"{name}_high"] for s in samples]
            assert np.mean(held) > 0.93, (quantity, name)


def test_refused(tmp_path):
    with refused("case: &case sampling = 'halton': must be one of: random, sobol"):
        sobol_case(tmp_path, 50, case={"sampling": "halton"})
    message = "must be at most 2**32 with sampling = 'sobol'"
    with refused(f"case: &case boulders = 4294967297: {message}"):
        sobol_case(tmp_path, 2**32 + 1)
    sobol_case(tmp_path, 2**32)
