# SPDX-License-Identifier: BSD-3-Clause
"""The kernel compared with 50-digit arithmetic: each contact is within its rounding bound.

More boulders, on real terrain and with tables: benchmarks/accuracy/truth.py.
"""

import math
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

import reference
import replay
import rockfall
import scenes
from rockfall.scene.read import read_scene
from rockfall.simulation.simulate import run_scene

BOULDERS = 15
VAUJANY = Path(__file__).parents[2] / "cases/vaujany"
NO_ROLLS = {"rest_angle": 90.0}  # tested in test_rolling.py
NORMAL = {"volume": "normal", "volume_mean": 0.8, "volume_std": 0.15}


def judged(scene, **known):
    """Run a scene and compare its boulders with the reference, whose world has the values `known`.
    Returns the result and the findings for each boulder."""
    scene = replay.at_origin(scene)
    scene = replace(scene, case=scene.case.replace(output={"trajectories": scene.boulders}))
    result, world = run_scene(scene), replace(replay.world_of(scene), **known)
    found = [
        replay.replay(world, number, rows, result)
        for number, rows in enumerate(replay.tracks(result), 1)
    ]
    assert len(found) == scene.boulders
    assert sum(one.undecided for one in found) <= 1
    for number, one in enumerate(found, 1):
        assert not one.faults
        for names, rows in (
            (replay.QUANTITIES, one.contacts),
            (replay.CROSSED, one.crossings),
            (replay.TOTALS, [one.totals]),
        ):
            for k, row in enumerate(rows, 1):
                for name, error in zip(names, row, strict=False):
                    assert error.size <= error.bound, (number, k, name, error)
    return result, found


def both(folder, z, start, *, cell=5.0, scatter=1.0, sets=None, arrays=None, **groups):
    """Compare boulders on an array of elevations with the reference; `start` (x, y) is relative to
    the south-western cell centre."""
    groups["case"] = {"boulders": BOULDERS, "seed": 2**40 + 77} | groups.get("case", {})
    groups["boulder"] = groups.get("boulder", NORMAL)
    if start is not None:
        place = {"x": [start[0]], "y": [start[1]]}
        groups["release"] = place | groups.get("release", {})
    groups["impact"] = NO_ROLLS | groups.get("impact", {})
    mean, covariance = sets or scenes.sets(scatter)
    case = scenes.make_case(folder, mean, covariance, **groups)
    grid = scenes.grid(z, cell, -cell / 2, -cell / 2)
    noise = scenes.NOISE if groups.get("more") is scenes.noise else None
    scene = read_scene(case, dem=z, transform=grid, **(arrays or {}))
    return judged(scene, mean=mean, covariance=covariance, noise=noise)


def contacts(found):
    return sum(len(one.contacts) for one in found)


def valley():
    rows = np.abs(np.arange(80) - 40.0)[:, None]
    return scenes.rough(gradient=0.0, relief=6.0) + 0.02 * rows**2


# ---- the judge


def test_the_numbers_of_the_reference():
    """Random words are those of Random123 for zeros; sine, cosine and normal quantile agree with
    other implementations."""
    assert reference.philox([0] * 4, 0) == [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]
    for angle in (Decimal("-0.8"), Decimal(0), Decimal("0.3"), reference.PI / 3):
        c, s = reference.cosine_sine(angle)
        assert math.isclose(c, math.cos(angle), rel_tol=1e-15)
        assert math.isclose(s, math.sin(angle), rel_tol=1e-15)
        assert abs(c * c + s * s - 1) < Decimal("1e-48")
    for word in (0, 1, 77, 2**20 + 3, 2**31 - 1, 2**31, 2**32 - 2**10, 2**32 - 1):
        tail = (min(word, 2**32 - 1 - word) + 0.5) / 2**32
        wanted = math.copysign(norm.isf(tail), word - 2**31 + 0.5)
        assert math.isclose(reference.normal(word), wanted, rel_tol=1e-9, abs_tol=1e-10)
        assert math.isclose(reference.quantile(Decimal(tail)), norm.isf(tail), rel_tol=1e-13)


@pytest.mark.family(2)
@pytest.mark.parametrize(("field", "off"), [("x", 1e-10), ("in_n", 1e-11),
                                            ("out_w", 1e-10), ])  # fmt: skip
def test_an_error_that_is_hardly_there_is_seen(tmp_path, field, off):
    z = scenes.rough()
    case = scenes.make_case(
        tmp_path, *scenes.sets(), case={"boulders": 1}, boulder=NORMAL, impact=NO_ROLLS,
        release={"x": [149.8], "y": [382.6]}, output={"trajectories": 1},
    )  # fmt: skip
    scene = read_scene(case, dem=z, transform=scenes.grid(z, 5.0, -2.5, -2.5))
    result, world = run_scene(scene), replay.world_of(scene)
    rows = replay.tracks(result)[0]
    rows[3, replay.FIELDS.index(field)] += off
    found = replay.replay(world, 1, rows, result)
    assert max(error.share for error in found.contacts[2]) > 1
    assert max(error.share for row in found.contacts[:2] for error in row) < 1


# ---- the kernel


TURNINGS = "past_aspect", "to_aspect", "lab"


@pytest.mark.all
@pytest.mark.parametrize("turning", TURNINGS)
def test_down_a_rough_slope_over_lines(tmp_path, turning):
    line = [{"name": "straight", "x": [0.0, 295.0], "y": [280.3, 283.1]},
            {"name": "bent", "x": [20.0, 150.0, 280.0], "y": [300.0, 231.7, 290.0]}]  # fmt: skip
    impact, case = {"turning": turning}, {"boulders": 25}
    _, found = both(tmp_path, scenes.rough(), (149.8, 382.6), line=line, impact=impact, case=case)
    assert contacts(found) > 500
    assert sum(len(one.crossings) for one in found) > BOULDERS


@pytest.mark.all
@pytest.mark.parametrize("turning", TURNINGS)
def test_across_a_valley_where_boulders_turn_back(tmp_path, turning):
    impact = {"turning": turning}
    result, _ = both(tmp_path, valley(), (149.8, 382.6), scatter=4.0, impact=impact)
    assert result.rebounds_redrawn > 20


@pytest.mark.family(2)
@pytest.mark.parametrize("climb", [3.0, 18.0])
def test_released_uphill_into_the_slope_and_falling_back(tmp_path, climb):
    """Flights land against their initial direction, so that boulders roll backwards."""
    release = {"velocity": [1.0, 6.0, climb], "drop_height": 0.0}
    both(tmp_path, scenes.rough(gradient=1.5), (149.8, 150.3), release=release)


@pytest.mark.all
@pytest.mark.parametrize("reading", ["diameter", "radius"])
def test_obstacles_of_method_a_single_precision_nodata_and_a_river(tmp_path, reading):
    z = scenes.rough(dtype="f4")
    z[50:53, 20:24] = np.nan
    random = np.random.default_rng(3)
    rocks = random.uniform(0.1, 2.0, (3, *z.shape)).astype("f4")
    rocks[:, 60:62] = np.inf
    names = ("rg70", "rg20", "rg10")
    surface = {name: "given" for name in names} | {"method": "A", "rg_reading": reading}
    arrays = dict(zip(names, rocks, strict=True))
    result, _ = both(tmp_path, z, (130.2, 382.6), surface=surface, arrays=arrays)
    assert {"absorbed", "left_domain", "hit_nodata"} <= set(scenes.status(result))
    assert result.rebounds_out_of_range > 0


def test_ratios_between_two_sets(tmp_path):
    rocks = np.random.default_rng(6).uniform(0.08, 0.9, (80, 60)).astype("f4")
    mean, covariance = scenes.sets()
    sets = mean * np.linspace(0.9, 1.05, 5)[:, None], covariance
    both(tmp_path, scenes.rough(), (149.8, 382.6), sets=sets,
         surface={"mean_radius": "given"}, impact={"ratio": "between", "turning": "lab"},
         arrays={"mean_radius": rocks})  # fmt: skip


@pytest.mark.all
@pytest.mark.parametrize("scatter", [0.0, 8.0])
def test_noise_within_an_impact(tmp_path, scatter):
    """Noise acts alone, or with scatter so large that draws are rejected and repeated."""
    rocks = np.random.default_rng(4).uniform(0.1, 0.6, (80, 60)).astype("f4")
    result, _ = both(tmp_path, scenes.rough(), (149.8, 382.6), scatter=scatter, more=scenes.noise,
                     surface={"mean_radius": "given"}, arrays={"mean_radius": rocks})  # fmt: skip
    assert (result.rebounds_redrawn > 20) == (scatter > 0)


def test_mean_radius_that_changes_from_cell_to_cell(tmp_path):
    z = scenes.rough(seed=5)
    rocks = np.random.default_rng(4).uniform(0.08, 0.6, z.shape).astype("f4")
    both(tmp_path, z, (149.8, 382.6), surface={"mean_radius": "given"},
         arrays={"mean_radius": rocks})  # fmt: skip


@pytest.mark.family(2)
@pytest.mark.parametrize(
    "boulder",
    [{"volume": "lognormal", "volume_mean": 1.0, "volume_std": 1.0},
     {"volume": "uniform", "volume_min": 0.1, "volume_max": 2.0, "volume_mean": None},
     {"volume": "list", "volumes": [0.1, 0.4, 3.0], "volume_mean": None},
     {"volume": "pareto", "volume_min": 0.05, "volume_max": 8.0, "volume_exponent": 0.6,
      "volume_mean": None},
     NORMAL | {"volume_std": 1.5}],
    ids=["lognormal", "uniform", "list", "pareto", "truncated"],
)  # fmt: skip
def test_laws_of_volume(tmp_path, boulder):
    result, _ = both(
        tmp_path, scenes.rough(), None, boulder=boulder,
        case={"boulders": 5}, impact={"impact_limit": 3},
        release={"x": [149.8, 100.1, 200.3], "y": [382.6, 350.2, 300.9]},
    )  # fmt: skip
    assert "impact_limit" in scenes.status(result)


def test_steep_cells_that_release_by_their_area(tmp_path):
    """Boulders fall vertically onto nodes, where four patches meet, some of them next to nodata."""
    z = scenes.rough(gradient=1.2, relief=8.0)
    z[10:12, 30:33] = np.nan
    cells = np.zeros(z.shape, np.int32)
    cells[9, 28:34] = cells[20, 10:12] = cells[0, 5] = 1
    result, found = both(
        tmp_path, z, None, case={"boulders": 2}, arrays={"cells": cells},
        release={"cells": "given", "by_area": True, "drop_height": 1.5},
    )  # fmt: skip
    assert len(found) > 2 * np.count_nonzero(cells)


def test_sets_without_an_admissible_draw(tmp_path):
    """Every rebound is forced: upwards at a hundredth of the speed, without a gain of energy."""
    mean = np.tile([1.3, 0.0, 0.1, 0.05, 0.3, 0.0, 0.2, 0.0, 0.9], (5, 1))
    sets = mean, np.tile(1e-6 * np.eye(9), (5, 1, 1))
    result, _ = both(tmp_path, scenes.rough(), (149.8, 382.6), sets=sets,
                     case={"boulders": 3}, impact={"impact_limit": 12})  # fmt: skip
    assert result.rebounds_forced > 0.9 * result.rebounds > 0


@pytest.mark.family(3)
@pytest.mark.parametrize("turning", TURNINGS)
def test_on_a_plane_the_first_heading_lies_along_the_aspect(tmp_path, turning):
    """Rounding errors of the heading must not turn all boulders to the same side."""
    y, x = np.mgrid[79:-1:-1, :60] * 5.0
    z = 1000.0 + 0.3 * x + 0.8 * y
    _, found = both(tmp_path, z, (241.7, 352.6), impact={"turning": turning, "impact_limit": 6})
    assert contacts(found) > 4 * BOULDERS


def test_flats_pits_and_releases_at_rest_on_the_ground(tmp_path):
    """Boulders that fall where nothing descends take any heading; a boulder at rest on the ground
    never moves."""
    z = np.full((9, 9), 100.0)
    z[4, 4] = 98.0
    both(tmp_path, z, (12.3, 27.1), release={"drop_height": 4.0})
    both(tmp_path, z, (20.5, 19.2), release={"drop_height": 4.0})
    result, _ = both(tmp_path, scenes.rough(), (149.8, 382.6), release={"drop_height": 0.0})
    assert set(scenes.status(result)) == {"stopped"}


@pytest.mark.parametrize("name", ["case.nml", pytest.param("case_A.nml", marks=pytest.mark.all)])
def test_on_the_slope_of_the_paper(name):
    case = rockfall.read_case(VAUJANY / name)
    case = case.replace(case={"boulders": 6}, output={"maps": None, "rebounds": False})
    judged(read_scene(case))


def test_whole_ways_part_no_faster_than_roundings_grow(tmp_path):
    """From the release on, kernel and reference agree for fifteen contacts, with growing rounding
    errors. At least 80 % of the boulders end with the same status and number of contacts."""
    case = scenes.make_case(
        tmp_path, *scenes.sets(), case={"boulders": BOULDERS}, boulder=NORMAL, impact=NO_ROLLS,
        release={"x": [149.8], "y": [382.6]}, output={"trajectories": BOULDERS},
    )  # fmt: skip
    z = scenes.rough()
    scene = read_scene(case, dem=z, transform=scenes.grid(z, 5.0, -2.5, -2.5))
    result, world = run_scene(scene), replay.world_of(scene)
    same = 0
    for number, rows in enumerate(replay.tracks(result), 1):
        found = replay.retrace(world, number, rows)
        assert (np.array(found.apart[:15]) < 1e-11 * 3.0 ** np.arange(len(found.apart[:15]))).all()
        ended = found.status == replay.status_of(result, number)
        same += ended and found.impacts == result["impacts"].values[number - 1]
    assert same >= 0.8 * BOULDERS
