# SPDX-License-Identifier: BSD-3-Clause
"""Runs whose maps would overflow are refused before they start; no others are."""

import numpy as np
import pytest

import rockfall
from rockfall.scene.read import read_scene
from rockfall.simulation.simulate import check_overflow, run_scene, start
from scenes import grid, make_case, rough, sets

Z = rough()
G = 9.81


def scene_of(folder, maps=("energy_mean", "energy_max"), boulders=1, **groups):
    release = {"x": [150.0], "y": [350.0], "drop_height": 5.0} | groups.pop("release", {})
    groups = {"case": {"boulders": boulders}, "output": {"maps": list(maps)}} | groups
    case = make_case(folder, *sets(), terrain={}, release=release, **groups)
    return read_scene(case, dem=Z, transform=grid(Z))


def check(scene):
    check_overflow(scene, scene.survey())


def fall(scene):
    """Height [m] of the maximum energy head above the lowest cell."""
    return scene.survey().head[0] - Z.min()


def test_a_billion_boulders_of_ten_cubic_metres_pass(tmp_path):
    normal = {"volume": "normal", "volume_mean": 10.0, "volume_std": 3.0}
    check(scene_of(tmp_path, boulders=10**9, boulder=normal))
    wide = {"volume": "lognormal", "volume_mean": 10.0, "volume_std": 20.0}
    check(scene_of(tmp_path, boulders=10**9, boulder=wide))  # a single one may have 14,000 m3


def test_the_bound_is_that_of_63_bits(tmp_path):
    """The sum of a map may be up to 9e18 J, below 2**63. For boulders of one volume it is bounded
    by the energy of the fall times their number."""
    scene = scene_of(tmp_path, boulders=1000)
    volume = 9.0e18 / (1000 * 2800 * G * fall(scene))
    for factor in 0.999, 1.001:
        boulder = {"volume": "fixed", "volume_mean": factor * volume}
        scene = scene_of(tmp_path, boulders=1000, boulder=boulder)
        if factor < 1:
            check(scene)
            continue
        with pytest.raises(rockfall.RockfallError, match="energy_mean: the sum of 1000 boulders"):
            start(scene, threads=1)


def test_squares_have_126_bits(tmp_path):
    """Squares of energies have 126 bits: a billion boulders of 10 m3 fit, a billion of 1000 m3 do
    not."""
    maps = {"maps": [f"{name}_std" for name in ("energy", "speed", "passing_height")]}
    check(scene_of(tmp_path, boulders=10**9, boulder={"volume_mean": 10.0}, **maps))
    with pytest.raises(rockfall.RockfallError, match="energy_std: the sum of 1000000000 .* J2 "):
        check(scene_of(tmp_path, boulders=10**9, boulder={"volume_mean": 1e3}, **maps))


@pytest.mark.parametrize("name", ["speed", "jump_height"])
def test_sums_of_other_quantities(tmp_path, name):
    many = {"maps": [f"{name}_mean"], "boulders": 2 * 10**9}
    high = {"release": {"drop_height": 1e12}, "flight": {"gravity": 1e12}}
    check(scene_of(tmp_path, **many))
    with pytest.raises(rockfall.RockfallError, match=f"{name}_mean: the sum of 2000000000 "):
        check(scene_of(tmp_path, **many, **high))
    check(scene_of(tmp_path, maps=["passages", "energy_q95"], **high))  # neither sums nor maxima


def test_sums_over_hits_of_trees(tmp_path):
    """A boulder may hit trees in a cell as often as it has contacts: their number fits, but not the
    sum of heights."""
    stand = {"uniform_stems": 9.0, "uniform_dbh_mean": 30.0, "uniform_dbh_std": 9.0}
    stand["uniform_conifers"] = 50.0
    wood = {"forest": stand, "boulders": 2 * 10**9}
    check(scene_of(tmp_path, maps=["tree_impacts"], **wood, impact={"impact_limit": 2**31 - 1}))
    few = {"maps": ["tree_impact_height_mean"], "impact": {"impact_limit": 1000}}
    check(scene_of(tmp_path, **few, **wood))
    with pytest.raises(rockfall.RockfallError, match="impact_height_mean.* or a lower &impact"):
        check(scene_of(tmp_path, maps=["tree_impact_height_mean"], **wood))


def test_maxima_are_of_single_precision(tmp_path):
    heavy = {
        "boulder": {"volume_mean": 1e12, "density": 1e12},
        "release": {"drop_height": 1e12}, "flight": {"gravity": 1e12},
    }  # fmt: skip
    with pytest.raises(rockfall.RockfallError, match="energy_max: can reach"):
        check(scene_of(tmp_path, maps=["energy_max"], **heavy))
    check(scene_of(tmp_path, maps=["speed_max_map"], **heavy))


def test_no_boulder_passes_the_bound(tmp_path):
    """No speed or energy exceeds the bound, and the largest energy is above 5 % of it."""
    scene = scene_of(tmp_path, boulders=300)
    result = run_scene(scene)
    assert result["energy_max"].max() <= 2800 * 0.8 * G * fall(scene) * (1 + 1e-6)
    assert np.nanmax(result["speed_max"]) <= np.sqrt(2 * G * fall(scene))
    assert result["energy_max"].max() > 0.05 * 2800 * 0.8 * G * fall(scene)
