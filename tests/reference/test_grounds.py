# SPDX-License-Identifier: BSD-3-Clause
"""Classical rebounds of the kernel compared with 50-digit arithmetic, contact by contact, and
properties of all grounds."""

from dataclasses import replace

import numpy as np
import pytest

import replay
import rockfall
import scenes
from made import every_third
from rockfall.scene.read import read_scene
from rockfall.simulation.simulate import run_scene

#: A row of each model with scatter, and an almost massless one.
COLUMNS = (
    "name,id,model,r_n,r_n_std,r_n_min,r_n_max,r_t,r_t_std,r_t_min,r_t_max,half_speed,"
    "half_speed_std,friction_angle,soil_density,obstacle_spread,roughness_angle,min_hop,source"
)
TABLE = f"""{COLUMNS}
soil,3,rockyfor3d,0.38,0.02,0.34,0.42,,,,,,,,1700,0.1,4,1,test
soft,4,rockyfor3d,0.13,0.05,,,,,,,,,,,0.5,,,test
dry,5,pfeiffer_bowen,0.33,0.03,,,0.85,0.05,0.8,0.9,,,,,,5,1,test
bouncy,6,bourrier_hungr,,,,,0.9,0.1,,,6.0,2.0,25,,,40,,test
sticky,7,bourrier_hungr,,,,,0.9,,,,3.0,,70,,,,0.5,test
road,8,constant,0.4,0.2,0.0,1.0,0.9,0.04,,,,,,,,2,2,test
flat,9,constant,0,,,,0.97,,,,,,,,,,,test
lake,10,absorbs,,,,,,,,,,,,,,,,test
"""
MODELS = "soil", "soft", "dry", "bouncy", "sticky", "road", "flat"
BOULDERS = 12


def judged(folder, z, rocks=None, **groups):
    """Run boulders down an array of elevations and compare every contact with the reference; return
    the result and the number of contacts."""
    (folder / "grounds.csv").write_text(TABLE)
    sources = np.size(groups.get("release", {}).get("x", 0.0))
    groups["case"] = {"boulders": -(-BOULDERS // sources), "seed": 2**40 + 77}
    groups["release"] = {"x": [149.8], "y": [382.6]} | groups.get("release", {})
    groups["boulder"] = {"volume": "normal", "volume_mean": 0.8, "volume_std": 0.15}
    groups["surface"]["ground_table"] = "grounds.csv"
    groups["impact"] = {"rest_angle": 90.0} | groups.get("impact", {})  # no rolling
    case = scenes.make_case(folder, *scenes.sets(), **groups)
    scene = read_scene(case, dem=z, transform=scenes.grid(z, 5.0, -2.5, -2.5), **(rocks or {}))
    scene = replay.at_origin(scene)
    scene = replace(scene, case=scene.case.replace(output={"trajectories": scene.boulders}))
    result, world = run_scene(scene), replay.world_of(scene)
    mean, covariance = scenes.sets()
    world = replace(world, mean=mean, covariance=covariance)
    contacts = undecided = 0
    for number, rows in enumerate(replay.tracks(result), 1):
        found = replay.replay(world, number, rows, result)
        assert not found.faults
        undecided += found.undecided
        for k, row in enumerate([*found.contacts, *found.crossings], 1):
            for error in row:
                assert error.size <= error.bound, (number, k, error)
        contacts += len(found.contacts)
    assert undecided <= BOULDERS // 6
    return result, contacts


@pytest.mark.parametrize("ground", every_third(MODELS))
def test_each_model_contact_by_contact(tmp_path, ground):
    surface = {"uniform_mean_radius": 0.1, "ground": ground}
    z = scenes.rough(gradient=1.0 if ground == "soft" else 0.8)
    result, contacts = judged(tmp_path, z, surface=surface, impact={"impact_limit": 25})
    assert contacts > (40 if ground == "soft" else 150)
    assert result["rebounds_by_ground"].values.tolist() == [int(result["rebounds"])]
    assert (result["rebounds_forced"] == result["rebounds"]) == (ground == "flat")


@pytest.mark.family(2)
@pytest.mark.parametrize("turning", ["to_aspect", "lab"])
def test_a_patchwork_of_all_grounds_and_of_rocks(tmp_path, turning):
    """Cells alternate between impact sets, classical rebounds and a lake. Obstacles are by method
    A, some without height and some 100 m high."""
    z = scenes.rough(gradient=1.5)
    random = np.random.default_rng(8)
    ids = random.choice([-5, 3, 4, 5, 6, 7, 8, 9], z.shape)  # -5 is masked below
    ids[40:80:4] = 10
    rocks = random.uniform(0.1, 1.0, (3, *z.shape)).astype("f4")
    rocks[:, ids == 3] *= random.choice([0.0, 1.0], (3, np.count_nonzero(ids == 3)))
    rocks[2, ids == 3] *= random.choice([1.0, 1000.0], np.count_nonzero(ids == 3))
    rocks[:, np.isin(ids, [5, 6, 7, 8])] = np.nan
    names = ("rg70", "rg20", "rg10")
    arrays = dict(zip(names, rocks, strict=True))
    arrays["ground_map"] = np.ma.masked_equal(ids, -5)
    surface = dict.fromkeys([*names, "ground_map"], "given") | {"method": "A"}
    result, contacts = judged(
        tmp_path, z, arrays, surface=surface,
        impact={"turning": turning, "ratio": "between", "impact_limit": 40},
        release={"x": np.linspace(50.2, 240.7, 8), "y": [382.6] * 8,
                 "velocity": [0.0, -15.0, 0.0], "drop_height": 5.0},
    )  # fmt: skip
    assert contacts > 60 and "absorbed" in scenes.status(result)
    by_ground = result["rebounds_by_ground"]
    assert int(by_ground.sum()) == int(result["rebounds"]) and (by_ground > 0).sum() == 8
    assert by_ground["ground"].values.tolist() == ["sets.nml", *MODELS, "lake"]


@pytest.mark.all
def test_very_fast_and_very_slow(tmp_path):
    """Boulders are thrown at 900 m/s, and dropped from 0.001 mm."""
    release = {"drop_height": 2.0, "velocity": [0.0, -200.0, -900.0]}
    for ground in MODELS:
        surface = {"uniform_mean_radius": 0.1, "ground": ground}
        judged(tmp_path, scenes.rough(), surface=surface, release=release,
               impact={"impact_limit": 4})  # fmt: skip
        judged(tmp_path, scenes.rough(), surface=surface, release={"drop_height": 1e-6},
               impact={"stop_speed": 1e-6, "impact_limit": 8})  # fmt: skip


def test_without_grounds_the_reference_sees_none(tmp_path):
    case = scenes.make_case(
        tmp_path, *scenes.sets(), release={"x": [150.0], "y": [380.0]}, terrain={}
    )
    z = scenes.rough()
    result = rockfall.run(case, dem=z, transform=scenes.grid(z))
    assert "rebounds_by_ground" not in result and "ground" not in result.coords
