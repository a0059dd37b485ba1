# SPDX-License-Identifier: BSD-3-Clause
"""Boulders run in lanes are bit-identical to boulders run one by one, on any processor and with any
threads and chunks."""

import numpy as np
import pytest
from rockfall._core import rockfall_f2py as _core

from benchmarks.stability import extremes
from made import every_third
from rockfall.result.crossings import at_lines
from rockfall.scene.read import read_scene
from rockfall.simulation.simulate import run_scene
from same import same_numbers
from scenes import grid, make_case, rough, sets, status

ONE_BY_ONE, NARROW, WIDE, MASKED = 0, 1, 2, 3  # as in rockfall_scene_type
BARE = {"maps": None, "rebounds": False, "trajectories": 0}
LINES = [
    {"name": "low", "x": [5.0, 295.0], "y": [200.0, 200.0]},
    {"name": "bent", "x": [5.0, 150.0, 295.0], "y": [300.0, 310.0, 290.0]},
]
MAPS = [
    "passages",
    "energy_mean",
    "energy_q95",
    "passing_height_max",
    "energy_line_angle_max",
    "travel_time_min",
    "hits",
    "hits_energy_exceeded",
]
TREES = ["tree_impacts", "tree_impact_height_mean", "tree_energy"]
ROLLS = {"sets": "sets.nml", "rest_angle": 10.0, "stop_speed": 3.0, "impact_limit": 60}
STAND = {"uniform_stems": 800, "uniform_dbh_mean": 12.0, "uniform_dbh_std": 4.0}
STAND |= {"uniform_conifers": 60.0}
NETS = [
    {"name": "net", "x": [5.0, 295.0], "y": [330.0, 330.0], "height": 1.5, "capacity": 20.0},
    {"name": "dam", "x": [20.0, 280.0], "y": [250.0, 310.0], "height": 2.0, "capacity": 1e4},
]
EXTREMES = {scene.name: scene for scene in extremes.scenes()}


def carried(scene, lanes, **how):
    _core.carry_in_lanes(scene.kernel.handle, lanes)
    return run_scene(scene, keep=True, **how)


def slope(folder, line=LINES, barrier=(), **groups):
    """Scene of a rough slope of 0.8 with a hole and an edge that boulders cross."""
    z = rough()
    z[60:64, 25:28] = np.nan
    sources = {"x": [60.0, 150.0, 293.0], "y": [380.0] * 3, "drop_height": 5.0}
    usual = {"case": {"boulders": 60}, "terrain": {}, "release": sources, "output": BARE}
    case = make_case(folder, *sets(2.0), line=line, **(usual | groups)).replace(barrier=[*barrier])
    return read_scene(case, dem=z, transform=grid(z))


@pytest.mark.family(2)
@pytest.mark.parametrize("lanes", [NARROW, WIDE, MASKED])
@pytest.mark.parametrize(
    "how", [{"threads": 1}, {"threads": 4}, {"threads": 1, "chunk": 7}, {"threads": 4, "chunk": 65}]
)
def test_no_number_depends_on_lanes(tmp_path, lanes, how):
    scene = slope(tmp_path)
    alone = carried(scene, ONE_BY_ONE, threads=1)
    assert {"stopped", "left_domain", "hit_nodata"} <= set(status(alone))
    assert alone["rebounds_redrawn"] > 0
    same_numbers(carried(scene, lanes, **how), alone)


@pytest.mark.family(2)
@pytest.mark.parametrize(
    "groups",
    [
        {
            "case": {"boulders": 60},
            "boulder": {"volume": "lognormal", "volume_mean": 1.0, "volume_std": 1.0},
        },
        {"line": []},
        {"output": BARE | {"maps": ["deposits"]}},
        {"output": BARE | {"maps": MAPS, "rebounds": True}},
        {"line": [], "output": BARE | {"maps": ["passages"], "rebounds": True}},
        {"surface": {"method": "A", "uniform_rg": [0.5, 0.9, 2.0]}},
        {"impact": {"sets": "sets.nml", "impact_limit": 3}},
        {"impact": {"sets": "sets.nml", "turning": "to_aspect"}},
        {"output": BARE | {"energy_balance": True}},
        {"impact": ROLLS, "output": BARE | {"energy_balance": True}},
        {"forest": STAND},
        {"forest": STAND, "line": [], "impact": ROLLS},
        {"forest": STAND | {"stem_height": 0.8}, "output": BARE | {"maps": MAPS + TREES}},
        {"barrier": NETS, "line": [], "output": BARE | {"maps": ["passages"]}},
        {"barrier": NETS, "forest": STAND, "impact": ROLLS, "output": BARE | {"maps": MAPS}},
    ],
    ids=[
        "lognormal volumes",
        "no lines",
        "deposits",
        "maps and histograms",
        "passages",
        "method A",
        "impact limit",
        "to_aspect",
        "energy balance",
        "energy balance and rolls",
        "forest",
        "forest and rolls",
        "forest and maps",
        "nets",
        "all obstacles",
    ],
)
def test_what_is_asked_for_is_the_same_in_lanes(tmp_path, groups):
    scene = slope(tmp_path, **groups)
    alone = carried(scene, ONE_BY_ONE)
    assert "forest" not in groups or alone.trees_hit.sum() > 30
    assert "barrier" not in groups or {1, 2, 3} <= {*np.unique(at_lines(alone)["barrier_outcome"])}
    for lanes in (NARROW, WIDE, MASKED):
        same_numbers(carried(scene, lanes), alone)


@pytest.mark.family(2)
@pytest.mark.parametrize("name", every_third(EXTREMES))
def test_extreme_scenes_are_the_same_in_lanes(name, tmp_path):
    extreme = EXTREMES[name]
    scene = read_scene(extreme.case(tmp_path, 150), **extreme.arrays())
    alone = carried(scene, ONE_BY_ONE)
    assert alone.impacts.sum() > 20
    for lanes in (NARROW, WIDE, MASKED):
        same_numbers(carried(scene, lanes), alone)


@pytest.mark.parametrize("lanes", every_third([MASKED, ONE_BY_ONE]))
def test_a_line_has_the_same_crossings_among_many(tmp_path, lanes):
    """Many lines are found by a spatial index, few by comparison with each flight: the crossings
    are the same."""
    random = np.random.default_rng(7)
    x = random.uniform(5.0, 295.0, (40, 3))
    y = random.uniform(100.0, 380.0, (40, 1)) + random.uniform(-60.0, 20.0, (40, 3))
    lines = [{"name": f"L{k}", "x": [*x[k]], "y": [*y[k]]} for k in range(40)]
    lines[5] |= {"object_width": 4.0}
    together = carried(slope(tmp_path, lines), lanes, threads=2)
    assert (np.isfinite(at_lines(together)["line_time"].values).sum(axis=1) > 0).sum() > 20
    for first in range(0, 40, 8):
        few = carried(slope(tmp_path, lines[first : first + 8]), lanes, threads=2)
        for name in few.variables:
            if name.startswith("line_") and few[name].dims == ("line", "boulder"):
                np.testing.assert_array_equal(together[name][first : first + 8], few[name])
