# SPDX-License-Identifier: BSD-3-Clause
"""Runs by an impact table: bit-identical however they are divided, in both programs; no gain of
energy; rebounds agree with the records; refusals."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from rockfall._core import rockfall_f2py as _core

import rockfall
from made import every_third, refused
from programs import make_full_case, run_program, same_results
from rockfall.analysis.validity.remarks import model_remarks
from rockfall.case import case_of
from rockfall.grounds import YIELDING, draws_of, ensemble_names, shipped_rows
from rockfall.grounds.impact_tables import (
    BLOCK_SHAPES,
    FIELDS,
    YieldingGround,
    open_table,
    plane_files,
    save_table,
    shipped_tables,
)
from rockfall.result.trajectories import vertices_of
from rockfall.scene.prepare import prepare
from rockfall.scene.read import read_scene
from rockfall.simulation.simulate import run_scene
from rockfall.studies.ensemble.uncertain_inputs import Uncertain, drawn_scene
from rockfall.text.summary import summary
from same import same, same_numbers
from scenes import case_in, grid, place, rough
from table_scenes import BY_TABLE, on_plane, terrain

MEADOW = YieldingGround(24.0, 4e5, relief=9.0, relief_radius=0.4, hurst=0.8)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Folder with a user's table: shipped records for ground of another strength."""
    folder = tmp_path_factory.mktemp("made")
    table = open_table(shipped_tables()["ploughed-compact-9"])
    save_table(replace(table, ground=MEADOW), folder / "meadow.nc")
    return folder


@pytest.fixture(scope="module")
def whole(made):
    """Case and result with every output, by a table and by other grounds in stripes."""
    case = case_in(made, impact=BY_TABLE, **place())
    return case, rockfall.run(case, **terrain())


def rebounds(result):
    """Rows of V_t, V_n, W before and after each contact of all trajectories."""
    names = [f"{when}_{what}" for when in ("in", "out") for what in "tnw"]
    rows = np.concatenate(vertices_of(result, *names), axis=1)
    return rows[:, np.abs(rows[:3]).sum(axis=0) > 0]


@pytest.mark.family(2)
@pytest.mark.parametrize("lanes", every_third([0, 1, 2, 3]))
def test_no_bit_depends_on_lanes(whole, lanes):
    case, result = whole
    scene = read_scene(case, **terrain())
    _core.carry_in_lanes(scene.kernel.handle, lanes)
    same(run_scene(scene), result)


@pytest.mark.parametrize("lanes", [1, 2, 3])
def test_cells_along_contacts_are_the_same_in_lanes(whole, lanes):
    """Cells and hits along contacts on the ground are the same in lanes as for boulders run one by
    one."""
    maps = ["passages", "energy_mean", "passing_height_max", "travel_time_min"]
    output = {"maps": [*maps, "hits_energy_exceeded"], "rebounds": True, "trajectories": 0}
    scene = read_scene(whole[0].replace(output=output), **terrain())
    results = []
    for carried in (0, lanes):
        _core.carry_in_lanes(scene.kernel.handle, carried)
        results.append(run_scene(scene))
    assert results[0]["hits_energy_exceeded"].max() > 1
    same(*results)


def test_threads_and_chunks_change_nothing(whole):
    case, result = whole
    same(rockfall.run(case, threads=3, chunk=17, **terrain()), result)


def test_parts_join_to_the_run(whole):
    case, result = whole
    parts = [rockfall.run(case, shard=(k, 3), **terrain()) for k in (1, 2, 3)]
    same(rockfall.merge(parts), result)


def test_both_programs_give_the_same(made, tmp_path):
    shutil.copy(made / "meadow.nc", tmp_path)
    case = make_full_case(tmp_path, impact=BY_TABLE)
    prepare(case, tmp_path / "ready")
    done = run_program("case.nml", "-o", "out.nc", "--quiet", cwd=tmp_path / "ready")
    assert done.returncode == 0, done.stderr
    same_results(rockfall.merge([tmp_path / "ready" / "out.nc"]), rockfall.run(case))


def test_a_mirrored_scene_has_mirrored_boulders(made):
    found = []
    for side in (1, -1):
        z = rough()[:, ::side]
        x = 148.3 if side == 1 else 300.0 - 148.3
        case = rockfall.Case(
            folder=made, case={"boulders": 60, "seed": 3}, impact=BY_TABLE | {"impact_limit": 12},
            boulder={"volume": "fixed", "volume_mean": 0.8},
            release={"x": [x], "y": [381.1], "drop_height": 5.0, "velocity": [side, -2.0, 0.0]},
        )  # fmt: skip
        found.append(rockfall.run(case, dem=z, transform=grid(z)))
    one, other = found
    assert np.allclose(one["stop_x"], 300.0 - other["stop_x"], atol=1e-6)
    for name in ("stop_y", "stop_z", "speed_max", "impacts", "status", "travel_time"):
        assert np.allclose(one[name], other[name], rtol=1e-7), name


def test_no_contact_on_flat_ground_gains_energy(made):
    result = on_plane(made, 0.0, 2000, release={"velocity": [0.0, -12.0, 0.0]})
    v = rebounds(result)
    weight = np.array([1.0, 1.0, 0.4])[:, None]
    before, after = ((weight * one**2).sum(axis=0) for one in (v[:3], v[3:]))
    assert v.shape[1] > 5000
    assert (after <= before * (1 + 1e-12)).all()


def test_energy_that_was_released_is_accounted_for(made):
    result = on_plane(made, 30.0, output={"energy_balance": True})
    energy = {name: result[f"energy_{name}"].values for name in ("released", "ground", "left")}
    assert np.allclose(energy["released"], energy["ground"] + energy["left"], rtol=1e-9)


def test_a_boulder_rolls_on_over_a_bench(made):
    """A boulder may continue to roll where it landed: there are more than ten rebounds per
    boulder."""
    result = on_plane(made, 15.0)
    assert int(result["rebounds"]) > 10 * result.sizes["boulder"]


def test_the_density_of_the_blocks_matters_where_ground_yields(made):
    light, heavy = (on_plane(made, 30.0, boulder={"density": rho}) for rho in (1500.0, 4000.0))
    assert not np.array_equal(light["stop_y"], heavy["stop_y"])


def test_a_table_that_was_replaced_is_read_again(made, tmp_path):
    shutil.copy(made / "meadow.nc", tmp_path / "t.nc")
    before = open_table(tmp_path / "t.nc")
    assert open_table(tmp_path / "t.nc") is before
    save_table(open_table(shipped_tables()["rocky-slope"]), tmp_path / "t.nc")
    assert not open_table(tmp_path / "t.nc").equals(before)


def test_an_unknown_table_is_refused(made):
    case = rockfall.Case(
        folder=made, case={"boulders": 1}, impact={"form": "table", "table": "mud"},
        boulder={"volume": "fixed", "volume_mean": 1.0}, release={"x": [50.0], "y": [480.0]},
    )  # fmt: skip
    with pytest.raises(rockfall.RockfallError, match="no such impact table") as caught:
        rockfall.run(case, **terrain())
    assert caught.value.code == 2


@pytest.mark.parametrize(
    ("field", "value"),
    every_third(
        [("along_out", np.nan), ("follower", 1e6), ("pull_along", 9.0), ("duration", -1e-3)]
    ),
)
def test_a_damaged_table_is_refused(made, tmp_path, field, value):
    table = open_table(made / "meadow.nc")
    record = table.record.copy()
    record[3, FIELDS.index(field)] = value
    save_table(type(table)(**{**vars(table), "record": record}), tmp_path / "meadow.nc")
    case = rockfall.Case(
        folder=tmp_path, case={"boulders": 1}, impact=BY_TABLE,
        boulder={"volume": "fixed", "volume_mean": 1.0}, release={"x": [50.0], "y": [480.0]},
    )  # fmt: skip
    name = case.path("meadow.nc")
    with refused(f"{name}: is a damaged impact table"):
        rockfall.run(case, **terrain())


@pytest.mark.parametrize("path", shipped_tables().values(), ids=shipped_tables())
def test_shipped_tables_are_small_and_sound(path):
    table = open_table(path)
    assert path.stat().st_size < 1_000_000
    assert np.isfinite(table.record).all() and np.isfinite(table.map).all()
    assert table.attrs["contacts"] > 5_000 and "&throw" in table.attrs["lab_case"]
    if path.stem == "rocky-slope":
        assert table.attrs["shape"] == "sphere" and not table.ground.strength
        return
    _, shape, relief = path.stem.split("-")
    assert table.attrs["shape"] == shape and table.relief.tolist() == [float(relief)]


@pytest.mark.parametrize("model", YIELDING)
@pytest.mark.parametrize("shape", BLOCK_SHAPES)
def test_rows_of_a_plane_have_the_same_columns_and_bins(model, shape):
    rows = [open_table(path) for path in plane_files(model, shape).values()]
    assert len(rows) > 1
    for row in rows:
        assert np.array_equal(row.size, rows[0].size) and row.bins == rows[0].bins


def test_a_zone_names_the_table_of_its_ground_and_boulders_their_shape(tmp_path):
    found = []
    for shape in "compact", "platy":
        case = case_in(
            tmp_path, impact={"form": "table"}, surface={"ground": "meadow"},
            boulder={"block_shape": shape}, **place(),
        )  # fmt: skip
        found.append(rockfall.run(case, **terrain()))
        assert found[-1]["ground_model"].values.tolist() == ["impact_table"]
    assert not np.array_equal(*(one["stop_y"] for one in found))
    said = [one.text for one in model_remarks(found[0], case)]
    assert any("followed impact tables (meadow)" in text for text in said), said
    case = case_in(tmp_path, impact={"form": "table"}, surface={"ground": "rock"}, **place())
    said = [one.text for one in model_remarks(rockfall.run(case, **terrain()), case)]
    assert any("followed impact tables (untested: rock)" in text for text in said), said


def on_rocks(folder, ratio, **groups):
    """Result of boulders by the shipped table of rocks, with a given R_b/R_m."""
    radius = np.cbrt(0.75 / np.pi * 0.27)
    of_rocks = {"impact": {"form": "table", "table": "rocky-slope"}}
    of_rocks |= {"surface": {"uniform_mean_radius": radius / ratio}}
    return on_plane(folder, 38.0, **(of_rocks | groups))


@pytest.mark.parametrize("end", [0, -1])
def test_contacts_beyond_the_ratios_of_a_table_are_counted_and_reported(tmp_path, end):
    ratios = open_table(shipped_tables()["rocky-slope"]).size
    outward = -1 if end == 0 else 1
    inside, outside = (on_rocks(tmp_path, ratios[end] * f) for f in (1.01**-outward, 1.01**outward))
    counts = [int(one["rebounds_out_of_range"]) for one in (inside, outside)]
    assert counts == [0, int(outside["rebounds"])] and counts[1] > 1000
    said = f"had R_b/R_m outside their impact table (rocky-slope: 1 to {ratios[-1]:g})"
    heard = [one for one in model_remarks(outside, case_of(outside)) if said in one.text]
    assert [one.is_warning for one in heard] == [True]
    assert f"caution: {counts[1]:,} of {counts[1]:,} rebounds (100 %) {said}" in summary(outside)
    assert not any("R_b/R_m" in one.text for one in model_remarks(inside, case_of(inside)))


@pytest.mark.parametrize("ratio", [1.5, 7.9])
def test_boulders_take_off_from_rocks_within_their_relief(tmp_path, ratio):
    """Boulders take off within 5 R_b of the ground, because heights over facets do not add up."""
    result = on_rocks(tmp_path, ratio, output={"trajectories": 100})
    names = ("x", "y", "z", "velocity_x", "velocity_y", "velocity_z", "time", "in_t", "in_n")
    rises = []
    for vertices in vertices_of(result, *names):
        place, velocity, time, met = np.split(vertices, [3, 6, 7])
        pause = np.diff(time[0])
        flown = place[:, :-1] + velocity[:, :-1] * pause
        flown[2] -= 9.81 / 2 * pause**2
        missed = place[:, 1:] - flown
        flies = ~met[:, :-1].any(axis=0) & met[:, 1:].any(axis=0) & (pause > 1e-3)
        rises.append(missed[2, flies & (np.abs(missed[:2]).max(axis=0) < 1e-6)])
    radius = np.cbrt(0.75 / np.pi * 0.27)
    assert 0.5 * radius < np.concatenate(rises).max() < 5 * radius


@pytest.mark.parametrize("lanes", [0, 1, 2, 3])
def test_lanes_count_contacts_beyond_the_ratios_alike(tmp_path, lanes):
    """Every contact of a boulder larger than the largest size of the table is counted, and no
    other."""
    volumes = {"volume": "lognormal", "volume_mean": 0.27, "volume_std": 0.6}
    y = np.mgrid[199:-1:-1, 0:40][0] * 2.5
    z = 500 + np.tan(np.radians(38.0)) * y
    case = case_in(
        tmp_path, case={"boulders": 200}, impact={"form": "table", "table": "rocky-slope"},
        surface={"uniform_mean_radius": 0.02}, boulder=volumes, output={"maps": None},
        release={"x": [50.0], "y": [480.0]},
    )  # fmt: skip
    scene = read_scene(case, dem=z, transform=grid(z, 2.5))
    _core.carry_in_lanes(scene.kernel.handle, lanes)
    result = run_scene(scene)
    n, total = int(result["rebounds_out_of_range"]), int(result["rebounds"])
    largest = 0.02 * open_table(shipped_tables()["rocky-slope"]).size[-1]
    beyond = np.cbrt(0.75 / np.pi * result["volume"].values) > largest
    assert n == int(result["impacts"].values[beyond].sum()) and 0 < n < total


def test_where_terrain_ends_within_a_contact_all_is_known(made):
    """Values are finite for boulders that roll over the edge of the terrain or into a hole."""
    z = 500 + np.tan(np.radians(25.0)) * 2.5 * np.mgrid[79:-1:-1, 0:40][0]
    z[60:63, 10:14] = np.nan
    case = rockfall.Case(
        folder=made, case={"boulders": 300, "seed": 2}, impact=BY_TABLE,
        boulder={"volume": "fixed", "volume_mean": 0.3},
        release={"x": [40.0], "y": [190.0], "drop_height": 2.0}, output={"trajectories": 300},
    )  # fmt: skip
    result = rockfall.run(case, dem=z, transform=grid(z, 2.5))
    edge, hole = ((result["status"] == one).sum() for one in (3, 5))
    assert edge > 50 and hole > 50, "boulders that leave the known terrain"
    for name in ("speed_max", "stop_x", "stop_z", "travel_time", "trajectory_velocity_x"):
        assert np.isfinite(result[name]).all(), name


def test_the_ground_is_an_uncertain_input(made, tmp_path):
    """A draw of the ensemble is bit-identical to a run by its table."""
    case = case_in(
        tmp_path, case={"seed": 5, "boulders": 40}, impact={"form": "table", "table": "talus"},
        ensemble={"sets": ["meadow", "soft-soil"], "runs": 8}, output={"maps": None}, **place(),
    )  # fmt: skip
    scene = read_scene(case, **terrain())
    inputs = Uncertain(scene)
    assert inputs.names == ["sets"] and {*inputs.set_checksums} == {"meadow", "soft-soil"}
    stops = []
    for which, name in enumerate(["meadow", "soft-soil"]):
        drawn = run_scene(drawn_scene(scene, [inputs._set(which)], 5))
        alone = rockfall.run(case.replace(impact={"table": name}), **terrain())
        assert np.array_equal(drawn["stop_x"], alone["stop_x"])
        stops.append(drawn["stop_y"].values)
    assert not np.array_equal(*stops)
    with pytest.raises(rockfall.RockfallError, match="no such impact table"):
        Uncertain(read_scene(case.replace(ensemble={"sets": ["no-ground", "talus"]}), **terrain()))


@pytest.mark.parametrize("name", ensemble_names())
def test_each_draw_of_an_ensemble_is_a_run_on_its_ground(tmp_path, name):
    """A draw is bit-identical to a run on a row of a user's table with the values of the draw."""
    of = name.removesuffix("-ensemble")
    shipped = shipped_rows().rows[of].cells
    case = case_in(
        tmp_path, surface={"ground": of}, output={"maps": None},
        ensemble={"sets": [name], "runs": 8}, case={"boulders": 40}, **place(),
    )  # fmt: skip
    scene = read_scene(case, **terrain())
    inputs = Uncertain(scene)
    draws = draws_of(of)
    assert len(inputs.sets) == len(draws) > 1
    for which, values in enumerate(draws):
        drawn = run_scene(drawn_scene(scene, [inputs._set(which)], case.case["seed"]))
        cells = shipped | {key: repr(value) for key, value in values.items()}
        cells["id"] = ""
        table = f"{','.join(cells)}\n{','.join(quoted(cell) for cell in cells.values())}\n"
        (tmp_path / f"{which}.csv").write_text(table)
        alone = case.replace(surface={"ground_table": f"{which}.csv"}, ensemble={"sets": None})
        same_numbers(rockfall.run(alone, **terrain()), drawn)


def quoted(cell):
    return f'"{cell}"'


def test_ensembles_of_several_grounds_come_together(tmp_path):
    """Draws of each ground are combined with all draws of the others; a draw replaces only its own
    ground."""
    names = ensemble_names()
    case = case_in(
        tmp_path, impact={"form": "table", "table": "rock"}, output={"maps": None},
        ensemble={"sets": names[:1], "runs": 8}, case={"boulders": 10}, **place(),
    )  # fmt: skip
    with pytest.raises(rockfall.RockfallError, match="has no effect: it replaces"):
        Uncertain(read_scene(case, **terrain()))
    ids = np.arange(80)[:, None] % len(names) + np.ones((1, 60), np.int32)
    grounds = [one.removesuffix("-ensemble") for one in names]
    rows = "".join(f"{k},{name},0.1\n" for k, name in enumerate(grounds, start=1))
    (tmp_path / "zones.csv").write_text(f"zone,ground,mean_radius\n{rows}")
    zoned = case.replace(
        surface={"zones": "given", "table": "zones.csv", "uniform_mean_radius": None},
        ensemble={"sets": names},
    )
    scene = read_scene(zoned, **terrain(), zones=ids)
    inputs = Uncertain(scene)
    numbers = [len(draws_of(ground)) for ground in grounds]
    assert len(inputs.sets) == np.prod(numbers)
    changed = set()
    for which in range(len(inputs.sets)):
        drawn = inputs._set(which).arrays["grounds"]
        changed |= {b.name for a, b in zip(drawn, scene.grounds, strict=True) if a.text != b.text}
    assert changed == set(grounds)
