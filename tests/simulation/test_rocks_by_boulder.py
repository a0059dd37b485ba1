# SPDX-License-Identifier: BSD-3-Clause
"""Rock sizes that vary by boulder (`&boulder mean_radius_sigma`): R_b/R_m of rebounds, its
distribution, bit-identical results, and refusals."""

import numpy as np
import pytest
from rockfall._core import rockfall_f2py as _core

import rockfall
from made import refused
from programs import find_program, make_full_case, run_program, same_results
from rockfall.errors import RockfallError
from rockfall.scene.prepare import prepare
from rockfall.scene.read import read_scene
from rockfall.simulation.simulate import run_scene
from rockfall.text.preview import preview
from same import same, same_numbers
from scenes import case_in, grid, place, rough

SIGMA = 0.5


def first_ratios(result):
    """R_b/R_m of the first rebound of each recorded boulder."""
    starts = np.flatnonzero(np.diff(result["trajectory_boulder"].values, prepend=0))
    ratio = result["trajectory_ratio"].values
    return np.array([ratio[start + 1] for start in starts])


@pytest.mark.all
@pytest.mark.parametrize("surface, groups", [
    ({"uniform_mean_radius": 0.25}, {}),
    ({"uniform_mean_radius": 0.25}, {"impact": {"ratio": "nearest"}}),
    ({"uniform_rg": [0.3, 0.5, 0.9], "method": "A"}, {}),
    ({"ground": "rocky-slope", "uniform_mean_radius": 0.25}, {}),
    ({"uniform_mean_radius": 0.25}, {"breakage": {"at": "impact", "min_area_ratio": 0.3}}),
], ids=["between", "nearest", "method A", "rocky-slope", "fragments"])  # fmt: skip
def test_a_boulder_has_the_bits_of_a_run_on_its_own_rocks(tmp_path, surface, groups):
    """The rocks of a boulder, and of its fragments, have the median radius times exp(-s z), where z
    is its ground strength."""
    z = rough()
    arrays = {"dem": z, "transform": grid(z)}
    case = case_in(tmp_path, surface=surface, case={"boulders": 40}, **place(), **groups)
    case = case.replace(boulder={"mean_radius_sigma": SIGMA})
    result = rockfall.run(case, **arrays)
    sizes = {key: np.array(value) for key, value in surface.items() if key.startswith("uniform")}
    strength = rockfall.ground_strength(result).values
    assert "breakage" not in groups or (result["fragments"] > 1).any()
    for k in (0, 7, 39):
        own = {name: (size * np.exp(-SIGMA * strength[k])).tolist() for name, size in sizes.items()}
        without = case.replace(surface=own, boulder={"mean_radius_sigma": None})
        alone = rockfall.run(without, **arrays)
        of_k, whole = (run["trajectory_boulder"].values == k + 1 for run in (alone, result))
        assert result["travel_time"][k] > 1
        for name in "stop_x", "stop_y", "path_length", "speed_max", "travel_time":
            assert result[name][k] == alone[name][k], name
        np.testing.assert_allclose(
            result["trajectory_ratio"][whole], alone["trajectory_ratio"][of_k], rtol=1e-12
        )


def test_ratios_are_lognormal(tmp_path):
    z, n = rough(), 2000
    case = case_in(
        tmp_path, case={"boulders": n}, boulder={"mean_radius_sigma": SIGMA},
        output={"maps": None, "rebounds": None, "trajectories": n}, **place(),
    )  # fmt: skip
    result = rockfall.run(case, dem=z, transform=grid(z))
    radius = (3 * 0.8 / (4 * np.pi)) ** (1 / 3)
    deviate = np.log(first_ratios(result) / (radius / 0.25)) / SIGMA
    np.testing.assert_allclose(deviate, rockfall.ground_strength(result), atol=1e-9)
    assert abs(deviate.mean()) < 4 / np.sqrt(n) and abs(deviate.std() - 1) < 4 / np.sqrt(2 * n)


def mixed(folder):
    """Case with impact sets, impact tables and a classical ground in zones, and its arrays."""
    (folder / "zones.csv").write_text(
        "zone,mean_radius,ground\n1,0.25,\n2,0.4,talus\n3,0.2,soil_4\n4,0.3,rocky-slope\n"
    )
    case = case_in(
        folder, surface={"zones": "given", "table": "zones.csv"}, case={"boulders": 120},
        boulder={"volume": "lognormal", "volume_mean": 0.6, "volume_std": 0.6,
                 "mean_radius_sigma": SIGMA}, **place(),
    )  # fmt: skip
    z = rough()
    zones = (np.arange(80)[:, None] // 5 % 4 + np.ones((1, 60))).astype("i4")
    return case, {"dem": z, "transform": grid(z), "zones": zones}


@pytest.fixture(scope="module")
def spread(tmp_path_factory):
    case, arrays = mixed(tmp_path_factory.mktemp("mixed"))
    return case, arrays, rockfall.run(case, **arrays)


@pytest.mark.family(2)
@pytest.mark.parametrize("lanes", [0, 1, 2, 3])
def test_no_bit_depends_on_lanes(spread, lanes):
    case, arrays, result = spread
    assert (result["rebounds_by_ground"] > 100).all()
    scene = read_scene(case, **arrays)
    _core.carry_in_lanes(scene.kernel.handle, lanes)
    same(run_scene(scene), result)


@pytest.mark.family(2)
@pytest.mark.parametrize("output", [{}, {"maps": None, "trajectories": None}])
def test_lanes_with_impact_sets_alone(tmp_path, output):
    """Runs by impact sets alone have a compiled loop of their own, which gives the same bits in
    lanes."""
    case = case_in(tmp_path, boulder={"mean_radius_sigma": SIGMA}, **place())
    z = rough()
    scene = read_scene(case.replace(output=output), dem=z, transform=grid(z))
    results = []
    for lanes in 0, 3:
        _core.carry_in_lanes(scene.kernel.handle, lanes)
        results.append(run_scene(scene))
    same(*results)
    usual = rockfall.run(
        case.replace(output=output, boulder={"mean_radius_sigma": None}), dem=z, transform=grid(z)
    )
    assert not np.array_equal(usual["stop_x"], results[0]["stop_x"])


@pytest.mark.all
def test_threads_chunks_and_parts_change_nothing(spread):
    case, arrays, result = spread
    same(rockfall.run(case, threads=3, chunk=17, **arrays), result)
    parts = [rockfall.run(case, shard=(k, 3), **arrays) for k in (1, 2, 3)]
    same(rockfall.merge(parts), result)


@pytest.mark.skipif(not find_program(), reason="no rockfall-batch")
def test_both_programs_give_the_same(tmp_path):
    case = make_full_case(tmp_path, boulder={"mean_radius_sigma": SIGMA}, case={"boulders": 20})
    prepare(case, tmp_path / "ready")
    done = run_program("case.nml", "-o", "out.nc", "--quiet", cwd=tmp_path / "ready")
    assert done.returncode == 0, done.stderr
    same_results(rockfall.merge([tmp_path / "ready" / "out.nc"]), rockfall.run(case))


def test_zero_is_none(tmp_path):
    z = rough()
    case = case_in(tmp_path, **place())
    none = rockfall.run(case, dem=z, transform=grid(z))
    zero = rockfall.run(case.replace(boulder={"mean_radius_sigma": 0.0}), dem=z, transform=grid(z))
    same_numbers(zero, none)


def test_classical_grounds_keep_their_obstacles(tmp_path):
    """Only R_b/R_m of impact sets and of their tables changes."""
    case, arrays = mixed(tmp_path)
    (tmp_path / "zones.csv").write_text(
        "zone,mean_radius,ground\n1,0.25,soil_4\n2,0.4,talus\n3,0.2,soil_4\n4,0.3,\n"
    )
    arrays["zones"] = arrays["zones"] % 3 + 1
    arrays["zones"][0, 0] = 4  # where no boulder passes; otherwise the key would have no effect
    same_numbers(
        rockfall.run(case, **arrays).drop_vars("trajectory_ratio"),
        rockfall.run(case.replace(boulder={"mean_radius_sigma": None}), **arrays).drop_vars(
            "trajectory_ratio"
        ),
    )


def test_the_preview_has_neutral_slopes_of_all_boulders(tmp_path):
    """For boulders of one volume, the range of R_b/R_m is that of the middle 90 % of rock sizes."""
    z = rough()
    case = case_in(tmp_path, **place()).replace(case={"boulders": 20})
    plain, wide = (
        preview(read_scene(case.replace(boulder=keys), dem=z, transform=grid(z)))
        for keys in ({}, {"mean_radius_sigma": 0.5})
    )
    (before,), (after,) = (
        [line for line in text.splitlines() if "R_b/R_m" in line and "neutral" in line]
        for text in (plain, wide)
    )
    radius = (3 * 0.8 / (4 * np.pi)) ** (1 / 3)
    low, high = (radius / 0.25 * np.exp(sign * 0.5 * 1.645) for sign in (-1, 1))
    assert "(" not in before.partition("neutral")[0]
    said = after.partition("R_b/R_m ")[2].partition(";")[0]
    ends = [float(text) for text in said.partition("(")[2].rstrip(")").split(" to ")]
    np.testing.assert_allclose(ends, [low, high], rtol=0.03)


@pytest.mark.parametrize("groups, said", [
    ({"surface": {"uniform_mean_radius": 0.2}, "boulder": {"mean_radius_sigma": 1.6}},
     "&boulder mean_radius_sigma = 1.6: must be 0 to 1.5"),
    ({"surface": {"ground": "talus"}},
     "&boulder mean_radius_sigma = 0.5: is only valid with rock sizes in &surface"),
    ({"impact": {"table": "talus"}, "surface": {}},
     "&boulder mean_radius_sigma = 0.5: is only valid with rock sizes in &surface"),
])  # fmt: skip
def test_what_a_case_cannot_mean_is_refused(groups, said):
    boulder = {"volume_mean": 1.0, "mean_radius_sigma": SIGMA} | groups.pop("boulder", {})
    with refused(f"case: {said}"):
        rockfall.Case(
            case={"boulders": 1}, boulder=boulder, terrain={"dem": "x.tif"},
            release={"x": [1.0], "y": [1.0]}, **groups,
        )  # fmt: skip


def test_it_is_refused_where_no_ground_compares_sizes(tmp_path):
    z = rough()
    case = case_in(tmp_path, surface={"uniform_mean_radius": 0.2, "ground": "talus"}, **place())
    case = case.replace(boulder={"mean_radius_sigma": SIGMA})
    with pytest.raises(RockfallError, match="mean_radius_sigma = 0.5: is only valid with impact"):
        read_scene(case, dem=z, transform=grid(z))
