# SPDX-License-Identifier: BSD-3-Clause
"""Runs over several grounds: bit-identical however they are divided, in both programs; consistent
counts; and properties of all classical rebounds."""

import numpy as np
import pytest
from rockfall._core import rockfall_f2py as _core

import rockfall
from made import make_raster
from programs import make_full_case, same_results
from rockfall.cli import main
from rockfall.language import speaking
from rockfall.result.crossings import at_lines
from rockfall.scene.prepare import prepare
from rockfall.scene.read import read_scene
from rockfall.simulation.parts.checkpoint import Checkpoint
from rockfall.simulation.simulate import run_chunks, run_scene, start
from rockfall.tables.run import provenance
from rockfall.text.preview import preview
from same import same
from scenes import CALM_SETS, case_in, grid, make_case, place, rough, sets

MODELS = ["soil_4", "pfeiffer_hard", "road", "slope"]
OWN = """name,id,model,r_t,half_speed,friction_angle,roughness_angle,r_n,source
slope,4,bourrier_hungr,0.9,6,30,6,,test
soil_4,1,rockyfor3d,,,,4,0.38,test
pfeiffer_hard,2,pfeiffer_bowen,0.9,,,4,0.4,test
road,3,constant,0.9,,,4,0.4,test
"""


def mixed(folder, **groups):
    """Case with every output on `rough`, with stripes of all models and of the case's impact
    sets."""
    (folder / "grounds.csv").write_text(OWN)
    surface = {"uniform_mean_radius": 0.1, "ground_map": "given", "ground_table": "grounds.csv"}
    return case_in(folder, surface=surface, **place(), **groups)


def terrain():
    ids = np.arange(80)[:, None] % 5 + np.zeros((1, 60), np.int32)
    z = rough()
    return {"dem": z, "transform": grid(z), "ground_map": np.ma.masked_equal(ids, 0)}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    case = mixed(tmp_path_factory.mktemp("whole"))
    return case, rockfall.run(case, **terrain())


@pytest.mark.family(2)
@pytest.mark.parametrize("lanes", [0, 1])
def test_no_bit_depends_on_lanes(whole, lanes):
    case, result = whole
    scene = read_scene(case, **terrain())
    _core.carry_in_lanes(scene.kernel.handle, lanes)
    same(run_scene(scene), result)


def test_each_ground_has_its_rebounds(whole):
    _, result = whole
    by_ground = result["rebounds_by_ground"]
    assert by_ground["ground"].values.tolist() == ["sets.nml", "slope", *MODELS[:3]]
    assert (by_ground > 100).all() and int(by_ground.sum()) == int(result["rebounds"])
    assert by_ground.dtype == np.int64
    stochastic = int(by_ground[0])
    assert 0 < int(result["rebounds_redrawn"]) < stochastic
    assert all(int(result[f"rebounds_out_of_{of}"]) <= stochastic for of in ("speed", "angle"))


STOCHASTIC = "stochastic impact model of Bourrier et al. (2009)"
TABLES = "impact tables of rockfall's laboratory"


def test_a_result_names_the_models_of_its_rebounds(whole, tmp_path):
    """The file has the names of the models in English, whatever the language; sets are not among
    them if no rebound uses them."""
    classical = "rockyfor3d; pfeiffer bowen; constant; bourrier hungr"
    _, result = whole
    start, _, last = result.attrs["source"].partition("classical models: ")
    assert start == f"rockfall {rockfall.__version__}, {STOCHASTIC}; "
    assert sorted(last.split("; ")) == sorted(classical.split("; "))
    for groups, models in (
        ({}, STOCHASTIC),
        ({"impact": {"form": "table", "table": "talus"}}, TABLES),
        ({"surface": {"ground": "rock_ledge"}}, "classical models: constant"),
        ({"surface": {"ground": "soil_0"}}, "no rebounds"),
    ):
        place_ = {**place(), "case": {"boulders": 3}}
        case = case_in(tmp_path, **place_, **groups)
        with speaking("de"):
            found = rockfall.run(case, dem=rough(), transform=grid(rough()))
        assert found.attrs["source"] == f"rockfall {rockfall.__version__}, {models}"
        with speaking("fr"):
            rows = dict(provenance(found)["table"].rows)
        assert rows["programme"].startswith(f"rockfall {rockfall.__version__}, ")
        assert models not in rows["programme"]
        (named,) = (rows[name] for name in rows if "paramètres" in name)
        assert ("utilisé par aucun rebond" in named) == (models != STOCHASTIC)


def test_threads_and_chunks_change_nothing(whole):
    case, result = whole
    same(rockfall.run(case, threads=3, chunk=17, **terrain()), result)


@pytest.mark.all
def test_parts_join_to_the_run(whole, tmp_path):
    case, result = whole
    parts = [rockfall.run(case, shard=(k, 3), **terrain()) for k in (1, 2, 3)]
    same(rockfall.merge([parts[2], parts[0], parts[1]]), result)
    rockfall.write_result(parts[0], tmp_path / "part.nc")
    same(rockfall.merge([tmp_path / "part.nc", *parts[1:]]), result)
    damaged = parts[1].copy(deep=True)
    damaged["rebounds_by_ground"].values[2] = -1
    with pytest.raises(rockfall.RockfallError, match="is damaged: rebounds_by_ground"):
        rockfall.merge([parts[0], damaged, parts[2]])


def test_a_run_goes_on_from_its_checkpoint(whole, tmp_path):
    case, result = whole
    scene = read_scene(case, **terrain())
    tally = start(scene, 1)
    checkpoint = Checkpoint(tmp_path / "out.nc", 60)
    run_chunks(tally, 100, iter([False, False, True]).__next__, lambda _: None)
    checkpoint.save(tally)
    assert 0 < tally.done < tally.boulders
    same(run_scene(scene, checkpoint=Checkpoint(tmp_path / "out.nc", 60)), result)


@pytest.mark.all
def test_a_written_result_is_read_as_it_was(whole, tmp_path):
    _, result = whole
    rockfall.write_result(result, tmp_path / "out.nc")
    same(rockfall.read_result(tmp_path / "out.nc"), result)


@pytest.mark.family(2)
@pytest.mark.parametrize(
    "way",
    [
        "zones",
        "windows",
        *(pytest.param(one, marks=pytest.mark.all) for one in ("map", "everywhere")),
    ],
)
def test_both_programs_give_the_same_bits(batch, tmp_path, way):
    """Grounds are given by zones with an impact set of their own, by a raster (also read in
    windows), or everywhere."""
    (tmp_path / "grounds.csv").write_text(OWN)
    (tmp_path / "calm.nml").write_text(CALM_SETS)
    rows = "zone,mean_radius,ground\n4,0.25,{}\n-2,,{}\n77,inf,\n"
    surface = {"ground_table": "grounds.csv"}
    zones = rows.format("soil_4", "road")
    if way in ("map", "windows"):
        ids = np.arange(60)[None] // 3 % 5 + np.zeros((80, 1), "i2")
        make_raster(tmp_path / "soil.tif", ids.astype("i2"), nodata=0, crs="EPSG:32632")
        surface["ground_map"] = "soil.tif"
        zones = "zone,mean_radius\n4,0.25\n-2,0.1\n"
    elif way == "everywhere":
        surface |= {"zones": None, "table": None, "ground": "pfeiffer_hard"}
    else:
        zones = rows.format("calm.nml", "road")
    groups = {"surface": surface, "output": {"energy_balance": True}}
    if way == "windows":
        groups["output"] |= {"maps": ["passages", "deposits"]}
    case = make_full_case(tmp_path, **groups)
    (tmp_path / "zones.csv").write_text(zones)
    result = rockfall.run(case)
    assert (result["rebounds_by_ground"] > 0).any()
    if way == "windows":
        same_results(rockfall.run(case, memory=25_000), result)
    prepare(case, tmp_path / "ready")
    for k in (1, 2):
        done = batch("ready/case.nml", "--shard", f"{k}/2", "-o", f"p{k}", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        for name in result["ground"].values:
            assert name in done.stdout
    same_results(rockfall.merge([tmp_path / "p1", tmp_path / "p2"]), result)


def test_energy_never_grows_and_is_accounted_for(whole):
    case, _ = whole
    case = case.replace(output={"energy_balance": True, "maps": None})
    result = rockfall.run(case, **terrain())
    closing = result["energy_released"] - result["energy_ground"] - result["energy_left"]
    assert float(abs(closing / result["energy_released"]).max()) < 1e-9
    before, after = (
        sum(
            w * result[f"trajectory_{at}_{v}"].values ** 2
            for v, w in zip("tnw", (1, 1, 0.4), strict=True)
        )
        for at in ("in", "out")
    )
    hit = result["trajectory_ratio"].values != 0
    assert hit.sum() > 500 and (after[hit] <= before[hit] * (1 + 1e-14)).all()
    assert (result["trajectory_out_n"].values[hit] > 0).all()
    assert set(np.unique(result["trajectory_ratio"].values)) > {-1.0, 0.0}


def test_a_mirrored_scene_has_mirrored_boulders(tmp_path):
    """With east and west exchanged, headings turn to the other side, and all other values are
    unchanged."""
    line = [{"name": "L", "x": [0.0, 300.0], "y": [280.0, 280.0]}]
    found = []
    for side in (1, -1):
        (tmp_path / "grounds.csv").write_text(OWN)
        z, ids = rough()[:, ::side], terrain()["ground_map"][:, ::side]
        x = 148.3 if side == 1 else 300.0 - 148.3
        case = make_case(
            tmp_path, *sets(), line=line, case={"boulders": 60},
            surface={"uniform_mean_radius": 0.1, "ground_map": "given",
                     "ground_table": "grounds.csv"},
            release={"x": [x], "y": [381.1], "drop_height": 5.0}, impact={"impact_limit": 12},
        )  # fmt: skip
        found.append(rockfall.run(case, dem=z, transform=grid(z), ground_map=ids))
    one, other = found
    assert np.allclose(one["stop_x"], 300.0 - other["stop_x"], atol=1e-6)
    for name in ("stop_y", "stop_z", "speed_max", "impacts", "status", "travel_time"):
        assert np.allclose(one[name], other[name], rtol=1e-7), name
    assert (one["rebounds_by_ground"] == other["rebounds_by_ground"]).all()


def test_no_random_number_of_anything_else_changes(tmp_path):
    """With another ground below the line, volumes are unchanged, and so are the paths of boulders
    that do not reach it."""
    z = rough()
    ids = np.zeros(z.shape, np.int32)
    ids[40:] = 3
    plain = case_in(tmp_path, **place())
    (tmp_path / "grounds.csv").write_text(OWN)
    own = plain.replace(surface={"ground_map": "given", "ground_table": "grounds.csv"})
    one = rockfall.run(plain, dem=z, transform=grid(z))
    masked = np.ma.masked_equal(ids, 0)
    other = rockfall.run(own, dem=z, transform=grid(z), ground_map=masked)
    assert np.array_equal(one["volume"], other["volume"])
    stayed = one["stop_y"].values > 200.5
    assert np.array_equal(one["stop_x"].values[stayed], other["stop_x"].values[stayed])
    line = np.isfinite(at_lines(one)["line_speed"].values[0])  # above the other ground
    assert line.sum() > 50
    assert np.array_equal(
        at_lines(one)["line_speed"], at_lines(other)["line_speed"], equal_nan=True
    )
    assert (other["rebounds_by_ground"] > 0).sum() == 2


def test_a_check_says_what_rebounds_follow(tmp_path):
    case = mixed(tmp_path)
    text = preview(read_scene(case, **terrain()))
    assert "soil_4 (rockyfor3d)" in text and "of the rebounds of a pilot run" in text
    assert "R_m 0.1 m" in text


@pytest.mark.all
def test_the_summary_and_the_page_have_a_row_for_each_ground(tmp_path, capsys, blank_figures):
    make_full_case(tmp_path, surface={"zones": None, "table": None, "ground": "road"})
    assert main(["run", str(tmp_path / "case.nml"), "-o", str(tmp_path / "out.nc")]) == 0
    out = capsys.readouterr().out
    assert "  ground" in out and "  road" in out and "constant" in out
    assert main(["report", str(tmp_path / "out.nc")]) == 0
    page = (tmp_path / "out.html").read_text()
    assert "Rebounds by ground" in page and "<td>constant</td>" in page.replace("th>", "td>")


@pytest.mark.family(2)
@pytest.mark.parametrize("lanes", [pytest.param(0, marks=pytest.mark.all), 1])
@pytest.mark.parametrize("form", ["matrix", "table"])
def test_slow_boulders_rest_where_their_ground_holds_them(tmp_path, form, lanes):
    """A plane of 33 degrees holds some boulders on talus and none on meadow; a given rest angle has
    priority."""

    def resting(ground, **impact):
        z = 500 + 5 * np.tan(np.radians(33.0)) * np.mgrid[40:0:-1, 0:40][0]
        release = {"x": [100.0], "y": [150.0], "drop_height": 0.001}
        where = {"ground": f"constant_{ground}"} if form == "matrix" else {}
        impact |= {"form": form} | ({"table": ground} if form == "table" else {})
        case = rockfall.Case(
            folder=tmp_path, case={"boulders": 400, "seed": 5}, release=release, impact=impact,
            boulder={"volume": "fixed", "volume_mean": 0.3}, surface=where,
        )  # fmt: skip
        scene = read_scene(case, dem=z, transform=grid(z))
        _core.carry_in_lanes(scene.kernel.handle, lanes)
        return np.mean(150.0 - run_scene(scene)["stop_y"].values < 2)

    assert resting("talus") > (0.3 if form == "matrix" else 0)
    assert resting("meadow") == 0
    if form == "matrix":  # with the table, no boulder stops there at any rest angle
        assert resting("meadow", rest_angle=38.0) > 0
    assert resting("talus", rest_angle=27.0) == 0
