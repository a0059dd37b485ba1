# SPDX-License-Identifier: BSD-3-Clause
"""Boulders that break: bit-identical results however they are run, energy and volume are conserved,
and runs without a break are unchanged."""

import re

import numpy as np
import pytest

import rockfall
import scenes
from programs import Killed, killed_after, make_prepared, refuses, same_results
from rockfall.analysis.validity.remarks import model_remarks
from rockfall.case import case_of
from rockfall.cli import main
from rockfall.result import variables
from rockfall.result.crossings import at_lines, line_values
from rockfall.scene.read import read_scene
from rockfall.scene.rebounds.breakage import breaking_speed, split_blocks
from rockfall.simulation.parts import checkpoint
from rockfall.simulation.simulate import run_scene
from same import same, same_numbers

LINES = [
    {"name": "low", "x": [5.0, 295.0], "y": [200.0, 200.0]},
    {"name": "object", "x": [150.0, 151.0], "y": [250.0, 250.0], "object_width": 20.0},
]
MAPS = list(variables.MAP)
BOTH = {"at": "both", "release_fall": 8.0, "min_area_ratio": 0.6, "max_fragments": 60}
FOREST = {"uniform_stems": 100.0, "uniform_dbh_mean": 30.0, "uniform_dbh_std": 5.0,
          "uniform_conifers": 50.0}  # fmt: skip
NET = {"name": "net", "x": [5.0, 295.0], "y": [120.0, 120.0], "height": 3.0, "capacity": 300.0}


def case(folder, boulders=30, scatter=2.0, obstacles=True, **groups):
    """Case with two sources on a rough slope and, unless `obstacles` is False, trees and a net."""
    usual = {
        "case": {"boulders": boulders},
        "surface": {"uniform_mean_radius": 0.3},
        "impact": {"ratio": "nearest"},
        "boulder": {"volume": "lognormal", "volume_mean": 1.5, "volume_std": 1.0},
        "release": {"x": [152.25, 140.0], "y": [385.125, 380.0], "drop_height": 3.0},
        "output": {"maps": MAPS, "rebounds": True, "energy_balance": True, "trajectories": 20},
    }
    if obstacles:
        usual |= {"forest": FOREST}
    usual = {name: usual.get(name, {}) | groups.get(name, {}) for name in {**usual, **groups}}
    made = scenes.make_case(folder, *scenes.sets(scatter), line=LINES, **usual)
    return made.replace(barrier=[NET]) if obstacles else made


def run(case, **how):
    z = scenes.rough()
    return rockfall.run(case, dem=z, transform=scenes.grid(z, 5.0), **how)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("breakage")


@pytest.fixture(scope="module")
def broken(folder):
    return run(case(folder, breakage=BOTH))


@pytest.fixture(scope="module")
def bare(folder):
    return run(case(folder, obstacles=False, breakage=BOTH))


@pytest.mark.all
def test_threads_chunks_and_shards_change_nothing(folder, broken, tmp_path):
    assert int(broken["fragments"].sum()) > 1000 and len(np.unique(broken["status"])) > 1
    same(run(case(folder, breakage=BOTH), threads=2, chunk=7), broken)
    for k in (1, 2):
        part = run(case(folder, breakage=BOTH), shard=(k, 2))
        rockfall.write_result(part, tmp_path / f"part{k}.nc")
    same_numbers(rockfall.merge([tmp_path / f"part{k}.nc" for k in (2, 1)]), broken)


@pytest.mark.all
def test_both_programs_have_the_same_bits(batch, tmp_path):
    """A run in two parts by rockfall-batch, the second beginning within a source, is bit-identical
    to one in Python, with every output and obstacle."""
    prepared = make_prepared(
        tmp_path, breakage=BOTH, case={"boulders": 8}, forest=FOREST,
        output={"energy_balance": True},
    )  # fmt: skip
    for k in (1, 2):
        done = batch("ready/case.nml", "--shard", f"{k}/2", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    result = rockfall.run(prepared)
    assert int(result["breakages"].sum()) > 100
    same_results(rockfall.merge([tmp_path / "case.part2of2", tmp_path / "case.part1of2"]), result)


@pytest.mark.all
def test_either_program_goes_on_from_a_checkpoint(batch, tmp_path, monkeypatch):
    made = make_prepared(tmp_path, breakage=BOTH, case={"boulders": 8})
    monkeypatch.setattr(checkpoint, "REST", 0.0)
    with monkeypatch.context() as patch, pytest.raises(Killed):
        killed_after(patch, 3)
        saved = checkpoint.Checkpoint(tmp_path / "part.nc.checkpoint", 0.0)
        run_scene(read_scene(made), chunk=10, checkpoint=saved)
    done = batch("ready/case.nml", "--output", "part.nc", "--resume", "--quiet", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "boulders reached &breakage max_fragments = 60: further breakage" in done.stderr
    same_numbers(rockfall.merge([tmp_path / "part.nc"]), rockfall.run(made))


def test_energy_adds_up(broken):
    """The energy released is that absorbed by ground, trees, barriers and breakage, and that
    left."""
    taken = ["ground", "trees", "barriers", "left", "breakage"]
    total = sum(broken[f"energy_{name}"] for name in taken)
    assert np.abs(broken["energy_released"] - total).max() < 1e-9 * broken["energy_released"].max()
    assert (broken["energy_breakage"] >= 0).all() and (broken["energy_breakage"] > 0).any()


def test_breaking_takes_a_hundredth(folder):
    """Fragments without fines start with the release velocity and 0.99 of its kinetic energy."""
    result = run(
        case(
            folder, obstacles=False,
            boulder={"volume_mean": 2.0, "volume_std": 0.0},
            release={"velocity": [0.0, -6.0, 1.0]},
            breakage={"at": "release", "release_fall": 5.0},
        )
    )  # fmt: skip
    kinetic = 0.5 * 2800.0 * 37.0
    fines = result["fines_volume"].values
    assert (result["fragments"] > 5).all() and (fines < 0.0025).all()
    expected = kinetic * (2.0 - 0.99 * (2.0 - fines))
    np.testing.assert_allclose(result["energy_breakage"].values, expected, rtol=1e-9)


def test_a_boulder_that_does_not_break_is_as_without_breakage(folder):
    """Results are equal without breakage and with limits that no boulder reaches."""
    for at, fall in (("release", 0.01), ("impact", None)):
        breakage = {"at": at, "min_area_ratio": 0.99, "min_volume": 10.0, "release_fall": fall}
        result = run(case(folder, breakage=breakage))
        assert (result["fragments"] == 1).all() and not result["fines_volume"].any()
        same_numbers(result, run(case(folder)))
        crossed = np.isfinite(at_lines(result)["line_speed"].values)
        assert np.array_equal(at_lines(result)["line_fragments"].values, crossed)
        volume = np.broadcast_to(result["volume"].values.astype("f4"), crossed.shape)
        assert np.array_equal(at_lines(result)["line_volume"].values[crossed], volume[crossed])


def test_maps_count_a_release_once_and_deposits_each_fragment(bare):
    boulders = bare.sizes["boulder"]
    assert bare["passages"].max() == boulders  # in the cell of a source
    assert (bare["hits"] <= boulders).all() and (bare["reach_probability"] <= 1).all()
    assert bare["deposits"].sum() > boulders
    assert bare["deposits"].sum() <= bare["fragments"].sum()
    ended = bare["status"].attrs["flag_meanings"].split()
    if (bare["status"] == 1 + ended.index("stopped")).all():
        assert bare["deposits"].sum() == bare["fragments"].sum()


def test_the_row_of_a_boulder_is_its_recorded_path(bare):
    """The recorded trajectory is that of the fragment that travels farthest, from the release
    on."""
    for number in np.unique(bare["trajectory_boulder"]):
        mine = bare["trajectory_boulder"].values == number
        path = np.stack([bare[f"trajectory_{axis}"].values[mine] for axis in "xyz"])
        time = bare["trajectory_time"].values[mine]
        row = bare.isel(boulder=int(number) - 1)
        assert np.array_equal(path[:, 0], [row[f"start_{axis}"] for axis in "xyz"])
        assert np.array_equal(path[:, -1], [row[f"stop_{axis}"] for axis in "xyz"])
        assert (np.diff(time) >= 0).all() and time[-1] == row["travel_time"]
        chord = np.sqrt((np.diff(path) ** 2).sum(axis=0)).sum()
        assert chord <= row["path_length"] * (1 + 1e-9)


def test_crossings_are_those_of_the_most_energetic_fragment(bare):
    crossed = np.isfinite(at_lines(bare)["line_speed"].values)
    fragments, volume = (
        at_lines(bare)["line_fragments"].values,
        at_lines(bare)["line_volume"].values,
    )
    assert np.array_equal(fragments > 0, crossed) and fragments.max() > 5
    assert (volume[crossed] <= np.broadcast_to(bare["volume"].values, crossed.shape)[crossed]).all()
    mass = 2800.0 * volume
    energy = 0.5 * mass * at_lines(bare)["line_speed"].values ** 2
    np.testing.assert_allclose(
        at_lines(bare)["line_energy_translational"].values, energy, rtol=1e-12
    )
    assert (fragments <= bare["fragments"].values + bare["breakages"].values).all()


def test_the_cap_is_kept_and_counted(folder):
    few = run(case(folder, breakage=BOTH | {"max_fragments": 3}))
    assert few["fragments"].max() == 3 and (few["breakages_capped"] > 0).all()
    many = run(case(folder, obstacles=False, breakage={"at": "release", "release_fall": 8.0}))
    assert many["fragments"].max() > 3 and not many["breakages_capped"].any()


def test_limits_are_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = "&case boulders = 1000 /\n&terrain dem = 'd.tif' /\n"
    text += "&surface uniform_mean_radius = 1.0 /\n"
    text += "&boulder volume_mean = 1.0 /\n&release x = 1.0 y = 1.0 /\n"
    for more, said in {
        "&breakage at = 'release' /": "release_fall is missing: needed for at = 'release'",
        "&breakage release_fall = 3.0 /": "release_fall = 3.0: is only valid with at = 'release' "
        "or 'both'",
        "&breakage at = 'impact' max_fragments = 1 /": "max_fragments = 1: must be 2 to 10000",
        "&breakage at = 'impact' min_area_ratio = 0.2 /": "min_area_ratio = 0.2: must be 0.25 to "
        "0.99",
    }.items():
        (tmp_path / "case.nml").write_text(text + more)
        refuses(["run", "case.nml", "-o", "r.nc"], f"case.nml: &breakage {said}", capsys)
    (tmp_path / "case.nml").write_text(f"{text}&breakage at = 'impact' /\n&output kept = 'none' /")
    said = "case.nml: &output kept = 'none': must be 'all' if boulders break .*"
    refuses(["run", "case.nml", "-o", "r.nc"], said, capsys)


def test_what_statistics_count_is_said(folder, bare):
    """Remarks report the unvalidated rule, the number of fragments at lines, and the reached
    limit."""
    texts = [one.text for one in model_remarks(bare, case_of(bare)) if one.is_warning]
    assert any(text.startswith("Breakage follows an unvalidated rule") for text in texts)
    (counted,) = (text for text in texts if " broke, into " in text)
    crossed = at_lines(bare)["line_fragments"].values[0]
    assert f"low: {crossed[crossed > 0].mean():.3g} fragments per crossing" in counted
    assert any("reached &breakage max_fragments = 60" in text for text in texts)
    whole = run(case(folder))
    assert not any("reak" in one.text for one in model_remarks(whole, case_of(whole)))


def test_observations_are_not_those_of_fragments(folder, bare, tmp_path):
    """Blocks at rest are not the farthest fragments: `back` refuses such a case, `compare` gives a
    note."""
    observed = tmp_path / "stops.csv"
    observed.write_text("x,y\n150.0,100.0\n160.0,110.0\n")
    with pytest.raises(
        rockfall.RockfallError, match="&breakage at = 'both': must be 'none': a boulder ends"
    ):
        rockfall.back_analysis(case(folder, breakage=BOTH), observed)
    notes = rockfall.compare(bare, observed).notes
    assert any(note.startswith("Boulders may break. Distances are") for note in notes)


def test_heights_at_a_line_use_the_fragment(bare):
    """The upper edge at a line is a fragment's radius above its centre."""
    upper = line_values(bare, "upper_edge", 0) - at_lines(bare)["line_passing_height"].values[0]
    radius = np.cbrt(0.75 / np.pi * at_lines(bare)["line_volume"].values[0])
    np.testing.assert_allclose(upper, radius, rtol=1e-9)


def test_splits_are_the_published_rule(folder):
    keys = {"at": "impact", "min_area_ratio": 0.25, "min_volume": 1e-4, "max_fragments": 10000}
    made = case(folder, obstacles=False, breakage=keys)
    volume, energy = 2.0, 1.2e4  # A_r = 0.26: a single series
    split = split_blocks(made, np.array([volume]), np.array([energy]))
    area = 0.0031 * energy**0.7562
    ratio = area / (area + 6 * volume ** (2 / 3))
    assert split.area_ratio[0] == pytest.approx(ratio, rel=1e-12)
    q, b = 1 - 0.5125 * ratio, 2.4875 - 1.6125 * ratio
    dimension = 3 + np.log(1 - q) / np.log(b)
    series = q * volume * np.arange(1, 7) ** (-1 / dimension)
    np.testing.assert_allclose(split.volumes[0, : (series > 1e-4).sum()], series[series > 1e-4])
    assert split.volumes.sum() + split.fines[0] == pytest.approx(volume, rel=1e-14)


def test_a_block_breaks_above_its_breaking_speed(folder):
    made = case(folder, obstacles=False, breakage={"at": "impact"})
    speed = breaking_speed(made, 1.0, 2800.0)
    near = 1400.0 * (speed + np.array([-1e-5, 1e-5])) ** 2
    split = split_blocks(made, np.ones(2), near)
    assert split.volumes[0, 0] == 1.0 > split.volumes[1, 0]
    assert breaking_speed(made, 0.001, 2800.0) == np.inf  # smaller than two fragments


def test_check_says_into_what_blocks_break(monkeypatch, capsys, place):
    more = "&breakage at = 'both', release_fall = 10.0 /\n"
    text = (place / "case.nml").read_text()
    (place / "case.nml").write_text(text + more)
    assert main(["check", "case.nml"]) == 0
    said = capsys.readouterr().out
    assert re.search(r"breakage +at release by a fall of 10 m, a block of .* m3 breaks into", said)
    assert re.search(r"\n +at impacts above .* m/s normal to the ground, a block", said)
